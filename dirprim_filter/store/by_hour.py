"""How a map turns with the hour: learned from whose hour vehicles came into sight in, as held-out days like it best.

In a slot a mode that e vehicles are expected in by all day, and n drove, has (n + s) / (e + s) of the flow of all day:
the posterior mean of a Poisson rate under a gamma prior of mean 1. Its pace is the mean over the n vehicles and q more
that drove as all day does. Strengths s and q are chosen by the log density of days that were held out; infinitely
strong ones say that all hours are alike, and win unless others are better by more than luck.
"""

from __future__ import annotations

import logging
from typing import NamedTuple, Self

import numpy as np
from scipy.special import logsumexp, stdtrit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.schedule import HOUR_NS, N_SLOTS, By, Schedule, _resembled, local_hours, slots_of
from dirprim_filter.primitives.visits import Visits
from dirprim_filter.store.driven import Driven

logger = logging.getLogger(__name__)

STRENGTHS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, np.inf)
"""Vehicles with which all day counts in a slot."""
N_FOLDS = 5
"""Of days, or as many as there are days."""
MOST_INSTANTS = 100_000
"""Of held-out vehicles are enough to choose by."""
LUCK = 0.01
"""Probability that a gain is believed where hours are alike; by a tenth, every fifth map of few days lost .01 nat."""
SLOWEST = 0.01
"""m/s: below it a gamma of speeds says nothing."""


class _Clock(NamedTuple):
    """When vehicles came into sight, by the clock."""

    slot: IntArray  # (n_vehicles,)
    fold: IntArray  # (n_vehicles,) of its day
    day: IntArray  # (n_vehicles,) 0, 1, ...
    n_slots: int

    @classmethod
    def of(cls, hour: IntArray, by: By, zone: str) -> Self:
        """Of hours since 1970-01-01, (n_vehicles,).

        Raises:
            ValueError: there is no such zone, or one day alone.
        """
        local = local_hours(hour * HOUR_NS, zone)
        days, day = np.unique(local // N_SLOTS["hour"], return_inverse=True)
        if days.size < 2:
            raise ValueError(
                f"by: expected recordings of at least two days, to hold some out, got {days.size}; add recordings, or "
                "learn without hours"
            )
        return cls(slots_of(local, by), day % min(N_FOLDS, days.size), day, N_SLOTS[by])


class _Counts(NamedTuple):
    """Of some vehicles, (n_slots, n_cells, m)."""

    seen: FloatArray
    expected: FloatArray
    ratios: FloatArray  # sum

    def of(self, slot: IntArray, cell: IntArray) -> _Counts:
        """(n, m) of slots and cells."""
        return _Counts(*(column[slot, cell] for column in self))

    def flow(self, strength: float, least: int) -> FloatArray:
        """Of fewer than `least` vehicles no more is used than that they are fewer."""
        seen = np.where(self.seen < least, np.minimum(self.expected, 0.5 * (least - 1)), self.seen)
        return (seen + strength) / (self.expected + strength) if np.isfinite(strength) else np.ones(seen.shape)

    def pace(self, strength: float, least: int) -> FloatArray:
        """1 where fewer than `least` vehicles drove."""
        if not np.isfinite(strength):
            return np.ones(self.seen.shape)
        mean = (self.ratios + strength) / (self.seen + strength)
        return np.where(self.seen < least, 1.0, mean)


class Strengths(NamedTuple):
    """What a schedule is fitted by, in any part of a map."""

    flow: float  # vehicles with which all day counts in a slot
    pace: float
    share: FloatArray  # (n_slots,) of the vehicles of the whole map, those of each slot


def learn_schedule(
    learned: PrimitiveMap, visits: Visits, mode: IntArray, hour: IntArray, *, by: By, zone: str, min_vehicles: int
) -> Schedule:
    """How a map turns with the hour, by strengths that its own vehicles choose; see `choose_strengths`."""
    strengths = choose_strengths(learned, visits, mode, hour, by=by, zone=zone, min_vehicles=min_vehicles)
    return fit_schedule(learned, visits, mode, hour, strengths, by=by, zone=zone, min_vehicles=min_vehicles)


def choose_strengths(
    learned: PrimitiveMap, visits: Visits, mode: IntArray, hour: IntArray, *, by: By, zone: str, min_vehicles: int
) -> Strengths:
    """What held-out days like best.

    Args:
        learned: the map of all day.
        visits: of the vehicles that it was learned from.
        mode: (v,) of each visit.
        hour: (n_vehicles,) since 1970-01-01, in which each came into sight.
        by: "hour" of the day, or of the "week".
        zone: whose clocks say the hour.
        min_vehicles: what fewer did in a slot is as all day.

    Raises:
        ValueError: there is no such zone, or one day alone.
    """
    clock = _Clock.of(hour, by, zone)
    driven, here = Driven.of(learned, visits, mode), np.unique(visits.vehicle)
    judged = _judged(learned, visits, clock, driven, here)
    return Strengths(*judged.strengths(min_vehicles), _shares(clock.slot[here], clock.n_slots))


def fit_schedule(
    learned: PrimitiveMap, visits: Visits, mode: IntArray, hour: IntArray, strengths: Strengths, *, by: By, zone: str,
    min_vehicles: int,
) -> Schedule:  # fmt: skip
    """How a map, or a part of one, turns with the hour.

    Args:
        learned: the map of all day.
        visits: as for `choose_strengths`, as are mode and hour.
        mode: (v,).
        hour: (n_vehicles,).
        strengths: chosen ones.
        by: "hour" of the day, or of the "week".
        zone: whose clocks say the hour.
        min_vehicles: what fewer did in a slot is as all day.

    Raises:
        ValueError: there is no such zone.
    """
    slot = slots_of(local_hours(hour * HOUR_NS, zone), by)
    counts = _counted(Driven.of(learned, visits, mode), slot, strengths.share, _shape(learned))
    flow, pace = counts.flow(strengths.flow, min_vehicles), counts.pace(strengths.pace, min_vehicles)
    there = learned.direction.weight[:-1, : learned.n_own_modes] > 0  # of modes that were withheld nothing is said
    return Schedule(
        by=by, zone=zone, flow=np.where(there, np.maximum(np.round(flow, 3), 1e-3), 1.0),
        pace=np.where(there, np.round(pace, 3), 1.0),
    )  # fmt: skip


def _shape(learned: PrimitiveMap) -> tuple[int, int]:
    """Cells, and modes of their own."""
    return learned.tessellation.n_cells, learned.n_own_modes


def _shares(slot: IntArray, n_slots: int) -> FloatArray:
    """(n_slots,) of the vehicles of some slots, (n,)."""
    return np.asarray(np.bincount(slot, minlength=n_slots) / max(slot.size, 1))


def _counted(driven: Driven, slot: IntArray, share: FloatArray, shape: tuple[int, int]) -> _Counts:
    """Vehicles of slots, (n_vehicles,): those of a mode are expected in the slots by their share, (n_slots,)."""
    size = (share.size, *shape)
    at = np.ravel_multi_index((slot[driven.vehicle], driven.cell, driven.mode), size)
    seen, ratios = (np.bincount(at, column, int(np.prod(size))).reshape(size) for column in (None, driven.ratio))
    return _Counts(seen.astype(float), share[:, None, None] * seen.sum(axis=0), ratios.astype(float))


class _Judged(NamedTuple):
    """Instants of vehicles, and what the vehicles of other days did in their slots and cells."""

    day: IntArray  # (n,)
    own: FloatArray  # (n, m) log density of each of the cell's own and borrowed modes, its weight included
    free: FloatArray  # (n,) of the place-free ones
    weight: FloatArray  # (n, m)
    shape: FloatArray  # (n, m) of the gamma of speeds
    hasty: FloatArray  # (n, m) its rate times the speed
    others: _Counts  # (n, m)

    def strengths(self, least: int) -> tuple[float, float]:
        """Of flow and of pace, one after the other."""
        found = [np.inf, np.inf]
        alike = self._log_density(np.inf, np.inf, least)
        best = before = alike
        for i in range(2):
            for strength in STRENGTHS:
                tried = [*found[:i], strength, *found[i + 1 :]]
                scores = self._log_density(tried[0], tried[1], least)
                if scores.mean() > best.mean() and self._is_beyond_luck(scores - before):
                    found, best = tried, scores
            before = best
        logger.info("by hour: %+.3f nat on held-out days; strengths %g and %g", (best - alike).mean(), *found)
        return found[0], found[1]

    def _is_beyond_luck(self, gained: FloatArray) -> bool:
        """Whether the mean gain over days is, by Student's t."""
        _, day, n = np.unique(self.day, return_inverse=True, return_counts=True)
        of_day = np.bincount(day, gained) / n
        if n.size < 2:
            return False
        return bool(of_day.mean() > stdtrit(n.size - 1, 1.0 - LUCK) * of_day.std(ddof=1) / np.sqrt(n.size))

    def _log_density(self, flow_strength: float, pace_strength: float, least: int) -> FloatArray:
        """(n,)."""
        flow, pace = self.others.flow(flow_strength, least), self.others.pace(pace_strength, least)
        turned = (self.weight * flow).sum(axis=1)
        kept = np.divide(self.weight.sum(axis=1), turned, out=np.ones(turned.size), where=turned > 0)
        # Of a gamma whose mean is `pace` times as much.
        faster = self.hasty * (1.0 - 1.0 / pace) - self.shape * np.log(pace)
        own = logsumexp(self.own + np.log(flow) + faster, axis=1) + np.log(kept)
        return np.asarray(np.logaddexp(own, self.free))


def _judged(learned: PrimitiveMap, visits: Visits, clock: _Clock, driven: Driven, here: IntArray) -> _Judged:
    of_visit, rows = visits.of_instant, visits.inside
    rows = rows[:: -(-rows.size // MOST_INSTANTS)] if rows.size else rows
    cell, vehicle = visits.cell[of_visit[rows]], visits.vehicle[rows]
    primitive = learned.primitive_at(visits.position[rows])
    speed = np.maximum(visits.speed[rows], SLOWEST)[:, None]
    of_mode = np.hstack([np.tile(np.arange(learned.n_own_modes), (rows.size, 1)), _resembled(learned)[cell]])
    m = of_mode.shape[1]
    each = primitive.direction.mode_log_density(visits.course[rows]) + primitive.speed.log_density(speed)
    others = [np.empty((rows.size, m)) for _ in _Counts._fields]
    is_here = np.isin(np.arange(clock.slot.size), here)
    for fold in range(int(clock.fold.max()) + 1):
        held_out = clock.fold[vehicle] == fold
        kept = is_here & (clock.fold != fold)
        share = _shares(clock.slot[kept], clock.n_slots)
        counts = _counted(driven.some(kept[driven.vehicle]), clock.slot, share, _shape(learned))
        for column, of in zip(others, counts.of(clock.slot[vehicle[held_out]], cell[held_out]), strict=True):
            column[held_out] = np.take_along_axis(of, of_mode[held_out], axis=1)
    return _Judged(
        clock.day[vehicle], each[:, :m], logsumexp(each[:, m:], axis=1), learned.direction.weight[cell, :m],
        primitive.speed.shape[:, :m], primitive.speed.rate[:, :m] * speed, _Counts(*others),
    )  # fmt: skip
