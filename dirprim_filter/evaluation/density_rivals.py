"""The rivals of Table I, each with the settings that are chosen for it.

All settings are chosen by `settings.choose` on held-out training vehicles. Limits are those of the data: logs do not
know positions better than to a decimetre, nor courses than to 1e-4 rad (those of SUMO are rounded to .01 degrees);
where directions repeat exactly the likelihood grows without bound as modes grow narrow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.evaluation.baselines.cliff_map import CliffMap
from dirprim_filter.evaluation.baselines.directional_grid_map import DirectionalGridMap
from dirprim_filter.evaluation.baselines.gaussian_process import DirectionalGaussianProcess
from dirprim_filter.evaluation.baselines.stef_map import StefMap
from dirprim_filter.evaluation.settings import Axis
from dirprim_filter.tracks import Tracks


@runtime_checkable
class DirectionModel(Protocol):
    """Whatever predicts directions."""

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (n, 2), (n,) -> (n,)."""
        ...


@runtime_checkable
class MotionModel(DirectionModel, Protocol):
    """Whatever predicts directions and speeds."""

    def speed_log_density(self, position: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(speed | position), per m/s. (n, 2), (n,) -> (n,)."""
        ...

    def log_density(self, position: FloatArray, direction: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(direction, speed | position), per radian and m/s. (n, 2), (n,), (n,) -> (n,)."""
        ...


Fit = Callable[[Tracks, tuple[float, ...], np.random.Generator], DirectionModel]
"""Learns a model from tracks, with values of the settings."""


class Method(NamedTuple):
    """A row of the table.

    Attributes:
        name: of the row.
        fit: learns its model.
        settings: to choose by held-out training vehicles; of our own methods, which choose for themselves, none.
    """

    name: str
    fit: Fit
    settings: tuple[Axis, ...] = ()


CELL_SIZE = Axis("cell size, m", start=3.0, factor=1.5, least=0.1)
PSEUDO_COUNT = Axis("pseudo-count, rows", start=1.0, factor=3.0)


def rivals() -> list[Method]:
    """Published methods; of CLiFF-map direction and speed, of the others direction alone."""
    narrowest = Axis("least deviation, rad", start=0.02, least=1e-4)
    return [
        Method("CLiFF-map", _fit_cliff_map, (
            CELL_SIZE, Axis("speed that counts as 1 rad, m/s", start=20.0, factor=4.0),
            Axis("bandwidth, rad", start=0.2, least=1e-4), narrowest, PSEUDO_COUNT,
        )),
        Method("STeF-map", _fit_stef_map, (CELL_SIZE, PSEUDO_COUNT)),
        Method("DGM", _fit_grid_map, (
            CELL_SIZE, Axis("greatest concentration", start=1e3, factor=3.0, most=1e8), PSEUDO_COUNT,
        )),
        Method("GP", _fit_process, (
            Axis("length, m", start=10.0, least=0.1), Axis("noise", start=0.1, least=1e-4),
        )),
    ]  # fmt: skip


def _fit_cliff_map(train: Tracks, values: tuple[float, ...], _rng: np.random.Generator) -> CliffMap:
    cell_size, speed_unit, bandwidth, least_deviation, pseudo_count = values
    return CliffMap.fit(
        train.position, train.direction, train.speed, cell_size=cell_size, speed_unit=speed_unit, bandwidth=bandwidth,
        least_deviation=least_deviation, pseudo_count=pseudo_count,
    )  # fmt: skip


def _fit_stef_map(train: Tracks, values: tuple[float, ...], _rng: np.random.Generator) -> StefMap:
    cell_size, pseudo_count = values
    return StefMap.fit(train.position, train.direction, cell_size=cell_size, pseudo_count=pseudo_count)


def _fit_grid_map(train: Tracks, values: tuple[float, ...], _rng: np.random.Generator) -> DirectionalGridMap:
    cell_size, bound, pseudo_count = values
    return DirectionalGridMap.fit(
        train.position, train.direction, cell_size=cell_size, max_concentration=bound, pseudo_count=pseudo_count
    )


def _fit_process(train: Tracks, values: tuple[float, ...], rng: np.random.Generator) -> DirectionalGaussianProcess:
    length, noise = values
    return DirectionalGaussianProcess.fit(train.position, train.direction, length=length, noise=noise, rng=rng)
