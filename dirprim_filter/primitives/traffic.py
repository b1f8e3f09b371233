"""Where the vehicles of a map are, where trips begin and end, and how they pass on: a Markov chain of manoeuvres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.special import gammaincinv

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.motion import Motion
from tessellation import Tessellation

STEP_S = 0.1
"""Seconds, the longest step; visits that were shorter count as long: then no step empties a manoeuvre twice."""
PAUSE_S, N_LONG_STEPS = 100.0, 100
"""What lasts longer takes so many implicit steps instead, which may be of any length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Traffic:
    """Traffic of one vehicle on average, as in the map's log.

    A manoeuvre of n visits and s seconds has traffic in proportion to s. If a of the visits followed another and b
    went on to another, n - a trips began with it and n - b ended. The expected vehicles u of N on the map follow
    du/dt = N begins + flow u. As many come as go: `later` keeps `present`.

    Attributes:
        present: (z,) probability that a vehicle of the map is in each manoeuvre.
        begins: (z,) 1/s, trips that begin in each.
        ends: (z,) 1/s, rate at which trips end in a manoeuvre's cell and mode, where more do than chance explains.
        flow: (z, z) 1/s, from the column's manoeuvre to the row's; on the diagonal minus the rate at which visits end.
        cell: (z,) of each, ascending.
        tessellation: the cells.
    """

    present: FloatArray
    begins: FloatArray
    ends: FloatArray
    flow: csr_array
    cell: IntArray
    tessellation: Tessellation

    @classmethod
    def of(cls, tessellation: Tessellation, motion: Motion) -> Self | None:
        """From the manoeuvres of places and the transitions between them; None without such transitions."""
        n, every = motion.n_placed, np.arange(motion.n_placed, dtype=np.int32)
        cell, mode, visits = motion.cell[:n], motion.mode[:n], motion.visits[:n]
        source = np.repeat(every, np.diff(motion.first[: n + 1]))
        placed = motion.following[: source.size] < n
        source, target = source[placed], motion.following[: placed.size][placed].astype(np.int32)
        times = motion.count[: placed.size][placed]
        if not times.sum() > 0:
            return None
        lasted_s = np.maximum(motion.seconds[:n], STEP_S * visits)
        total_s, per_second = float(lasted_s.sum()), _inverse(lasted_s)
        begun = np.maximum(visits - np.bincount(target, times, n), 0.0)
        ended = np.maximum(visits - np.bincount(source, times, n), 0.0)
        _, place = np.unique(cell * (mode.max(initial=0) + np.int64(1)) + mode, return_inverse=True)
        rate = np.append(times * per_second[source], -visits * per_second)
        where = (np.append(target, every), np.append(source, every))
        return cls(
            present=lasted_s / total_s, begins=begun / total_s,
            ends=_certain_ends(*(np.bincount(place, of).astype(np.float64) for of in (ended, lasted_s)))[place],
            flow=csr_array((rate, where), shape=(n, n)), cell=cell, tessellation=tessellation,
        )  # fmt: skip

    def later(self, share: FloatArray, dt_s: float) -> FloatArray:
        """(z,) -> (z,) vehicles in each manoeuvre after `dt_s`, those that began their trip since included."""
        if dt_s > PAUSE_S:
            from scipy.sparse.linalg import splu  # noqa: PLC0415 - most logs have no such pause

            step_s = dt_s / N_LONG_STEPS
            implicit = splu(eye_array(share.size, format="csc") - step_s * self.flow.tocsc())
            for _ in range(N_LONG_STEPS):
                share = implicit.solve(share + step_s * self.begins)
            return np.maximum(share, 0.0)
        n_steps = int(np.ceil(dt_s / STEP_S))
        for _ in range(n_steps):
            share = share + dt_s / n_steps * (self.begins + self.flow @ share)
        return np.maximum(share, 0.0)

    def density(self, share: FloatArray, position: FloatArray, *, spread_m: float) -> FloatArray:
        """(z,), (n, 2) -> (n,) vehicles per square metre, averaged over a Gaussian about each position (cubature)."""
        off = spread_m * np.sqrt(2.0) * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        in_cell, area = np.bincount(self.cell, share, self.tessellation.n_cells), self.tessellation.area
        per_area = np.append(np.divide(in_cell, area, out=np.zeros(area.size), where=area > 0), 0.0)  # `OUTSIDE`: last
        return np.asarray(per_area[self.tessellation.cell_of(position[:, None] + off)].mean(axis=1))


def _certain_ends(n: FloatArray, seconds: FloatArray) -> FloatArray:
    """(p,) 1/s, by which each place's rate of ends, n in so many seconds, certainly exceeds that of all.

    A log that itself ends cuts off trips wherever they are. The rate of a place is the lower limit of the 95 % interval
    of a Poisson rate (Garwood 1936).
    """
    least = np.where(n > 0, gammaincinv(np.maximum(n, 1e-9), 0.025), 0.0)
    return np.asarray(np.maximum(least * _inverse(seconds) - n.sum() / seconds.sum(), 0.0))


def _inverse(seconds: FloatArray) -> FloatArray:
    return np.divide(1.0, seconds, out=np.zeros(seconds.size), where=seconds > 0)
