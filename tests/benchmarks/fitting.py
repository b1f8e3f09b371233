"""What the fit of a cell costs, and what a log of many rows costs: `python tests/benchmarks/fitting.py [most rows]`.

Defends four decisions: a large cell is fitted to some of its rows; EM is accelerated and given up early where a mode
more is hopeless; cells are sorted by counting; and one compiled pass serves all cells. The peer is EM as written in
numpy: whole arrays, log space, three modes given, directions alone, until the mean log likelihood gains less than
1e-6 or 100 iterations have passed. Ours counts the modes by BIC and fits the speeds as well, from raw arrays. The
cell is the mixture of the paper's Fig. 2: modes at -45, 0 and 45 degrees of concentration 20, of one third each, with
speeds Gamma(20, 2).
"""

import resource
import sys
import time
import tracemalloc
from functools import partial
from pathlib import Path

import numpy as np
from scipy.special import i0e, i1e, logsumexp

sys.path.insert(0, str(Path(__file__).parents[1]))

from dirprim_filter import Tracks, learn_primitives
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions.modes import dbscan
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.fitting import bounds_of, fit_all
from dirprim_filter.primitives.rows import CellRows, TrackRows
from situations import one_cell
from tessellation import GridTessellation
from tessellation.gates import residents


def fig_2(n, rng):
    mode = rng.choice(3, size=n)
    direction = np.deg2rad([-45.0, 0.0, 45.0])[mode] + rng.vonmises(0.0, 20.0, n)
    return direction, rng.gamma(20.0, 0.5, n)


def em_in_numpy(direction, n_modes=3, tolerance=1e-6, most=100):
    """Whole-array EM; concentration by the usual approximation (Banerjee et al. 2005)."""
    n = direction.size
    weight = np.full(n_modes, 1.0 / n_modes)
    mean = np.quantile(direction, (np.arange(n_modes) + 0.5) / n_modes)
    kappa = np.full(n_modes, 10.0)
    before = -np.inf
    for _ in range(most):
        log_p = kappa * (np.cos(direction[:, None] - mean) - 1.0) - np.log(2 * np.pi * i0e(kappa)) + np.log(weight)
        norm = logsumexp(log_p, axis=1, keepdims=True)
        r = np.exp(log_p - norm)
        total = r.sum(axis=0)
        c, s = (r * np.cos(direction)[:, None]).sum(axis=0), (r * np.sin(direction)[:, None]).sum(axis=0)
        weight, mean = total / n, np.arctan2(s, c)
        length = np.hypot(c, s) / total
        kappa = length * (2.0 - length**2) / (1.0 - length**2)
        a = i1e(kappa) / i0e(kappa)
        kappa = kappa - (a - length) / (1.0 - a * a - a / kappa)
        now = norm.mean()
        if now - before < tolerance:
            break
        before = now
    return weight, mean, kappa


def fitted(direction, speed):
    """The modes of one cell, of some of the rows where there are many."""
    spread = float(np.log(speed.mean()) - np.log(speed).mean())
    bounds = bounds_of(LearningConfig(), prior_strength=0.02, speed_spread=spread)
    cell = one_cell(direction, speed, n_vehicles=speed.size)
    return Modes(*(column[0] for column in fit_all(cell, bounds)))


def least(work, seconds=1.0):
    """The least time of some runs."""
    times, until = [], time.perf_counter() + seconds
    while not times or time.perf_counter() < until:
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def against_numpy():
    print("One cell, Fig. 2          ours    numpy, K = 3   ratio   modes")
    for n, asked in ((500, 20), (5_000, 100), (50_000, 1_000)):
        direction, speed = fig_2(n, np.random.default_rng(0))
        ours, theirs = np.inf, np.inf
        for _ in range(3):  # taking turns, as others may share the machine
            ours = min(ours, least(partial(fitted, direction, speed), 0.5))
            theirs = min(theirs, least(partial(em_in_numpy, direction), 0.5))
        modes = fitted(direction, speed)
        print(
            f"{n:>8,} angles  {1e3 * ours:8.3f} ms {1e3 * theirs:11.1f} ms {theirs / ours:6.0f}x (asked {asked:,}x)"
            f"  {(modes.weight > 0).sum()}"
        )


def counted():
    draws = [fig_2(500, np.random.default_rng(seed)) for seed in range(100)]
    bic = sum((fitted(*draw).weight > 0).sum() == 3 for draw in draws)
    for eps, share in ((0.5, 0.05), (0.2, 0.05), (0.1, 0.05), (0.1, 0.02)):
        right = sum(dbscan(d, eps=eps, min_samples=max(3, int(share * d.size))).max() == 2 for d, _ in draws)
        print(f"three modes found in 100 draws of 500 angles: BIC {bic}, DBSCAN (eps {eps}, share {share}) {right}")


def by_rows(most):
    print("\nAll rows in one cell, and in 1,000 cells, flat; then all of learn_primitives with cells given, curved")
    print("      rows     one cell   per row   1,000 cells   per row   peak of its arrays   learn   per row   peak")
    n = 10_000
    while n <= most:
        rng = np.random.default_rng(n)
        direction, speed = fig_2(n, rng)
        one = one_cell(direction, speed, n_vehicles=n)
        bounds = bounds_of(LearningConfig(), prior_strength=0.02, speed_spread=0.025)
        begin = time.perf_counter()
        fit_all(one, bounds)
        in_one = time.perf_counter() - begin
        del one
        side = 310.0  # 31 x 32 cells of 10 m
        rows = TrackRows(
            vehicle=np.arange(n) // 100, time_ns=np.arange(n) * 10**9, position=rng.uniform(0, side, (n, 2)),
            direction=direction, speed=speed, group=np.arange(n) // 100,
        )  # fmt: skip
        cells = GridTessellation.covering(rows.position, cell_size=10.0)
        tracemalloc.start()
        begin = time.perf_counter()
        fit_all(
            CellRows.of(
                rows, residents(cells.cell_of(rows.position), cells.centers), rows.position, standing_speed=0.3
            ),
            bounds,
        )
        in_many = time.perf_counter() - begin
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        tracks = Tracks(
            track_id=rows.vehicle, time_ns=rows.time_ns, position=rows.position, direction=direction, speed=speed
        )
        del rows
        begin = time.perf_counter()
        tracemalloc.start()
        config = LearningConfig(prior_strength=0.02, parameter_cost=1.0)
        learn_primitives(tracks, tessellation=cells, config=config, rng=np.random.default_rng(0))
        whole, whole_peak = time.perf_counter() - begin, tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        print(
            f"{n:>10,}  {1e3 * in_one:8.1f} ms {1e9 * in_one / n:6.0f} ns {1e3 * in_many:10.1f} ms"
            f" {1e9 * in_many / n:6.0f} ns {peak / n:12.0f} B per row {whole:10.2f} s {1e6 * whole / n:6.1f} us"
            f" {whole_peak / n:5.0f} B per row",
            flush=True,
        )
        n *= 10
    print(f"peak resident memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB")


if __name__ == "__main__":
    fitted(*fig_2(5_000, np.random.default_rng(0)))  # compiles
    against_numpy()
    counted()
    by_rows(int(float(sys.argv[1])) if len(sys.argv) > 1 else 10_000_000)
