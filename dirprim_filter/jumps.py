"""Steps that no body can make: placeholders, outliers, and ids that several vehicles have.

What a body can do is judged by accelerations, and by how fast, how noisy and how frequent the log's own rows are, so
people, cars, boats and aircraft are judged alike. The scale is that of neighbours in time, not of consecutive rows
alone: jumps do not enter it, even if every second row is another vehicle's.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray

FASTEST = 1000.0
"""m/s: no vehicle in the air is faster."""
ACCELERATION = 100.0
"""m/s2, ten times that of falling: no vehicle does more."""
TIMES_USUAL = 6.0
"""By so many times the log's usual speed may a velocity differ from that of the step before and after."""
STEPS, NOISES = 4.0, 25.0
"""A jump is longer than so many usual steps, and than so many times the log's noise."""
TIMES_APART = 5.0
"""Another vehicle of the id is so many times as far: a shorter jump may be a correction of the position."""
SLOWEST = 1.0
"""m/s, the usual speed where vehicles stand, or nearly."""
NEAREST = 4
"""Rows so far apart are neighbours; so many vehicles of one id are distinguished at once."""
SAMPLED, SAMPLED_OF_EACH = 20_000, 200
"""Rows that the scale is estimated from, and those that each vehicle's own is."""
LEAST_ROWS = 3
"""A part of fewer rows is no vehicle of its own."""
MOST_JUMPS = 100_000
"""More are not sorted out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """How a log's vehicles usually move, or, (m,) numbers each, each of them; zeros where no vehicle has two rows.

    Attributes:
        speed: m/s, which a tenth of the rows exceed.
        noise: metres from a row to the straight line between rows before and after, in the median.
        interval_s: seconds between a vehicle's rows, in the median.
        n_steps: how many were looked at.
        straightness: length of a way across some rows by that of its steps, in the median; 0 where nothing moves.
        acceleration: m/s2, which a tenth of the rows exceed.
    """

    speed: Any
    noise: Any
    interval_s: Any
    n_steps: int
    straightness: Any
    acceleration: Any

    @classmethod
    def of(cls, vehicle: IntArray, time_ns: IntArray, position: FloatArray, each: IntArray | None = None) -> Scale:
        """Of rows in order of vehicle and time, none of which repeats another: by a sample, or of `each` number."""
        last, row = vehicle.size - 1, np.arange(0, vehicle.size, 1 + vehicle.size // SAMPLED)
        if each is not None:
            begin, n = np.unique(each, return_index=True, return_counts=True)[1:]
            place = np.arange(vehicle.size) - begin[each]
            row = np.flatnonzero(place % (1 + n // SAMPLED_OF_EACH)[each] == 0)
            each = each[row]
        speed, off, acceleration = np.full((3, row.size), np.nan)
        for lag in range(1, NEAREST + 1):
            before, after = np.maximum(row - lag, 0), np.minimum(row + lag, last)
            is_last = (after - row < lag) | (vehicle[after] != vehicle[row])
            is_end = is_last | (row - before < lag) | (vehicle[before] != vehicle[row])
            passed_s = np.where(is_last, np.nan, (time_ns[after] - time_ns[row]) * 1e-9)
            since_s = np.where(is_end, np.nan, (time_ns[row] - time_ns[before]) * 1e-9)
            way_m = np.hypot(*(position[after] - position[row]).T)
            share = (since_s / (since_s + passed_s))[:, None]
            off_m = np.hypot(*(position[row] - position[before] * (1.0 - share) - position[after] * share).T)
            speed, off = np.fmin(speed, way_m / passed_s), np.fmin(off, off_m)
            acceleration = np.fmin(acceleration, 2.0 * off_m / (since_s * passed_s))
            if lag == 1:
                interval_s, step_m = passed_s, np.where(is_last | (way_m == 0), np.nan, way_m)
        straightness = np.where(is_last, np.nan, way_m) / (NEAREST * step_m)
        measured = (speed, 0.9), (off, 0.5), (interval_s, 0.5), (straightness, 0.5), (acceleration, 0.9)
        found = [_quantiles(values, share, each) for values, share in measured]
        names = ("speed", "noise", "interval_s", "straightness", "acceleration")
        return cls(n_steps=int(np.isfinite(interval_s).sum()), **dict(zip(names, found, strict=True)))

    @property
    def usual(self) -> Any:
        """The speed, m/s, also where vehicles stand."""
        return np.maximum(self.speed, SLOWEST)

    @property
    def least_m(self) -> Any:
        """What is shorter is no jump."""
        return np.maximum(STEPS * self.usual * self.interval_s, NOISES * self.noise)


def _most(usual: Any, dt_s: Any) -> Any:
    """m/s, by which a velocity may differ from the one `dt_s` seconds before, at a usual speed."""
    return np.minimum(np.minimum(ACCELERATION * dt_s, TIMES_USUAL * usual) + 0.5 * usual, FASTEST)


def _quantiles(values: FloatArray, share: float, each: IntArray | None) -> Any:
    """Of the values that are known; of those of each number, (m,); 0 where there is none."""
    known = np.flatnonzero(np.isfinite(values))
    if each is None:
        return float(np.quantile(values[known], share)) if known.size else 0.0
    order = known[np.lexsort((values[known], each[known]))]
    n = np.bincount(each[known], minlength=int(each.max(initial=-1)) + 1)
    middle = np.cumsum(n) - n + (share * np.maximum(n - 1, 0)).astype(np.int64)
    return np.where(n > 0, np.append(values[order], 0.0)[np.minimum(middle, order.size)], 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Jumps:
    """What is wrong with where vehicles are reported to be.

    Attributes:
        at: (j,) rows before a jump.
        left_out: (n,) rows that do not fit to those before and after.
        part: (n,) 0; of an id of several vehicles, the number of the vehicle among them.
    """

    at: IntArray
    left_out: BoolArray
    part: IntArray

    @classmethod
    def of(cls, vehicle: IntArray, time_ns: IntArray, position: FloatArray, scale: Scale) -> Jumps:
        """Of rows in order of vehicle and time, none a repeat; if more than `MOST_JUMPS`, they stay as they are."""
        found = cls(
            at=_jumps(vehicle, time_ns, position, scale),
            left_out=np.zeros(vehicle.size, np.bool_), part=np.zeros(vehicle.size, np.int64),
        )  # fmt: skip
        if 0 < found.at.size <= MOST_JUMPS:
            rows = np.flatnonzero(np.isin(vehicle, vehicle[found.at]))
            found._sort_out(rows, vehicle[rows], time_ns[rows], position[rows], scale)
        return found

    def _sort_out(
        self, rows: IntArray, vehicle: IntArray, time_ns: IntArray, position: FloatArray, scale: Scale
    ) -> None:
        """Judge all rows of some vehicles anew, each vehicle by a scale of its own."""
        begin = np.flatnonzero(np.diff(vehicle, prepend=-1))
        number = np.repeat(np.arange(begin.size), np.diff(begin, append=vehicle.size))
        own = Scale.of(vehicle, time_ns, position, number)  # but no finer than the log's
        own = replace(own, speed=np.maximum(own.speed, scale.speed), noise=np.maximum(own.noise, scale.noise))
        start = np.union1d(begin, 1 + _jumps(vehicle, time_ns, position, own, number))
        last = np.append(start[1:], vehicle.size) - 1
        moves = np.append(0, np.cumsum((np.diff(position, axis=0) != 0).any(axis=1)))
        columns = rows[start], rows[last] + 1, time_ns[start], time_ns[last], moves[start] == moves[last]
        places = (map(tuple, position[at].tolist()) for at in (start, last))
        pieces = map(_Piece, *(column.tolist() for column in columns), *places)
        of_each = [[*islice(pieces, n)] for n in np.bincount(number[start]).tolist()]
        n_at = Counter(piece.first for of in of_each if len(of) > 1 for piece in of if piece.stays)
        for of, least_m, usual in zip(of_each, own.least_m.tolist(), own.usual.tolist(), strict=True):
            if len(of) > 1:
                self._mark(_chains(of, least_m, usual), least_m, n_at)

    def _mark(self, chains: list[Chain], least_m: float, n_at: Counter[Place]) -> None:
        """What is left out of a vehicle, and the parts of the rest; places where several pieces stay stand for none."""
        number, lasts = 0, {piece.end: piece.last for chain in chains for piece in chain}
        for chain, is_detour in zip(chains, _are_detours(chains), strict=True):
            kept = [one for one in chain if not (one.stays and (len({*one.first}) == 1 or n_at[one.first] > 1))]
            own, start = number, chain[0].start
            if is_detour or sum(one.end - one.start for one in kept) < LEAST_ROWS:
                kept = []
            elif chain is not chains[0] and not self.left_out[start - 1]:
                is_correction = math.dist(lasts[start], chain[0].first) < TIMES_APART * least_m
                own = int(self.part[start - 1]) if is_correction else number
            for one in chain:
                self.left_out[one.start : one.end] = True
            for one in kept:
                self.left_out[one.start : one.end], self.part[one.start : one.end] = False, own
            number += bool(kept) and own == number


def _jumps(
    vehicle: IntArray, time_ns: IntArray, position: FloatArray, scale: Scale, each: IntArray | None = None
) -> IntArray:
    """(j,) rows from which no body comes to the next one, as far as its steps before and after say.

    The scale is of all, or of `each` number. Most steps are too short for a jump, and no more is asked of them.
    """
    least_m, usual = (of if each is None else of[each[:-1]] for of in (scale.least_m, scale.usual))
    x_m, y_m = np.diff(position, axis=0).T
    is_far = (x_m * x_m + y_m * y_m > least_m * least_m) & (vehicle[1:] == vehicle[:-1])
    at, last = np.flatnonzero(is_far), vehicle.size - 1

    def velocity(row: IntArray) -> tuple[FloatArray, FloatArray]:
        """(j, 2) m/s from each row to the next; NaN where there is none; and (j,) the seconds."""
        row, then = np.clip(row, 0, last), np.clip(row + 1, 0, last)
        is_step = (vehicle[row] == vehicle[then]) & (then > row)
        dt_s = np.where(is_step, (time_ns[then] - time_ns[row]) * 1e-9, np.nan)
        return (position[then] - position[row]) / dt_s[:, None], dt_s

    own, dt_s = velocity(at)
    speed = np.hypot(*own.T)
    changes = [np.hypot(*(own - velocity(at + side)[0]).T) for side in (-1, 1)]
    excess = np.fmin(speed, np.fmin(*changes))
    least_m, usual = (of if each is None else of[at] for of in (least_m, usual))
    return np.asarray(at[(excess * dt_s > least_m) & ((excess > _most(usual, dt_s)) | (speed > FASTEST))])


Place = tuple[float, float]


class _Piece(NamedTuple):
    """Rows of a vehicle without a jump, which rows, when, and where they begin and end."""

    start: int
    end: int
    begin_ns: int
    end_ns: int
    stays: bool
    first: Place
    last: Place


Chain = list[_Piece]
"""Pieces of a vehicle's rows, one after the other, that one body may have driven."""


def _chains(pieces: Sequence[_Piece], least_m: float, usual: float) -> list[Chain]:
    """Each piece behind the one from whose end it is reached best, if it can be."""
    chains, recent = list[Chain](), list[Chain]()
    for piece in pieces:
        reached = dict[int, float]()
        for i, chain in enumerate(recent):
            way_m, dt_s = math.dist(chain[-1].last, piece.first), (piece.begin_ns - chain[-1].end_ns) * 1e-9
            if way_m <= least_m or way_m <= _most(usual, dt_s) * dt_s:
                reached[i] = way_m
        chain = recent.pop(min(reached, key=reached.__getitem__)) if reached else []
        if not chain:
            chains.append(chain)
        chain.append(piece)
        recent = [chain, *recent[: NEAREST - 1]]
    return chains


def _are_detours(chains: list[Chain]) -> list[bool]:
    """Of each chain whether it is one piece, before and after which is the same other chain."""
    pieces = sorted((piece.start, i) for i, chain in enumerate(chains) for piece in chain)
    whose = [-1, *(i for _, i in pieces), -2]
    around = {i: before == after for before, i, after in zip(whose, whose[1:], whose[2:], strict=False)}
    return [len(chain) == 1 and around[i] for i, chain in enumerate(chains)]
