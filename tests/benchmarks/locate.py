"""Point location: a raster of candidate generators beside a k-d tree, from 1e2 to 1e6 generators.

Decides: the filter asks for the cell of every particle in every step, so location is compiled, of constant time, and
inlined; a k-d tree would cost more than the motion itself. The raster costs memory and time to build, both linear.
`fetch` is what memory allows: one number fetched at random from as much of it as the raster takes.

    python tests/benchmarks/locate.py
"""

import time

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from tessellation import GridTessellation
from tessellation._kernels import locate_all
from tessellation.locate import voronoi_locator

N_QUERIES = 1_000_000
SIDE_M = 1000.0


@njit(nogil=True)
def fetched(table, place):
    total = 0.0
    for i in place:
        total += table[i]
    return total


def nanoseconds(call, repeats=5):
    """Per query, the least of several runs."""
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - start)
    return 1e9 * best / N_QUERIES


def main():
    rng = np.random.default_rng(0)
    position = rng.uniform(0, SIDE_M, (N_QUERIES, 2))
    region = GridTessellation(
        origin=np.zeros(2), cell_size=SIDE_M / 100, n_x=100, n_y=100, square=np.arange(10_000)
    ).locator
    cell = np.empty(N_QUERIES, np.int64)
    voronoi_locator(position[:50], region)
    locate_all(region, position, cell)
    fetched(np.zeros(9), np.zeros(9, np.int64))
    print(f"{N_QUERIES} random positions, ns each; ratio = k-d tree / raster")
    print(
        f"{'generators':>10} {'build s':>8} {'MB':>6} {'raster':>7} {'tree':>7} {'tree 2':>7} "
        f"{'ratio':>6} {'ratio 2':>7} {'fetch':>6}"
    )
    for n in (100, 10_000, 1_000_000):
        generators = rng.uniform(0, SIDE_M, (n, 2))
        start = time.perf_counter()
        locator = voronoi_locator(generators, region)
        build = time.perf_counter() - start
        size = sum(np.asarray(column).nbytes for column in locator)
        tree = cKDTree(generators)
        one = nanoseconds(lambda at=locator: locate_all(at, position, cell))
        tree_one = nanoseconds(lambda of=tree: of.query(position), 2)
        tree_two = nanoseconds(lambda of=tree: of.query(position, workers=2), 2)
        table, place = np.ones(size // 8), rng.integers(0, size // 8, N_QUERIES)
        fetch = nanoseconds(lambda t=table, p=place: fetched(t, p))
        print(
            f"{n:10d} {build:8.2f} {size / 1e6:6.1f} {one:7.1f} {tree_one:7.0f} {tree_two:7.0f} "
            f"{tree_one / one:6.1f} {tree_two / one:7.1f} {fetch:6.1f}"
        )


if __name__ == "__main__":
    main()
