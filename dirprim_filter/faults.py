"""Faults of observed motion: wrong units, vehicles that drive backwards or jump, or that are copies of others.

Learning and scoring take a log of tracks for the truth, so its faults enter both. Two vehicles cannot be at one place:
two that stay within `COPY_M` for a second are one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.track_ids import qualified_names

if TYPE_CHECKING:
    from dirprim_filter.tracks import Tracks

BACKWARDS_M = 3.0
"""A vehicle that loses so much of its way, measured along its own heading, drove backwards."""
JUMP_M = 3.0
"""So far from where it was bound a vehicle comes by no acceleration, but by a jump; more, where its noise is large."""
JUMP_ACCELERATION = 15.0
"""m/s^2, more than which no vehicle accelerates."""
MANY_DEVIATIONS = 8.0
"""A jump is so many times the median of a vehicle's own second differences."""
MAX_STEP_S = 2.0
"""Across a longer pause nothing is known of the path between."""
COPY_M = 0.05
"""Two that are so near each other are one vehicle."""
MOST_ABREAST = 100
"""Of more vehicles that stand in one line north to south, not all are compared."""
COPY_S = 1.0
"""Seconds that two vehicles share a place at the same instants."""
MOVING_FROM = 1.0
"""m/s: the distance that standing vehicles drive says nothing of units."""
COMPARED_S, LONGEST_S = 2.0, 4.0
"""Stated speeds and courses are compared with the way between rows so far apart: noise is small beside it."""
LEAST_COMPARED, LEAST_SHARED = 20, 3
UNLIKE_RATIO, UNLIKE_ANGLE = 1.6, np.pi / 6
"""Of the distance by speeds to that by positions, or its inverse; and radians between courses, in the median."""
UNITS = {3.6: "km/h", 2.237: "mph", 3.281: "ft/s", 1.944: "knots"}
"""By how much larger their numbers are than those of m/s."""
UNIT_SHARE = 0.06
DEGREES_PER_M = 1e-4
"""Positions by which all go so much less than by their speeds are degrees: of latitude 1e-5 are 1.1 m."""
SMALL_M = 0.5
"""Three vehicles have no room in so small a square."""
SHOWN = 6
"""Ids listed in a line; the others are counted."""


def find_faults(tracks: Tracks) -> list[str]:
    """A line for each kind of fault that tracks have, with the vehicles' names as by `qualified_names`.

    By sorting, in time that grows little faster than the rows.
    """
    vehicle = tracks.vehicle
    order = np.lexsort((tracks.time_ns, vehicle))
    path = _Path(
        vehicle=vehicle[order], time_ns=tracks.time_ns[order], position=tracks.position[order],
        direction=tracks.body_direction[order], speed=tracks.speed[order], group=tracks.group[order],
    )  # fmt: skip
    if not path.vehicle.size:
        return []
    first = np.searchsorted(path.vehicle, np.arange(path.vehicle[-1] + 1))
    names = qualified_names(tracks.track_id[order][first], path.group[first])
    found = {
        "move against their own heading": _missteps(path, _lost_distance(path), BACKWARDS_M, names),
        "jump": _missteps(path, *_jumps(path), names),
        "are copies of others at the same instants": _copies(path, names),
    }
    lines = [f"vehicles that {what} ({len(of)}): {_few(of)}" for what, of in found.items() if of]
    return _unlike_units(path, tracks.direction[order]) + lines


class _Path(NamedTuple):
    """Rows of tracks by vehicle and time: (n, ...) each."""

    vehicle: IntArray
    time_ns: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    group: IntArray

    def steps(self) -> tuple[FloatArray, BoolArray]:
        """(n - 1,) seconds from each row to the next, and whether that is the same vehicle soon."""
        dt_s = np.diff(self.time_ns) * 1e-9
        return dt_s, (np.diff(self.vehicle) == 0) & (dt_s <= MAX_STEP_S)


def _unlike_units(path: _Path, course: FloatArray) -> list[str]:
    """What does not fit to where vehicles go; (n,) courses over ground. What was derived from positions always fits."""
    if path.vehicle[-1] >= 2 and (np.ptp(path.position, axis=0) < SMALL_M).all():
        return [f"all positions lie within {SMALL_M:g} m: are they degrees? Say latitude and longitude"]
    dt_s, soon = path.steps()
    driven = np.append(0.0, np.cumsum(np.where(soon, dt_s * 0.5 * (path.speed[1:] + path.speed[:-1]), 0.0)))
    breaks = np.append(0, np.cumsum(~soon))
    since_s = (path.time_ns - path.time_ns.min()) * 1e-9
    key = since_s + path.vehicle * (since_s.max() + 2.0 * LONGEST_S)  # ascending, vehicles apart
    later = np.minimum(np.searchsorted(key, key + COMPARED_S), key.size - 1)
    distance = driven[later] - driven
    moves = (breaks[later] == breaks) & (key[later] - key <= LONGEST_S) & (distance >= MOVING_FROM * COMPARED_S)
    if np.count_nonzero(moves) < LEAST_COMPARED:
        return []
    way_m = (path.position[later] - path.position)[moves]
    ratio = float(distance[moves].sum()) / max(float(np.linalg.norm(way_m, axis=1).sum()), 1e-9)
    if ratio > 1.0 / DEGREES_PER_M:
        return ["speeds lead thousands of times as far as positions: are these degrees? Say latitude and longitude"]
    found = []
    if not 1.0 / UNLIKE_RATIO < ratio < UNLIKE_RATIO:
        unit = next((unit for factor, unit in UNITS.items() if abs(ratio / factor - 1.0) < UNIT_SHARE), "another unit")
        found.append(f"speeds lead {ratio:.3g} times as far as positions: are they in {unit} in place of m/s?")
    apart = float(np.median(np.abs(wrap(course[moves] - np.arctan2(way_m[:, 1], way_m[:, 0])))))
    if apart > UNLIKE_ANGLE:
        found.append(
            f"courses and positions are {np.rad2deg(apart):.0f} deg apart in the median: are courses in degrees, or "
            "from north?"
        )
    return found


def _missteps(path: _Path, metres: FloatArray, least: FloatArray | float, names: AnyArray) -> list[str]:
    """The vehicles of which a row has more metres (n,) than is allowed, (n_vehicles,) or alike; and the most."""
    most = np.zeros(names.size)
    np.maximum.at(most, path.vehicle, metres)
    return [f"{names[vehicle]} ({most[vehicle]:.0f} m)" for vehicle in np.flatnonzero(most > least)]


def _lost_distance(path: _Path) -> FloatArray:
    """(n,) metres by which a vehicle is behind the furthest that it came, along its own heading."""
    _, soon = path.steps()
    heading = np.column_stack([np.cos(path.direction), np.sin(path.direction)])
    along = np.einsum("ni,ni->n", np.diff(path.position, axis=0), 0.5 * (heading[1:] + heading[:-1]))
    come = np.concatenate([[0.0], np.cumsum(np.where(soon, along, 0.0))])
    come += path.vehicle * (np.ptp(come) + 1.0)  # so that no vehicle is behind the one before it
    return np.asarray(np.maximum.accumulate(come) - come)


def _jumps(path: _Path) -> tuple[FloatArray, FloatArray]:
    """(n,) metres from where a row was bound by the step before, and (n_vehicles,) how many are a jump.

    What an acceleration within reason does in that time is taken off.
    """
    dt_s, soon = path.steps()
    velocity = np.diff(path.position, axis=0) / np.maximum(dt_s, 1e-9)[:, None]
    short_s = np.minimum(dt_s[1:], dt_s[:-1])
    both = soon[1:] & soon[:-1]
    off = np.where(both, np.linalg.norm(np.diff(velocity, axis=0), axis=1) * short_s, 0.0)
    metres = np.zeros(path.vehicle.size)
    driven = JUMP_ACCELERATION * short_s * np.maximum(dt_s[1:], dt_s[:-1])
    metres[1:-1] = np.where(both, np.maximum(off - driven, 0.0), 0.0)
    n_vehicles = int(path.vehicle[-1]) + 1
    owner = path.vehicle[1:-1][both]
    by_size = np.lexsort((off[both], owner))
    ends = np.searchsorted(owner[by_size], np.arange(n_vehicles + 1))
    middle = off[both][by_size][np.minimum((ends[:-1] + ends[1:]) // 2, max(owner.size - 1, 0))] if owner.size else 0.0
    median = np.where(ends[1:] > ends[:-1], middle, 0.0)
    return metres, np.maximum(JUMP_M, MANY_DEVIATIONS * median)


def _copies(path: _Path, names: AnyArray) -> list[str]:
    """Vehicles that are within `COPY_M` of another, in each axis, for a second."""
    _, instant = np.unique(np.column_stack([path.group, path.time_ns]), axis=0, return_inverse=True)
    near = _near(np.column_stack([path.position, instant.ravel().astype(np.float64)]), path.vehicle)
    pairs, n = np.unique(near, axis=0, return_counts=True)
    dt_s, same = np.diff(path.time_ns) * 1e-9, np.diff(path.vehicle) == 0
    return [
        f"{names[b]} of {names[a]}"
        for (a, b), count in zip(pairs.tolist(), n.tolist(), strict=True)
        if count >= LEAST_SHARED and count * np.median(dt_s[same & (path.vehicle[1:] == a)]) >= COPY_S
    ]


def _near(place: FloatArray, vehicle: IntArray) -> IntArray:
    """(p, 2) numbers of two vehicles, the lesser first, for each row within `COPY_M` of another in each axis.

    In order of instant and east each row is compared with the next ones, as long as any of them is near enough.
    """
    order, near = np.lexsort((place[:, 0], place[:, 2])), [np.empty((0, 2), np.int64)]
    for ahead in range(1, min(len(order), MOST_ABREAST)):
        one, other = order[:-ahead], order[ahead:]
        apart = np.abs(place[other] - place[one])
        abreast = (apart[:, 2] == 0) & (apart[:, 0] <= COPY_M)
        if not abreast.any():
            break
        pairs = np.sort(np.column_stack([vehicle[one], vehicle[other]]), axis=1)
        near.append(pairs[abreast & (apart[:, 1] <= COPY_M) & (pairs[:, 0] != pairs[:, 1])])
    return np.concatenate(near)


def _few(found: list[str]) -> str:
    return ", ".join(found[:SHOWN]) + (f" and {len(found) - SHOWN} more" if len(found) > SHOWN else "")
