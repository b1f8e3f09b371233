"""Drawing from a map and evaluating its log densities, beside PyRecEst and beside what the arithmetic alone costs.

The decision it defends: compiled kernels of our own for `PrimitiveMap`, instead of numpy over gathered modes.
PyRecEst's `CircularMixture` has no places and no speeds: it gets its best case, one mixture of the modes of the map's
busiest cell for all rows, and directions alone. The limit is a compiled loop of one exponential, one logarithm and one
sine for each row, on as many threads; the numpy row is `primitive_at(...).direction.log_density`.

    pip install pyrecest; python tests/benchmarks/sampling.py [rows]
"""

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit

from dirprim_filter import learn_primitives
from dirprim_filter.distributions._blocks import over_blocks

sys.path.insert(0, str(Path(__file__).parents[1]))
from situations import ring_traffic

try:
    from pyrecest.distributions import VonMisesDistribution
    from pyrecest.distributions.circle.circular_mixture import CircularMixture
except ImportError:
    sys.exit("sampling.py compares with PyRecEst, which is not installed: pip install pyrecest")


@njit(nogil=True)
def limit(x, out):
    """One exponential, one logarithm and one sine for each row."""
    for i in range(x.size):
        out[i] = math.exp(x[i]) + math.log(x[i]) + math.sin(x[i])


def by_numpy(learned, position, direction):
    """The log density over gathered modes."""
    return learned.primitive_at(position).direction.log_density(direction)


def seconds(work: Callable[[], object], repeats: int = 7) -> float:
    """The least wall time of a call, after one to warm up."""
    work()
    found = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        found.append(time.perf_counter() - start)
    return min(found)


def main() -> None:
    """Print the table."""
    n = int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000
    n_peer, some = n // 100, n // 10  # PyRecEst draws one by one
    traffic, rng = ring_traffic(np.random.default_rng(7)), np.random.default_rng(1)
    position = traffic.position[rng.integers(len(traffic), size=n)]
    x, out = rng.uniform(0.1, 3.0, n), np.empty(n)
    bound = seconds(lambda: over_blocks(lambda a, b: limit(x[a:b], out[a:b]), n)) / n
    print(f"{n:,} rows; ns for each row; limit (exp, log and sine): {bound * 1e9:.1f}")
    for kind in ("flat", "curved"):
        learned = learn_primitives(traffic, cell_size=6.0, primitive=kind, rng=np.random.default_rng(7))
        direction, speed = learned.sample(position, rng=rng)
        busiest = int(np.argmax(learned.n_rows[:-1]))
        own = learned.direction[busiest]
        used = own.weight > 0
        peer = CircularMixture(
            [
                VonMisesDistribution(np.array(m), np.array(k))
                for m, k in zip(own.mean_direction[used], own.concentration[used], strict=True)
            ],
            own.weight[used] / own.weight[used].sum(),
        )
        rows = {
            "sample direction and speed": (
                seconds(lambda m=learned: m.sample(position, rng=rng)) / n,
                seconds(lambda p=peer: p.sample(n_peer), 2) / n_peer,
            ),
            "log density of direction": (
                seconds(lambda m=learned, d=direction: m.direction_log_density(position, d)) / n,
                seconds(lambda p=peer, d=direction: np.log(p.pdf(d)), 3) / n,
            ),
            "log density of both": (
                seconds(lambda m=learned, d=direction, s=speed: m.log_density(position, d, s)) / n,
                math.nan,
            ),
            "log density of direction, numpy": (
                seconds(lambda m=learned, d=direction: by_numpy(m, position[:some], d[:some]), 2) / some,
                math.nan,
            ),
        }
        modes = np.count_nonzero(learned.direction.weight, axis=1)[learned.tessellation.cell_of(position)].mean()
        print(f"\n{kind}, {modes:.1f} modes a row{'':16}ours   PyRecEst    times   of limit")
        for name, (ours, theirs) in rows.items():
            print(f"{name:32}{ours * 1e9:9.1f}{theirs * 1e9:11.0f}{theirs / ours:9.0f}{ours / bound:11.1f}")


if __name__ == "__main__":
    main()
