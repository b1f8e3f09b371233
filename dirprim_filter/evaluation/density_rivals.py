"""The rivals of Table I, each with the settings that are chosen for it.

All settings are chosen by `settings.choose` on held-out training vehicles. Limits are those of the data: logs do not
know positions better than to a decimetre, nor courses than to 1e-4 rad (those of SUMO are rounded to .01 degrees);
where directions repeat exactly the likelihood grows without bound as modes grow narrow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions.angles import TWO_PI
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
        Method(
            "CLiFF-map",
            _fit(CliffMap.fit, "cell_size", "speed_unit", "bandwidth", "least_deviation", "pseudo_count", speed=True),
            (CELL_SIZE, Axis("speed that counts as 1 rad, m/s", start=20.0, factor=4.0),
             Axis("bandwidth, rad", start=0.2, least=1e-4), narrowest, PSEUDO_COUNT),
        ),
        Method("STeF-map", _fit(StefMap.fit, "cell_size", "pseudo_count"), (CELL_SIZE, PSEUDO_COUNT)),
        Method(
            "DGM", _fit(DirectionalGridMap.fit, "cell_size", "max_concentration", "pseudo_count"),
            (CELL_SIZE, Axis("greatest concentration", start=1e3, factor=3.0, most=1e8), PSEUDO_COUNT),
        ),
        Method(
            "GP", _fit(DirectionalGaussianProcess.fit, "length", "noise", rng=True),
            (Axis("length, m", start=10.0, least=0.1), Axis("noise", start=0.1, least=1e-4)),
        ),
    ]  # fmt: skip


def _fit(fit: Callable[..., DirectionModel], *names: str, speed: bool = False, rng: bool = False) -> Fit:
    """Fits to positions and directions, perhaps speeds, with the settings of these names."""

    def learn(train: Tracks, values: tuple[float, ...], own: np.random.Generator) -> DirectionModel:
        rows = (train.position, train.direction, train.speed)[: 2 + speed]
        return fit(*rows, **dict(zip(names, values, strict=True)), **({"rng": own} if rng else {}))

    return learn


@dataclass(frozen=True, slots=True, kw_only=True)
class Uninformative:
    """1 / (2 pi) = 0.159 for every direction, and a uniform density of speed from 0 to `max_speed`, m/s."""

    max_speed: float

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian. (..., 2), (...) -> (...)."""
        return np.full(np.broadcast_shapes(position.shape[:-1], direction.shape), -np.log(TWO_PI))

    def speed_log_density(self, position: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(speed | position), per m/s; -inf out of range. (..., 2), (...) -> (...)."""
        inside = (speed >= 0) & (speed <= self.max_speed)
        shape = np.broadcast_shapes(position.shape[:-1], speed.shape)
        return np.broadcast_to(np.where(inside, -np.log(self.max_speed), -np.inf), shape)

    def log_density(self, position: FloatArray, direction: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(direction, speed | position), per radian and m/s. (..., 2), (...), (...) -> (...)."""
        return self.direction_log_density(position, direction) + self.speed_log_density(position, speed)
