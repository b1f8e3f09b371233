"""Vehicles that do what none did: known traffic, changed where no map can expect it.

Each vehicle keeps its times and what it did before; afterwards it leaves its own motion in one of `KINDS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.tracks import Tracks

LEAST_S = 15.0
"""Of a vehicle's track; of a shorter one little would be left before or after."""
MIDDLE = (0.3, 0.6)
"""Of a vehicle's time, in which it begins to misbehave."""
MOVING_FROM = 2.0
"""m/s: so fast it is then."""
BRAKING, CREEPING = 6.0, 0.25
"""m/s^2, and the share of its own speed at which a vehicle creeps."""
RADIUS_M, TURNING, STARTING = 5.0, 4.0, 2.0
"""Of a turn: metres, the highest speed in it, m/s, and the acceleration after it, m/s^2."""
JUMP_M = 2.0


def misbehaving(tracks: Tracks, *, kind: str, rng: np.random.Generator) -> Tracks:
    """The same traffic, in which each vehicle that is seen for long enough misbehaves from a random moment on.

    Args:
        tracks: the traffic; vehicles of less than `LEAST_S`, and those that stand in their `MIDDLE`, stay as they are.
        kind: `stop`: brakes at 6 m/s^2 and stays; `creep`: brakes to a quarter of its speed and goes on so; `turn`:
            brakes, turns round to the left on 5 m of radius and drives back beside its own path, until that ends;
            `against`: drives all its path from its end to its beginning; `jump`: is 2 m to the left or right from one
            row to the next, and goes on parallel.
        rng: when, and to which side. What a vehicle does depends on no other's length.

    Returns:
        Tracks whose courses and speeds are those of the positions; a jump is no motion. Headings that are no longer
        known are left out.

    Raises:
        ValueError: another kind.
    """
    if kind not in KINDS:
        raise ValueError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
    if not len(tracks):
        return tracks
    vehicle = tracks.vehicle
    parts = []
    for rows in np.split(np.argsort(vehicle, kind="stable"), np.cumsum(np.bincount(vehicle))[:-1]):
        when, side = rng.random(2)
        track = tracks[rows]
        time_s = _seconds(track)
        middle = (time_s >= MIDDLE[0] * time_s[-1]) & (time_s <= MIDDLE[1] * time_s[-1])
        starts = np.flatnonzero(middle & (track.speed >= MOVING_FROM))
        if time_s[-1] >= LEAST_S and starts.size:
            track = KINDS[kind](track, int(starts[int(when * starts.size)]), side)
        parts.append(track)
    return Tracks.concatenate(parts)


def _slower(track: Tracks, start: int, *, share: float) -> Tracks:
    """From a row on at a share of the vehicle's own speed, on its own path."""
    time_s, way = _seconds(track), _lengths(track.position)
    own = np.gradient(way, time_s)
    braked = own[start] - BRAKING * (time_s - time_s[start])
    driven = np.minimum(_driven(way, time_s, np.maximum(share * own, braked), start), way[-1])
    return _at(track, _along(way, track.position, driven))


def _turned(track: Tracks, start: int) -> Tracks:
    """Round to the left, and back; as it was where its path ends before it has braked."""
    time_s, way, left = _seconds(track), _lengths(track.position), _left(track)
    fast = float(np.gradient(way, time_s)[start])
    slow = min(fast, TURNING)
    turn_at = way[start] + (fast**2 - slow**2) / (2.0 * BRAKING)
    if turn_at > way[-1]:
        return track
    there = np.append(way[way < turn_at], turn_at)
    place, side = _along(way, track.position, there), _along(way, left, there)
    side /= np.hypot(*side.T)[:, None]
    angle = np.linspace(0.0, np.pi, 33)[1:, None]
    ahead = np.array([side[-1, 1], -side[-1, 0]])
    arc = place[-1] + RADIUS_M * (side[-1] * (1.0 - np.cos(angle)) + ahead * np.sin(angle))
    path = np.concatenate([place, arc, (place + 2.0 * RADIUS_M * side)[-2::-1]])
    since_s = time_s - time_s[start]
    turned_s = (fast - slow) / BRAKING + np.pi * RADIUS_M / slow
    after = np.minimum(slow + STARTING * np.maximum(since_s - turned_s, 0.0), fast)
    speed = np.maximum(fast - BRAKING * since_s, after)
    driven, length = _driven(way, time_s, speed, start), _lengths(path)
    here = driven <= length[-1]
    return _at(track[here], _along(length, path, driven[here]))


def _reversed(track: Tracks) -> Tracks:
    time_s = _seconds(track)
    return _at(track, _along(time_s, track.position, time_s[-1] - time_s))


def _jumped(track: Tracks, start: int, side: float) -> Tracks:
    parallel = _at(track, track.position + np.copysign(JUMP_M, side - 0.5) * _left(track))
    return Tracks.concatenate([track[:start], parallel[start:]])


KINDS: Mapping[str, Callable[[Tracks, int, float], Tracks]] = {
    "stop": lambda track, start, _: _slower(track, start, share=0.0),
    "creep": lambda track, start, _: _slower(track, start, share=CREEPING),
    "turn": lambda track, start, _: _turned(track, start),
    "against": lambda track, _, __: _reversed(track),
    "jump": _jumped,
}


def _seconds(track: Tracks) -> FloatArray:
    return np.asarray((track.time_ns - track.time_ns[0]) * 1e-9, np.float64)


def _left(track: Tracks) -> FloatArray:
    """(n, 2) unit vectors to the left of the course."""
    return np.column_stack([-np.sin(track.direction), np.cos(track.direction)])


def _lengths(path: FloatArray) -> FloatArray:
    """(n,) metres from the first of the points (n, 2)."""
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))


def _driven(way: FloatArray, time_s: FloatArray, speed: FloatArray, start: int) -> FloatArray:
    """(n,) metres: as they were up to a row, then the integral of the speed (n,)."""
    steps = 0.5 * (speed[start:-1] + speed[start + 1 :]) * np.diff(time_s[start:])
    return np.concatenate([way[: start + 1], way[start] + np.cumsum(steps)])


def _along(known: FloatArray, points: FloatArray, at: FloatArray) -> FloatArray:
    """(m, 2) points (n, 2), known at ascending numbers (n,), interpolated at others (m,)."""
    return np.column_stack([np.interp(at, known, column) for column in points.T])


def _at(track: Tracks, position: FloatArray) -> Tracks:
    """The rows elsewhere (n, 2); courses and speeds follow."""
    return Tracks.from_positions(
        track_id=track.track_id, time_ns=track.time_ns, position=position, group=track.group, size=track.size
    )
