"""A map's motion as the kernels take it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dirprim_filter.arrays import FloatArray, read_only
from dirprim_filter.primitives._manoeuvres import (
    DISTANCE,
    LANES,
    N_COLUMNS,
    N_FIELDS,
    PUSH,
    TURNING,
    Candidates,
    MotionTable,
)
from dirprim_filter.primitives.motion import CREEP, JUMP_S, LAGS, PUSH_RATE, Motion

if TYPE_CHECKING:
    from dirprim_filter.primitives.cues import Cue
    from dirprim_filter.primitives.primitive_map import PrimitiveMap

OWN_WAY_S = 4.0
"""Seconds over which a vehicle that goes its own way changes its velocity as the background's do."""
COURSE_FLOOR, PACE_FLOOR, PATH_FLOOR = 0.02, 0.03, 0.1
"""Radians, log speed, metres, added to a manoeuvre's spreads where its fit to a vehicle is computed."""

LEAST_LOG_FIT = -60.0
"""Of a manoeuvre to a cue, against the one that fits best: weights are in single precision."""
BACKGROUND_DENSITY = np.exp(-2.0)
"""Density of course, log pace and path outside of cells, in those units: any direction or pace, on three lanes."""


def motion_table(primitives: PrimitiveMap, *, step_s: float = 0.1, own_way_rate: float = 0.0) -> MotionTable:
    """The motion of a map.

    Args:
        primitives: the map.
        step_s: seconds, the longest step.
        own_way_rate: 1/s, at which vehicles in motion leave what they follow and go their own way: straight on, with
            a white acceleration that changes their velocity as much as the background's motion does.
    """
    motion, cells, may = primitives.motion, primitives.tessellation, _candidates(primitives)
    moves, spread = motion.start_rate == 0.0, motion.log_pace_spread + PACE_FLOOR
    row = np.column_stack([
        _centers(primitives)[motion.cell], motion.course, motion.bend, moves[:, None] * motion.acceleration,
        moves * motion.push, moves * motion.course_spread, moves & (motion.cell >= 0), moves * (1.0 + motion.stretch),
        motion.start_rate, motion.curvature,
    ])  # fmt: skip
    of_cell = motion.cell[: motion.n_placed]
    free = np.column_stack([motion.log_pace, 1.0 / spread, motion.seconds / spread])[motion.n_placed :]
    return MotionTable(
        locator=primitives.compiled().locator,
        candidates=may,
        row=np.vstack([row, _own_way(motion)]),
        ahead=np.append(motion.turn_ahead, 0.0),
        favour=np.empty(0),
        begin=np.searchsorted(of_cell, np.arange(cells.n_cells + 1)),
        first=np.append(motion.first, motion.first[-1]),
        following=read_only(motion.following),
        count=read_only(motion.count),
        free=np.vstack([free, np.zeros((1, 3))]),
        most=int(np.diff(may.begin).max(initial=0)),
        course_rate=motion.course_rate,
        background_visits=motion.background_visits,
        own_way_rate=own_way_rate,
        step_s=step_s,
    )


def under(table: MotionTable, cue: Cue | None) -> MotionTable:
    """The motion of a vehicle that gives a cue: it draws its next manoeuvre from p_t p_0 (Eq. 4).

    p_t is the cue, a mixture of von Mises over the direction some seconds later, relative to the current one, at the
    mean turn of each manoeuvre; p_0 is how often it is driven. A cue that fits none of a place says nothing there.
    """
    if cue is None:
        return table
    log_fit = cue.belief(0.0).log_density(table.ahead)
    return table._replace(favour=np.exp(np.maximum(log_fit - log_fit.max(), LEAST_LOG_FIT)))


def _own_way(motion: Motion) -> FloatArray:
    """(16,) the row of who goes straight on."""
    white, lasting = motion.wander()
    lasts = lasting[0] + 2.0 * np.maximum(1.0 - np.arange(1, LAGS) / OWN_WAY_S, 0.0) @ lasting[1:]
    along, across = np.maximum(white + JUMP_S * lasts, 0.0)
    often = motion.seconds * ((motion.cell < 0) & (motion.start_rate == 0.0))
    speed = np.sqrt(often @ np.square(np.exp(motion.log_pace) - CREEP) / max(often.sum(), 1e-9))
    row = np.zeros(N_COLUMNS)
    row[[PUSH, TURNING, DISTANCE]] = np.sqrt(along * PUSH_RATE / 2.0), np.sqrt(across) / max(speed, CREEP), 1.0
    return row


def _centers(primitives: PrimitiveMap) -> FloatArray:
    """(n_cells + 1, 3) east, north, and how far from there fields go; the last row is of no cell."""
    return np.column_stack([primitives.centers, np.append(0.6 * np.sqrt(primitives.tessellation.area), 0.0)])


def _candidates(primitives: PrimitiveMap) -> Candidates:
    """The manoeuvres of each cell, eight side by side."""
    motion, n = primitives.motion, primitives.motion.n_placed
    by_course = 1.0 / (motion.course_spread + COURSE_FLOOR)
    by_pace = 1.0 / (motion.log_pace_spread + PACE_FLOOR)
    by_path = 1.0 / (motion.path_spread + PATH_FLOOR)
    scale = by_course * by_pace * by_path / BACKGROUND_DENSITY
    column = np.column_stack([
        motion.course, motion.bend, motion.log_pace, motion.gain, motion.path, np.cos(motion.path_direction),
        np.sin(motion.path_direction), by_course, by_pace, by_path, motion.visits * scale, motion.seconds * scale,
    ])[:n]  # fmt: skip
    stands = motion.start_rate > 0
    kind = 2 * motion.cell[:n] + stands[:n]
    order, size = np.argsort(kind, kind="stable"), np.bincount(kind, minlength=2 * primitives.tessellation.n_cells)
    begin = np.append(0, np.cumsum(-(-size // LANES)))
    at = LANES * begin[kind[order]] + np.arange(n) - np.repeat(np.cumsum(size) - size, size)
    field, number = np.zeros((begin[-1] * LANES, N_FIELDS), np.float32), np.zeros(begin[-1] * LANES, np.int64)
    field[at], number[at] = column[order], order
    return Candidates(
        center=_centers(primitives)[:-1],
        begin=begin,
        field=field.reshape(-1, LANES, N_FIELDS).transpose(0, 2, 1).reshape(-1, N_FIELDS * LANES),
        number=np.maximum.accumulate(number.reshape(-1, LANES), axis=1),
    )
