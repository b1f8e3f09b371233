"""What turns with the hour: how many vehicles drive each mode of a cell, and how fast; all else is of all day.

Its slots are the hours of the day, or of the week from Monday on, by the clocks of a time zone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta, tzinfo
from typing import TYPE_CHECKING, Literal, get_args
from zoneinfo import ZoneInfo

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray, as_floats
from dirprim_filter.distributions import Gamma, VonMisesMixture, von_mises
from dirprim_filter.distributions.von_mises_mixture import log_weights
from dirprim_filter.primitives.motion import CREEP, Motion

if TYPE_CHECKING:
    from dirprim_filter.primitives.primitive_map import PrimitiveMap

HOUR_NS = 3600 * 10**9
By = Literal["hour", "week"]
N_SLOTS: dict[str, int] = dict(zip(get_args(By), (24, 168), strict=True))
MONDAY = 72
"""Hours from a Monday to the first Thursday, which 1970-01-01 was."""
STEPS_AHEAD = 16
"""Cells further ahead say nothing of the manoeuvre here, which tells vehicles apart by where they are 30 m on."""
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """How a map turns with the hour.

    Attributes:
        by: "hour" of the day, or of the "week".
        zone: whose clocks say the hour, such as Europe/Berlin.
        flow: (n_slots, n_cells, m) vehicles of each of a cell's own modes, over as many as all day has one expect.
        pace: (n_slots, n_cells, m) their mean speed over that of all day.

    Raises:
        ValueError: slots or a zone that do not exist, or numbers that are not positive.
    """

    by: By
    zone: str
    flow: FloatArray
    pace: FloatArray

    def __post_init__(self) -> None:
        if self.by not in N_SLOTS:
            raise ValueError(f"by: expected one of {', '.join(N_SLOTS)}, got {self.by!r}")
        _zone(self.zone)
        shape = f"{N_SLOTS[self.by]} cells m"
        for name in ("flow", "pace"):
            column = as_floats(name, getattr(self, name), shape)
            if column.shape != self.flow.shape or (column <= 0).any():
                raise ValueError(f"{name}: expected positive numbers, as many as of flow, got {column.shape}")
            object.__setattr__(self, name, column)

    def slots_of(self, time_ns: IntArray) -> IntArray:
        """(n,) the slots of times, nanoseconds since 1970-01-01. (n,)."""
        return slots_of(local_hours(time_ns, self.zone), self.by)

    def applied(self, primitives: PrimitiveMap, slot: int) -> PrimitiveMap:
        """The map in a slot: the same cells, modes and manoeuvres, with that slot's weights and speeds."""
        return replace(turned(primitives, self.flow[slot], self.pace[slot]), schedule=None)


def turned(primitives: PrimitiveMap, flow: FloatArray, pace: FloatArray) -> PrimitiveMap:
    """The map with other weights and mean speeds of its cells' own modes.

    A borrowed mode turns as the cell's own that it resembles most. What the place-free modes weigh in a cell, and how
    often its manoeuvres were seen together, stays.

    Args:
        primitives: the map.
        flow: (n_cells, m) vehicles of each mode, over as many as the map has one expect.
        pace: (n_cells, m) their mean speed over that of the map.
    """
    weight, rate = primitives.direction.weight.copy(), primitives.speed.rate.copy()
    of_mode = np.hstack([np.tile(np.arange(primitives.n_own_modes), (len(pace), 1)), _resembled(primitives)])
    placed = (slice(None, -1), slice(of_mode.shape[1]))
    drawn = weight[placed] * np.take_along_axis(flow, of_mode, axis=1)
    total = drawn.sum(axis=1, keepdims=True)
    weight[placed] = drawn * np.divide(weight[placed].sum(axis=1, keepdims=True), total, out=total, where=total > 0)
    rate[placed] /= np.take_along_axis(pace, of_mode, axis=1)
    direction = primitives.direction
    return replace(
        primitives,
        direction=VonMisesMixture(
            weight=weight, mean_direction=direction.mean_direction, concentration=direction.concentration
        ),
        speed=Gamma(shape=primitives.speed.shape, rate=rate),
        motion=_turned(primitives.motion, flow, pace),
    )


def _resembled(primitives: PrimitiveMap) -> IntArray:
    """(n_cells, n_borrowed_modes) the own mode of greatest density at the means of each borrowed one."""
    n, end = primitives.n_own_modes, primitives.n_own_modes + primitives.n_borrowed_modes
    direction, speed = primitives.direction, primitives.speed
    weight, mean, concentration, shape, rate = (
        column[:-1, None, :n]
        for column in (direction.weight, direction.mean_direction, direction.concentration, speed.shape, speed.rate)
    )
    log_p = log_weights(weight) + Gamma(shape=shape, rate=rate).log_density(speed.mean[:-1, n:end, None])
    log_p += von_mises.log_density(direction.mean_direction[:-1, n:end, None], mean, concentration)
    return np.asarray(log_p.argmax(axis=-1), np.int64)


def local_hours(time_ns: IntArray, zone: str) -> IntArray:
    """(n,) full hours since 1970-01-01, 0:00, by the clocks of a zone. (n,) nanoseconds.

    Raises:
        ValueError: there is no such zone.
    """
    clocks = _zone(zone)
    hour, of = np.unique(np.asarray(time_ns, np.int64) // HOUR_NS, return_inverse=True)
    moments = [(EPOCH + timedelta(hours=h)).astimezone(clocks) for h in hour.tolist()]
    ahead_s = np.array([(moment.utcoffset() or timedelta()).total_seconds() for moment in moments])
    return np.asarray((np.asarray(time_ns, np.int64) // 10**9 + ahead_s[of].astype(np.int64)) // 3600)


def slots_of(local_hour: IntArray, by: By) -> IntArray:
    """(n,) the slots of hours by the clock. (n,)."""
    return local_hour % N_SLOTS["hour"] if by == "hour" else (local_hour + MONDAY) % N_SLOTS["week"]


def _zone(name: str) -> tzinfo:
    try:
        return UTC if name == "UTC" else ZoneInfo(name)  # UTC also where the system has no list of zones
    except (ValueError, OSError, KeyError) as error:  # ZoneInfoNotFoundError is a KeyError
        raise ValueError(f"zone: expected the name of a time zone such as Europe/Berlin, got {name!r}") from error


def _turned(motion: Motion, flow: FloatArray, pace: FloatArray) -> Motion:
    """Manoeuvres as fast as their modes, and as frequent as these and those that follow them.

    A vehicle that drives a way f times as fast accelerates f^2 times as much on it, beside its way back to the mean.
    """
    n = motion.n_placed
    faster = np.append(pace[motion.cell[:n], motion.mode[:n]], np.ones(len(motion) - n))
    speed = np.exp(motion.log_pace) - CREEP
    acceleration = motion.acceleration * np.column_stack([faster**2] * 3 + [np.ones(len(motion))])
    acceleration[:, 0] += motion.acceleration[:, 3] * speed * (faster**2 - faster)
    source = np.repeat(np.arange(len(motion)), np.diff(motion.first))
    share = np.append(_flow_of_manoeuvres(motion, flow), np.ones(len(motion) - n))
    return replace(
        motion,
        visits=_shared_out(motion.visits, share, motion.cell),
        seconds=_shared_out(motion.seconds, share, motion.cell),
        log_pace=np.where(faster == 1.0, motion.log_pace, np.log(np.maximum(faster * speed, 0.0) + CREEP)),
        acceleration=acceleration,
        count=_shared_out(motion.count, share[motion.following], source),
    )


def _flow_of_manoeuvres(motion: Motion, flow: FloatArray) -> FloatArray:
    """(n_placed,) a mode's flow is that of its manoeuvres together; of these each as much as what follows it has."""
    n = motion.n_placed
    source = np.repeat(np.arange(n), np.diff(motion.first[: n + 1]))
    on = motion.following[: source.size] < n
    source, following, count = source[on], motion.following[: on.size][on], motion.count[: on.size][on]
    gone_on = np.bincount(source, count, n)
    _, mode = np.unique(np.column_stack([motion.cell[:n], motion.mode[:n]]), axis=0, return_inverse=True)
    visits, of_mode = np.bincount(mode, motion.visits[:n]), flow[motion.cell[:n], motion.mode[:n]]
    found = of_mode
    for _ in range(STEPS_AHEAD):
        ahead = np.divide(
            np.bincount(source, count * found[following], n), gone_on, out=of_mode.copy(), where=gone_on > 0
        )
        mean = np.bincount(mode, motion.visits[:n] * ahead) / np.maximum(visits, 1e-9)
        found = of_mode * ahead / np.maximum(mean[mode], 1e-9)
    return found


def _shared_out(amount: FloatArray, share: FloatArray, of: IntArray) -> FloatArray:
    """(n,) amounts in other shares, as much as before in each of `of`, which numbers them from -1 on."""
    before, after = (np.bincount(of + 1, column) for column in (amount, amount * share))
    return amount * share * np.divide(before, after, out=np.ones(before.size), where=after > 0)[of + 1]
