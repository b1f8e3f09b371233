"""Is the particle filter's step cheap enough to write it ourselves, and does `dirprim track` keep up with a log?

Decision: compiled kernels of our own instead of Stone Soup 1.9 or `particles` 0.3. One step, predict, weigh, resample,
of one target on a plain constant-velocity model for the peers, and on a map for us, which costs more; at most 5 ms per
1e5 particles is wanted. Then a whole log through the tracker and the MCAP writer: 100 vehicles of 1,000 particles at
10 Hz are to be tracked ten times faster than they drove, in memory that does not grow with the log.

    python tests/benchmarks/tracking.py [--particles 100000] [--seconds 20]

The peers are no dependencies: pip install stonesoup==1.9 particles==0.3
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter import learn_primitives, write_tracks
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ParticleFilter, Tracker
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.recording.reader import stream_detections
from dirprim_filter.recording.writer import EstimateWriter
from dirprim_filter.replay import replay
from situations import ring_traffic

DT_S, NOISE_M = 0.1, 0.5
REPEATS = 15


def best_ms(step: Callable[[], object], repeats: int = REPEATS) -> float:
    """The least of several runs, after one that compiles."""
    step()
    taken = []
    for _ in range(repeats):
        began = time.perf_counter()
        step()
        taken.append(time.perf_counter() - began)
    return 1e3 * min(taken)


def our_steps(primitive_map: PrimitiveMap, n: int, n_vehicles: int) -> dict[str, float]:
    """Milliseconds of each step for n particles in all."""
    ours = ParticleFilter(primitive_map, FilterConfig(n_particles=n // n_vehicles, noise_m=NOISE_M, resample_below=1.0))
    ours.reserve(n_vehicles)
    slot, angle = np.arange(n_vehicles), np.linspace(0, 6, n_vehicles)
    place = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    measured = Detections(track_id=slot, time_ns=np.zeros(n_vehicles, np.int64), position=place)
    ours.begin(slot, np.arange(n_vehicles, dtype=np.uint64), measured)
    dt_s = np.full(n_vehicles, DT_S)

    def whole() -> None:
        ours.predict(slot, dt_s)
        ours.weigh(slot, measured)
        ours.resample(slot)

    return {
        "predict": best_ms(lambda: ours.predict(slot, dt_s)),
        "weigh": best_ms(lambda: ours.weigh(slot, measured)),
        "moments": best_ms(lambda: ours.moments(slot)),
        "whole": best_ms(whole),
    }


def stone_soup(n: int) -> float:
    """Milliseconds of the same step."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.particle import ParticlePredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import ParticleState
    from stonesoup.updater.particle import ParticleUpdater

    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0), ConstantVelocity(1.0)])
    sensor = LinearGaussian(4, (0, 2), np.eye(2) * NOISE_M**2)
    predictor, updater = ParticlePredictor(motion), ParticleUpdater(sensor, resampler=SystematicResampler())
    now = datetime(2026, 1, 1)
    rng = np.random.default_rng(0)
    prior = ParticleState(StateVectors(rng.normal(0, 1, (4, n))), weight=np.full(n, 1 / n), timestamp=now)
    seen = Detection(np.zeros((2, 1)), timestamp=now + timedelta(seconds=DT_S), measurement_model=sensor)

    def step() -> None:
        predicted = predictor.predict(prior, timestamp=seen.timestamp)
        updater.update(SingleHypothesis(predicted, seen))

    return best_ms(step)


def particles_package(n: int) -> float:
    """Milliseconds of the same step."""
    import particles
    from particles import distributions as dists
    from particles import state_space_models as ssm

    class Motion(ssm.StateSpaceModel):  # type: ignore[misc]
        def PX0(self):  # noqa: N802
            return dists.MvNormal(loc=np.zeros(4), cov=np.eye(4))

        def PX(self, t, xp):  # noqa: N802
            F = np.eye(4)
            F[0, 2] = F[1, 3] = DT_S
            return dists.MvNormal(loc=xp @ F.T, cov=0.01 * np.eye(4))

        def PY(self, t, xp, x):  # noqa: N802
            return dists.MvNormal(loc=x[:, :2], cov=NOISE_M**2 * np.eye(2))

    seen = [np.zeros(2)] * (REPEATS + 2)
    smc = particles.SMC(fk=ssm.Bootstrap(ssm=Motion(), data=seen), N=n, resampling="systematic", ESSrmin=1.0)
    next(smc)
    return best_ms(lambda: next(smc))


def end_to_end(primitive_map: PrimitiveMap, seconds: float, n_particles: int, *, stride: int) -> tuple[float, float]:
    """How many times faster than it was driven a log is tracked, and MiB by which memory grew in its second half."""
    traffic = ring_traffic(np.random.default_rng(1), n_vehicles=100, n_rows=round(seconds / DT_S))
    seen = Detections.of(traffic)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        write_tracks(traffic, log, detections=seen)
        config = FilterConfig(n_particles=n_particles, noise_m=NOISE_M)
        for name in ("warm.mcap", "timed.mcap"):
            tracker = Tracker(primitive_map, config=config, rng=np.random.default_rng(0))
            grown = MemoryWitness(round(seconds / DT_S) // 2)
            began = time.perf_counter()
            with EstimateWriter(Path(folder) / name, metadata={}, particle_stride=stride) as out:
                replay(stream_detections(log), tracker, [out, grown])
            taken = time.perf_counter() - began
    return seconds / taken, grown.mebibytes()


class MemoryWitness:
    """A sink that notes how much memory was in use half-way."""

    def __init__(self, at_frame: int) -> None:
        self._left, self._half_way = at_frame, 0

    def write(self, _: object) -> None:
        self._left -= 1
        if self._left == 0:
            self._half_way = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    def mebibytes(self) -> float:
        return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - self._half_way) / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--seconds", type=float, default=20.0)
    given = parser.parse_args()
    n = given.particles
    learned = learn_primitives(
        ring_traffic(np.random.default_rng(0)), tessellation="grid", cell_size=6.0, rng=np.random.default_rng(0)
    )
    print(f"{n} particles: milliseconds, nanoseconds per particle")
    steps = our_steps(learned, n, 100)
    for name, ms in steps.items():
        print(f"  ours on a map, 100 vehicles, {name:<9}{ms:8.2f} ms {1e6 * ms / n:8.1f} ns")
    for name, peer in (("stonesoup", stone_soup), ("particles", particles_package)):
        try:
            ms = peer(n)
            reported = f"{name}, constant velocity, whole"
            print(f"  {reported:<38}{ms:8.2f} ms {1e6 * ms / n:8.1f} ns  {ms / steps['whole']:.1f} x ours")
        except ImportError:
            print(f"  {name}: not installed; pip install stonesoup==1.9 particles==0.3")
    print("a log of 100 vehicles at 10 Hz, 1,000 particles each, read, tracked and written:")
    for stride in (1, 10):
        speed, grown = end_to_end(learned, given.seconds, 1000, stride=stride)
        print(f"  every {stride:>2}. particle written: {speed:5.1f} x real time, {grown:+.1f} MiB in the second half")


if __name__ == "__main__":
    main()
