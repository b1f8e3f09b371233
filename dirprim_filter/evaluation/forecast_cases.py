"""Instants of held-out tracks from which forecasts are made, what came after, and how near a forecast is to it.

Courses and speeds of a log are central differences, which look ahead. Here they follow from what was seen until then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.course import HALF_WINDOWS_S, STANDING_M, Ways
from dirprim_filter.distributions.angles import difference
from dirprim_filter.evaluation import _kernels
from dirprim_filter.evaluation.truth import usual_interval_s
from dirprim_filter.track_ids import qualified_names, rows_of_each
from dirprim_filter.tracks import Tracks

SCORES = ("energy", "ade", "fde", "coverage_50", "coverage_90")
HORIZONS_S = tuple(0.5 * i for i in range(1, 17))
START_EVERY_S = 1.0
MAX_STARTS = 8
"""Of a vehicle: that one which waits for minutes does not outweigh all others."""
MAX_MATCH_S = 0.25
"""Between rows further from an instant than this, and than a vehicle's rows usually are from each other, its place is
not known."""
PAST_NS = int(HALF_WINDOWS_S[0] * 1e9)
"""A vehicle's motion is its move over so long before, or since the row before where rows are further apart."""
FEWEST_CASES = 20
"""At a horizon that is scored, or by which settings are chosen: below it too few vehicles are still there."""
MOVES_M = 0.5 * STANDING_M
"""A shorter move has no course."""


class Cases(NamedTuple):
    """Instants from which forecasts are made, and what came after.

    Attributes:
        vehicle: (n,) number of the vehicle, (group, id), among those of the log.
        name: (n,) str, the vehicle's id, with its group's: the same whichever vehicles it is forecast with.
        group: (n,) the vehicle's.
        position: (n, 2) metres.
        direction: (n,) radians, by no later row than the instant's: `seen_so_far`.
        speed: (n,) m/s, likewise.
        later: (n, n_horizons, 2) metres, where the vehicle was that much later; NaN where the log does not say.
        log: all rows of the log, those of vehicles that are not forecast too, likewise.
        row: (n,) which of these each case is.
    """

    vehicle: IntArray
    name: AnyArray
    group: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    later: FloatArray
    log: Tracks
    row: IntArray

    @classmethod
    def of(
        cls, tracks: Tracks, *, horizons_s: Sequence[float] = HORIZONS_S, among: Tracks | None = None
    ) -> Cases:  # fmt: skip
        """Up to `MAX_STARTS` instants of each vehicle, `START_EVERY_S` apart, spread over its track.

        `among` are all vehicles of the log, of which `tracks` are some; left out, there are no others.
        """
        log, is_known = seen_so_far(tracks if among is None else among)
        vehicle, first = log.vehicle, log.first_rows
        names = qualified_names(log.track_id[first], log.group[first])
        own = qualified_names(tracks.track_id[tracks.first_rows], tracks.group[tracks.first_rows])
        of_each = rows_of_each(vehicle)  # tracks are in order of time
        starts, later = [np.empty(0, np.int64)], [np.empty((0, len(horizons_s), 2))]
        near_s = max(MAX_MATCH_S, usual_interval_s(log))
        for v in np.flatnonzero(np.isin(names, own)):
            rows = of_each[v]
            time_s = (log.time_ns[rows] - log.time_ns[rows[0]]) * 1e-9
            at = _spread(time_s, is_known[rows], horizon_s=min(horizons_s))
            starts.append(rows[at])
            wanted_s = time_s[at][:, None] + np.asarray(horizons_s)
            later.append(_position_at(wanted_s, time_s, log.position[rows], near_s))
        row = np.concatenate(starts)
        return cls(
            vehicle=np.asarray(vehicle[row], np.int64), name=names[vehicle[row]], group=log.group[row],
            position=log.position[row], direction=log.direction[row], speed=log.speed[row],
            later=np.concatenate(later), log=log, row=row,
        )  # fmt: skip

    def some(self, chosen: BoolArray) -> Cases:
        """Those that are chosen, (n,), of the same log."""
        return Cases(**{name: of if name == "log" else of[chosen] for name, of in self._asdict().items()})


def seen_so_far(tracks: Tracks) -> tuple[Tracks, BoolArray]:
    """The tracks with each row's course and speed by the vehicle's rows until then, and (n,) where these suffice.

    A move over `PAST_NS` is as old as its middle, which is recent. Where rows are further apart it is not: there its
    course and speed go on to change until now as they did since the move before, which is exact on an arc at constant
    acceleration. A vehicle that stands keeps its last course; one that has not moved yet has its heading.
    """
    ways = Ways.of(tracks.vehicle, tracks.time_ns, tracks.position, longest_gap_s=np.inf)
    order, first, axis, row = ways.order, ways.first, ways.axis, np.arange(len(tracks))
    before = np.maximum(first, np.minimum(np.searchsorted(axis, axis - PAST_NS), row - 1))
    span_ns = axis - axis[before]
    move = ways.position - ways.position[before]
    length, course = np.hypot(*move.T), np.arctan2(move[:, 1], move[:, 0])
    speed = length / np.maximum(span_ns * 1e-9, 1e-9)
    moves = length >= MOVES_M
    is_sparse = span_ns > PAST_NS
    has_two = before > first
    share = np.where(is_sparse & has_two, span_ns / np.maximum(span_ns + span_ns[before], 1), 0.0)
    turned = np.where(moves & moves[before], difference(course, course[before]), 0.0)
    course = course + share * turned
    speed = np.maximum(speed + share * (speed - speed[before]), 0.0)
    moved = np.maximum.accumulate(np.where(moves, row, -1))
    heading = tracks.heading[order]
    own = np.where(np.isnan(heading), course, heading)
    columns = np.empty((2, row.size))
    columns[:, order] = np.where(moved >= first, course[moved], own), speed
    is_known = np.empty(row.size, np.bool_)
    is_known[order] = (axis - axis[first] >= PAST_NS) & (has_two | ~is_sparse)
    return replace(tracks, direction=columns[0], speed=columns[1]), is_known


def _spread(time_s: FloatArray, is_known: BoolArray, *, horizon_s: float) -> IntArray:
    """Rows of known motion at which to start, so that at least the nearest horizon is seen."""
    possible = np.flatnonzero(is_known & (time_s <= time_s[-1] - horizon_s + 1e-6))
    if not possible.size:
        return possible
    instants = np.arange(time_s[possible[0]], time_s[possible[-1]] + 1e-6, START_EVERY_S)
    chosen = np.unique(np.linspace(0, instants.size - 1, min(instants.size, MAX_STARTS)).round().astype(np.int64))
    return possible[np.unique(np.searchsorted(time_s[possible], instants[chosen] - 1e-6))]


def _position_at(wanted: FloatArray, time_s: FloatArray, position: FloatArray, near_s: float) -> FloatArray:
    """(...) seconds -> (..., 2), linear between rows at most `near_s` away; NaN elsewhere."""
    found = np.stack([np.interp(wanted, time_s, position[:, axis]) for axis in (0, 1)], axis=-1)
    after = np.clip(np.searchsorted(time_s, wanted - 1e-6), 0, time_s.size - 1)
    before = np.maximum(after - 1, 0)
    near = np.abs(time_s[after] - wanted) <= 1e-6
    between = (time_s[before] <= wanted) & (wanted <= time_s[after])
    near |= between & (wanted - time_s[before] <= near_s) & (time_s[after] - wanted <= near_s)
    return np.where(near[..., None], found, np.nan)


def mean_log_energy(sample: FloatArray, later: FloatArray) -> float:
    """Mean over horizons of the log of the mean energy score; NaN where no horizon has `FEWEST_CASES`.

    The score is proper (Gneiting and Raftery 2007, Eq. 22): of settings too wide a net and too narrow a one both cost.
    """
    judged = np.flatnonzero(np.isfinite(later[..., 0]).sum(axis=0) >= FEWEST_CASES)
    if not judged.size:
        return float("nan")
    energy = score_cases(sample[:, :, judged], later[:, judged])[..., SCORES.index("energy")]
    return float(np.log(np.nanmean(energy, axis=0)).mean())


def score_cases(sample: FloatArray, later: FloatArray) -> FloatArray:
    """Every score of every case and horizon, in the order of `SCORES`; NaN where the truth is not known.

    Args:
        sample: (n, n_samples, n_horizons, 2) metres.
        later: (n, n_horizons, 2) metres.

    Returns:
        (n, n_horizons, 5).
    """
    n, _, n_horizons, _ = sample.shape
    known = np.isfinite(later[..., 0])
    of_samples = np.full((n, n_horizons, 2), np.nan)
    for h in range(n_horizons):
        rows = np.flatnonzero(known[:, h])
        out = np.empty((rows.size, 2))
        _kernels.score_samples(np.ascontiguousarray(sample[rows, :, h]), later[rows, h], out)
        of_samples[rows, h] = out
    energy, rank = of_samples[..., 0], of_samples[..., 1]
    off = np.linalg.norm(sample.mean(axis=1) - later, axis=-1)
    so_far = np.cumsum(off, axis=1) / np.arange(1, n_horizons + 1)
    inside = [np.where(known, rank < probability, np.nan) for probability in (0.5, 0.9)]
    return np.stack([energy, so_far, off, *inside], axis=-1)
