"""Motion from cell to cell: the manoeuvres of each mode, and the transitions between manoeuvres.

A mode holds the direction and speed of vehicles in a cell; its *manoeuvres* separate those that continue differently:
vehicles that leave a roundabout at the next exit, or that brake for the line. Senanayake et al. 2020 name interactions
between cells as future work: here they are counts of transitions from manoeuvre to manoeuvre.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from dirprim_filter.arrays import FloatArray, IntArray, as_floats
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.leader import LeaderResponse

CREEP = 0.3
"""m/s, added to speeds before their logarithm is taken, so that slow vehicles are similar."""
COURSE_RATE = 2.0
"""1/s: rate at which deviations from courses decay where no log says it."""
PUSH_RATE = 0.5
"""1/s: rate at which a vehicle's own acceleration decays."""
JUMP_S = 1.0
"""Seconds after which a background vehicle may change its manoeuvre."""
LAGS = 16
"""Multiples of it after which a background vehicle's manoeuvre says nothing."""
PUSHED_SHARE = 0.85
"""Of the variance of a vehicle's own acceleration, what its mean over a second has at `PUSH_RATE`."""
REVERSION = 0.2
"""1/s, reversion of the speed to its mode's where there are no visits."""
ANYWHERE_PUSH, ANYWHERE_TURNING = 1.0, 0.2
"""m/s^2, and radians in the square root of a second: background motion without a log."""
START_RATE = 0.1
"""1/s: rate at which standing vehicles start, without a log."""
WIDE_M = 3.0
"""Metres: spread across the path where it is not known, about a lane."""
ASSUMED_VISITS = 100.0
"""Visits of a cell whose vehicles were not counted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Manoeuvres in order of their cells; the background ones are last.

    Linear fields are of the offset from the cell's centre, metres east and north.

    Attributes:
        cell: (z,) ascending; -1 for the background manoeuvres, which come last.
        mode: (z,) which column of the map's modes.
        visits: (z,) how many were seen.
        seconds: (z,) how long they lasted together.
        course: (z,) radians, at the centre; of no meaning where `start_rate` is positive or the cell is -1.
        bend: (z, 2) rad/m, its field.
        course_spread: (z,) radians between vehicles; of background manoeuvres radians in the square root of a second.
        log_pace: (z,) log of speed + 0.3 m/s, at the centre.
        gain: (z, 2) 1/m, its field.
        log_pace_spread: (z,).
        path: (z, 3) offset of the path to the left: coefficients of 1, u and u^2 along the mode's mean direction.
        path_spread: (z,) metres.
        path_direction: (z,) radians, direction of `u`.
        acceleration: (z, 4) m/s^2 by 1, metres east, metres north, m/s of the vehicle's speed.
        push: (z,) m/s^2, standard deviation of a vehicle's own acceleration beside that.
        stretch: (z,) distance driven over the integral of speed, less 1: speedometers and curbs differ by place.
        start_rate: (z,) 1/s, rate at which standing vehicles start; 0 for manoeuvres in motion.
        turn_ahead: (z,) radians by which vehicles have turned `AHEAD_S` later.
        curvature: (z,) 1/m, of background manoeuvres; the others turn by their bend.
        first: (z + 1,) transitions of manoeuvre z are those from first[z] to first[z + 1].
        following: (t,) the manoeuvre that followed: in the next cell, or of background ones `JUMP_S` later.
        count: (t,) how often.
        background_visits: pseudo-count of the background's manoeuvres against those of a cell.
        course_rate: 1/s, rate at which a vehicle's deviation from the course of its manoeuvre decays.
        leader: the response to leaders; None where it was not learned, or improves no prediction.

    Raises:
        ValueError: columns of different lengths, numbers that are not finite, amounts below zero, or transitions to
            nowhere.
    """

    cell: IntArray
    mode: IntArray
    visits: FloatArray
    seconds: FloatArray
    course: FloatArray
    bend: FloatArray
    course_spread: FloatArray
    log_pace: FloatArray
    gain: FloatArray
    log_pace_spread: FloatArray
    path: FloatArray
    path_spread: FloatArray
    path_direction: FloatArray
    acceleration: FloatArray
    push: FloatArray
    stretch: FloatArray
    start_rate: FloatArray
    turn_ahead: FloatArray
    curvature: FloatArray
    first: IntArray
    following: IntArray
    count: FloatArray
    background_visits: float = 1.0
    course_rate: float = COURSE_RATE
    leader: LeaderResponse | None = None

    def __post_init__(self) -> None:
        n = self.cell.size
        for name in FLOATS:
            shape = f"{n} {WIDE[name]}" if name in WIDE else f"{n}"
            object.__setattr__(self, name, as_floats(name, getattr(self, name), shape))
        if self.mode.shape != (n,) or self.first.shape != (n + 1,) or self.following.shape != self.count.shape:
            raise ValueError(
                f"mode, first, following, count: expected ({n},), ({n + 1},) and two of one length, got "
                f"{self.mode.shape}, {self.first.shape}, {self.following.shape} and {self.count.shape}"
            )
        placed = self.cell[self.cell >= 0]
        if n < placed.size + 2 or (np.diff(placed) < 0).any() or (self.cell[placed.size :] != -1).any():
            raise ValueError("cell: expected cells in ascending order, then -1 for two background manoeuvres at least")
        ordered = self.first[0] == 0 and self.first[-1] == self.following.size and (np.diff(self.first) >= 0).all()
        if not ordered or ((self.following < 0) | (self.following >= n)).any():
            raise ValueError(f"first, following: expected transitions to manoeuvres 0 to {n - 1}")
        object.__setattr__(self, "count", as_floats("count", self.count, f"{self.following.size}"))
        for name in AMOUNTS:
            if (getattr(self, name) < 0).any():
                raise ValueError(f"{name}: expected no negative numbers, got {getattr(self, name).min()}")
        for name in ("background_visits", "course_rate"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name}: expected a positive number, got {getattr(self, name)}")

    def __len__(self) -> int:
        return self.cell.size

    @property
    def n_placed(self) -> int:
        """Number of manoeuvres that are of a cell."""
        return int(np.count_nonzero(self.cell >= 0))

    def wander(self) -> tuple[FloatArray, FloatArray]:
        """By how much the background's vehicles change their velocity, along and across their course.

        Returns:
            (2,) m^2/s^3, the density of what is white: pushes, and turns by chance; and (`LAGS`, 2) m^2/s^4, the
            covariance of what manoeuvres accelerate and turn now with that of multiples of `JUMP_S` later, 0 first.
        """
        free = np.s_[self.n_placed :]
        share = self.seconds[free] / max(self.seconds[free].sum(), 1e-9)
        speed = np.where(self.start_rate[free] == 0.0, np.exp(self.log_pace[free]) - CREEP, 0.0)
        white = share @ np.column_stack(
            [2.0 * self.push[free] ** 2 / PUSH_RATE, (speed * self.course_spread[free]) ** 2]
        )
        gained = self.acceleration[free, 0] + self.acceleration[free, 3] * speed
        kept = np.column_stack([gained, speed**2 * self.curvature[free]])
        counts = csr_array((self.count, self.following, self.first), shape=(len(self), len(self)))[free, free]
        chain = counts.toarray() + 1e-9
        chain, later, lasting = chain / chain.sum(axis=1, keepdims=True), kept, []
        for _ in range(LAGS):
            lasting.append(share @ (kept * later))
            later = chain @ later
        return white, np.array(lasting)

    def without_places(self) -> Motion:
        """The background manoeuvres alone."""
        n = self.n_placed
        columns = {name: getattr(self, name)[n:] for name in (*FLOATS, "cell", "mode")}
        first = self.first[n:] - self.first[n]
        following, count = self.following[self.first[n] :] - n, self.count[self.first[n] :]
        return replace(self, **columns, first=first, following=following, count=count)

    @classmethod
    def settling(cls, modes: Modes, n_own: int) -> Self:
        """Motion by primitives alone: one manoeuvre for each mode, to which vehicles revert.

        The spread of the acceleration is what keeps the speed's variance that of the mode's gamma. (n_cells + 1, M).
        """
        at = np.nonzero(modes.weight[:-1, :n_own])
        own, free = modes.take(at), modes.take(-1)
        pace, visits, n = own.shape / own.rate, ASSUMED_VISITS * own.weight, own.weight.size
        moving = float(free.weight[free.shape / free.rate >= CREEP].sum())
        anyhow = unlearned_background(share=moving, standing=float(free.weight.sum()) - moving, start_rate=START_RATE)
        placed = {
            "cell": at[0], "mode": at[1], "visits": visits, "seconds": visits, "course": own.mean_direction,
            "bend": own.bend, "course_spread": np.minimum(1.0 / np.sqrt(np.maximum(own.concentration, 1e-9)), 2.0),
            "log_pace": np.log(pace + CREEP), "gain": own.gain * (pace / (pace + CREEP))[:, None],
            "log_pace_spread": np.sqrt(1.0 / own.shape), "path_spread": np.full(n, WIDE_M),
            "path_direction": own.mean_direction,
            "acceleration": REVERSION * np.column_stack([pace, pace[:, None] * own.gain, np.full(n, -1.0)]),
            "push": np.sqrt(pace**2 / own.shape * REVERSION * (REVERSION + PUSH_RATE)),
            "start_rate": np.where(pace < CREEP, START_RATE, 0.0),
        }  # fmt: skip
        return cls(
            **joined(placed, anyhow), first=np.zeros(n + len(anyhow["cell"]) + 1, np.int64),
            following=np.empty(0, np.int64), count=np.empty(0),
        )  # fmt: skip


FLOATS = tuple(f.name for f in fields(Motion) if f.type == "FloatArray" and f.name != "count")
"""Columns of floats, a row for each manoeuvre."""
WIDE = {"bend": 2, "gain": 2, "path": 3, "acceleration": 4}
"""How many numbers a row of them has; one in the others."""
AMOUNTS = (
    "visits", "seconds", "course_spread", "log_pace_spread", "path_spread", "push", "start_rate", "count",
)  # fmt: skip
"""Columns that are nowhere negative."""


def joined(one: dict[str, FloatArray], other: dict[str, FloatArray]) -> dict[str, Any]:
    """Columns of manoeuvres, one after the other; what one does not have is 0 there."""

    def column(part: dict[str, FloatArray], name: str) -> FloatArray:
        n = part["cell"].size
        return part[name] if name in part else np.zeros((n, WIDE[name]) if name in WIDE else n)

    return {name: np.concatenate([column(one, name), column(other, name)]) for name in (*FLOATS, "cell", "mode")}


def unlearned_background(*, share: float, standing: float, start_rate: float) -> dict[str, FloatArray]:
    """Background manoeuvres where no log says how vehicles move: straight on, or standing."""
    return background_manoeuvres(
        share=[share], log_pace=[0.0], log_pace_spread=[1.0], acceleration=[[0.0, 0.0]], push=[ANYWHERE_PUSH],
        turning=[ANYWHERE_TURNING], curvature=[0.0], standing=standing, start_rate=start_rate,
    )  # fmt: skip


def background_manoeuvres(
    *, share: npt.ArrayLike, log_pace: npt.ArrayLike, log_pace_spread: npt.ArrayLike, acceleration: npt.ArrayLike,
    push: npt.ArrayLike, turning: npt.ArrayLike, curvature: npt.ArrayLike, standing: float, start_rate: float,
) -> dict[str, FloatArray]:  # fmt: skip
    """Manoeuvres of no place: k in motion, and then that of vehicles that stand.

    Args:
        share: (k,) how often vehicles move like each.
        log_pace: (k,) log of speed + 0.3 m/s.
        log_pace_spread: (k,).
        acceleration: (k, 2) m/s^2, by 1 and m/s of the vehicle's speed.
        push: (k,) m/s^2.
        turning: (k,) radians in the square root of a second.
        curvature: (k,) 1/m, positive to the left.
        standing: how often they stand.
        start_rate: 1/s.
    """
    amount = np.append(share, max(standing, 1e-3))
    n = amount.size
    gained = np.zeros((n, 4))
    gained[:-1, [0, 3]] = np.reshape(np.asarray(acceleration, np.float64), (n - 1, 2))
    return {
        "cell": np.full(n, -1), "mode": np.zeros(n, np.int64), "visits": amount, "seconds": amount,
        "course_spread": np.append(turning, 0.0), "log_pace": np.append(log_pace, np.log(CREEP)),
        "log_pace_spread": np.append(log_pace_spread, 1.0), "path_spread": np.full(n, WIDE_M), "acceleration": gained,
        "push": np.append(push, 0.0), "start_rate": np.append(np.zeros(n - 1), start_rate),
        "curvature": np.append(curvature, 0.0),
    }  # fmt: skip
