"""How much of a log is on a map: a log that is mostly outside needs another map, frame or origin."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterable
from itertools import chain, islice
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.texts import counted, say
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.filtering import GroupTracker
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from tessellation import GridTessellation

logger = logging.getLogger(__name__)

NONE = np.empty((0, 2))
RECENT = 8
"""Frames, in one of which a vehicle with an id was, whichever sensor saw it."""


class Coverage:
    """An `EstimateSink` that counts which of a log's rows are outside of a map, and which have no estimate."""

    def __init__(
        self, learned: PrimitiveMap | None, map_file: Path | None, log: Path, *, is_needed: bool = True
    ) -> None:
        self._map, self._map_file, self._log = learned, map_file, log
        self._cells = learned.tessellation if learned else GridTessellation.empty()
        self._is_needed = is_needed and self._cells.n_cells > 0
        self._n_rows = self._n_outside = self._n_estimated = 0
        self._ids, self._came_again = deque[set[str]](maxlen=RECENT), False
        self._box = np.full((2, 2), np.inf)  # least x and y of the rows, and of the same negated

    def write(self, frame: TrackedFrame) -> None:
        """Count the rows of a frame."""
        self.see(frame.detections.position)
        if not self._came_again:
            ids = set(frame.detections.track_id.astype(np.str_).tolist())
            self._came_again = any(NO_ID in ids or not ids.isdisjoint(former) for former in self._ids)
            self._ids.append(ids)
        self._n_estimated += int((frame.estimates.unseen_s == 0).sum())

    def see(self, position: FloatArray) -> bool:
        """Count rows (n, 2); -> whether all of them are outside."""
        n_outside = int((self._cells.cell_of(position) < 0).sum())
        self._n_rows, self._n_outside = self._n_rows + len(position), self._n_outside + n_outside
        self._box = np.minimum(self._box, _box(position))
        return n_outside == len(position)

    def begun(self, frames: Iterable[Detections], reading: Reading) -> Iterable[Detections]:
        """The same frames; if the first is outside of the map, a file is read once more, until one is not.

        Raises:
            ValueError: all are outside.
        """
        coming = iter(frames)
        first = list(islice(coming, 1))
        if first and self._is_needed and (self._log.is_file() or self._log.is_dir()):
            probe = Coverage(self._map, self._map_file, self._log)
            if probe.see(first[0].position) and all(probe.see(of.position) for of in reading.detections(self._log)):
                probe.check()
        return chain(first, coming)

    def check(self, position: FloatArray = NONE) -> None:
        """Warn where more than half of the rows are outside; of these (n, 2) too.

        Raises:
            ValueError: all are.
        """
        self.see(position)
        share = self._n_outside / max(self._n_rows, 1)
        where = (
            f"{share:.1%} of the rows outside: those of {self._log} lie in {_text(self._box)}, the map in "
            f"{_text(_box(self._cells.centers))}"
        )
        if share == 1 and self._is_needed:
            raise ValueError(
                f"{self._map_file}: expected a map of the log's place, got one with {where}; take another map, or say "
                "--set frame=... or origin=..."
            )
        if share > 0.5 and self._is_needed:
            logger.warning("%s: %s: is it the map of this place, in the same frame and origin?", self._map_file, where)

    def say(self, what: str, trackers: GroupTracker, *, share_true: float) -> bool:
        """Check, and print both shares; -> whether most rows of vehicles have no estimate: the log is hardly tracked.

        Args:
            what: was tracked.
            trackers: by which.
            share_true: of the rows, that are no clutter.
        """
        self.check()
        if trackers.recoveries:
            say(f"{trackers.recoveries} beliefs reinitialised, as they did not explain their measurements", err=True)
        what += f", {counted(trackers.n_groups, 'group')}, each by itself" if trackers.n_groups > 1 else ""
        if self._n_rows:
            missing, outside = 1.0 - self._n_estimated / self._n_rows, self._n_outside / self._n_rows
            what += f"; {missing:.1%} of {counted(self._n_rows, 'row')} without an estimate"
            what += f", {outside:.1%} outside the map" if self._map else ""
        say(what)
        is_poor = self._n_estimated < 0.5 * share_true * self._n_rows
        if is_poor:
            why = "is the noise larger (--noise), or less clutter (--set clutter_density=1e-9)?"
            if len(self._ids) > 1 and not self._came_again:
                why = "no id comes again: `dirprim track --no-ids` does without them"
            say(f"most rows have no estimate: {why}", err=True)
        return is_poor


def _box(position: FloatArray) -> FloatArray:
    return np.array([position.min(axis=0, initial=np.inf), (-position).min(axis=0, initial=np.inf)])


def _text(box: FloatArray) -> str:
    (west, south), (east, north) = box[0], -box[1]
    return f"x {west:.0f} to {east:.0f}, y {south:.0f} to {north:.0f} m"
