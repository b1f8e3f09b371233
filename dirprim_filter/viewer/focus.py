"""Whom to look at: the vehicle asked for, else the one that the filter understands least; and what is shown of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.columns import is_held
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.track_ids import as_texts

KEPT_S = 8.0
"""Seconds for which a vehicle stays in focus: quick changes would make its plots useless."""
BIN_DEG = 5


class Look(NamedTuple):
    """The vehicle in one frame.

    Attributes:
        track_id: of the vehicle.
        position: (2,) metres.
        cue: mean direction, radians, and concentration of its turn signal; 0 where it gives none.
        belief: (n_bins,) share of its particles by direction; zeros where there are none.
    """

    track_id: str
    position: FloatArray
    cue: tuple[float, float]
    belief: FloatArray


class Focus:
    """Follows from frame to frame the vehicle of the lowest log evidence.

    Args:
        chosen: id of the vehicle to look at instead.
    """

    def __init__(self, chosen: str | None) -> None:
        self._chosen, self._name = chosen, ""
        self._since_ns = 0

    def see(self, frame: TrackedFrame, *, box: FloatArray) -> Look | None:
        """The vehicle in a frame, None where it is not there; those in the box, (2, 2) metres, come first."""
        self._name = name = self._chosen or self._worst(frame, box)
        if name not in frame.names:
            return None
        row = frame.names.index(name)
        mine = frame.particles.of(row)
        bins = np.floor(mine.direction % TWO_PI / TWO_PI * (360 // BIN_DEG)).astype(np.int64)
        return Look(
            name, frame.estimates.position[row], _signal(frame, row),
            np.bincount(bins, mine.weight, 360 // BIN_DEG).astype(np.float64),
        )  # fmt: skip

    def _worst(self, frame: TrackedFrame, box: FloatArray) -> str:
        """The one before, for a while, if in view; then of those measured now the one that is least expected."""
        estimates = frame.estimates
        is_out = ((estimates.position < box[0]) | (estimates.position > box[1])).any(axis=1)
        is_known = self._name in frame.names and not is_out[frame.names.index(self._name)]
        measured = np.flatnonzero(estimates.unseen_s == 0)
        if not measured.size or (is_known and frame.time_ns < self._since_ns + KEPT_S * 1e9):
            return self._name
        self._since_ns = frame.time_ns
        return str(frame.names[measured[np.lexsort((estimates.log_evidence[measured], is_out[measured]))[0]]])


def _signal(frame: TrackedFrame, row: int) -> tuple[float, float]:
    """The mean direction and the concentration of the turn signal that a vehicle gives now; 0 of none."""
    seen = frame.detections
    own = np.flatnonzero(as_texts(seen.track_id) == frame.names[row]) if is_held(seen.cue) else np.empty(0, np.int64)
    if not own.size or not np.isfinite(seen.cue[own[0]]).all():
        return 0.0, 0.0
    turn, concentration = seen.cue[own[0]].tolist()
    return float(frame.estimates.direction[row]) + turn, concentration
