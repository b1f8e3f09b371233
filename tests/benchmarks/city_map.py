"""What a city's map costs when it is held whole: memory, and seconds until it is ready to track with.

Decides: from how many cells on `track` loads a part of a map. A learned map is laid out again and again, side by side.

    dirprim learn recordings/roundabout_learn.mcap -o one.mcap
    python tests/benchmarks/city_map.py write one.mcap city.mcap 300
    python tests/benchmarks/city_map.py load city.mcap          # whole
    python tests/benchmarks/city_map.py load city.mcap 300      # what lies within so many metres of one place
"""

from __future__ import annotations

import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter import load_map, save_map
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.motion_table import MotionKnobs, motion_table
from dirprim_filter.primitives.part import Ground
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.traffic import Traffic
from tessellation import VoronoiTessellation


def city(one: PrimitiveMap, n: int) -> PrimitiveMap:
    """A map of n places that are all alike, in squares beside each other."""
    position = one.tessellation.centers
    apart, side = float(np.ptp(position, axis=0).max()) + 50.0, int(np.ceil(np.sqrt(n)))
    shift = apart * np.column_stack([np.arange(n) % side, np.arange(n) // side])

    def rows(column: np.ndarray) -> np.ndarray:
        return np.concatenate([np.tile(column[:-1], (n, *[1] * (column.ndim - 1))), column[-1:]])

    everywhere = (shift[:, None] + position).reshape(-1, 2)
    return PrimitiveMap(
        tessellation=VoronoiTessellation.covering(everywhere, generators=everywhere, reach=3.0),
        direction=VonMisesMixture(
            weight=rows(one.direction.weight), mean_direction=rows(one.direction.mean_direction),
            concentration=rows(one.direction.concentration),
        ),
        speed=Gamma(shape=rows(one.speed.shape), rate=rows(one.speed.rate)),
        n_rows=rows(one.n_rows), n_place_free_modes=one.n_place_free_modes, n_borrowed_modes=one.n_borrowed_modes,
        bend=rows(one.bend), gain=rows(one.gain), motion=motion_of(one.motion, one.tessellation.n_cells, n),
    )  # fmt: skip


def motion_of(motion: Motion, n_cells: int, n: int) -> Motion:
    """The manoeuvres of n places; transitions stay within each, place-free ones come last."""
    placed, all_ = motion.n_placed, motion.cell.size
    cut = int(motion.first[placed])

    def rows(column: np.ndarray) -> np.ndarray:
        return np.concatenate([np.tile(column[:placed], (n, *[1] * (column.ndim - 1))), column[placed:]])

    lengths = np.diff(motion.first)
    following = [np.where(motion.following[:cut] < placed, motion.following[:cut] + i * placed,
                          motion.following[:cut] + (n - 1) * placed) for i in range(n)]  # fmt: skip
    last = motion.following[cut:]
    return replace(
        motion,
        cell=np.concatenate([*(motion.cell[:placed] + i * n_cells for i in range(n)), motion.cell[placed:all_]]),
        mode=rows(motion.mode), **{name: rows(getattr(motion, name)) for name in FLOATS},
        first=np.append(0, np.cumsum(rows(lengths))),
        following=np.concatenate([*following, np.where(last < placed, last, last + (n - 1) * placed)]),
        count=np.concatenate([np.tile(motion.count[:cut], n), motion.count[cut:]]),
    )  # fmt: skip


def load(path: str, reach_m: float | None = None) -> None:
    """Seconds and memory, beyond what the program takes, of loading a map and of all that tracking makes of it."""
    before, began = most_mib(), time.process_time()
    loaded = load_map(path, near=None if reach_m is None else lambda: Ground(np.zeros((1, 2)), reach_m))
    cells = loaded.tessellation
    print(
        f"{cells.n_cells} cells, {Path(path).stat().st_size / 1e6:.0f} MB: loaded in "
        f"{time.process_time() - began:.1f} s; held: {now_mib():.0f} MiB, at most {most_mib():.0f}, of which the "
        f"program {before:.0f}",
        flush=True,
    )
    began = time.process_time()
    motion_table(loaded, MotionKnobs())
    Traffic.of(loaded)
    loaded.log_density(cells.centers[:100], np.zeros(100), np.ones(100))
    print(f"made ready in {time.process_time() - began:.1f} s; held {now_mib():.0f} MiB, at most {most_mib():.0f}")


def most_mib() -> float:
    """The most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def now_mib() -> float:
    """The memory that it has."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


if __name__ == "__main__":
    if sys.argv[1] == "write":
        save_map(city(load_map(sys.argv[2]), int(sys.argv[4])), sys.argv[3], force=True)
    else:
        load(sys.argv[2], float(sys.argv[3]) if len(sys.argv) > 3 else None)
