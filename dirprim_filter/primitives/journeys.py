"""Journeys of vehicles that a map remembers: what comes after what.

A primitive tells what vehicles do at a place, not which of them will turn, brake at the line or wait for how long.
Senanayake et al. 2020 name interactions between cells as future work. Here they are kept whole: a vehicle that moves
as another did at this place goes on as that one went on, for as long as it moves like it. In the limit of small cells,
each with a mode for every vehicle, these are the transitions from mode to mode, with all their memory.

Vehicles that move like none that was seen here go on as some vehicle at another place that was as fast: the motion
model that knows no place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from dirprim_filter.distributions.angles import difference
from dirprim_filter.primitives import _following, _likening
from dirprim_filter.primitives._candidates import MOST_SPEEDS, N_STEADY, SLOWEST_STEADY, SPEEDS_PER_MPS, STEADY_RATIO
from dirprim_filter.primitives._likening import (
    CREEP,
    FARTHEST,
    FARTHEST_M,
    LATERAL_M,
    LONGEST_M,
    MOST_PIXELS,
    PIXEL_M,
    SECTORS,
    JourneyTable,
)
from dirprim_filter.primitives.rows import TrackRows
from tessellation.arrays import BoolArray, FloatArray, IntArray, as_floats

INTERVAL_S = 0.5
"""Between the rows of a journey: at 10 m/s on a bend of 20 m radius the chord is 0.15 m off the arc."""
LONGEST_GAP_S = 1.5
"""Between two rows further apart the vehicle's way is not known: its journey ends, and another begins."""
MOVING = 0.5
"""m/s; slower rows have no direction of their own."""
STEADY_S = 10.0
"""How long a journey straight on lasts."""
MOST_ROWS = 60_000
"""More are not kept: of so many rows a busy junction has hundreds in every direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Journeys:
    """Rows of vehicles, one journey after the other.

    Attributes:
        position: (n, 2) metres.
        direction: (n,) radians; of a standing vehicle between those before and after.
        speed: (n,) m/s.
        duration: (n,) seconds to the journey's next row; 0 for its last.
        nearness: how near is alike, in units of 1.5 m across the way, 0.12 rad and 0.5 m/s with 15 % of the speed.
        strength: so many alike journeys weigh as much as those of all other places; infinite: places tell nothing.
        direction_rate: 1/s, how fast a vehicle's direction gives way to its journey's.
        speed_rate: 1/s, the same of its speed.

    Raises:
        ValueError: columns of different lengths, numbers that are not finite, durations below zero, a last journey
            that does not end, or knobs that are not positive.
    """

    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    duration: FloatArray
    nearness: float = 0.7
    strength: float = 0.1
    direction_rate: float = 1.0
    speed_rate: float = 0.2

    def __post_init__(self) -> None:
        n = len(self.direction)
        for name, shape in (("position", f"{n} 2"), ("direction", f"{n}"), ("speed", f"{n}"), ("duration", f"{n}")):
            object.__setattr__(self, name, as_floats(name, getattr(self, name), shape))
        if (self.duration < 0).any() or (self.speed < 0).any() or (n > 0 and self.duration[-1] != 0):
            raise ValueError("speed, duration: expected at least 0, and 0 s after the last row")
        for name in ("nearness", "strength", "direction_rate", "speed_rate"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a positive number, got {getattr(self, name)}")

    def __len__(self) -> int:
        return len(self.direction)

    @classmethod
    def none(cls) -> Journeys:
        """No journey."""
        return cls(position=np.empty((0, 2)), direction=np.empty(0), speed=np.empty(0), duration=np.empty(0))

    @classmethod
    def of(cls, rows: TrackRows, *, most_rows: int = MOST_ROWS) -> Journeys:
        """The journeys of vehicles, `INTERVAL_S` from row to row; of every so many-th where there are many rows."""
        share = max(1, -(-len(rows) // most_rows))
        rows = rows[rows.vehicle % share == 0] if share > 1 else rows
        new = np.diff(rows.vehicle, prepend=-1) != 0
        keep = np.empty(len(rows), np.bool_)
        _following.thin(new, rows.time_ns, int(INTERVAL_S * 1e9) - 1_000_000, keep)
        kept = rows[keep]
        duration = np.diff(kept.time_ns, append=0) * 1e-9
        ends = np.diff(kept.vehicle, append=-1) != 0
        duration[ends | (duration > LONGEST_GAP_S) | (duration <= 0)] = 0.0
        return cls(
            position=kept.position, direction=_directions(kept, ends), speed=kept.speed, duration=duration
        ).without_lone_rows()

    def without_lone_rows(self) -> Journeys:
        """The same without journeys of one row, which lead nowhere."""
        lone = (
            (self.duration == 0) & (np.concatenate([[0.0], self.duration[:-1]]) == 0)
            if len(self)
            else np.empty(0, bool)
        )
        return replace(
            self, position=self.position[~lone], direction=self.direction[~lone], speed=self.speed[~lone],
            duration=self.duration[~lone],
        )  # fmt: skip

    def _restlessness(self, goes_on: IntArray) -> tuple[float, float]:
        """How much directions, radians, and speeds, m/s, change in a second, and in t seconds as its square root."""
        later, lasts = goes_on + 1, self.duration[goes_on]
        moves = np.minimum(self.speed[goes_on], self.speed[later]) >= MOVING
        turned = difference(self.direction[later], self.direction[goes_on])[moves]
        gained = self.speed[later] - self.speed[goes_on]
        return (
            float(np.sqrt((turned**2).sum() / max(lasts[moves].sum(), 1.0))),
            float(np.sqrt((gained**2).sum() / max(lasts.sum(), 1.0))),
        )

    def _reach(self) -> float:
        """Metres from a journey's way within which a vehicle may be like it."""
        return LATERAL_M * self.nearness * float(np.sqrt(FARTHEST))

    def without_places(self) -> Journeys:
        """The same, followed without regard to the place."""
        return replace(self, strength=np.inf)

    def table(
        self, *, direction_spread: float, speed_spread: float, drift: float, forget_rate: float,
        agility: float,
    ) -> JourneyTable:  # fmt: skip
        """The journeys as the kernels take them, with what a filter or forecast adds: see `FilterConfig`."""
        goes_on = np.flatnonzero(self.duration > 0)
        following = np.minimum(goes_on + 1, len(self) - 1)
        row = np.zeros((max(len(self), 1), 8))
        row[: len(self), 0], row[: len(self), 1], row[: len(self), 4] = self.direction, self.speed, self.duration
        lasts = self.duration[goes_on]
        row[goes_on, 2] = difference(self.direction[following], self.direction[goes_on]) / lasts
        row[goes_on, 3] = (self.speed[following] - self.speed[goes_on]) / lasts
        row[goes_on, 5:7] = (self.position[following] - self.position[goes_on]) / lasts[:, None]
        row[1 : len(self), 7] = np.cumsum(self.duration == 0)[:-1]
        at_least = np.maximum(row[: len(self), 1], CREEP)
        place = np.zeros((len(row), 6))
        place[: len(self)] = np.column_stack(
            [self.position, np.cos(self.direction), np.sin(self.direction), self.duration * at_least, 1.0 / at_least]
        )
        squares = _covered(place, self.direction, goes_on, reach=min(self._reach(), FARTHEST_M))
        row = np.vstack([row, _steady()])
        turning, hurrying = self._restlessness(goes_on)
        by_speed = goes_on[np.argsort(self.speed[goes_on], kind="stable")]
        return JourneyTable(
            row=row,
            place=place,
            first_steady=len(row) - 2 * (N_STEADY + 1),
            slower=np.searchsorted(self.speed[by_speed], np.arange(MOST_SPEEDS) / SPEEDS_PER_MPS),
            by_speed=by_speed,
            **squares,
            nearness=self.nearness,
            strength=self.strength,
            direction_rate=self.direction_rate,
            speed_rate=self.speed_rate,
            direction_spread=direction_spread,
            speed_spread=speed_spread,
            drift=drift,
            forget_rate=forget_rate,
            turning=agility * turning,
            hurrying=agility * hurrying,
        )


def _steady() -> FloatArray:
    """(2 N_STEADY + 2, 8) rows of journeys straight on, each with its end."""
    pace = np.concatenate([[0.0], SLOWEST_STEADY * STEADY_RATIO ** np.arange(N_STEADY)])
    row = np.zeros((2 * pace.size, 8))
    row[:, 1] = np.repeat(pace, 2)
    row[::2, 4], row[::2, 5] = STEADY_S, pace
    row[:, 7] = -2.0  # no vehicle's
    return row


def _directions(rows: TrackRows, ends: BoolArray) -> FloatArray:
    """Each row's direction; where a vehicle stands, what it turns to in even steps from the last to the next."""
    direction = rows.direction.copy()
    moves = rows.speed >= MOVING
    for begin, stop in pairwise(np.concatenate([[0], np.flatnonzero(ends) + 1])):
        own = slice(begin, stop)
        at = np.flatnonzero(moves[own])
        if 0 < at.size < stop - begin:
            direction[own] = np.interp(np.arange(stop - begin), at, np.unwrap(rows.direction[own][at]))
    return direction


def _covered(place: FloatArray, direction: FloatArray, goes_on: IntArray, *, reach: float) -> dict[str, Any]:
    """Which rows each square and sector of directions knows: the part of `JourneyTable` that tells it."""
    low, extent = np.zeros(2), np.zeros(2)
    if goes_on.size:
        margin = reach + min(float(place[goes_on, _likening.REACH].max()), LONGEST_M)
        low = place[goes_on, :2].min(axis=0) - margin
        extent = np.ptp(place[goes_on, :2], axis=0) + 2.0 * margin
    pixel = max(PIXEL_M, float(extent.max()) / np.sqrt(MOST_PIXELS))
    n_x, n_y = (int(n) + 1 for n in extent / pixel)
    sector = np.floor(direction * (SECTORS / (2.0 * np.pi))).astype(np.int64) % SECTORS
    first = np.zeros(n_x * n_y * SECTORS + 1, np.int64)
    grid = (place, sector, goes_on, low, pixel, n_x, n_y, reach)
    _likening.cover(*grid, first, np.empty(0, np.int64))
    first = np.cumsum(first)
    member = np.empty(first[-1], np.int64)
    _likening.cover(*grid, first[:-1].copy(), member)
    return {
        "origin_x": low[0], "origin_y": low[1], "per_metre": 1.0 / pixel, "n_x": n_x, "n_y": n_y, "first": first,
        "member": member, "most_alike": int(np.diff(first[::SECTORS]).max(initial=0)),
    }  # fmt: skip
