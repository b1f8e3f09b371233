"""What a tracker knows of the frame that it is at."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.filtering.association import Hits

NO_ROWS: IntArray = np.empty(0, np.int64)


@dataclass(slots=True, kw_only=True)
class CurrentFrame:
    """The current frame, and the tracks that its detections are assigned to.

    Attributes:
        detections: with the times when they were true: a latency before they arrived.
        hits: tracks of earlier frames, and the rows of `detections` assigned to them.
        by_chance: (d,) density of clutter and first detections expected at each of `detections`, see `Undetected`.
        home: slots of all tracks that may be reported: labelled ones of the frame in its order, labelled ones that it
            does not hold, and unlabelled ones.
        n_aside: how many beliefs were moved aside.
        held: the slots that hold their beliefs at the frame's time.
        is_scan: whether the sensor looked.
        is_weighed: whether the beliefs are weighed by it.
        moments: of those, once they are weighed.
        shown: of these, what there are estimates of.
        shown_home: likewise of `home`.
        shown_names: their names.
        innovation: (slots, 2) distance and normalised square, where they were asked for.
        lost: the slots of reinitialised beliefs.
    """

    detections: Detections = field(default_factory=Detections.none)
    hits: Hits = field(default_factory=lambda: Hits(NO_ROWS, NO_ROWS))
    by_chance: FloatArray = field(default_factory=lambda: np.empty(0))
    home: IntArray = field(default_factory=NO_ROWS.copy)
    n_aside: int = 0
    held: IntArray = field(default_factory=NO_ROWS.copy)
    is_scan: bool = True
    is_weighed: bool = False
    moments: FloatArray | None = None
    shown: IntArray = field(default_factory=NO_ROWS.copy)
    shown_home: IntArray = field(default_factory=NO_ROWS.copy)
    shown_names: list[str] = field(default_factory=list)
    innovation: FloatArray | None = None
    lost: IntArray = field(default_factory=NO_ROWS.copy)
