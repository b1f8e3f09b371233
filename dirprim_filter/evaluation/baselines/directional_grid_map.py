"""Directional grid maps: in each square of a grid a mixture of von Mises, by EM; the number of modes by DBSCAN.

Source: Senanayake and Ramos, Directional grid maps: modeling multimodal angular uncertainty in dynamic environments,
IROS 2018. No cell leans on any other. Three departures, all in its favour: densities are computed in log space (the
published code overflows at concentrations above 713 and then leaves its multimodal cells out); the concentration is
bounded, because angles that repeat make the likelihood unbounded; and a uniform direction counts as so many rows in
each cell, or one vehicle that turns where none did would cost thousands of nat.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray, as_floats
from dirprim_filter.distributions import VonMisesMixture, von_mises
from dirprim_filter.distributions.angles import difference, wrap
from dirprim_filter.distributions.modes import NOISE, dbscan
from dirprim_filter.distributions.von_mises_mixture import log_weights
from tessellation import GridTessellation

EPS = 0.5
"""Radians, the reach of DBSCAN's neighbourhoods; scikit-learn's default."""
MIN_SAMPLES = 5
"""Of a core point; scikit-learn's default."""
MAX_MODES = 8
MAX_ITERATIONS = 200
TOLERANCE = 1e-6
"""EM ends when the mean log likelihood of the rows rises by less."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionalGridMap:
    """A mixture of directions for each square; off the grid all are as likely.

    Attributes:
        cells: the squares that hold data.
        direction: (n_cells + 1, M) the mixtures; the last is uniform, so that index `OUTSIDE` gathers it.
    """

    cells: GridTessellation
    direction: VonMisesMixture

    @classmethod
    def fit(
        cls,
        position: FloatArray,
        direction: FloatArray,
        *,
        cell_size: float,
        max_concentration: float,
        pseudo_count: float,
    ) -> Self:
        """Fit every square's mixture to its rows.

        Args:
            position: (n, 2) metres, n >= 1.
            direction: (n,) radians.
            cell_size: metres, the side of a square.
            max_concentration: bound of a mode's concentration.
            pseudo_count: rows, positive, as which a uniform direction counts in each square.

        Raises:
            ValueError: shapes that do not fit, or no row.
        """
        cells = GridTessellation.covering(position, cell_size=cell_size)
        direction = wrap(as_floats("direction", direction, "n"))
        cell = cells.cell_of(position)
        order = np.argsort(cell, kind="stable")
        start = np.searchsorted(cell[order], np.arange(cells.n_cells + 1))
        label = _clusters(direction[order], start)
        own = _expectation_maximisation(direction[order], cell[order], label, cells.n_cells, max_concentration)
        share: FloatArray = pseudo_count / (np.diff(start, append=start[-1]) + pseudo_count)
        return cls(cells=cells, direction=_with_uniform(own, share))

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (..., 2), (...) -> (...)."""
        return self.direction[self.cells.cell_of(position)].log_density(direction)


def _clusters(direction: FloatArray, start: IntArray) -> IntArray:
    """(n,) DBSCAN's label of each row in its cell, below `MAX_MODES`; a cell without a cluster is one."""
    label = np.empty(direction.size, np.int64)
    for first, last in pairwise(start):
        found = dbscan(direction[first:last], eps=EPS, min_samples=MIN_SAMPLES)
        label[first:last] = found if (found != NOISE).any() else 0
    return np.minimum(label, MAX_MODES - 1)


def _expectation_maximisation(
    direction: FloatArray, cell: IntArray, label: IntArray, n_cells: int, max_concentration: float
) -> VonMisesMixture:
    """All cells' mixtures together; rows sorted by cell, starting from the clusters, noise in none of them."""
    n_modes = int(label.max()) + 1
    start = np.searchsorted(cell, np.arange(n_cells))
    unit = np.column_stack([np.ones_like(direction), np.cos(direction), np.sin(direction)])
    share = np.eye(n_modes + 1)[label][:, :n_modes]  # label -1 takes the last row, which has no mode
    before = -np.inf
    for _ in range(MAX_ITERATIONS):
        sums = np.add.reduceat(share[:, :, None] * unit[:, None, :], start)  # (n_cells, n_modes, 3)
        mixture = _maximisation(sums, max_concentration)
        mode = _mode_log_density(mixture, cell, direction)
        top = mode.max(axis=1, keepdims=True)
        share = np.exp(mode - top)
        total = share.sum(axis=1, keepdims=True)
        share /= total
        now = float((top + np.log(total)).mean())
        if now - before < TOLERANCE:
            break
        before = now
    return mixture


def _maximisation(sums: FloatArray, max_concentration: float) -> VonMisesMixture:
    """The mixtures of greatest likelihood. sums: (n_cells, n_modes, 3) of shares, cosines and sines."""
    count, c, s = np.moveaxis(sums, -1, 0)
    resultant = np.hypot(c, s) / np.maximum(count, 1e-300)
    return VonMisesMixture(
        weight=count / count.sum(axis=1, keepdims=True),
        mean_direction=np.arctan2(s, c),
        concentration=np.minimum(von_mises.concentration_of(np.minimum(resultant, 1.0)), max_concentration),
    )


def _mode_log_density(mixture: VonMisesMixture, cell: IntArray, direction: FloatArray) -> FloatArray:
    """(n, n_modes) log(weight VM) of each row in its cell; as `mode_log_density`, the constants once per cell."""
    constant = log_weights(mixture.weight) - von_mises.log_normaliser(mixture.concentration)
    half_turn = 0.5 * difference(direction[:, None], mixture.mean_direction[cell])
    log_p: FloatArray = constant[cell] - 2.0 * mixture.concentration[cell] * np.sin(half_turn) ** 2
    return log_p


def _with_uniform(own: VonMisesMixture, share: FloatArray) -> VonMisesMixture:
    """The cells' mixtures, and none behind them, each mixed with a uniform direction. share: (n_cells + 1,) its own."""

    def with_last(values: FloatArray) -> FloatArray:
        return np.pad(values, ((0, 1), (0, 1)))

    weight = with_last(own.weight) * (1.0 - share[:, None])
    weight[:, -1] = share
    return VonMisesMixture(
        weight=weight, mean_direction=with_last(own.mean_direction), concentration=with_last(own.concentration)
    )
