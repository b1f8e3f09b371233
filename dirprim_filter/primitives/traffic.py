"""Where the vehicles of a map are, where journeys begin and end, and how they pass on: a Markov chain of manoeuvres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import csr_array
from scipy.special import gammaincinv

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from tessellation import Tessellation

STEP_S = 0.1
"""Seconds, the longest step; visits that were shorter count as long: then no step empties a manoeuvre twice."""
ELSEWHERE = -1
"""A manoeuvre of the map that is not in the part of it."""


class Passages(NamedTuple):
    """How vehicles passed from manoeuvre to manoeuvre of places; columns as of `Motion`."""

    number: IntArray  # (z,) which of the map's manoeuvres these are, ascending
    cell: IntArray  # (z,) ascending
    mode: IntArray  # (z,)
    visits: FloatArray  # (z,)
    seconds: FloatArray  # (z,)
    source: AnyArray  # (t,) which of these each transition is from; int32, half the memory
    target: AnyArray  # (t,) and to; or `ELSEWHERE`
    times: FloatArray  # (t,) how often it happened

    @classmethod
    def of(cls, primitive_map: PrimitiveMap) -> Self:
        """Of all manoeuvres of a whole map."""
        of, n = primitive_map.motion, primitive_map.motion.n_placed
        source = np.repeat(np.arange(n, dtype=np.int32), np.diff(of.first[: n + 1]))
        target = of.following[: source.size]
        placed = target < n
        return cls(
            np.arange(n), of.cell[:n], of.mode[:n], of.visits[:n], of.seconds[:n], source[placed],
            target[placed].astype(np.int32), of.count[: source.size][placed],
        )  # fmt: skip

    @property
    def lasted_s(self) -> FloatArray:
        """(z,) how long visits lasted together, at least `STEP_S` each."""
        return np.maximum(self.seconds, STEP_S * self.visits)

    @property
    def arrived(self) -> FloatArray:
        """(z,) how many visits followed another of these."""
        within = self.target != ELSEWHERE
        return np.asarray(np.bincount(self.target[within], self.times[within], self.cell.size), np.float64)

    def ended(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """(p,), (p,), (z,): visits that nothing followed and seconds in each cell and mode; which of these each is in.

        After what is elsewhere counts as after what is here.
        """
        gone_on = np.bincount(self.source, self.times, self.cell.size)
        _, place = np.unique(self.cell * (self.mode.max(initial=0) + np.int64(1)) + self.mode, return_inverse=True)
        ended, seconds = (np.bincount(place, of) for of in (np.maximum(self.visits - gone_on, 0.0), self.lasted_s))
        return np.asarray(ended, np.float64), np.asarray(seconds, np.float64), np.asarray(place, np.int64)


class Totals(NamedTuple):
    """Sums over a whole map that has traffic: what a part of it cannot add up."""

    n_manoeuvres: int  # of places
    area: float  # square metres, of all cells
    seconds: float  # how long visits lasted
    begun: float  # journeys
    end_rate: float  # 1/s, how often a visit's journey ended with it

    @classmethod
    def of(cls, passages: Passages, tessellation: Tessellation) -> Self | None:
        """Of all passages of a map; None where it counted no transitions."""
        if not passages.times.sum() > 0:
            return None
        ended, seconds, _ = passages.ended()
        return cls(
            passages.cell.size, float(tessellation.area.sum()), float(passages.lasted_s.sum()),
            float(np.maximum(passages.visits - passages.arrived, 0.0).sum()), float(ended.sum() / seconds.sum()),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Traffic:
    """Traffic of one vehicle on average, as in the map's log.

    A manoeuvre of n visits and s seconds holds traffic in proportion to s. If a of the visits followed another and b
    went on to another, n - a journeys began with it and n - b ended. As many come as go: `later` keeps `present`.

    In a part of a map all manoeuvres elsewhere are one more, the last, of no cell: as long as vehicles spread over
    them as in the map's log, the others' vehicles are those of the whole (a lumped chain).

    Attributes:
        present: (z,) probability that a vehicle of the map is in each manoeuvre.
        begins: (z,) 1/s, journeys that begin in each.
        ends: (m,) 1/s, rate at which journeys end in a manoeuvre's cell and mode, where more do than chance explains;
            not of those elsewhere.
        flow: (z, z) 1/s, from the column's manoeuvre to the row's; on the diagonal minus the rate at which visits end.
        cell: (z,) of each, ascending; of those elsewhere the number of cells.
        number: (m,) which of the map's manoeuvres they are, ascending.
        area: (c + 1,) square metres, of each cell; last, of none.
        tessellation: the cells.
        total_area: square metres, of all cells of the map.
    """

    present: FloatArray
    begins: FloatArray
    ends: FloatArray
    flow: csr_array
    cell: IntArray
    number: IntArray
    area: FloatArray
    tessellation: Tessellation
    total_area: float

    @classmethod
    def of(cls, primitive_map: PrimitiveMap) -> Traffic | None:
        """Of a map with places, or of a part of one; None where it has none, or counted no transitions."""
        if primitive_map.part is not None:
            return primitive_map.part.traffic
        passages, cells = Passages.of(primitive_map), primitive_map.tessellation
        totals = Totals.of(passages, cells)
        return None if totals is None else cls._of_all(passages, cells, totals)

    @classmethod
    def _of_all(cls, of: Passages, tessellation: Tessellation, totals: Totals) -> Self:
        n, seconds, every = of.cell.size, of.lasted_s, np.arange(of.cell.size, dtype=np.int32)
        per_second = _inverse(seconds)
        rate = np.append(of.times * per_second[of.source], -of.visits * per_second)
        where = (np.append(of.target, every), np.append(of.source, every))
        return cls(
            present=seconds / totals.seconds, begins=np.maximum(of.visits - of.arrived, 0.0) / totals.seconds,
            ends=_ends(of, totals), flow=csr_array((rate, where), shape=(n, n)), cell=of.cell, number=of.number,
            area=np.append(tessellation.area, 0.0), tessellation=tessellation, total_area=totals.area,
        )  # fmt: skip

    @classmethod
    def of_part(cls, of: Passages, arrived: FloatArray, tessellation: Tessellation, totals: Totals) -> Self:
        """Of some manoeuvres (z,) of a map and its totals; how many of their visits followed any other (z,)."""
        n, seconds, every = of.cell.size, of.lasted_s, np.arange(of.cell.size + 1, dtype=np.int32)
        rest = max(totals.seconds - seconds.sum(), 0.0) if n < totals.n_manoeuvres else 0.0
        lasted = np.append(seconds, rest)
        per_second = _inverse(lasted)
        begun = np.maximum(of.visits - arrived, 0.0)
        begun = np.append(begun, max(totals.begun - begun.sum(), 0.0) if rest > 0 else 0.0)
        goes = of.times[of.target == ELSEWHERE].sum()
        comes = np.maximum(arrived - of.arrived, 0.0)
        source = np.concatenate([of.source, np.full(n, n, np.int32), every])
        target = np.concatenate([np.where(of.target == ELSEWHERE, n, of.target), every[:n], every])
        rate = np.concatenate([of.times, comes, -np.append(of.visits, begun[-1] + goes)]) * per_second[source]
        return cls(
            present=lasted / totals.seconds, begins=begun / totals.seconds, ends=_ends(of, totals),
            flow=csr_array((rate, (target, source)), shape=(n + 1, n + 1)),
            cell=np.append(of.cell, tessellation.n_cells), number=of.number,
            area=np.append(tessellation.area, 0.0), tessellation=tessellation, total_area=totals.area,
        )  # fmt: skip

    def later(self, share: FloatArray, dt_s: float) -> FloatArray:
        """(z,) -> (z,) vehicles in each manoeuvre after `dt_s`, those that began their journey since included."""
        n_steps = int(np.ceil(dt_s / STEP_S))
        for _ in range(n_steps):
            share = share + dt_s / n_steps * (self.begins + self.flow @ share)
        return np.maximum(share, 0.0)

    def density(self, share: FloatArray, position: FloatArray, *, spread_m: float) -> FloatArray:
        """(z,), (n, 2) -> (n,) vehicles per square metre, averaged over a Gaussian about each position (cubature)."""
        if len(position) == 0:
            return np.empty(0)
        off = spread_m * np.sqrt(2.0) * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        cell = self.tessellation.cell_of(position[:, None] + off)
        asked, of = np.unique(cell, return_inverse=True)
        begin, end = (np.searchsorted(self.cell, asked, side=side) for side in ("left", "right"))
        there = [share[i:j] for i, j in zip(begin.tolist(), end.tolist(), strict=True)]
        in_cell = np.bincount(np.repeat(np.arange(asked.size), end - begin), np.concatenate(there), asked.size)
        area = self.area[asked]  # `OUTSIDE` is the last
        per_area = np.divide(in_cell, area, out=np.zeros(asked.size), where=area > 0)
        return np.asarray(per_area[of].reshape(cell.shape).mean(axis=1))


def _ends(of: Passages, totals: Totals) -> FloatArray:
    """(z,) 1/s, by which each place's rate of ends certainly exceeds that of all.

    A log that itself ends cuts off journeys wherever they are. The rate of a place is the lower limit of the 95 %
    interval of a Poisson rate (Garwood 1936).
    """
    n, s, place = of.ended()
    least = np.where(n > 0, gammaincinv(np.maximum(n, 1e-9), 0.025), 0.0)
    rate = np.divide(least, s, out=np.zeros(n.size), where=s > 0)
    return np.asarray(np.maximum(rate - totals.end_rate, 0.0)[place])


def _inverse(seconds: FloatArray) -> FloatArray:
    return np.divide(1.0, seconds, out=np.zeros(seconds.size), where=seconds > 0)
