"""What a map and a belief look like, as plain arrays: petals, outlines, ellipses, arrows, boxes.

Pure geometry in the map's own frame (metres, x east, y north); the live stream and the figures both draw from
here.

The roses follow Nightingale's: a petal's area, not its length, is proportional to probability. A cell of one sharp mode
has one long petal that reaches past its border; a cell where vehicles go every way has a small round one. A rose is
larger where there was more traffic, whatever its cell: of wide cells at the border the eye must not see first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions.angles import difference
from dirprim_filter.drawing.colors import ByteArray, speed_color
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from tessellation import Tessellation

SHARPEST_PETAL = 10.0
"""Concentrations are drawn up to this one, a standard deviation of 18 degrees: narrower could not be seen."""
STANDING_SPEED = LearningConfig().standing_speed
"""m/s; below it a direction means nothing."""
SMALLEST_PETAL = 0.02
"""Modes of less weight are not drawn."""
PETAL_VERTICES = 24
REACH = 1.5
"""How far the longest petal of a usual cell with usual traffic goes, as a share of the way from its centre to its
border: along a lane it ends before the next cell's petal begins."""
TRAFFIC = (1.0 / 12.0, 4.0)
"""Times the usual: with less a rose is no smaller, with more no larger."""
HEAD, HEAD_OVER, HEAD_WIDTH = 0.42, 0.35, 0.42
"""An arrowhead's length as a share of its petal's, how much of it lies beyond the tip, and half its width over it."""
BUSY_SHARE = 0.75
"""Of the traffic: what to look at first. A map reaches far along its roads, where nothing happens."""


class Petals(NamedTuple):
    """The petals of a map's roses, discs first and the heaviest first, so that a lighter one is drawn over it.

    Attributes:
        polygon: (n, k, 2) metres; the first vertex is the cell's centre.
        mean_speed: (n,) m/s, of the petal's mode.
        weight: (n,) of the petal's mode among those of its cell that move; of a disc, the share of rows that stand.
        cell: (n,) the petal's cell, or square of cells.
        reach: (n,) metres, of the petal's rose.
        is_disc: (n,) of standing vehicles.
    """

    polygon: FloatArray
    mean_speed: FloatArray
    weight: FloatArray
    cell: IntArray
    reach: FloatArray
    is_disc: BoolArray


class _Modes(NamedTuple):
    """What roses are made of: (m,) modes, each of a rose, and (r,) roses."""

    rose: IntArray  # (m,) of the mode
    weight: FloatArray  # (m,) share of the rose's rows
    mean: FloatArray  # (m,) radians
    concentration: FloatArray  # (m,)
    speed: FloatArray  # (m,) mean, m/s
    bend: FloatArray  # (m, 2) rad/m
    n_rows: IntArray  # (r,)
    area: FloatArray  # (r,) square metres, of the rose's ground
    root: FloatArray  # (r, 2) metres


def rose_petals(primitives: PrimitiveMap, *, spacing: float | None = None) -> Petals:
    """One petal for each mode of its own of each cell that holds data; a disc for that of standing vehicles.

    Where most wait, petals of those that go are as large as elsewhere: they lie on the disc of those that stand.

    The radius at direction theta is R sqrt(w VM(theta; mu, k) / VM(mu; mu, K)) with R the rose's reach, see
    `_rose_reach`, K = `SHARPEST_PETAL` and k = min(kappa, K): the area is proportional to w, whatever kappa. Where the
    mode bends, so does the petal: as much along its way as the mode's mean direction turns along it.

    Args:
        primitives: the map.
        spacing: metres; cells in squares so wide have one rose together, in which modes that point alike are one:
            a picture of a city has no room for all.
    """
    modes = _modes(primitives) if spacing is None else _together(_modes(primitives), spacing)
    stands = modes.speed < STANDING_SPEED
    moving = np.bincount(modes.rose, np.where(stands, 0.0, modes.weight), len(modes.root))[modes.rose]
    weight = np.where(stands, modes.weight, modes.weight / np.maximum(moving, SMALLEST_PETAL))
    drawn = np.flatnonzero((weight >= SMALLEST_PETAL) & (modes.n_rows > 0)[modes.rose] & (modes.area > 0)[modes.rose])
    drawn = drawn[np.lexsort((-weight[drawn], ~stands[drawn]))]
    rose, weight, mean = modes.rose[drawn], weight[drawn], modes.mean[drawn]
    concentration = np.minimum(modes.concentration[drawn], SHARPEST_PETAL)
    with np.errstate(divide="ignore"):
        # Out to the angle where the radius has fallen to 8 % of the length.
        half_width = np.arccos(np.clip(1.0 + 2.0 * np.log(0.08) / concentration, -1.0, 1.0))
    theta = mean[:, None] + half_width[:, None] * np.linspace(-1.0, 1.0, PETAL_VERTICES)
    sharpest = von_mises.log_density(np.zeros(()), np.zeros(()), np.array(SHARPEST_PETAL))
    log_p = von_mises.log_density(theta, mean[:, None], concentration[:, None]) - sharpest
    reach = _rose_reach(modes)[rose]
    radius = reach[:, None] * np.sqrt(weight[:, None] * np.exp(log_p))
    root = modes.root[rose][:, None, :]
    curvature = (modes.bend[drawn] * _heading(mean)).sum(axis=-1)
    bend = np.clip(curvature, -1.0 / reach, 1.0 / reach)  # at most a radian from root to tip
    rim = root + _along_arc(radius, theta, bend[:, None])
    return Petals(
        polygon=np.concatenate([root, rim], axis=1), mean_speed=modes.speed[drawn], weight=weight, cell=rose,
        reach=reach, is_disc=stands[drawn],
    )  # fmt: skip


def petal_heads(petals: Petals) -> FloatArray:
    """Arrowheads at the tips of petals; of discs, and of petals so wide that they point nowhere, none. -> (m, 3, 2)."""
    root, rim = petals.polygon[:, 0], petals.polygon[:, 1:]
    tip = 0.5 * (rim[:, PETAL_VERTICES // 2 - 1] + rim[:, PETAL_VERTICES // 2])
    along = tip - root
    length = np.hypot(*along.T)
    is_sharp = ~petals.is_disc & (np.hypot(*(rim[:, 0] - rim[:, -1]).T) < length)
    along, tip = along[is_sharp], tip[is_sharp]
    base = tip - (1.0 - HEAD_OVER) * HEAD * along
    side = HEAD_WIDTH * HEAD * np.column_stack([-along[:, 1], along[:, 0]])
    return np.stack([base + side, tip + HEAD_OVER * HEAD * along, base - side], axis=1)


def _modes(primitives: PrimitiveMap) -> _Modes:
    """Of each cell its own."""
    cell, mode = np.nonzero(primitives.own_weight > 0)
    of = primitives.modes.take((cell, mode))
    return _Modes(
        cell, of.weight, of.mean_direction, of.concentration, of.shape / of.rate, of.bend,
        primitives.n_rows[:-1], primitives.tessellation.area, primitives.tessellation.centers,
    )  # fmt: skip


def _together(modes: _Modes, spacing: float) -> _Modes:
    """Of the cells in each square `spacing` wide, weighted by their rows; a rose's ground is a square at least.

    Of a rose's modes that move the heaviest takes up all that point within 40 degrees of it, by the moments of their
    densities; then of what is left the heaviest, again and again. Those that stand are one.
    """
    square, rose = np.unique(np.floor(modes.root / spacing).astype(np.int64), axis=0, return_inverse=True)
    rose, n_roses = rose.reshape(-1), len(square)
    n_rows = np.bincount(rose, modes.n_rows, n_roses)
    center = [np.bincount(rose, modes.n_rows * of, n_roses) / np.maximum(n_rows, 1.0) for of in modes.root.T]
    area = np.full(n_roses, spacing**2)
    np.maximum.at(area, rose, np.where(modes.area > 0, modes.area, 0.0))
    own, mass = rose[modes.rose], modes.weight * modes.n_rows[modes.rose]
    is_alone = np.bincount(rose, modes.n_rows > 0, n_roses)[own] < 2
    leader, left = np.arange(own.size), modes.speed >= STANDING_SPEED
    leader[~left] = own.size + own[~left]
    while left.any():
        rows = np.flatnonzero(left)
        rows = rows[np.lexsort((-mass[rows], own[rows]))]
        _, first = np.unique(own[rows], return_index=True)
        heaviest = np.full(n_roses, -1)
        heaviest[own[rows[first]]] = rows[first]
        near = rows[np.abs(difference(modes.mean[rows], modes.mean[heaviest[own[rows]]])) <= math.radians(40.0)]
        leader[near] = heaviest[own[near]]
        left[near] = False
    _, kept, merged = np.unique(leader, return_index=True, return_inverse=True)
    total = np.maximum(np.bincount(merged, mass), 1e-12)
    resultant = mass * von_mises.mean_resultant_length(modes.concentration)
    east, north = (np.bincount(merged, resultant * of(modes.mean)) / total for of in (np.cos, np.sin))
    return _Modes(
        own[kept], total / np.maximum(n_rows[own[kept]], 1.0), np.arctan2(north, east),
        von_mises.concentration_of(np.hypot(east, north)), np.bincount(merged, mass * modes.speed) / total,
        modes.bend[kept] * is_alone[kept, None], n_rows, area, np.column_stack(center),
    )  # fmt: skip


def _rose_reach(modes: _Modes) -> FloatArray:
    """How far the longest petal of each rose may go. -> (r,) metres.

    Half the geometric mean of the ground's width and the usual one, times `REACH` and the fourth root of the traffic
    over the usual: so areas grow with the root of the traffic. Usual is the median over rows.
    """
    n_rows, area = modes.n_rows, modes.area
    drawn = (n_rows > 0) & (area > 0)
    if not drawn.any():
        return np.zeros(len(area))
    usual_rows, usual_area = (
        np.quantile(of[drawn], 0.5, weights=n_rows[drawn], method="inverted_cdf") for of in (n_rows, area)
    )
    traffic = np.clip(n_rows / usual_rows, *TRAFFIC)
    usual = min(0.5 * REACH * usual_area**0.5, 0.18 * float(area.sum()) ** 0.5)  # not to hide a map of few cells
    return np.asarray(usual * (area / usual_area * traffic) ** 0.25)


def fastest_speed(petals: Petals) -> float:
    """The speed that gets the last colour: the fastest 2 % of petals share it; whole m/s, at least 1."""
    if petals.mean_speed.size == 0:
        return 1.0
    return float(max(1.0, np.ceil(np.quantile(petals.mean_speed, 0.98))))


def petal_colors(petals: Petals, *, fastest: float) -> ByteArray:
    """The colour of each vertex, by the petal's mean speed; darker at the root, from where it points. -> (n, k, 4)."""
    color = np.repeat(speed_color(petals.mean_speed, fastest=fastest)[:, None], petals.polygon.shape[1], axis=1)
    color[~petals.is_disc, 0, :3] //= 4
    return color


def fan_triangles(polygon: FloatArray) -> IntArray:
    """Triangles from the first vertex of each polygon. (n, k, 2) -> (n (k - 2), 3) of the n k vertices."""
    n, k = polygon.shape[:2]
    rim = np.arange(1, k - 1)
    fan = np.stack([np.zeros_like(rim), rim, rim + 1], axis=-1)
    triangles: IntArray = (fan + k * np.arange(n)[:, None, None]).reshape(-1, 3)
    return triangles


def cell_outlines(tessellation: Tessellation) -> list[FloatArray]:
    """The border of each cell that has one as a closed line: (k + 1, 2) metres, the last point the first."""
    return [np.concatenate([polygon, polygon[:1]]) for polygon in tessellation.polygons() if len(polygon)]


def extent(points: FloatArray) -> FloatArray:
    """The box around points with 6 % of margin, at least 20 m wide: its SW and NE corner. (n, 2) -> (2, 2)."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    half = np.maximum(0.5 * (high - low) + 0.06 * (high - low).max(), 10.0)
    center = 0.5 * (low + high)
    return np.stack([center - half, center + half])


def map_extent(primitives: PrimitiveMap, *, share: float = 1.0) -> FloatArray:
    """The box around the cells that hold a share of the traffic, those left out at each side alike. -> (2, 2).

    That is around all cells where it is at most 1.3 times as long, or where there is no traffic. Its SW and NE corner.
    """
    polygons, n_rows = primitives.tessellation.polygons(), primitives.n_rows[:-1]
    whole = extent(np.concatenate(polygons) if polygons else np.empty((0, 2)))
    if share >= 1.0 or n_rows.sum() == 0:
        return whole
    kept = np.ones(len(n_rows), np.bool_)
    for place in primitives.tessellation.centers.T:
        order = np.argsort(place)
        below = np.cumsum(n_rows[order]) / n_rows.sum()
        rare = 0.25 * (1.0 - share)  # at each of four sides
        kept[order] &= (below > rare) & (below - n_rows[order] / n_rows.sum() < 1.0 - rare)
    busy = [polygon for polygon, one in zip(polygons, kept, strict=True) if one and len(polygon)]
    box = extent(np.concatenate(busy)) if busy else whole
    return whole if np.ptp(whole, axis=0).max() <= 1.3 * np.ptp(box, axis=0).max() else box


def covariance_axes(covariance: FloatArray, *, probability: float) -> tuple[FloatArray, FloatArray]:
    """The ellipse that holds a Gaussian's `probability`: half axes, angle. (..., 2, 2) -> (..., 2), (...).

    The squared Mahalanobis distance in the plane is chi-squared with two degrees of freedom; its quantile is
    -2 log(1 - p). The half axes are in metres, the shorter first; the angle is its own from east, in radians.
    """
    variance, axis = np.linalg.eigh(covariance)
    half_axes = np.sqrt(np.maximum(variance, 0.0) * -2.0 * np.log1p(-probability))
    return half_axes, np.arctan2(axis[..., 1, 0], axis[..., 0, 0])


def motion_arrow(direction: FloatArray, speed: FloatArray) -> FloatArray:
    """How far a vehicle gets in a second. (...), (...) -> (..., 2) metres."""
    arrow: FloatArray = np.asarray(speed)[..., None] * _heading(direction)
    return arrow


def vehicle_outline(position: FloatArray, heading: FloatArray, size: FloatArray) -> FloatArray:
    """The closed outline of vehicles from above, with a pointed bow. (n, 2), (n,), (n, 3) -> (n, 6, 2) metres.

    Those of unknown size are drawn as a middling car.
    """
    body = np.array([[-0.5, -0.5], [0.28, -0.5], [0.5, 0.0], [0.28, 0.5], [-0.5, 0.5], [-0.5, -0.5]])
    across = np.where(np.isnan(size[:, :2]), (4.5, 1.8), size[:, :2])
    along, aside = np.moveaxis(body * across[:, None], -1, 0)[..., None]
    ahead, left = _heading(heading)[:, None], _heading(np.asarray(heading) + 0.5 * np.pi)[:, None]
    outline: FloatArray = position[:, None] + along * ahead + aside * left
    return outline


def _along_arc(length: FloatArray, direction: FloatArray, curvature: FloatArray) -> FloatArray:
    """End point of an arc that starts in a direction and turns by `curvature` per metre. (...) -> (..., 2) metres.

    The chord of the arc points half its turn aside, and is shorter than the arc by sinc of half its turn.
    """
    half_turn = 0.5 * curvature * length
    chord: FloatArray = length * np.sinc(half_turn / np.pi)
    return chord[..., None] * _heading(direction + half_turn)


def _heading(direction: FloatArray) -> FloatArray:
    return np.stack([np.cos(direction), np.sin(direction)], axis=-1)
