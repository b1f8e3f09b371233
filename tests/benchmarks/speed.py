"""What own kernels save: `python tests/benchmarks/speed.py {fit,step,read}`, a rival's in turn, in one run.

fit: the fit of one cell (modes counted by BIC, speeds too) beside EM of directions alone, with three modes given, in
    numpy arrays. The cell is the mixture of the paper's Fig. 2.
step: predict, weigh and resample 100,000 particles on a map; and `dirprim track` at its defaults, by the clock and with
    its start, of a minute of 100 vehicles at 10 Hz: how many times faster than they drove.
read: 200,000 messages of 60 bytes on 50 topics, beside the stock library, thousands a second.

Milliseconds of processor time, the least of several runs.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from scipy.special import i0e, i1e, logsumexp

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter import learn_primitives, write_tracks
from dirprim_filter.config import FilterConfig, LearningConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import ParticleFilter
from dirprim_filter.primitives.fitting import bounds_of, fit_all
from dirprim_filter.recording import save_map
from dirprim_filter.recording.scan import scan
from situations import one_cell, ring_traffic

RUNS = 15


def least_ms(*works: Callable[[], object], runs: int = RUNS) -> list[float]:
    """The least milliseconds of each, taking turns, after a run that compiles."""
    found = [np.inf] * len(works)
    for i in range(runs + 1):
        for k, work in enumerate(works):
            began = time.process_time()
            work()
            found[k] = min(found[k], 1e3 * (time.process_time() - began)) if i else np.inf
    return found


def fit() -> None:
    for n in (500, 5_000, 50_000):
        rng = np.random.default_rng(0)
        mode = rng.choice(3, size=n)
        direction = np.deg2rad([-45.0, 0.0, 45.0])[mode] + rng.vonmises(0.0, 20.0, n)
        speed = rng.gamma(20.0, 0.5, n)

        def ours(direction=direction, speed=speed, n=n) -> object:
            spread = float(np.log(speed.mean()) - np.log(speed).mean())
            bounds = bounds_of(LearningConfig(), prior_strength=0.02, speed_spread=spread)
            return fit_all(one_cell(direction, speed, n_vehicles=n), bounds)

        own, theirs = least_ms(ours, lambda direction=direction: em_in_numpy(direction))
        print(f"{n:,} angles {own:.3f} ms {theirs:.1f} ms")


def em_in_numpy(direction, n_modes=3, tolerance=1e-6, most=100):
    """Whole-array EM; concentration by the usual approximation (Banerjee et al. 2005)."""
    weight, kappa = np.full(n_modes, 1.0 / n_modes), np.full(n_modes, 10.0)
    mean = np.quantile(direction, (np.arange(n_modes) + 0.5) / n_modes)
    before = -np.inf
    for _ in range(most):
        log_p = kappa * (np.cos(direction[:, None] - mean) - 1.0) - np.log(2 * np.pi * i0e(kappa)) + np.log(weight)
        norm = logsumexp(log_p, axis=1, keepdims=True)
        r = np.exp(log_p - norm)
        total = r.sum(axis=0)
        c, s = (r * np.cos(direction)[:, None]).sum(axis=0), (r * np.sin(direction)[:, None]).sum(axis=0)
        weight, mean = total / direction.size, np.arctan2(s, c)
        length = np.hypot(c, s) / total
        kappa = length * (2.0 - length**2) / (1.0 - length**2)
        a = i1e(kappa) / i0e(kappa)
        kappa = kappa - (a - length) / (1.0 - a * a - a / kappa)
        now = norm.mean()
        if now - before < tolerance:
            break
        before = now
    return weight, mean, kappa


def step(n: int = 100_000, n_vehicles: int = 100, seconds: float = 60.0) -> None:
    learned = learn_primitives(
        ring_traffic(np.random.default_rng(0)), tessellation="grid", cell_size=6.0, rng=np.random.default_rng(0)
    )
    ours = ParticleFilter(learned, FilterConfig(n_particles=n // n_vehicles, resample_below=1.0))
    ours.reserve(n_vehicles)
    slot, angle = np.arange(n_vehicles), np.linspace(0, 6, n_vehicles)
    place = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    measured = Detections(track_id=slot, time_ns=np.zeros(n_vehicles, np.int64), position=place)
    ours.begin(slot, np.arange(n_vehicles, dtype=np.uint64), measured)

    def whole() -> None:
        ours.predict(slot, np.full(n_vehicles, 0.1))
        ours.weigh(slot, measured)
        ours.resample(slot)

    print(f"whole step {least_ms(whole)[0]:.2f} ms")
    traffic = ring_traffic(np.random.default_rng(1), n_vehicles=n_vehicles, n_rows=round(10 * seconds))
    with tempfile.TemporaryDirectory() as folder:
        log, of, out = (str(Path(folder) / name) for name in ("log.mcap", "map.mcap", "out.mcap"))
        write_tracks(traffic, log, detections=Detections.of(traffic))
        save_map(learned, of)
        command = [sys.executable, "-m", "dirprim_filter.cli", "track", log, "--map", of, "-o", out, "--force"]
        taken = []
        for _ in range(3):
            began = time.perf_counter()
            subprocess.run(command, check=True, capture_output=True)
            taken.append(time.perf_counter() - began)
        print(f"whole log {seconds / min(taken):.1f} x real time")


def read(n: int = 200_000, n_topics: int = 50, size: int = 60) -> None:
    rng = np.random.default_rng(0)
    data = [rng.bytes(size // 2) + bytes(size - size // 2) for _ in range(200)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start()
            channels = [writer.register_channel(f"/t{i}", "blob", 0) for i in range(n_topics)]
            for i in range(n):
                writer.add_message(channels[i % n_topics], i * 100_000, data[i % 200], i * 100_000, i)
            writer.finish()

        def ours() -> None:
            with scan(path) as log:
                deque(log, maxlen=0)
                assert not log.damage

        def stock() -> None:
            with path.open("rb") as file:
                deque(make_reader(file, validate_crcs=True).iter_messages(), maxlen=0)

        own, theirs = (n / ms for ms in least_ms(ours, stock, runs=3))
        print(f"messages {own:.0f} k/s {theirs:.0f} k/s")


if __name__ == "__main__":
    {"fit": fit, "step": step, "read": read}[sys.argv[1]]()
