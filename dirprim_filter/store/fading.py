"""Age: what is older counts less, in how many vehicles drive a mode where it changed, and slowly in how they drive it.

That a street is driven the other way shows in how many drive which mode, and few vehicles tell. How they drive it, mean
directions, spreads, paths, many vehicles must tell: if all of it faded as fast, maps of streets where nothing changes
would be learned from too few.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.motion import Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.schedule import _shared_out, turned
from dirprim_filter.primitives.visits import Visits
from dirprim_filter.store.driven import Driven
from dirprim_filter.store.regimes import Periods, still_so
from dirprim_filter.store.steps import HOUR_NS

SLOWER = 4.0
"""Half-lives, after which a vehicle counts half in how others drive."""
STRENGTH = 1.0
"""Vehicles with which a mode's weight and mean speed lean on what they were without fading."""


LATEST = (1 << 63) - 1
"""Nanoseconds: later than any recording."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fading:
    """How what is older counts less.

    Attributes:
        half_life_s: seconds, in which half of all places change, see `regimes`, and after which a vehicle counts half
            in how fast others are.
        now_ns: nanoseconds since 1970-01-01, from when age is counted; what is later is left out.

    Raises:
        ValueError: a half-life that is not positive.
    """

    half_life_s: float
    now_ns: int

    def __post_init__(self) -> None:
        if not (np.isfinite(self.half_life_s) and self.half_life_s > 0):
            raise ValueError(f"half_life_s: expected a positive number of seconds, got {self.half_life_s}")

    def share(self, hour: IntArray) -> FloatArray:
        """(n,) of the vehicles that came into sight in hours since 1970-01-01."""
        age_s = (self.now_ns // HOUR_NS - hour) * 3600.0
        return np.where(age_s < 0, 0.0, 0.5 ** (np.maximum(age_s, 0.0) / self.half_life_s))

    def until(self, end_ns: int) -> Self:
        """With age counted from there, if that is earlier: what has not been seen since does not age."""
        return replace(self, now_ns=min(self.now_ns, end_ns))

    @property
    def slowly(self) -> Self:
        """As by which the rest fades."""
        return replace(self, half_life_s=SLOWER * self.half_life_s)


def refreshed(learned: PrimitiveMap, visits: Visits, mode: IntArray, hour: IntArray, fading: Fading) -> PrimitiveMap:
    """The map with weights and mean speeds by what vehicles count.

    In weights a vehicle counts as probably as its cell has not changed since; in mean speeds that, halved by its age.

    Args:
        learned: the map.
        visits: of the vehicles that it was learned from, of whom as many are left as fade slowly.
        mode: (v,) of each visit.
        hour: (n_vehicles,) since 1970-01-01, in which each came into sight.
        fading: by how they age.
    """
    driven = Driven.of(learned, visits, mode)
    shape = (learned.tessellation.n_cells, learned.n_own_modes)
    periods = Periods.of(fading.now_ns // HOUR_NS - hour, fading.half_life_s)
    counts = still_so(
        driven.cell, driven.mode, periods.of_vehicle[driven.vehicle], change=periods.change, n_modes=shape[1]
    )
    share = counts * (fading.share(hour) / fading.slowly.share(hour))[driven.vehicle]
    at = np.ravel_multi_index((driven.cell, driven.mode), shape)
    columns = (np.ones(at.size), driven.ratio, counts, share, share * driven.ratio)
    seen, ratios, kept, faded, faded_ratios = (np.bincount(at, c, int(np.prod(shape))).reshape(shape) for c in columns)
    of_cell = seen.sum(axis=1, keepdims=True)
    expected = seen * np.divide(kept.sum(axis=1, keepdims=True), of_cell, out=np.ones(of_cell.shape), where=of_cell > 0)
    usual = np.divide(ratios, seen, out=np.ones(shape), where=seen > 0)
    pace = (faded_ratios / usual + STRENGTH) / (faded + STRENGTH)
    return turned(learned, (kept + STRENGTH) / (expected + STRENGTH), pace)


def refreshed_manoeuvres(
    motion: Motion, manoeuvre: IntArray, vehicle: IntArray, hour: IntArray, fading: Fading
) -> Motion:  # fmt: skip
    """Motion with the visits to a mode shared out between its manoeuvres as vehicles drive them now.

    What follows a manoeuvre may be out of sight, in a part of a map: here a vehicle counts in its manoeuvre as probably
    as the cell's vehicles have not shared themselves out anew between manoeuvres since.

    Args:
        motion: of the map by `refreshed`.
        manoeuvre: (v,) of each visit.
        vehicle: (v,) of each visit.
        hour: (n_vehicles,) since 1970-01-01, in which each came into sight.
        fading: by how they age.
    """
    n = motion.n_placed
    cell, mode = motion.cell[:n], motion.mode[:n]
    number = np.arange(n) - np.searchsorted(cell, cell)
    who, which = np.unique(np.column_stack([vehicle, manoeuvre]), axis=0).T
    periods = Periods.of(fading.now_ns // HOUR_NS - hour, fading.half_life_s)
    counts = still_so(
        cell[which], number[which], periods.of_vehicle[who], change=periods.change,
        n_modes=1 + int(number.max(initial=0)),
    )  # fmt: skip
    seen, kept = (np.bincount(which, column, n) for column in (np.ones(which.size), counts))
    of_cell, left = (np.bincount(cell, column)[cell] for column in (seen, kept))
    expected = seen * np.divide(left, of_cell, out=np.ones(n), where=of_cell > 0)
    flow = (kept + STRENGTH) / (expected + STRENGTH)
    _, of_mode = np.unique(np.column_stack([cell, mode]), axis=0, return_inverse=True)
    share, of = np.append(flow, np.ones(len(motion) - n)), np.append(of_mode, np.full(len(motion) - n, -1))
    return replace(motion, visits=_shared_out(motion.visits, share, of), seconds=_shared_out(motion.seconds, share, of))
