"""Compiled kernels: whether it is said that they are compiled, which takes long; their cache; filling it."""

from __future__ import annotations

import logging
import os
import pickle
import sys
from pathlib import Path

import dirprim_filter as dp


def quiet_unless_watched() -> None:
    """That kernels are compiled is said on a terminal only."""
    logging.getLogger("tessellation._compiling").setLevel(logging.NOTSET if sys.stderr.isatty() else logging.ERROR)


def mend_cache() -> None:
    """Remove what a power cut left empty or cut of the compiler's cache, and say so: commands would end in an error.

    Where there is no place for a cache that is said too.
    """
    from tessellation._cache import has_a_place

    broken = [path for folder in cache_folders() for path in folder.rglob("*.nb[ic]") if not _is_pickled(path)]
    for path in broken:
        path.unlink(missing_ok=True)
    if broken:
        sys.stderr.write(
            f"warning: {len(broken)} of the compiled kernels' files were damaged and are removed; compiling anew\n"
        )
    if not has_a_place():
        sys.stderr.write("warning: every run compiles, up to a minute: set NUMBA_CACHE_DIR to a folder of yours\n")


def cache_folders() -> list[Path]:
    """Where compiled kernels are."""
    package, given = Path(__file__).parents[1], os.environ.get("NUMBA_CACHE_DIR")
    return [Path(given)] if given else [package, package.parent / "tessellation"]


def _is_pickled(path: Path) -> bool:
    """Whether it begins and ends as what numba writes: a cut one does not."""
    with path.open("rb") as file:
        if file.read(1) != pickle.PROTO:
            return False
        file.seek(-1, os.SEEK_END)
        return file.read(1) == pickle.STOP


def warm_up() -> None:
    """Track and forecast one vehicle on a map of one cell: every kernel on the way is compiled, and cached."""
    import numpy as np

    from dirprim_filter.distributions.highest_density import highest_density_regions
    from dirprim_filter.primitives._modes import Modes
    from tessellation import GridTessellation

    two_rows, rng = np.ones((2, 1)), np.random.default_rng(0)
    anywhere = dp.PrimitiveMap(
        tessellation=GridTessellation.covering(np.zeros((1, 2)), cell_size=1.0), n_rows=np.ones(2, np.int64),
        modes=Modes.flat(two_rows, 0.0 * two_rows, two_rows, two_rows, two_rows), n_background_modes=0,
    )  # fmt: skip
    tracker = dp.Tracker(anywhere, config=dp.FilterConfig(n_particles=10), rng=rng)
    reported = dp.Detections(
        track_id=np.array(["a", "a", "a"]),
        time_ns=np.array([0, 1, 2], np.int64) * 10**8,  # the third frame resamples
        position=np.array([[0.0, 0.0], [1.5, 0.0], [1.5, 0.0]]),  # where few particles come near: it has its kernel
    )
    for frame in reported.frames():
        tracker.step(frame)
    paths = dp.forecast(anywhere, position=(0.0, 0.0), direction=0.0, speed=1.0, n_samples=2, rng=rng)
    highest_density_regions(paths, (0.5,))
