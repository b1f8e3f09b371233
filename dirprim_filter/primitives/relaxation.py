"""How fast vehicles settle on the primitives, learned from the same vehicle's rows near in time.

The deviation of an Ornstein-Uhlenbeck process is correlated over t as e^{-k t}. Deviations are from the mode of the
place where the vehicle is then: a vehicle that follows a bend has none from a curved mode, but from a flat one it has
the turn of the cell, which passes for a fast rate.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.distributions.angles import difference
from dirprim_filter.primitives.primitive_map import PrimitiveMap, Relaxation
from dirprim_filter.primitives.rows import TrackRows
from tessellation.arrays import BoolArray, FloatArray, IntArray
LAG_S=1.0
MIN_PAIRS = 10
RATES = (0.02, 10.0)
MIN_TURNING = 1e-4
MIN_DRIFT = 0.02
FALLBACK = Relaxation(
    direction_rate=0.5,
    speed_rate=0.2,
    mode_rate=0.1,
    place_free_turning=0.05,
    place_free_speed_rate=0.05,
    drift=0.01,
)


def pairs_at(rows, lag_s):
    axis = rows.vehicle * (rows.time_ns.max() - rows.time_ns.min() + 10**10) + rows.time_ns - rows.time_ns.min()
    j = np.searchsorted(axis, axis + int((lag_s - 0.05) * 1e9))
    j = np.minimum(j, len(rows) - 1)
    ok = (rows.vehicle[j] == rows.vehicle) & (np.abs((rows.time_ns[j] - rows.time_ns) * 1e-9 - lag_s) < 0.3 * lag_s) & (j > np.arange(len(rows)))
    i = np.flatnonzero(ok)
    return i, j[i]


def learn_relaxation(primitive_map: PrimitiveMap, rows: TrackRows, *, standing_speed: float) -> Relaxation:
    moving = rows.speed >= standing_speed
    i, j = pairs_at(rows, 0.2)
    i1, j1 = pairs_at(rows, LAG_S)
    m = moving[i] & moving[j]; i, j = i[m], j[m]
    m = moving[i1] & moving[j1]; i1, j1 = i1[m], j1[m]
    if i1.size < MIN_PAIRS:
        return FALLBACK
    dt = (rows.time_ns[j1] - rows.time_ns[i1]) * 1e-9
    # lead: lateral displacement against turn
    turn = difference(rows.direction[j], rows.direction[i])
    middle = rows.direction[i] + 0.5 * turn
    way = rows.position[j] - rows.position[i]
    lateral = -way[:, 0] * np.sin(middle) + way[:, 1] * np.cos(middle)
    near = (np.abs(turn) < 0.5) & (np.abs(lateral) < 2.0)
    lead = float((lateral * turn)[near].sum() / max((turn**2)[near].sum(), 1e-9))
    rest = lateral[near] - lead * turn[near]
    # only if it explains
    cell = primitive_map.tessellation.cell_of(rows.position)
    dturn, ratio, mode = _deviations(primitive_map, rows, cell)
    in_cell = np.flatnonzero((cell[i] == cell[j]) & (cell[i] >= 0))
    stays = float((mode[i][in_cell] == mode[j][in_cell]).mean()) if in_cell.size else 1.0
    from_mean = rows.speed - rows.speed[moving].mean()
    turned1 = difference(rows.direction[j1], rows.direction[i1])
    drift = _drift(rows, i1, j1, lead)
    rel = Relaxation(
        direction_rate=_rate(dturn, i1, j1, dt.mean(), FALLBACK.direction_rate),
        speed_rate=_rate(ratio, i1, j1, dt.mean(), FALLBACK.speed_rate),
        mode_rate=float(np.clip(-np.log(max(stays, 1e-3)) / 0.2, *RATES)),
        place_free_turning=max(float(np.mean(turned1**2)) / dt.mean(), MIN_TURNING),
        place_free_speed_rate=_rate(from_mean, i1, j1, dt.mean(), FALLBACK.place_free_speed_rate),
        drift=drift,
        lead=lead,
    )
    return rel


def _deviations(
    primitive_map: PrimitiveMap, rows: TrackRows, cell: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    direction, speed = primitive_map.primitive_at(rows.position)
    log_p = direction.mode_log_density(rows.direction) + speed.log_density(rows.speed[:, None])
    mode = np.asarray(log_p.argmax(axis=-1), dtype=np.int64)
    at = np.arange(len(rows)), mode
    draws = (direction.concentration[at] > 0) & (cell >= 0)
    turn = np.where(draws, difference(rows.direction, direction.mean_direction[at])*np.sqrt(direction.concentration[at]), np.nan)
    gain = np.where(draws, (rows.speed / speed.mean[at]-1)*np.sqrt(speed.shape[at]), np.nan)
    return turn, gain, mode


def _rate(deviation, i, j, step_s: float, fallback: float) -> float:
    before, after = deviation[i], deviation[j]
    both = np.isfinite(before) & np.isfinite(after)
    if both.sum() < MIN_PAIRS:
        return fallback
    b, a = np.clip(before[both], -4, 4), np.clip(after[both], -4, 4)
    spread = np.sqrt(float((b**2).sum()) * float((a**2).sum()))
    correlation = float((b * a).sum()) / max(spread, 1e-12)
    return float(np.clip(-np.log(max(correlation, 1e-3)) / step_s, *RATES))


def _drift(rows: TrackRows, i, j, lead) -> float:
    d = rows.direction
    heading = np.column_stack([np.cos(d), np.sin(d)])
    axle = rows.position - lead * heading
    v = rows.speed[:, None] * heading
    n = len(rows)
    dt = np.diff(rows.time_ns, append=rows.time_ns[-1]) * 1e-9
    step = np.zeros((n, 2)); step[:-1] = 0.5 * (v[:-1] + v[1:]) * dt[:-1, None]
    way = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)[:-1]])
    un = axle[j] - axle[i] - (way[j] - way[i])
    t = (rows.time_ns[j] - rows.time_ns[i]) * 1e-9
    q = (un**2).sum(1) / (2 * t)
    return max(float(np.median(q) / np.log(2)) , 1e-3)
