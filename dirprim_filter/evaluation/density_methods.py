"""The rows of Table I: ours, and rivals with the settings that are chosen for them.

All settings are chosen by `settings.choose` on held-out training vehicles. Limits are those of the data: logs do not
know positions better than to a decimetre, nor courses than to 1e-4 rad (those of SUMO are rounded to .01 degrees);
where directions repeat exactly the likelihood grows without bound as modes grow narrow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.evaluation.baselines.cliff_map import CliffMap
from dirprim_filter.evaluation.baselines.directional_grid_map import DirectionalGridMap
from dirprim_filter.evaluation.baselines.gaussian_process import DirectionalGaussianProcess
from dirprim_filter.evaluation.baselines.stef_map import StefMap
from dirprim_filter.evaluation.settings import Axis
from dirprim_filter.primitives import PrimitiveMap, learn_primitives
from dirprim_filter.tracks import Tracks

Fit = Callable[[Tracks, tuple[float, ...], np.random.Generator], Any]
"""Learns from tracks, with values of the settings, a model of directions, or of directions and speeds."""


def log_densities(model: Any, test: Tracks) -> dict[str, FloatArray]:
    """(n,) natural logs of `direction`, per radian, and, of a model that has them, `speed`, per m/s, and `joint`."""
    found = {"direction": model.direction_log_density(test.position, test.direction)}
    if hasattr(model, "log_density"):
        found["speed"] = model.speed_log_density(test.position, test.speed)
        found["joint"] = model.log_density(test.position, test.direction, test.speed)
    return found


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


PRIMITIVE_KINDS: tuple[Any, ...] = get_args(get_type_hints(learn_primitives)["primitive"])
"""What `learn_primitives` can learn, the default first: each is a row of the table."""
WITHOUT_MAP = "without the map"
CELL_SIZE = Axis("cell size, m", start=3.0, factor=1.5, least=0.1)
PSEUDO_COUNT = Axis("pseudo-count, rows", start=1.0, factor=3.0)


def all_methods(*, max_speed: float) -> list[Method]:
    """Every row of the table.

    Args:
        max_speed: m/s, of all rows: given to the uninformative baseline.
    """
    return [
        *(Method(f"primitive, {kind}", _learner(primitive=kind)) for kind in PRIMITIVE_KINDS),
        Method("primitive, the paper's", _learner(primitive="flat", tessellation="grid", modes="dbscan")),
        Method("one cell", _learner(n_cells=1)),
        Method(WITHOUT_MAP, _without_map),
        *rivals(),
        Method("uninformative", lambda _train, _values, _rng: Uninformative(max_speed=max_speed)),
    ]


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


def _fit(fit: Callable[..., Any], *names: str, speed: bool = False, rng: bool = False) -> Fit:
    """Fits to positions and directions, perhaps speeds, with the settings of these names."""

    def learn(train: Tracks, values: tuple[float, ...], own: np.random.Generator) -> Any:
        rows = (train.position, train.direction, train.speed)[: 2 + speed]
        return fit(*rows, **dict(zip(names, values, strict=True)), **({"rng": own} if rng else {}))

    return learn


def _learner(**options: Any) -> Fit:
    return lambda train, _values, rng: learn_primitives(train, rng=rng, **options)


def _without_map(train: Tracks, _values: tuple[float, ...], rng: np.random.Generator) -> PrimitiveMap:
    return learn_primitives(train, tessellation="grid", n_cells=1, primitive="flat", rng=rng).without_places()


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
