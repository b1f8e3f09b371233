"""Where the vehicles of a map are, where journeys begin and end, and how they pass on: a Markov chain of manoeuvres."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import csr_array
from scipy.special import gammaincinv

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from tessellation import OUTSIDE, Tessellation

STEP_S = 0.1
"""Seconds, the longest step; visits that were shorter count as long: then no step empties a manoeuvre twice."""


class Passages(NamedTuple):
    """How vehicles passed from manoeuvre to manoeuvre; columns as of `Motion`."""

    cell: IntArray  # (z,) those of a cell alone
    mode: IntArray  # (z,)
    visits: FloatArray  # (z,)
    seconds: FloatArray  # (z,)
    first: IntArray  # (z + 1,)
    following: IntArray  # (t,)
    count: FloatArray  # type: ignore[assignment]  # (t,), not the method of tuples


@dataclass(frozen=True, slots=True, kw_only=True)
class Traffic:
    """Traffic of one vehicle on average, as in the map's log.

    A manoeuvre of n visits and s seconds holds traffic in proportion to s. If a of the visits followed another and b
    went on to another, n - a journeys began with it and n - b ended. As many come as go: `later` keeps `present`.

    Attributes:
        present: (z,) probability that a vehicle of the map is in each manoeuvre.
        begins: (z,) 1/s, journeys that begin in each.
        ends: (z,) 1/s, rate at which journeys end in its cell and mode, where more do than chance explains.
        flow: (z, z) 1/s, from the column's manoeuvre to the row's; on the diagonal minus the rate at which visits end.
        cell: (z,) of each, ascending.
        area: (c,) square metres, of each cell.
        center: (c, 2) metres, of each.
        tessellation: what positions are located in: the cells, or a part of them.
        number: (n + 1,) which cells its n cells are; last, `OUTSIDE`.
    """

    present: FloatArray
    begins: FloatArray
    ends: FloatArray
    flow: csr_array
    cell: IntArray
    area: FloatArray
    center: FloatArray
    tessellation: Tessellation
    number: IntArray

    @classmethod
    def of(cls, primitive_map: PrimitiveMap) -> Traffic | None:
        """Of a map with places, of a part that of the whole; None where it has none, or counted no transitions."""
        if primitive_map.part is not None:
            return primitive_map.part.traffic
        of, n = primitive_map.motion, primitive_map.motion.n_placed
        passages = Passages(
            of.cell[:n], of.mode[:n], of.visits[:n], of.seconds[:n], of.first[: n + 1], of.following, of.count
        )
        cells = primitive_map.tessellation
        return cls.counted(passages, cells.area, cells.centers, cells, np.arange(cells.n_cells))

    @classmethod
    def counted(
        cls, of: Passages, area: FloatArray, center: FloatArray, tessellation: Tessellation, number: IntArray
    ) -> Self | None:
        """Of what was counted in cells (c,), (c, 2), some of which can be located; None where no transition was."""
        n, visits = of.cell.size, of.visits
        source = np.repeat(np.arange(n, dtype=np.int32), np.diff(of.first))  # half the memory of larger numbers
        target, count = of.following[: source.size], of.count[: source.size]
        placed = target < n
        source, target, count = source[placed], target[placed].astype(np.int32, copy=False), count[placed]
        if not count.sum() > 0:
            return None
        seconds = np.maximum(of.seconds, STEP_S * visits)
        present = seconds / seconds.sum()
        per_second = np.divide(1.0, seconds, out=np.zeros(n), where=seconds > 0)
        arrived, gone_on = np.bincount(target, count, n), np.bincount(source, count, n)
        _, place = np.unique(of.cell * (of.mode.max() + np.int64(1)) + of.mode, return_inverse=True)
        every = np.arange(n, dtype=np.int32)
        where = (np.append(target, every), np.append(source, every))
        rate = np.append(count * per_second[source], -visits * per_second)
        return cls(
            present=present, begins=np.maximum(visits - arrived, 0.0) / seconds.sum(),
            ends=_rate_beyond_chance(np.maximum(visits - gone_on, 0.0), seconds, place),
            flow=csr_array((rate, where), shape=(n, n)), cell=of.cell,
            area=area, center=center, tessellation=tessellation, number=np.append(number, OUTSIDE),
        )  # fmt: skip

    def located_in(self, tessellation: Tessellation, number: IntArray) -> Self:
        """The same traffic; positions are looked up in some of the cells, `number` (n,) says in which."""
        return replace(self, tessellation=tessellation, number=np.append(number, OUTSIDE))

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
        cell = self.number[self.tessellation.cell_of(position[:, None] + off)]
        asked, of = np.unique(cell, return_inverse=True)
        begin, end = (np.searchsorted(self.cell, asked, side=side) for side in ("left", "right"))
        there = [share[i:j] for i, j in zip(begin.tolist(), end.tolist(), strict=True)]
        in_cell = np.bincount(np.repeat(np.arange(asked.size), end - begin), np.concatenate(there), asked.size)
        area = np.where(asked == OUTSIDE, 0.0, self.area[asked])
        per_area = np.divide(in_cell, area, out=np.zeros(asked.size), where=area > 0)
        return np.asarray(per_area[of].reshape(cell.shape).mean(axis=1))


def _rate_beyond_chance(ended: FloatArray, seconds: FloatArray, place: IntArray) -> FloatArray:
    """(z,) 1/s, by which each place's rate of ends certainly exceeds that of all; `place` (z,) numbers them.

    A log that itself ends cuts off journeys wherever they are. The rate of a place is the lower limit of the 95 %
    interval of a Poisson rate (Garwood 1936).
    """
    n, s = np.bincount(place, ended), np.bincount(place, seconds)
    least = np.where(n > 0, gammaincinv(np.maximum(n, 1e-9), 0.025), 0.0)
    rate = np.divide(least, s, out=np.zeros(n.size), where=s > 0)
    return np.asarray(np.maximum(rate - n.sum() / s.sum(), 0.0)[place])
