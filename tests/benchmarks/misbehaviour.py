"""Vehicles that do what none did: traffic in which each changes its motion somewhere in its middle.

What a map was learned from says nothing of them, so they show what a filter costs that believes it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.tracks import Tracks

Kind = Literal["stops dead", "creeps", "turns round", "drives against", "jumps"]
KINDS: tuple[Kind, ...] = get_args(Kind)
BRAKES = 6.0
"""m/s^2, of a vehicle that stops dead."""
CREEPS = 0.25
"""Share of its speed that a vehicle keeps which creeps."""
U_TURN_M = 5.0
"""Radius of a turn back."""
JUMP_M = 2.0
LEAST_ROWS = 20
"""Shorter tracks stay as they are."""
EARLIEST, LATEST = 0.3, 0.7
"""Shares of a track between which it happens."""


def misbehaving(tracks: Tracks, *, kind: Kind, rng: np.random.Generator) -> Tracks:
    """The same vehicles, each of which misbehaves once; times, ids and groups stay.

    Args:
        tracks: how they drove.
        kind: "stops dead": brakes by 6 m/s^2 and stands; "creeps": brakes likewise, to a quarter of its speed; "turns
            round": turns back to the left on a circle of 5 m radius and drives back beside its own path; "drives
            against": its whole path in the opposite direction; "jumps": is 2 m to the left from one row to the next,
            and goes on.
        rng: when.

    Raises:
        ValueError: an unknown kind.
    """
    if kind not in KINDS:
        raise ValueError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
    order = np.lexsort((tracks.time_ns, tracks.vehicle))
    position = tracks.position.copy()
    for rows in np.split(order, np.flatnonzero(np.diff(tracks.vehicle[order])) + 1):
        share = rng.uniform(EARLIEST, LATEST)  # drawn for all, so that none depends on another's length
        if rows.size >= LEAST_ROWS:
            time_s = (tracks.time_ns[rows] - tracks.time_ns[rows[0]]) * 1e-9
            position[rows] = _PATHS[kind](time_s, tracks.position[rows], int(share * rows.size))
    return Tracks.from_positions(
        track_id=tracks.track_id, time_ns=tracks.time_ns, position=position, group=tracks.group
    )


def _along(position: FloatArray, way_m: FloatArray) -> FloatArray:
    """Points of a path (n, 2) so many metres (m,) from its first; beyond its end straight on."""
    step = np.hypot(*np.diff(position, axis=0).T)
    so_far = np.concatenate([[0.0], np.cumsum(step)])
    moves = np.concatenate([[True], step > 1e-6])
    points, at = position[moves], so_far[moves]
    if points.shape[0] < 2:
        return np.broadcast_to(position[0], (way_m.size, 2)).copy()
    found = np.column_stack([np.interp(way_m, at, column) for column in points.T])
    last = (points[-1] - points[-2]) / (at[-1] - at[-2])
    return np.asarray(found + np.maximum(way_m - at[-1], 0.0)[:, None] * last)


def _way_m(position: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(position, axis=0).T))])


def _stopped(time_s: FloatArray, position: FloatArray, row: int) -> FloatArray:
    way, speed = _way_m(position), _speed(time_s, position, row)
    since = np.minimum(np.maximum(time_s - time_s[row], 0.0), speed / BRAKES)
    braked = way[row] + speed * since - 0.5 * BRAKES * since**2
    return _along(position, np.where(time_s <= time_s[row], way, braked))


def _crept(time_s: FloatArray, position: FloatArray, row: int) -> FloatArray:
    way, since = _way_m(position), np.maximum(time_s - time_s[row], 0.0)
    share = np.maximum(1.0 - BRAKES * since / max(_speed(time_s, position, row), 1e-9), CREEPS)
    return _along(position, np.concatenate([[0.0], np.cumsum(share[1:] * np.diff(way))]))


def _turned_round(time_s: FloatArray, position: FloatArray, row: int) -> FloatArray:
    speed = max(_speed(time_s, position, row), 2.0)
    back = position[: row + 1][::-1]
    aside = back + 2.0 * U_TURN_M * _left(back[::-1])[::-1]  # beside the path that it came by
    angle = np.linspace(0.0, np.pi, 30)
    ahead, left = _heading(position, row), _left(position[: row + 1])[-1]
    turn = position[row] + U_TURN_M * (np.sin(angle)[:, None] * ahead + (1.0 - np.cos(angle))[:, None] * left)
    path = np.concatenate([position[: row + 1], turn[1:], aside[1:]])
    way = _way_m(position)
    after = way[row] + speed * (time_s - time_s[row])
    return _along(path, np.where(time_s <= time_s[row], way, after))


def _against(_: FloatArray, position: FloatArray, __: int) -> FloatArray:
    return position[::-1]


def _jumped(_: FloatArray, position: FloatArray, row: int) -> FloatArray:
    moved = position.copy()
    moved[row:] += JUMP_M * _left(position)[row:]
    return moved


def _speed(time_s: FloatArray, position: FloatArray, row: int) -> float:
    before = max(row - 3, 0)
    return float(np.hypot(*(position[row] - position[before])) / max(time_s[row] - time_s[before], 1e-9))


def _heading(position: FloatArray, row: int) -> FloatArray:
    """Unit vector of the way by which it came."""
    back = position[row] - position[: row + 1]
    far = np.flatnonzero(np.hypot(*back.T) > 1.0)
    ahead = back[far[-1]] if far.size else np.array([1.0, 0.0])
    return np.asarray(ahead / np.hypot(*ahead))


def _left(position: FloatArray) -> FloatArray:
    """(n, 2) unit vectors to the left of a path, metre by metre."""
    ahead = np.array([_heading(position, i) for i in range(len(position))])
    return np.column_stack([-ahead[:, 1], ahead[:, 0]])


_PATHS: dict[Kind, Callable[[FloatArray, FloatArray, int], FloatArray]] = {
    "stops dead": _stopped,
    "creeps": _crept,
    "turns round": _turned_round,
    "drives against": _against,
    "jumps": _jumped,
}
