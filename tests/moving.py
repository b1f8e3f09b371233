"""Maps whose manoeuvres are written by hand, and particles that move by them."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dirprim_filter import estimates
from dirprim_filter.config import FilterConfig
from dirprim_filter.distributions import _random as random
from dirprim_filter.forecasting import leader_table, projected, sampled
from dirprim_filter.primitives import _motion
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.motion import COURSE_RATE, FLOATS, Motion, background_manoeuvres, joined
from dirprim_filter.primitives.motion_table import motion_table
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from tessellation import GridTessellation

SIDE = 20.0
ALONE = np.empty((0, 3))
"""No vehicle has a leader."""
NOTHING = 1e-300


class Particles(NamedTuple):
    """Particles of one vehicle."""

    position: np.ndarray
    direction: np.ndarray
    speed: np.ndarray
    cell: np.ndarray
    manoeuvre: np.ndarray
    push: np.ndarray


def seeded(key):
    state = np.zeros(4, np.uint64)
    random.seed_state(np.uint64(key), state)
    return state


def motion_by_hand(cell, *, transitions=(), background_visits=NOTHING, turning=0.2, **columns):
    """Manoeuvres of cells, all alike but for the columns given; (before, after, count) of each transition.

    Vehicles keep 10 m/s, without noise; `background_visits` are next to none: the background is not taken up.
    """
    n = len(cell)
    wide = {"bend": 2, "gain": 2, "path": 3, "acceleration": 4}
    usual = {"visits": 1.0, "seconds": 1.0, "course_spread": 0.0, "log_pace": np.log(10.3), "log_pace_spread": 10.0}
    usual |= {"path_spread": 1e3}
    placed = {name: np.full((n, wide[name]) if name in wide else n, usual.get(name, 0.0)) for name in FLOATS}
    for name, column in columns.items():
        placed[name][:] = column
    placed |= {"cell": np.array(cell), "mode": np.zeros(n, np.int64)}
    free = background_manoeuvres(
        share=[1.0],
        log_pace=[0.0],
        log_pace_spread=[1.0],
        acceleration=[[0.0, 0.0]],
        push=[1.0],
        turning=[turning],
        curvature=[0.0],
        standing=0.1,
        start_rate=0.1,
    )
    pairs = sorted(transitions)
    first = np.searchsorted([before for before, _, _ in pairs], np.arange(n + len(free["cell"]) + 1))
    return Motion(
        **joined(placed, free), first=first, following=np.array([after for _, after, _ in pairs], np.int64),
        count=np.array([count for _, _, count in pairs], np.float64), background_visits=background_visits,
    )  # fmt: skip


def squares(n_x, n_y, motion, *, side=SIDE):
    """A map of square cells from the origin on, row by row, that moves so; its primitives head east at 10 m/s."""
    n = n_x * n_y
    column = np.ones((n + 1, 1))
    return PrimitiveMap(
        tessellation=GridTessellation(origin=np.zeros(2), cell_size=side, n_x=n_x, n_y=n_y, square=np.arange(n)),
        modes=Modes.flat(column, 0 * column, 100.0 * column, 100.0 * column, 10.0 * column),
        n_rows=np.ones(n + 1, np.int64), n_background_modes=0, motion=motion,
    )  # fmt: skip


def ring_road(radius, *, pace, swing, back, shape, side=4.0):
    """A ring around the origin, driven counter-clockwise: speeds return to pace + swing sin(angle) at the rate `back`.

    A grid of cells, in each a manoeuvre along the circles around the origin, to first order; first speeds are of a
    gamma of this shape, of mean `pace`.
    """
    n = 2 * int(np.ceil((radius + 3.0) / side))
    centre = side * (np.stack(np.meshgrid(*[np.arange(n) - n / 2 + 0.5] * 2), axis=-1).reshape(-1, 2))
    x, y = centre.T
    course, bend = np.arctan2(x, -y), np.column_stack([-y, x]) / (x**2 + y**2)[:, None]
    to_pace = [back * (pace + swing * y / radius), 0 * x, 0 * x + back * swing / radius, 0 * x - back]
    motion = motion_by_hand(np.arange(n * n), course=course, bend=bend, acceleration=np.column_stack(to_pace))
    made = squares(n, n, motion, side=side)
    column = np.ones((n * n + 1, 1))
    return replace(
        made,
        tessellation=replace(made.tessellation, origin=np.full(2, -side * n / 2)),
        modes=Modes.flat(
            column, np.append(course, 0.0)[:, None], 1e4 * column, shape * column, shape / pace * column
        )._replace(bend=np.append(bend, np.zeros((1, 2)), axis=0)[:, None]),
    )


def only_places(primitive_map):
    """The same map, whose background manoeuvres no vehicle takes up where a cell has its own."""
    return replace(primitive_map, motion=replace(primitive_map.motion, background_visits=NOTHING))


def settled(table, n, *, place=(0.0, 0.0), direction=0.0, speed=10.0, state):
    """Particles at one state, that have taken up manoeuvres."""
    made = Particles(
        np.tile(np.asarray(place, np.float64), (n, 1)), np.full(n, float(direction)), np.full(n, float(speed)),
        np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n),
    )  # fmt: skip
    _motion.initialise_motion(table, *made, state)
    return made


def moved(
    primitive_map, dt_s, *, n=20_000, key=5, n_calls=1, step_s=0.1, own_way_rate=0.0, course_rate=COURSE_RATE, **start
):
    """Particles after so many seconds, cut into calls."""
    table = motion_table(primitive_map, step_s=step_s, own_way_rate=own_way_rate)._replace(course_rate=course_rate)
    state = seeded(key)
    particles = settled(table, n, state=state, **start)
    for _ in range(n_calls):
        _motion.move(table, *particles, ALONE, dt_s / n_calls, state)
    return particles


def state_of(place, direction, speed):
    """A belief that is sure."""
    sure = {"weight": np.ones(1), "vehicle": np.zeros(1, np.int64)}
    return estimates.Particles(position=np.array([place]), direction=np.array([direction]), speed=[speed], **sure)


def rollouts(primitive_map, position, direction, speed, *, time_s, n_samples, interaction="none", seed):
    """Samples of where vehicles (n,) are at times (n_times,) ahead, all in one scene: (n, n_samples, n_times, 2)."""
    table, config, rng = motion_table(primitive_map), FilterConfig(interaction=interaction), np.random.default_rng(seed)
    states = map(state_of, position, direction, speed)
    clouds = [sampled(table, state, n_samples, rng=rng) for state in states]
    return projected(table, clouds, np.diff(time_s, prepend=0.0), leader_table(primitive_map, config))
