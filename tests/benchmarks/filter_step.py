"""What a step of the particle filter costs, and what bounds it; what a forecast costs.

Defends: vehicles move by manoeuvres, two normal draws and the look-up of a cell to a step, and go over to another where
they enter a cell; how much of a deviation a step keeps is worked out once for all particles, and no gamma is drawn.

    python tests/benchmarks/filter_step.py

1e5 particles: 100 vehicles of 1,000, so that all cores have work. Minima of repeated runs.
"""

import time

import numpy as np
from numba import njit

from dirprim_filter import learn_primitives
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.distributions import _random as random
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.rollouts import Start, Steps, sample_paths
from dirprim_filter.primitives.motion_table import motion_table
from dirprim_filter.tracks import Tracks

N_VEHICLES, N_PARTICLES = 100, 1000


def ring(rng, *, n_vehicles, n_rows=100, dt_s=0.1, radius=20.0):
    """Vehicles around a roundabout."""
    begin = rng.uniform(0, 2 * np.pi, n_vehicles)
    pace = rng.gamma(50.0, 8.0 / 50.0, n_vehicles)
    r = radius + rng.normal(0, 0.7, n_vehicles)
    t = np.arange(n_rows) * dt_s
    angle = begin[:, None] + pace[:, None] / r[:, None] * t
    return Tracks(
        track_id=np.repeat(np.arange(n_vehicles), n_rows),
        time_ns=np.tile((t * 1e9).round().astype(np.int64), n_vehicles),
        position=np.stack([r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)], axis=-1).reshape(-1, 2),
        direction=(angle + np.pi / 2).ravel(),
        speed=np.repeat(pace, n_rows),
    )


@njit
def draw(n, state):
    """n normals."""
    total = 0.0
    for _ in range(n):
        total += random.draw_normal(state)
    return total


def least(run, *, times=15):
    """Seconds that the quickest of several runs takes."""
    run()
    taken = []
    for _ in range(times):
        begin = time.perf_counter()
        run()
        taken.append(time.perf_counter() - begin)
    return min(taken)


def main():
    """Print the table."""
    rng = np.random.default_rng(0)
    tracks = ring(rng, n_vehicles=60)
    learned = learn_primitives(tracks, tessellation="grid", cell_size=6.0, rng=rng)
    seen = ring(np.random.default_rng(1), n_vehicles=N_VEHICLES, n_rows=1)
    detections = Detections.of(seen)
    slot = np.arange(N_VEHICLES)
    n = N_VEHICLES * N_PARTICLES
    print(f"{'part':<34}{'ms':>8}{'ns per particle':>18}")
    for name, primitive_map in (("manoeuvres", learned), ("place-free", learned.without_places())):
        bayes_filter = ParticleFilter(primitive_map, FilterConfig(n_particles=N_PARTICLES, resample_below=1.0))
        bayes_filter.reserve(N_VEHICLES)
        bayes_filter.begin(slot, np.arange(N_VEHICLES, dtype=np.uint64), detections)
        dt_s = np.full(N_VEHICLES, 0.1)
        still = bayes_filter.belief.cloud
        bayes_filter.predict(slot, dt_s)  # compiled now
        even = [column.copy() for column in still]
        bayes_filter.weigh(slot, detections)
        weighed = [column.copy() for column in still]  # even weights would not be resampled

        def restore(kept, still=still):
            for column, value in zip(still, kept, strict=True):
                column[:] = value

        parts = {
            "restore": lambda r=restore, k=even: r(k),
            "predict": lambda f=bayes_filter, r=restore, k=even, d=dt_s: (r(k), f.predict(slot, d)),
            "weigh": lambda f=bayes_filter, r=restore, k=even: (r(k), f.weigh(slot, detections)),
            "resample": lambda f=bayes_filter, r=restore, k=weighed: (r(k), f.resample(slot)),
        }
        taken = {part: least(run) for part, run in parts.items()}
        total = 0.0
        for part in ("predict", "weigh", "resample"):
            seconds = taken[part] - taken["restore"]
            total += seconds
            print(f"{name + ', ' + part:<34}{1e3 * seconds:>8.2f}{1e9 * seconds / n:>18.1f}")
        print(f"{name + ', together':<34}{1e3 * total:>8.2f}{1e9 * total / n:>18.1f}")
    state = np.array([1, 2, 3, 4], np.uint64)
    print(f"{'one normal draw, one core':<34}{'':>8}{1e9 * least(lambda: draw(10**6, state)) / 1e6:>18.1f}")
    table = motion_table(learned)
    start = Start.of(tracks.position[:1], tracks.direction[:1], tracks.speed[:1])
    steps = Steps.of(5.0, 0.5, 100)
    seconds = least(lambda: sample_paths(table, start, steps, rng=rng), times=50)
    print(f"{'forecast, 100 paths of 10 steps':<34}{1e3 * seconds:>8.3f}{1e9 * seconds / 1e3:>18.1f}")


if __name__ == "__main__":
    main()
