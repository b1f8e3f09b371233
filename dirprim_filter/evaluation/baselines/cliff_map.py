"""CLiFF-map: in each square of a grid a mixture of semi-wrapped normals over direction and speed.

Source: Kucner, Magnusson, Schaffernicht, Bennetts and Lilienthal, Enabling flow awareness for mobile robots in
partially observable environments, IEEE Robotics and Automation Letters, 2017. A semi-wrapped normal is a bivariate
normal whose direction is wrapped onto the circle and whose speed is not: slow modes give some to speeds below 0.
The number of modes of a square is found by mean shift, the modes by EM.

Two additions make the density finite everywhere: a least covariance, as directions that repeat make the likelihood
unbounded; and a background (any direction, and a normal of all speeds) that counts as so many rows in each square. With
it squares of few rows need no threshold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import logsumexp

from dirprim_filter.arrays import FloatArray, IntArray, as_floats
from dirprim_filter.distributions.angles import TWO_PI, difference, wrap
from dirprim_filter.distributions.von_mises_mixture import log_weights
from tessellation import GridTessellation

WRAPS = TWO_PI * np.arange(-1, 2)
"""Radians: the nearest turn of the circle and its neighbours."""
MOST_DEVIATION = 2.0
"""Of a mode, in radians and multiples of the unit of speed: all but 3e-6 of it lies within the wraps."""
BINS = 2.0
"""Mean shift moves means of bins, so many to a bandwidth, instead of rows: rows of traffic repeat each other."""
MAX_SHIFTS, SHIFT_TOLERANCE = 50, 0.01
MAX_ITERATIONS, TOLERANCE = 50, 1e-4
"""EM ends when the mean log likelihood of the rows rises by less."""


class Modes(NamedTuple):
    """Semi-wrapped normals, sorted by square: (m, ...) each, for speeds in the map's unit."""

    first: IntArray  # (n_cells + 2,) the first mode of each square; the last, without modes, is for `OUTSIDE`
    weight: FloatArray  # (m,) within its square
    mean: FloatArray  # (m, 2) direction and speed
    covariance: FloatArray  # (m, 2, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class CliffMap:
    """Modes and a background for each square; off the grid the background alone.

    Attributes:
        cells: the squares that hold data.
        modes: of all squares.
        background_share: (n_cells + 1,) weight of the background; the last is 1.
        speed_unit: m/s that count as a radian.
        background_speed: mean and standard deviation of all speeds, m/s.
    """

    cells: GridTessellation
    modes: Modes
    background_share: FloatArray
    speed_unit: float
    background_speed: tuple[float, float]

    @classmethod
    def fit(
        cls,
        position: FloatArray,
        direction: FloatArray,
        speed: FloatArray,
        *,
        cell_size: float,
        speed_unit: float,
        bandwidth: float,
        least_deviation: float,
        pseudo_count: float,
    ) -> Self:
        """Fit every square's modes to its rows.

        Args:
            position: (n, 2) metres, n >= 1.
            direction: (n,) radians.
            speed: (n,) m/s.
            cell_size: metres, the side of a square.
            speed_unit: m/s that count as a radian in the next two.
            bandwidth: of mean shift, radians.
            least_deviation: of a mode in every axis, radians.
            pseudo_count: rows, positive, as which the background counts in each square.

        Raises:
            ValueError: shapes that do not fit, or no row.
        """
        cells = GridTessellation.covering(position, cell_size=cell_size)
        direction, speed = wrap(as_floats("direction", direction, "n")), as_floats("speed", speed, "n")
        cell = cells.cell_of(position)
        order = np.argsort(cell, kind="stable")
        row = np.column_stack([direction, speed / speed_unit])[order]
        start = mean_shift_modes(row, cell[order], cells.n_cells, bandwidth)
        modes, _ = expectation_maximisation(row, cell[order], start, least_deviation)
        n_rows = np.bincount(cell, minlength=cells.n_cells + 1).astype(np.float64)
        return cls(
            cells=cells, modes=modes, background_share=pseudo_count / (n_rows + pseudo_count), speed_unit=speed_unit,
            background_speed=(float(speed.mean()), max(float(speed.std()), least_deviation * speed_unit)),
        )  # fmt: skip

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (n, 2), (n,) -> (n,)."""
        pairs, deviation = self._pairs(position), np.sqrt(self.modes.covariance[:, 0, 0])
        turn = difference(np.asarray(direction)[pairs.row], self.modes.mean[pairs.mode, 0])[:, None] + WRAPS
        mode = self._log_weight(pairs) + logsumexp(_log_normal(turn, deviation[pairs.mode, None]), axis=1)
        return self._mixture(position, pairs, mode, np.full(len(position), -np.log(TWO_PI)))

    def speed_log_density(self, position: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(speed | position), per m/s. (n, 2), (n,) -> (n,)."""
        pairs, deviation = self._pairs(position), np.sqrt(self.modes.covariance[:, 1, 1])
        faster = np.asarray(speed)[pairs.row] / self.speed_unit - self.modes.mean[pairs.mode, 1]
        mode = self._log_weight(pairs) + _log_normal(faster, deviation[pairs.mode]) - np.log(self.speed_unit)
        return self._mixture(position, pairs, mode, self._background(speed))

    def log_density(self, position: FloatArray, direction: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(direction, speed | position), per radian and m/s. (n, 2), (n,), (n,) -> (n,)."""
        pairs, row = self._pairs(position), np.column_stack([direction, np.asarray(speed) / self.speed_unit])
        wrapped = _wrapped_log_density(self.modes, pairs, *_apart(self.modes, pairs, row))
        mode = logsumexp(wrapped, axis=1) - np.log(self.speed_unit)
        return self._mixture(position, pairs, mode, self._background(speed) - np.log(TWO_PI))

    def _pairs(self, position: FloatArray) -> Pairs:
        return pairs_of(self.modes.first, self.cells.cell_of(position) % (self.cells.n_cells + 1))

    def _log_weight(self, pairs: Pairs) -> FloatArray:
        return log_weights(self.modes.weight)[pairs.mode]

    def _background(self, speed: FloatArray) -> FloatArray:
        mean, deviation = self.background_speed
        return _log_normal(np.asarray(speed) - mean, np.asarray(deviation))

    def _mixture(self, position: FloatArray, pairs: Pairs, mode: FloatArray, background: FloatArray) -> FloatArray:
        """(n,) log densities. mode: (p,) of each pair, with its weight; background: (n,)."""
        share = self.background_share[self.cells.cell_of(position)]
        own = np.full(len(position), -np.inf)
        known = pairs.row[pairs.start]
        own[known] = np.log1p(-share[known]) + _log_sum_of_rows(mode, pairs)
        return np.asarray(np.logaddexp(own, np.log(share) + background))


class Pairs(NamedTuple):
    """Each row with each member of its square."""

    row: IntArray  # (p,) ascending
    mode: IntArray  # (p,) the member
    start: IntArray  # the first pair of each row that has one


def pairs_of(first: IntArray, cell: IntArray) -> Pairs:
    """Pair rows with what their squares hold. first: (c + 1,) of each square's members; cell: (n,)."""
    count = np.diff(first)[cell]
    row = np.repeat(np.arange(cell.size), count)
    end = np.cumsum(count)
    mode = np.arange(row.size) + (first[cell] - end + count)[row]
    return Pairs(row, mode, (end - count)[count > 0])


def mean_shift_modes(row: FloatArray, cell: IntArray, n_cells: int, bandwidth: float) -> Modes:
    """Where the density of each square's rows is greatest: round modes, as wide as the bandwidth.

    Args:
        row: (n, 2) direction and speed, sorted by square.
        cell: (n,) their squares.
        n_cells: squares, each with a row.
        bandwidth: standard deviation of the kernel.
    """
    key = np.column_stack([cell, np.floor(row * (BINS / bandwidth))])
    bins, number, mass = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    point = np.stack([np.bincount(number, column) for column in row.T], axis=1) / mass[:, None]
    of_point = bins[:, 0].astype(np.int64)
    pairs = pairs_of(np.searchsorted(of_point, np.arange(n_cells + 1)), of_point)

    def apart(top: FloatArray, other: FloatArray) -> FloatArray:
        away = other[pairs.mode] - top[pairs.row]
        return np.column_stack([wrap(away[:, 0]), away[:, 1]])

    top = point.copy()
    for _ in range(MAX_SHIFTS):
        away = apart(top, point)
        pull = mass[pairs.mode] * np.exp(-0.5 * (away**2).sum(axis=1) / bandwidth**2)
        shift = np.add.reduceat(pull[:, None] * away, pairs.start) / np.add.reduceat(pull, pairs.start)[:, None]
        top += shift
        if np.abs(shift).max() < SHIFT_TOLERANCE * bandwidth:
            break
    same = (apart(top, top) ** 2).sum(axis=1) < bandwidth**2
    links = coo_array((np.ones(same.sum()), (pairs.row[same], pairs.mode[same])), shape=(mass.size, mass.size))
    _, label = connected_components(links, directed=False)  # in order of their first points, and so of the squares
    heaviest = np.lexsort((-mass, label))[np.searchsorted(np.sort(label), np.arange(label.max() + 1))]
    n_rows, of_mode = np.bincount(label, mass), of_point[heaviest]
    return Modes(
        first=np.searchsorted(of_mode, np.arange(n_cells + 2)),
        weight=n_rows / np.bincount(of_mode, n_rows)[of_mode],
        mean=np.column_stack([wrap(top[heaviest, 0]), top[heaviest, 1]]),
        covariance=np.tile(bandwidth**2 * np.eye(2), (heaviest.size, 1, 1)),
    )


def expectation_maximisation(
    row: FloatArray, cell: IntArray, modes: Modes, least_deviation: float
) -> tuple[Modes, list[float]]:
    """Modes of all squares together, and the mean log likelihood of the rows before each iteration.

    Args:
        row: (n, 2) direction and speed, sorted by square.
        cell: (n,) their squares.
        modes: where to begin, in each square that has a row.
        least_deviation: of a mode in every axis.
    """
    pairs, found = pairs_of(modes.first, cell), [-np.inf]
    n_modes, n_rows = modes.weight.size, np.bincount(cell, minlength=modes.first.size - 1)
    of_mode = np.repeat(np.arange(modes.first.size - 1), np.diff(modes.first))
    modes = modes._replace(covariance=_bounded(modes.covariance, least_deviation))
    for _ in range(MAX_ITERATIONS):
        turn, faster = _apart(modes, pairs, row)
        wrapped = _wrapped_log_density(modes, pairs, turn, faster)
        total = _log_sum_of_rows(logsumexp(wrapped, axis=1), pairs)
        found.append(float(total.mean()))
        if found[-1] - found[-2] < TOLERANCE:
            break
        share = np.exp(wrapped - total[pairs.row, None])
        of_pair, turned, squared = (np.einsum("ij,ij->i", share, turn**power) for power in range(3))
        faster = faster[:, 0]
        sums = np.stack(
            [np.bincount(pairs.mode, term, n_modes) for term in (
                of_pair, turned, of_pair * faster, squared, turned * faster, of_pair * faster**2,
            )]
        )  # fmt: skip
        mean = sums[1:3] / np.maximum(sums[0], 1e-300)
        second = sums[[[3, 4], [4, 5]]] / np.maximum(sums[0], 1e-300)
        modes = Modes(
            first=modes.first,
            weight=sums[0] / n_rows[of_mode],
            mean=np.column_stack([wrap(modes.mean[:, 0] + mean[0]), modes.mean[:, 1] + mean[1]]),
            covariance=_bounded(np.moveaxis(second - mean[:, None] * mean[None], -1, 0), least_deviation),
        )
    return modes, found[1:]


def _bounded(covariance: FloatArray, least_deviation: float) -> FloatArray:
    """Of all covariances within the bounds the one of greatest likelihood: eigenvalues are clipped. (m, 2, 2)."""
    value, vector = np.linalg.eigh(covariance)
    value = np.clip(value, least_deviation**2, MOST_DEVIATION**2)
    return np.asarray((vector * value[:, None, :]) @ np.swapaxes(vector, 1, 2))


def _apart(modes: Modes, pairs: Pairs, row: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(p, 3) turns from the modes' means to the rows' directions, once for each wrap, and (p, 1) of speeds."""
    away = row[pairs.row] - modes.mean[pairs.mode]
    away[:, 0] -= TWO_PI * np.rint(away[:, 0] / TWO_PI)
    return away[:, :1] + WRAPS, away[:, 1:]


def _wrapped_log_density(modes: Modes, pairs: Pairs, turn: FloatArray, faster: FloatArray) -> FloatArray:
    """(p, 3) log of weight and normal density, once for each wrap: of the turn, and of the speed given the turn."""
    variance, common, of_speed = (modes.covariance[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    slope = common / variance
    rest = of_speed - slope * common
    constant = log_weights(modes.weight) - 0.5 * np.log(variance * rest) - np.log(TWO_PI)
    constant, slope, of_turn, of_rest = (
        column[pairs.mode, None] for column in (constant, slope, -0.5 / variance, -0.5 / rest)
    )
    return np.asarray(constant + of_turn * turn**2 + of_rest * (faster - slope * turn) ** 2)


def _log_normal(away: FloatArray, deviation: FloatArray) -> FloatArray:
    return np.asarray(-0.5 * (away / deviation) ** 2 - np.log(deviation) - 0.5 * np.log(TWO_PI))


def _log_sum_of_rows(log_p: FloatArray, pairs: Pairs) -> FloatArray:
    """(p,) -> natural log of the sum of exponentials over the pairs of each row that has one."""
    return np.asarray(np.logaddexp.reduceat(log_p, pairs.start)) if log_p.size else log_p
