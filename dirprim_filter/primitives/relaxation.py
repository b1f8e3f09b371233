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

MAX_INTERVAL_S = 1.5
"""Rows of a vehicle further apart are not neighbours in time."""
MIN_PAIRS = 10
RATES = (0.02, 10.0)
"""1/s; slower than this nothing settles within a forecast, faster than this rows half a second apart cannot tell."""
MIN_TURNING = 1e-4
MIN_DRIFT = 0.02
"""m^2/s; a simulator drives on its lines, a filter that trusts them to the centimetre loses whoever does not."""
FALLBACK = Relaxation(
    direction_rate=0.5,
    speed_rate=0.2,
    mode_rate=0.1,
    place_free_turning=0.05,
    place_free_speed_rate=0.05,
    drift=0.01,
)
"""Where a log has no pairs to learn from."""


def learn_relaxation(primitive_map: PrimitiveMap, rows: TrackRows, *, standing_speed: float) -> Relaxation:
    """Rates from pairs of rows of a vehicle.

    Args:
        primitive_map: the map; its own relaxation is not looked at.
        rows: observations sorted by vehicle and time.
        standing_speed: m/s; slower rows have no direction.
    """
    moving = rows.speed >= standing_speed
    near = _pairs(rows, moving)
    if near.size < MIN_PAIRS:
        return FALLBACK
    step_s = float((rows.time_ns[near + 1] - rows.time_ns[near]).mean() * 1e-9)
    turned = difference(rows.direction[near + 1], rows.direction[near])
    from_mean = rows.speed - rows.speed[moving].mean()
    cell = primitive_map.tessellation.cell_of(rows.position)
    turn, gain, mode = _deviations(primitive_map, rows, cell)
    in_cell = near[(cell[near] == cell[near + 1]) & (cell[near] >= 0)]
    stays = float((mode[in_cell] == mode[in_cell + 1]).mean()) if in_cell.size else 1.0
    return Relaxation(
        direction_rate=_rate(turn, near, step_s, FALLBACK.direction_rate),
        speed_rate=_rate(gain, near, step_s, FALLBACK.speed_rate),
        mode_rate=float(np.clip(-np.log(max(stays, 1e-3)) / step_s, *RATES)),
        place_free_turning=max(float(np.mean(turned**2)) / step_s, MIN_TURNING),
        place_free_speed_rate=_rate(from_mean, near, step_s, FALLBACK.place_free_speed_rate),
        drift=_drift(rows, near),
    )


def _pairs(rows: TrackRows, moving: BoolArray) -> IntArray:
    """Rows whose vehicle has a next row soon after, moving in both."""
    interval_s = np.diff(rows.time_ns) * 1e-9
    near = (np.diff(rows.vehicle) == 0) & (interval_s > 0) & (interval_s <= MAX_INTERVAL_S)
    return np.flatnonzero(near & moving[:-1] & moving[1:])


def _deviations(
    primitive_map: PrimitiveMap, rows: TrackRows, cell: IntArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Each row's turn and speed off the mode most responsible for it, NaN where none draws, and that mode."""
    direction, speed = primitive_map.primitive_at(rows.position)
    log_p = direction.mode_log_density(rows.direction) + speed.log_density(rows.speed[:, None])
    mode = np.asarray(log_p.argmax(axis=-1), dtype=np.int64)
    at = np.arange(len(rows)), mode
    draws = (direction.concentration[at] > 0) & (cell >= 0)
    turn = np.where(draws, difference(rows.direction, direction.mean_direction[at]), np.nan)
    gain = np.where(draws, rows.speed - speed.mean[at], np.nan)
    return turn, gain, mode


def _rate(deviation: FloatArray, near: IntArray, step_s: float, fallback: float) -> float:
    """The rate at which deviations lose their correlation from one row to the next."""
    before, after = deviation[near], deviation[near + 1]
    both = np.isfinite(before) & np.isfinite(after)
    if both.sum() < MIN_PAIRS:
        return fallback
    spread = np.sqrt(float((before[both] ** 2).sum()) * float((after[both] ** 2).sum()))
    correlation = float((before[both] * after[both]).sum()) / max(spread, 1e-12)
    return float(np.clip(-np.log(max(correlation, 1e-3)) / step_s, *RATES))


def _drift(rows: TrackRows, near: IntArray) -> float:
    """Diffusion of what the mean of two rows' velocities leaves unexplained of the way between them."""
    dt_s = (rows.time_ns[near + 1] - rows.time_ns[near])[:, None] * 1e-9
    velocity = rows.speed[:, None] * np.column_stack([np.cos(rows.direction), np.sin(rows.direction)])
    way = rows.position[near + 1] - rows.position[near]
    unexplained = way - 0.5 * (velocity[near] + velocity[near + 1]) * dt_s
    return max(float((unexplained**2).sum() / (2.0 * dt_s.sum())), MIN_DRIFT)
