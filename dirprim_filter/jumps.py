"""Steps that no body can make: placeholders, outliers, and ids that several vehicles have.

What a body can do is judged by accelerations, and by how fast, how noisy and how frequent the log's own rows are, so
people, cars, boats and aircraft are judged alike. The scale is that of neighbours in time, not of consecutive rows
alone: jumps do not enter it, even if every second row is another vehicle's.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise

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
"""Rows so far apart are neighbours; so many vehicles of one id are told apart at once."""
SAMPLED = 20_000
"""Rows that the scale is estimated from."""
LEAST_ROWS = 3
"""A part of fewer rows is no vehicle of its own."""
MOST_JUMPS = 100_000
"""More are not sorted out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """How a log's vehicles usually move, by a sample of its rows; zeros where no vehicle has two.

    Attributes:
        speed: m/s, which a tenth of the rows exceed.
        noise: metres from a row to the straight line between rows before and after, in the median.
        interval_s: seconds between a vehicle's rows, in the median.
        n_steps: of the sample.
        straightness: length of a way across some rows by that of its steps, in the median; NaN where nothing moves.
    """

    speed: float
    noise: float
    interval_s: float
    n_steps: int
    straightness: float

    @classmethod
    def of(cls, vehicle: IntArray, time_ns: IntArray, position: FloatArray) -> Scale:
        """Of rows in order of vehicle and time, none of which repeats another."""
        row, last = np.arange(0, vehicle.size, 1 + vehicle.size // SAMPLED), vehicle.size - 1
        speed, off, ways = (np.full((NEAREST, row.size), np.nan) for _ in range(3))
        for lag in range(NEAREST):
            before, after = np.maximum(row - lag - 1, 0), np.minimum(row + lag + 1, last)
            near = np.flatnonzero((vehicle[after] == vehicle[row]) & (after > row + lag))
            there, here = after[near], row[near]
            way, passed = position[there] - position[here], time_ns[there] - time_ns[here]
            speed[lag, near], ways[lag, near] = np.hypot(*way.T) / (passed * 1e-9), np.hypot(*way.T)
            inside = near[(before[near] < here - lag) & (vehicle[before[near]] == vehicle[here])]
            ends = time_ns[before[inside]], time_ns[after[inside]]
            share = ((time_ns[row[inside]] - ends[0]) / (ends[1] - ends[0]))[:, None]
            between = position[before[inside]] * (1.0 - share) + position[after[inside]] * share
            off[lag, inside] = np.hypot(*(position[row[inside]] - between).T)
            if lag == 0:
                interval_s = float(np.median(passed)) * 1e-9 if near.size else 0.0
        straight = ways[-1, ways[0] > 0] / (NEAREST * ways[0, ways[0] > 0])
        return cls(
            speed=_best(speed, 0.9), noise=_best(off, 0.5), interval_s=interval_s,
            n_steps=int(np.isfinite(speed[0]).sum()),
            straightness=float(np.nanmedian(straight)) if np.isfinite(straight).any() else np.nan,
        )  # fmt: skip

    def beside(self, other: Scale) -> Scale:
        """That of the two of larger speed and noise."""
        return replace(self, speed=max(self.speed, other.speed), noise=max(self.noise, other.noise))

    @property
    def least_m(self) -> float:
        """What is shorter is no jump."""
        return max(STEPS * max(self.speed, SLOWEST) * self.interval_s, NOISES * self.noise)

    def most(self, dt_s: FloatArray) -> FloatArray:
        """m/s, by which a velocity may differ from the one `dt_s` seconds before."""
        usual = max(self.speed, SLOWEST)
        return np.minimum(np.minimum(ACCELERATION * dt_s, TIMES_USUAL * usual) + 0.5 * usual, FASTEST)


def _best(of_lags: FloatArray, share: float) -> float:
    """A quantile of the rows, each at its best lag."""
    best = np.fmin.reduce(of_lags)
    known = best[np.isfinite(best)]
    return float(np.quantile(known, share)) if known.size else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Jumps:
    """What is wrong with where vehicles are said to be.

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
        left_out, part = np.zeros(vehicle.size, np.bool_), np.zeros(vehicle.size, np.int64)
        at = _jumps(vehicle, time_ns, position, scale)
        whole = cls(at=at, left_out=left_out, part=part)
        if not 0 < at.size <= MOST_JUMPS:
            return whole
        found = list[tuple[list[Chain], float]]()
        numbers = np.unique(vehicle[at])
        ends = np.searchsorted(vehicle, numbers), np.searchsorted(vehicle, numbers, side="right")
        for first, end in zip(*(of.tolist() for of in ends), strict=True):
            rows = slice(first, end)
            own = scale.beside(Scale.of(vehicle[rows], time_ns[rows], position[rows]))
            cuts = first + 1 + _jumps(vehicle[rows], time_ns[rows], position[rows], own)
            if cuts.size:
                found.append((_chains([first, *cuts.tolist(), end], time_ns, position, own), own.least_m))
        whole._mark(found, position)
        return whole

    def _mark(self, found: list[tuple[list[Chain], float]], position: FloatArray) -> None:
        """What is left out, and the parts of the rest, of the chains of some vehicles, and their least jumps."""
        pieces = [piece for chains, _ in found for chain in chains for piece in chain]
        places = {piece: place for piece in pieces if (place := _only_place(piece, position))}
        n_at = Counter(places.values())
        nowhere = {piece for piece, (x, y) in places.items() if x == y or n_at[x, y] > 1}
        for chains, least_m in found:
            number = 0
            for chain, is_detour in zip(chains, _are_detours(chains), strict=True):
                rows = [np.arange(*piece) for piece in chain if piece not in nowhere]
                own = number
                if is_detour or sum(map(len, rows)) < LEAST_ROWS:
                    rows = []
                elif (start := chain[0][0]) > chains[0][0][0] and not self.left_out[start - 1]:
                    way_m = float(np.hypot(*(position[start] - position[start - 1])))
                    own = int(self.part[start - 1]) if way_m < TIMES_APART * least_m else number
                for piece in chain:
                    self.left_out[slice(*piece)] = True
                for of_piece in rows:
                    self.left_out[of_piece], self.part[of_piece] = False, own
                number += bool(rows) and own == number


def _jumps(vehicle: IntArray, time_ns: IntArray, position: FloatArray, scale: Scale) -> IntArray:
    """(j,) rows from which no body comes to the next one, as far as its steps before and after say."""
    dt_s = np.where(np.diff(vehicle) == 0, np.diff(time_ns) * 1e-9, np.nan)
    velocity = np.diff(position, axis=0) / dt_s[:, None]
    change, nothing = np.hypot(*np.diff(velocity, axis=0).T), [np.nan] * min(1, dt_s.size)
    speed = np.hypot(*velocity.T)
    excess = np.fmin(speed, np.fmin(np.append(nothing, change), np.append(change, nothing)))
    is_far = excess * dt_s > scale.least_m
    return np.flatnonzero(is_far & ((excess > scale.most(dt_s)) | (speed > FASTEST)))


Chain = list[tuple[int, int]]
"""Pieces of a vehicle's rows, from and to, one after the other, that one body may have driven."""


def _chains(cuts: list[int], time_ns: IntArray, position: FloatArray, scale: Scale) -> list[Chain]:
    """The pieces between cuts, each behind the one from whose end it is reached best, if it can be."""
    chains: list[Chain] = []
    recent: list[Chain] = []
    for start, end in pairwise(cuts):
        ended = np.array([chain[-1][1] - 1 for chain in recent], np.int64)
        dt_s = (time_ns[start] - time_ns[ended]) * 1e-9
        way_m = np.hypot(*(position[start] - position[ended]).T)
        able = (way_m <= scale.least_m) | (way_m <= scale.most(dt_s) * dt_s)
        if able.any():
            chain = recent.pop(int(np.argmin(np.where(able, way_m, np.inf))))
        else:
            chain = []
            chains.append(chain)
        chain.append((start, end))
        recent = [chain, *recent[: NEAREST - 1]]
    return chains


def _are_detours(chains: list[Chain]) -> list[bool]:
    """Of each chain whether it is one piece, before and after which is the same other chain."""
    pieces = sorted((start, i) for i, chain in enumerate(chains) for start, _ in chain)
    whose = [-1, *(i for _, i in pieces), -2]
    around = {i: before == after for before, i, after in zip(whose, whose[1:], whose[2:], strict=False)}
    return [len(chain) == 1 and around[i] for i, chain in enumerate(chains)]


def _only_place(piece: tuple[int, int], position: FloatArray) -> tuple[float, float] | None:
    """Where all rows of a piece are, if at one place."""
    x, y = position[piece[0]].tolist()
    return (x, y) if (position[slice(*piece)] == (x, y)).all() else None
