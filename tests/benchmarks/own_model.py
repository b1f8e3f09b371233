"""Are beliefs right where the model is? `PYTHONPATH=tests python tests/benchmarks/own_model.py`.

Defends the state that the smoother keeps, and tells what the number of particles costs. Vehicles are drawn from the
filter's own motion model, so that a mean normalised squared error other than 2 is the particles' and the smoother's.
"""

from __future__ import annotations

import argparse

import numpy as np

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateList
from dirprim_filter.evaluation.tracking_report import coverage, normalised_squared
from dirprim_filter.filtering import ParticleFilter
from dirprim_filter.filtering.smoothing import Smoother
from situations import one_cell_map

NOISE_M, STEP_S, SETTLED_NS = 0.7, 0.1, 1_000_000_000


def config(n_particles):
    """A filter that looks for nobody but who drives by the map."""
    return FilterConfig(
        n_particles=n_particles, noise_m=NOISE_M, outlier_probability=1e-13, redraw_rate=1e-9, place_free_share=1e-9,
        place_free_agility=1.0, innovation_outlier_rate=1e-12,
    )  # fmt: skip


def drawn(model, n, n_rows):
    """(n_rows, n, 2) ways of vehicles of the model."""
    one, slot = ParticleFilter(model, config(1)), np.arange(n)
    one.reserve(n)
    here = Detections(track_id=slot.astype(str), time_ns=np.zeros(n, np.int64), position=np.zeros((n, 2)))
    one.begin(slot, slot.astype(np.uint64), here)
    path = []
    for _ in range(n_rows):
        path.append(one.belief.cloud.position[:n, 0].copy())
        one.predict(slot, np.full(n, STEP_S))
    return np.array(path)


def main() -> None:
    """Print root mean square and normalised squared errors of filter and smoother, by the number of particles."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=40)
    parser.add_argument("--rows", type=int, default=60)
    given = parser.parse_args()
    model = one_cell_map(concentration=1e3, shape=20.0)
    path = drawn(model, given.vehicles, given.rows)
    seen = path + np.random.default_rng(0).normal(0.0, NOISE_M, path.shape)
    ids = np.arange(given.vehicles).astype(str)
    for n_particles in (300, 1000, 3000, 10_000):
        found, later, knobs = EstimateList(), EstimateList(), config(n_particles)
        smoother = Smoother(max_gap_s=knobs.max_gap_s, sinks=[later.write])
        tracker = smoother.tracker(
            0, model, config=knobs, tracking=TrackingConfig(clutter_density=1e-12), rng=np.random.default_rng(1)
        )
        with smoother:
            for i, position in enumerate(seen):
                time_ns = np.full(given.vehicles, round(i * STEP_S * 1e9))
                tracker.predict(Detections(track_id=ids, time_ns=time_ns, position=position))
                tracker.weigh()
                frame = tracker.frame()
                found.write(frame)
                smoother.write(frame)
                tracker.resample()
        for kind, of in (("filter", found.all()), ("smoother", later.all())):
            row = np.round(of.time_ns * 1e-9 / STEP_S).astype(np.int64)
            error = of.position - path[row, of.track_id.astype(np.int64)]
            settled = of.time_ns >= SETTLED_NS
            squared = normalised_squared(error, of.covariance)[settled]
            rmse, held = np.sqrt((error[settled] ** 2).sum(axis=1).mean()), coverage(squared, 0.9)
            told = f"{rmse:.3f} m, NEES {squared.mean():.2f}, {held:.1%} in the 90 % ellipse"
            print(f"{n_particles:6,d} particles, {kind:8s} {told}", flush=True)


if __name__ == "__main__":
    main()
