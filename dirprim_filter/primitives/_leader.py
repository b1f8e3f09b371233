"""Compiled: the leader of a particle, and the particle's response to it.

The leader is the nearest vehicle on the arc that the particle is about to drive, going in about the same direction.
"""

import math
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray, read_only
from dirprim_filter.primitives._manoeuvres import BEND_E, BEND_N, CURVATURE, STANDING_BELOW, STARTS, MotionTable
from dirprim_filter.primitives.leader import N_FEATURES, N_PACES
from tessellation._compiling import compiled

FAR_M, NEAR_M = 60.0, 0.5
"""Metres ahead: a vehicle farther away is no leader; a nearer one is the vehicle itself, or beside it."""
HALF_LANE_M = 1.75
SAME_WAY = 0.5
"""Cosine of the angle up to which two vehicles drive in the same direction."""
TIGHTEST = 0.1
"""1/m, the largest curvature of the arc."""
QUEUE_M = 7.0
"""Metres from centre to centre in a queue."""
BRAKING, REACTION_S = 0.75, 1.0
"""m/s^2 and seconds: the braking and the reaction time in the safe speed of Gipps."""
SAFE, CLOSING, GAP_M = 12.0, 12.0, 40.0
"""m/s, m/s and metres at which the features saturate."""
HARDEST, STRONGEST = -8.0, 4.0
"""m/s^2: the bounds of the response."""
SLOW = 2.0
"""m/s, below which a leader has just started."""
STARTS_BEHIND_M = 25.0
"""Up to this distance a leader decides whether a standing vehicle starts."""
NO_LEADER = 1e9
"""Metres: the distance of a leader that does not exist."""


class LeaderTable(NamedTuple):
    """A map's response to leaders, as the kernels take it."""

    gain: FloatArray  # (N_FEATURES,)
    push: float
    trust: float
    start_rate: FloatArray  # (3,)


ALONE = LeaderTable(read_only(np.zeros(N_FEATURES)), 0.0, 0.0, read_only(np.zeros(N_PACES)))
"""Of vehicles that go on as if no other vehicle were there."""


@compiled
def behind(
    others: FloatArray, own: int, position: FloatArray, direction: FloatArray, curvature: FloatArray, seen: FloatArray
) -> None:  # fmt: skip
    """Fills (n, 3): metres to each particle's leader, from centre to centre, `NO_LEADER` if none, its speed, and which.

    `others` are place, direction and speed of all vehicles in each particle's scene, (n, m, 4), or in that of all,
    (1, m, 4); number `own` is the particles' own vehicle. `curvature` is of the arc that each is about to drive.
    """
    one_scene = len(others) == 1
    for p in range(direction.size):
        w = 0 if one_scene else p
        c, s, bend = math.cos(direction[p]), math.sin(direction[p]), curvature[p]
        nearest, speed, leader = FAR_M, 0.0, -1
        for j in range(others.shape[1]):
            dx, dy = others[w, j, 0] - position[p, 0], others[w, j, 1] - position[p, 1]
            ahead = c * dx + s * dy
            if j == own or ahead < NEAR_M or ahead >= nearest:
                continue
            if abs(c * dy - s * dx - 0.5 * bend * ahead * ahead) > HALF_LANE_M:
                continue
            same = math.cos(others[w, j, 2] - direction[p] - bend * ahead)
            if same > SAME_WAY:
                nearest, speed, leader = ahead, same * others[w, j, 3], j
        seen[p, 0], seen[p, 1], seen[p, 2] = nearest if leader >= 0 else NO_LEADER, speed, leader


@compiled
def ahead_of_each(state: FloatArray, first: IntArray, seen: FloatArray, feature: FloatArray) -> None:
    """Fills (n, 3), see `behind`: the leader, straight on, of each vehicle of each instant, see `Instants`.

    And (n, N_FEATURES), see `describe`.
    """
    n, none = len(state), np.int64(-1)  # no literal, nor parts of rows: `behind` would be compiled once more
    straight, position, direction = np.empty(n), np.empty((n, 2)), np.empty(n)
    for j in range(n):
        position[j, 0], position[j, 1], direction[j], straight[j] = state[j, 0], state[j, 1], state[j, 2], 0.0
    for i in range(first.size - 1):
        a, b = first[i], first[i + 1]
        others = state[a:b].reshape((1, b - a, 4))
        behind(others, none, position[a:b], direction[a:b], straight[a:b], seen[a:b])
        for j in range(a, b):
            seen[j, 2] += a
            describe(state[j, 3], seen[j, 0], seen[j, 1], feature[j])


@compiled
def bends(table: MotionTable, manoeuvre: IntArray, direction: FloatArray, curvature: FloatArray) -> None:
    """Fills (n,) 1/m: the arc that each particle is about to drive, by its manoeuvre."""
    for p in range(direction.size):
        row, z = table.row, manoeuvre[p]
        bend = row[z, BEND_E] * math.cos(direction[p]) + row[z, BEND_N] * math.sin(direction[p]) + row[z, CURVATURE]
        curvature[p] = 0.0 if row[z, STARTS] > 0.0 else min(max(bend, -TIGHTEST), TIGHTEST)


@compiled
def describe(speed: float, gap: float, leader: float, feature: FloatArray) -> None:
    """Fills (N_FEATURES,) the features of a driver's situation.

    The main one is how much faster it could drive and still stop behind a leader that brakes (Gipps 1981).
    """
    free = max(gap - QUEUE_M, 0.0)
    reach = BRAKING * REACTION_S
    safe = math.sqrt(reach * reach + leader * leader + 2.0 * BRAKING * free) - reach
    room, closing = min(max(safe - speed, -SAFE), SAFE), min(max(leader - speed, -CLOSING), CLOSING)
    feature[0], feature[1], feature[2], feature[3] = 1.0, room, max(room, 0.0), max(room - 4.0, 0.0)
    feature[4], feature[5], feature[6], feature[7] = speed, closing, room * speed, closing * speed
    feature[8], feature[9] = speed * speed, min(free, GAP_M)


@compiled
def respond(table: LeaderTable, speed: FloatArray, push: FloatArray, seen: FloatArray, led: FloatArray) -> None:
    """Fills (n, 3), see `_motion.move`, from speeds, pushes and leaders, (n,), (n,) and (n, 3)."""
    feature = np.empty(N_FEATURES)
    for p in range(speed.size):
        led[p, 0], led[p, 1], led[p, 2] = 0.0, 1.0, 0.0
        gap, leader = seen[p, 0], seen[p, 1]
        if gap >= (STARTS_BEHIND_M if speed[p] < STANDING_BELOW else FAR_M):
            continue
        describe(speed[p], gap, leader, feature)
        gained = 0.0
        for i in range(N_FEATURES):
            gained += table.gain[i] * feature[i]
        gained = min(max(gained, HARDEST), STRONGEST) + table.push * push[p]
        led[p, 0], led[p, 1] = table.trust * gained, 1.0 - table.trust
        pace = (leader >= STANDING_BELOW) + (leader >= SLOW)  # it stands, has just started, or drives
        led[p, 2] = table.trust * table.start_rate[pace]
