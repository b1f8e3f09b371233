"""Entities of vehicles: one of its own for each of the first, and one for all that come after.

The viewer slows down with many hundreds of entities, and nobody reads so many.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from dirprim_filter.arrays import IntArray
from dirprim_filter.track_ids import Numbers, rows_of_each

MOST_OWN = 100
"""Vehicles with an entity of their own."""
OTHERS = "all others"


class Lane(NamedTuple):
    """What an entity shows: rows, in order of the instants, so many of `counts` at each of `instants`."""

    path: str
    is_new: bool
    rows: IntArray
    instants: IntArray
    counts: IntArray


class Lanes:
    """Divides the rows of some instants by entity; one that shows nothing any more is emptied once.

    Args:
        root: what comes before the names.
    """

    def __init__(self, root: str) -> None:
        self._root, self._path = root, dict[str, str]()
        self._shown, self._known = set[str](), set[str]()

    def divided(self, names: Sequence[str], instant: IntArray, n_instants: int) -> Iterator[Lane]:
        """Lanes of rows with (n,) ascending instants."""
        numbers = Numbers()
        place = numbers.of([self._path_of(name) for name in names])
        drawn = dict(zip(numbers, rows_of_each(place), strict=True))
        nothing = np.empty(0, np.int64)
        for path in [*drawn, *(self._shown - drawn.keys())]:
            rows = drawn.get(path, nothing)
            counts = np.bincount(instant[rows], minlength=n_instants)
            before = np.concatenate([[path in self._shown], counts[:-1] > 0])
            instants = np.flatnonzero((counts > 0) | before)
            yield Lane(path, path not in self._known, rows, instants, counts[instants])
            self._known.add(path)
            (self._shown.add if counts[-1] else self._shown.discard)(path)

    def _path_of(self, name: str) -> str:
        if name not in self._path:
            is_own = len(self._path) < MOST_OWN
            parts = name.split("/") if is_own else [OTHERS]
            path = rr.new_entity_path([self._root.strip("/"), *(part or "_" for part in parts)])
            if not is_own:
                return path
            self._path[name] = path
        return self._path[name]


OTHER_PATH = rr.new_entity_path([OTHERS])
