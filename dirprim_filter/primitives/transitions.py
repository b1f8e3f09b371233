"""Which mode a vehicle takes up when it comes from a mode of the cell beside: the interactions between cells.

Senanayake et al. 2020 name them as future work. A junction's cell cannot tell from direction and speed alone who will
turn; which mode of the cell before a vehicle comes from often can.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.distributions.angles import difference
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import TrackRows
from tessellation.arrays import FloatArray, IntArray

SUB_STEPS = 4
STRENGTH = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Transitions:
    """CSR"""

    start: IntArray  # (n_cells + 2,)
    target: IntArray  # (E,)
    probability: FloatArray  # (E, M, M)
    leave: FloatArray  # (n_cells + 1, M) 1/s
    goal: FloatArray  # (n_cells + 1, M, K) probability of each goal

    @classmethod
    def none(cls, n_cells, m):
        return cls(start=np.zeros(n_cells + 2, np.int64), target=np.empty(0, np.int64), goal=np.ones((n_cells + 1, m, 1)), probability=np.empty((0, 1, m, m)), leave=np.zeros((n_cells + 1, m)))


import os
K = int(os.environ.get("K", "8"))
GS = float(os.environ.get("GS", "0.5"))


def goals_of(rows):
    """(n_vehicles,) which cluster of ends each vehicle's track ends in."""
    last = np.flatnonzero(np.append(np.diff(rows.vehicle) != 0, True))
    end, veh = rows.position[last], rows.vehicle[last]
    centers = [end.mean(0)]
    d = np.hypot(*(end - centers[0]).T)
    centers = [end[d.argmax()]]
    d = np.hypot(*(end - centers[0]).T)
    while len(centers) < min(K, len(end)):
        centers.append(end[d.argmax()])
        d = np.minimum(d, np.hypot(*(end - centers[-1]).T))
    c = np.array(centers)
    for _ in range(20):
        label = np.hypot(end[:, None, 0] - c[:, 0], end[:, None, 1] - c[:, 1]).argmin(1)
        for k in range(len(c)):
            if (label == k).any():
                c[k] = end[label == k].mean(0)
    out = np.zeros(veh.max() + 1, np.int64); out[veh] = label
    return out, len(c)


def learn_transitions(primitive_map: PrimitiveMap, rows: TrackRows) -> Transitions:
    label, n_goals = goals_of(rows)
    n, m = primitive_map.direction.weight.shape
    dt = np.diff(rows.time_ns) * 1e-9
    pair = np.flatnonzero((np.diff(rows.vehicle) == 0) & (dt > 0) & (dt < 0.6))
    # interpolate
    f = (np.arange(SUB_STEPS + 1) / SUB_STEPS)
    pos = rows.position[pair][:, None] * (1 - f)[:, None] + rows.position[pair + 1][:, None] * f[:, None]
    turn = difference(rows.direction[pair + 1], rows.direction[pair])
    near = f < 0.5
    d = np.where(np.abs(turn)[:, None] < 1.0, rows.direction[pair][:, None] + turn[:, None] * f, np.where(near, rows.direction[pair][:, None], rows.direction[pair + 1][:, None]))
    s = rows.speed[pair][:, None] * (1 - f) + rows.speed[pair + 1][:, None] * f
    cell = primitive_map.tessellation.cell_of(pos)
    direction, speed = primitive_map.primitive_at(pos.reshape(-1, 2))
    own = m - primitive_map.n_place_free_modes
    lat = np.stack([lateral(primitive_map, primitive_map.anchor, cell.ravel(), np.full(cell.size, q), pos.reshape(-1, 2)) for q in range(m)], axis=1)
    wide = primitive_map.lane[cell.ravel()]
    log_p = -0.5 * (lat / wide) ** 2 - np.log(np.where(np.isfinite(wide), wide, 1.0)) + direction.mode_log_density(d.ravel()) + speed.log_density(np.maximum(s.ravel(), 1e-3)[:, None])
    mode = log_p[:, :own].argmax(axis=1).reshape(cell.shape)
    veh = np.repeat(rows.vehicle[pair], SUB_STEPS)
    a, b = cell[:, :-1].ravel(), cell[:, 1:].ravel()
    i, j = mode[:, :-1].ravel(), mode[:, 1:].ravel()
    sub_s = np.repeat(dt[pair] / SUB_STEPS, SUB_STEPS)
    switch = (a == b) & (a >= 0) & (i != j)
    here = (a == b) & (a >= 0)
    time = np.zeros((n, m)); np.add.at(time, (a[here], i[here]), sub_s[here])
    n_switch = np.zeros((n, m)); np.add.at(n_switch, (a[switch], i[switch]), 1.0)
    stands = np.zeros(m, bool); stands[own - 1] = True
    leave = np.zeros((n, m))
    for kind in (stands, ~stands):
        g = (n_switch[:, kind].sum() + 1e-3) / (time[:, kind].sum() + 1e-2)
        leave[:, kind] = (n_switch[:, kind] + 2.0 * g) / (time[:, kind] + 2.0)
    leave = np.minimum(leave, 5.0)
    gk = np.unique(np.column_stack([a, i, label[veh], veh])[a >= 0], axis=0)
    gc = np.zeros((n, m, n_goals)); np.add.at(gc, (gk[:, 0], gk[:, 1], gk[:, 2]), 1.0)
    of_cell = gc.sum(axis=1, keepdims=True) + 0.1
    of_cell /= of_cell.sum(axis=2, keepdims=True)
    goal = (gc + 0.3 * of_cell) / (gc.sum(axis=2, keepdims=True) + 0.3)
    cross = ((a != b) & (a >= 0) & (b >= 0)) | switch
    key = np.unique(np.column_stack([a, b, i, j, veh])[cross], axis=0)
    a, b, i, j = key[:, 0], key[:, 1], key[:, 2], key[:, 3]
    edges, e = np.unique(np.column_stack([a, b]), axis=0, return_inverse=True)
    of_goal = np.zeros((len(edges), n_goals, m, m))
    np.add.at(of_goal, (e, label[key[:, 4]], i, j), 1.0)
    count = of_goal.sum(axis=1)
    w = np.zeros((n, m)); w[:, :own] = primitive_map.direction.weight[:, :own]
    w /= np.maximum(w.sum(axis=1, keepdims=True), 1e-12)
    to = count.sum(axis=1) # (E, M) into j from any i
    base = (to + STRENGTH * w[edges[:, 1]]) / (to.sum(1, keepdims=True) + STRENGTH)
    p = (count + STRENGTH * base[:, None, :]) / (count.sum(axis=2, keepdims=True) + STRENGTH)
    inside = edges[:, 0] == edges[:, 1]
    p[inside] *= 1.0 - np.eye(m)
    p /= np.maximum(p.sum(axis=2, keepdims=True), 1e-300)
    p = (of_goal + GS * p[:, None]) / (of_goal.sum(axis=3, keepdims=True) + GS)
    return Transitions(goal=goal, leave=leave, start=np.searchsorted(edges[:, 0], np.arange(n + 1)).astype(np.int64), target=edges[:, 1].astype(np.int64), probability=p)


def lateral(primitive_map, anchor, cell, mode, position):
    """(n,) metres left of the mode's line."""
    c = primitive_map.centers[cell]
    b = primitive_map.bend[cell, mode]
    a = anchor[cell, mode]
    mid = 0.5 * (a + position) - c
    mu = primitive_map.direction.mean_direction[cell, mode] + (b * mid).sum(-1)
    off = position - a
    return -off[..., 0] * np.sin(mu) + off[..., 1] * np.cos(mu)


def learn_lanes(primitive_map, rows):
    n, m = primitive_map.direction.weight.shape
    own = m - primitive_map.n_place_free_modes
    cell = primitive_map.tessellation.cell_of(rows.position)
    direction, speed = primitive_map.primitive_at(rows.position)
    log_p = direction.mode_log_density(rows.direction) + speed.log_density(np.maximum(rows.speed, 1e-3)[:, None])
    mode = log_p[:, :own].argmax(axis=1)
    ok = np.flatnonzero((cell >= 0) & (primitive_map.direction.concentration[cell, mode] > 0))
    c, k, pos = cell[ok], mode[ok], rows.position[ok]
    # one mean per vehicle, so that who waits does not outweigh
    key, inv = np.unique(np.column_stack([c, k, rows.vehicle[ok]]), axis=0, return_inverse=True)
    cnt = np.bincount(inv); px = np.bincount(inv, pos[:, 0]) / cnt; py = np.bincount(inv, pos[:, 1]) / cnt
    c, k = key[:, 0], key[:, 1]; pos = np.column_stack([px, py])
    anchor = np.repeat(primitive_map.centers[:, None], m, axis=1)
    num = np.zeros((n, m)); s = np.zeros((n, m, 2))
    np.add.at(num, (c, k), 1.0); np.add.at(s, (c, k), pos)
    has = num > 0
    anchor[has] = s[has] / num[has][:, None]
    e = lateral(primitive_map, anchor, c, k, pos)
    sq = np.zeros((n, m)); np.add.at(sq, (c, k), e**2)
    typical = np.sqrt((e**2).mean())
    wide = np.append(np.sqrt(primitive_map.tessellation.area) / np.sqrt(12), 0.0)[:, None]
    lane = np.sqrt((sq + 1.0 * wide**2) / (num + 1.0))
    lane[~has] = np.inf
    return anchor, np.maximum(lane, 0.1)


def learn_slip(primitive_map, rows, lead):
    n, m = primitive_map.direction.weight.shape
    own = m - primitive_map.n_place_free_modes
    dt = np.diff(rows.time_ns) * 1e-9
    i = np.flatnonzero((np.diff(rows.vehicle) == 0) & (dt > 0) & (dt < 0.6) & (rows.speed[1:] > 0.5) & (rows.speed[:-1] > 0.5))
    turn = difference(rows.direction[i + 1], rows.direction[i])
    jump = np.abs(turn) > 1.0
    heading = rows.direction[i] + np.where(jump, 0.0, 0.5 * turn)
    way = rows.position[i + 1] - rows.position[i]
    along = way[:, 0] * np.cos(heading) + way[:, 1] * np.sin(heading)
    side = -way[:, 0] * np.sin(heading) + way[:, 1] * np.cos(heading) - np.where(jump, 0.0, lead * turn)
    slip = np.arctan2(side, along)
    cell = primitive_map.tessellation.cell_of(rows.position[i])
    direction, speed = primitive_map.primitive_at(rows.position[i])
    log_p = direction.mode_log_density(rows.direction[i]) + speed.log_density(np.maximum(rows.speed[i], 1e-3)[:, None])
    mode = log_p[:, :own].argmax(axis=1)
    ok = (cell >= 0) & (np.hypot(*way.T) > 0.05)
    cell, mode, slip, veh = cell[ok], mode[ok], slip[ok], rows.vehicle[i][ok]
    key, inv = np.unique(np.column_stack([cell, mode, veh]), axis=0, return_inverse=True)
    cnt = np.bincount(inv); c = np.bincount(inv, np.cos(slip)) / cnt; s = np.bincount(inv, np.sin(slip)) / cnt
    C, S = np.zeros((n, m)), np.zeros((n, m))
    np.add.at(C, (key[:, 0], key[:, 1]), c); np.add.at(S, (key[:, 0], key[:, 1]), s)
    return np.arctan2(S, C + 1.0)


def learn_speed_rates(primitive_map, rows, i, j, dt, fallback):
    n, m = primitive_map.direction.weight.shape
    from dirprim_filter.primitives.relaxation import _deviations
    cell = primitive_map.tessellation.cell_of(rows.position)
    _, z, mode = _deviations(primitive_map, rows, cell)
    ok = np.isfinite(z[i]) & np.isfinite(z[j])
    i, j = i[ok], j[ok]
    b, a = np.clip(z[i], -4, 4), np.clip(z[j], -4, 4)
    zz, z2 = np.zeros((n, m)), np.zeros((n, m))
    np.add.at(zz, (cell[i], mode[i]), a * b); np.add.at(z2, (cell[i], mode[i]), b * b)
    rho = np.exp(-fallback * dt)
    rho = np.clip((zz + 20 * rho) / (z2 + 20), 0.02, 0.99)
    return -np.log(rho) / dt
