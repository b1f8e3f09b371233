"""Learning how vehicles go on: visits are grouped into manoeuvres, and motion follows from their sums."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.sparse import block_diag, csr_array

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives import _clustering
from dirprim_filter.primitives._map_kernels import ModeTable
from dirprim_filter.primitives.background import MOST_ROWS, Background
from dirprim_filter.primitives.motion import COURSE_RATE, CREEP, PUSHED_SHARE, Motion, joined
from dirprim_filter.primitives.motion_sums import SLOWEST_COURSE, Labels, MotionSums, deviation, pace_field
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.visits import Visits

DETAIL = 0.3
"""Squared distance, in units of what is alike, from which on a visit is of another manoeuvre. By 1 no log is forecast
better than chance has it, and where simulated vehicles repeat each other forecasts are 4 to 6 % worse."""
MOST_MANOEUVRES = 32
"""Of a mode."""
# Ridges in visits, by which a manoeuvre leans on its mode: of a field's value at the centre, and of its slope, for
# visits that are spread over the cell.
COURSE_RIDGE = np.array([0.3, 1.5, 1.5])
PACE_RIDGE = np.array([0.3, 1.5, 1.5])
PATH_RIDGE = np.array([1e-6, 0.05, 0.5])
ACCELERATION_RIDGE = np.array([0.3, 3.0, 3.0, 0.1])
"""Little for the speed, visits (m/s)^2: what it says brings a vehicle that is too fast back to the others, and lets one
that comes fast brake harder. By 6 in its place forecasts of 5 s are 1 to 5 % worse on four logs."""
STRETCH_RIDGE = np.array([0.5])
VARIANCE_OF_PLACE = 1.0 / 12.0
"""Variance of a coordinate in a square cell, per its area."""
ANY_COURSE = 2.0
"""Radians, spread of the course of standing manoeuvres: without meaning."""
SPREAD_VISITS = 3.0
"""Visits with which a manoeuvre's spreads are shrunk to those of all."""
FEWEST_VISITS = 3
"""Of a manoeuvre from which the usual spread is estimated."""
MOST_REVERSION = 2.0
"""1/s, of the speed to the mean."""
BACKGROUND_VISITS = 30.0
"""Pseudo-count of the background's manoeuvres against those of a cell. Of 5, 30, 200 and 1000 held-out
forecasts chose this one on every log."""
SPREAD = 1.8
"""By how much vehicles stray further than those that a manoeuvre was fitted to. On five logs the 90 % region of
forecasts holds 84 to 90 % by 1.4, 87 to 91 % by 1.7 and 88 to 92 % by 2, but for few vehicles and noisy starts; the
energy score differs by 1 %. Chosen for each log it would be too small: its cells have seen who is held out."""

COURSE_LAG_S, FARTHEST = 0.5, 0.5
"""Seconds over which deviations from courses are compared, and radians from which on one is another mode's."""
COURSE_RATES = COURSE_RATE, 8.0
"""1/s, the least and the most that their decay can be: at lower rates beliefs turn too slowly with who turns round."""
FEWEST_DEVIATIONS = 30
"""Instants compared, below which no rate is learned."""


def learn_motion(
    primitives: PrimitiveMap, rows: TrackRows, background: Background, *, rng: np.random.Generator
) -> Motion:
    """The motion of a map's vehicles.

    Args:
        primitives: the map; its own motion is not looked at.
        rows: observations sorted by vehicle and time.
        background: of the rows.
        rng: draws rows where there are many, and the order of grouping.
    """
    visits = Visits.of(rows.some(MOST_ROWS, rng=rng), primitives.tessellation)
    if len(visits) == 0:
        return primitives.motion
    labels = label_visits(primitives, visits, rng=rng)
    sums = MotionSums.of(visits, labels, primitives)
    motion = motion_of(sums, labels, primitives, background)
    return replace(motion, course_rate=course_rate(visits, labels, primitives))


def label_visits(
    primitives: PrimitiveMap, visits: Visits, *, detail: float = DETAIL, rng: np.random.Generator
) -> Labels:  # fmt: skip
    """Group the visits of each mode of each cell, in an order that is drawn; see `DETAIL`."""
    inside = np.flatnonzero(visits.cell >= 0)
    mode, feature = modes_of(primitives, visits), visits.features(primitives.centers)
    n_modes = primitives.modes.weight.shape[1]
    key = visits.cell[inside] * n_modes + mode[inside]
    order = np.argsort(key, kind="stable")
    bounds = np.append(np.flatnonzero(np.diff(key[order], prepend=-1)), order.size)
    label = np.full(len(visits), -1, np.int64)
    of_group: list[int] = []
    for a, b in pairwise(bounds.tolist()):
        members = inside[order[a:b]]
        found = np.empty(members.size, np.int64)
        _clustering.dp_means(feature[members], rng.permutation(members.size), detail, MOST_MANOEUVRES, found)
        used, found = np.unique(found, return_inverse=True)
        label[members] = len(of_group) + found
        of_group += [int(key[order[a]])] * used.size
    cell, mode_of = np.divmod(np.array(of_group, dtype=np.int64), n_modes)
    return Labels(label, cell, mode_of)


def course_rate(visits: Visits, labels: Labels, primitives: PrimitiveMap) -> float:
    """1/s, at which deviations from courses decay: by how alike they are a while later.

    From the courses of modes: those of manoeuvres were fitted to who deviates, and new vehicles do so for longer. Rows
    that come seldom do not show it: between them ways are straight.
    """
    moving = (visits.cell >= 0) & ~visits.stands
    at, off = np.flatnonzero(moving[visits.of_instant]), np.full(visits.speed.size, np.nan)
    z = labels.label[visits.of_instant[at]]
    off[at] = deviation(visits, primitives, at=at, there=(labels.cell[z], labels.mode[z]))
    later, off[np.abs(off) > FARTHEST] = visits.later(COURSE_LAG_S), np.nan
    both = np.flatnonzero((later >= 0) & np.isfinite(off) & np.isfinite(off[later]))
    if both.size < FEWEST_DEVIATIONS or visits.scale.interval_s > COURSE_LAG_S:
        return COURSE_RATE
    weight = visits.weight[visits.of_instant[both]] * np.clip(visits.speed[both], SLOWEST_COURSE, 1.0)
    now, then = off[both], off[later[both]]
    alike = (weight * now) @ then / max(np.sqrt(((weight * now) @ now) * ((weight * then) @ then)), 1e-300)
    return float(np.clip(-np.log(max(alike, 1e-9)) / visits.lag_s(COURSE_LAG_S), *COURSE_RATES))


def modes_of(primitives: PrimitiveMap, visits: Visits) -> IntArray:
    """(v,) the mode of each visit among its cell's own: the likeliest of all its instants together, of who stands last.

    Of visits to no cell it says nothing.
    """
    n_own = primitives.n_own_modes
    at = np.flatnonzero((visits.cell >= 0)[visits.of_instant])
    of_instant = visits.of_instant[at]
    v = np.maximum(visits.speed[at], 1e-2)
    total = np.empty((max(n_own - 1, 1), len(visits)))
    for m, log_p in enumerate(total):
        one = primitives.modes.take((slice(None), [m]))
        each = ModeTable.of(one, primitives.centers).log_density(
            visits.cell[of_instant], visits.position[at], visits.course[at], v
        )
        log_p[:] = np.bincount(of_instant, np.maximum(each, -30.0), minlength=len(visits))
    return np.asarray(np.where(visits.stands, n_own - 1, np.argmax(total, axis=0)), np.int64)


def motion_of(sums: MotionSums, labels: Labels, primitives: PrimitiveMap, background: Background) -> Motion:
    """Motion from sums over visits, where it deviates from the primitives, and the background of the same vehicles."""
    cell, mode = labels.cell, labels.mode
    beta = {name: getattr(sums, name).solved(ridge) for name, ridge in _ridges(labels, primitives).items()}
    course, pace, acceleration = beta["course"], beta["log_pace"], beta["acceleration"]
    square = [getattr(sums, name).mean_square(beta[name]) for name in ("course", "log_pace", "path", "pushed")]
    square[3] /= PUSHED_SHARE
    acceleration[:, 3] = np.clip(acceleration[:, 3], -MOST_REVERSION, 0.0)
    mean_speed = primitives.speed.mean[cell, mode]
    acceleration[:, 0] -= acceleration[:, 3] * mean_speed
    direction = primitives.modes.mean_direction[cell, mode]
    stands = mode == primitives.n_own_modes - 1
    placed = {
        "cell": cell, "mode": mode, "visits": sums.visits, "seconds": sums.seconds,
        "course": direction + course[:, 0], "bend": primitives.modes.bend[cell, mode] + course[:, 1:],
        "log_pace": np.log(mean_speed + CREEP) + pace[:, 0], "gain": pace_field(primitives, cell, mode) + pace[:, 1:],
        "path": beta["path"], "path_direction": direction, "acceleration": acceleration,
        "stretch": beta["stretch"][:, 0],
        "start_rate": np.where(stands, (sums.left + 0.1) / (sums.seconds + 1.0), 0.0),
        "turn_ahead": sums.turn.xy[:, 0] / np.maximum(sums.turn.weight, 1e-9),
        **_spreads(np.stack(square), sums.visits, stands),
    }  # fmt: skip
    transition = csr_array(block_diag([sums.transition, background.following], format="csr"))
    transition.sum_duplicates()
    transition.eliminate_zeros()
    return Motion(
        **joined(placed, background.manoeuvres), first=transition.indptr.astype(np.int64),
        following=transition.indices.astype(np.int64), count=transition.data.astype(np.float64),
        background_visits=BACKGROUND_VISITS,
    )  # fmt: skip


def _spreads(square: FloatArray, visits: FloatArray, stands: BoolArray) -> dict[str, FloatArray]:
    """Standard deviations, columns of `Motion`: they lean on the usual ones; who was seen once says little.

    Args:
        square: (4, z) means of what visits are off, in course, log pace and path, and in acceleration. Usual are the
            medians over the manoeuvres in motion, by their visits' degrees of freedom.
        visits: (z,)
        stands: (z,) manoeuvres of who stands.
    """
    often = ~stands & (visits >= FEWEST_VISITS)
    n, usual = visits[often], np.ones(len(square))
    if often.any():
        usual = np.median(n * square[:, often] / (n - 1.5), axis=1)
    freedom = np.maximum(visits - 1.5, 0.0) + SPREAD_VISITS
    course, pace, path, push = np.sqrt(np.maximum((visits * square + SPREAD_VISITS * usual[:, None]) / freedom, 1e-8))
    return {
        "course_spread": np.where(stands, ANY_COURSE, SPREAD * course), "log_pace_spread": pace,
        "path_spread": path, "push": SPREAD * push,
    }  # fmt: skip


def _ridges(labels: Labels, primitives: PrimitiveMap) -> dict[str, FloatArray]:
    """(z, p) or (p,) of each regression: slopes are of visits that are spread over the cell."""
    wide = VARIANCE_OF_PLACE * primitives.tessellation.area[labels.cell][:, None]  # m^2
    field, curve = np.insert(np.repeat(wide, 2, axis=1), 0, 1.0, axis=1), wide ** np.arange(3.0)
    by_state = ACCELERATION_RIDGE * np.insert(field, 3, 1.0, axis=1)
    return {
        "course": COURSE_RIDGE * field, "log_pace": PACE_RIDGE * field, "path": PATH_RIDGE * curve,
        "acceleration": by_state, "pushed": by_state, "stretch": STRETCH_RIDGE,
    }  # fmt: skip
