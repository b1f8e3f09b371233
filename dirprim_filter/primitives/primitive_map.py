"""Directional primitives on a map: p(direction, speed | position).

Source: Senanayake et al., Directional Primitives for Uncertainty-Aware Motion Estimation in Urban Environments, 2020,
Eq. 1-3.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self, cast

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray, as_floats, require
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.origin import Origin
from dirprim_filter.primitives import _map_kernels
from dirprim_filter.primitives._map_kernels import MapTable, ModeTable
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.motion import Motion
from tessellation import GridTessellation, Tessellation
from tessellation.locate import locator_of


class Primitive(NamedTuple):
    """How vehicles move at a place: directions in modes (Eq. 1), and for each mode its speeds (Eq. 3).

    Leading axes broadcast; the last axis of every parameter counts the modes, padded with weight 0.
    """

    direction: VonMisesMixture
    speed: Gamma

    @classmethod
    def of(cls, modes: Modes) -> Self:
        """Where modes hold, without their slopes."""
        mean = modes.mean_direction
        direction = VonMisesMixture(weight=modes.weight, mean_direction=mean, concentration=modes.concentration)
        return cls(direction, Gamma(shape=modes.shape, rate=modes.rate))


@dataclass(frozen=True, slots=True, kw_only=True)
class PrimitiveMap:
    """A primitive for every place: those of the cells, and one that holds wherever no cell does.

    Parameters have one row for each cell and, last, the row of the background model: so that index `OUTSIDE`,
    which is -1, gathers it.

    Attributes:
        tessellation: the cells.
        modes: (n_cells + 1, M) modes of direction and speed.
        n_rows: (n_cells + 1,) how many observations each row was learned from.
        n_background_modes: how many of the last modes are tails, or the background model's: what a cell leans on
            where it knows little. They say where vehicles go at large, not here, so motion is not drawn to them.
        motion: how vehicles go on from place to place; left out: each on the mode of its cell, and settling on it.
        origin: latitude and longitude of the plane's origin, degrees; None where positions have none.

    Raises:
        ValueError: the parameters are not those of n_cells + 1 primitives.
    """

    tessellation: Tessellation
    modes: Modes
    n_rows: IntArray
    n_background_modes: int
    motion: Motion = None  # type: ignore[assignment]  # made of the primitives where it is left out
    origin: Origin | None = None
    _table: MapTable | None = field(init=False, repr=False, compare=False, default=None)

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", Origin.of(self.origin))
        n, (direction, speed) = self.tessellation.n_cells + 1, Primitive.of(self.modes)
        shapes = direction.weight.shape, speed.shape.shape
        if len(shapes[0]) != 2 or shapes[0] != shapes[1] or shapes[0][0] != n or self.n_rows.shape != (n,):
            raise ValueError(
                f"direction, speed, n_rows: expected ({n}, M), ({n}, M) and ({n},), "
                f"got {shapes[0]}, {shapes[1]} and {self.n_rows.shape}"
            )
        if not 0 <= self.n_background_modes <= shapes[0][1]:
            raise ValueError(f"n_background_modes: expected 0 to {shapes[0][1]}, got {self.n_background_modes}")
        slopes = (as_floats(name, getattr(self.modes, name), f"{n} {shapes[0][1]} 2") for name in ("bend", "gain"))
        mixture = direction.weight, direction.mean_direction, direction.concentration
        object.__setattr__(self, "modes", Modes(*mixture, speed.shape, speed.rate, *slopes))
        if self.motion is None:
            object.__setattr__(self, "motion", Motion.settling(self.modes, self.n_own_modes))
        last = self.motion.cell[self.motion.n_placed - 1] if self.motion.n_placed else -1
        if last >= n - 1 or ((self.motion.mode < 0) | (self.motion.mode >= shapes[0][1])).any():
            raise ValueError(f"motion: expected manoeuvres of {n - 1} cells and {shapes[0][1]} modes, got others")

    @property
    def direction(self) -> VonMisesMixture:
        """(n_cells + 1, M) mixture of directions."""
        return Primitive.of(self.modes).direction

    @property
    def speed(self) -> Gamma:
        """(n_cells + 1, M) speeds of each mode."""
        return Primitive.of(self.modes).speed

    @property
    def n_own_modes(self) -> int:
        """How many of the first modes are a cell's own; where they were learned, the last is for standing."""
        return int(self.modes.weight.shape[1]) - self.n_background_modes

    @property
    def own_weight(self) -> FloatArray:
        """(n_cells, n_own_modes) the weights of the cells' own modes."""
        return self.modes.weight[:-1, : self.n_own_modes]

    @property
    def centers(self) -> FloatArray:
        """(n_cells + 1, 2) where each row's parameters hold, metres; of the background row anywhere, so the origin."""
        return np.vstack([self.tessellation.centers.reshape(-1, 2), np.zeros(2)])

    def primitive_at(self, position: FloatArray) -> Primitive:
        """The primitives that hold at positions. (..., 2) -> leading axes (...).

        Raises:
            ValueError: the last axis is not 2, or a coordinate is not finite.
        """
        cell = self.tessellation.cell_of(position)
        offset = np.asarray(position, dtype=np.float64) - self.centers[cell]
        return Primitive.of(self.modes.take(cell).at(offset))

    def log_density(self, position: FloatArray, direction: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(direction, speed | position), per radian and m/s. (..., 2), (...), (...) -> (...).

        -inf for a negative speed. Leading axes broadcast.

        Raises:
            ValueError: the last axis of the positions is not 2, or a number is not finite.
        """
        return self._log_densities(position, direction, speed)

    def direction_log_density(self, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Natural log of p(direction | position), per radian (Eq. 1). (..., 2), (...) -> (...). See `log_density`."""
        return self._log_densities(position, direction, None)

    def speed_log_density(self, position: FloatArray, speed: FloatArray) -> FloatArray:
        """Natural log of p(speed | position), per m/s: gammas, mixed. (..., 2), (...) -> (...). See `log_density`."""
        return self._log_densities(position, None, speed)

    def sample(self, position: FloatArray, *, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """A direction and a speed at each position, radians and m/s. (..., 2) -> (...), (...).

        Raises:
            ValueError: the last axis is not 2, or a coordinate is not finite.
        """
        position = as_floats("position", position, "... 2")
        place = position.reshape(-1, 2)
        direction, speed = np.empty((2, len(place)))
        state = require("rng", rng, np.random.Generator).integers(0, 2**64, size=4, dtype=np.uint64)
        _map_kernels.draw(self.compiled(), place, state, direction, speed)
        return direction.reshape(position.shape[:-1]), speed.reshape(position.shape[:-1])

    def _log_densities(
        self, position: FloatArray, direction: FloatArray | None, speed: FloatArray | None
    ) -> FloatArray:
        """The log density of what is given."""
        given = {"direction": direction, "speed": speed}
        columns = {name: as_floats(name, column, "...") for name, column in given.items() if column is not None}
        position = as_floats("position", position, "... 2")
        shape = np.broadcast_shapes(position.shape[:-1], *(column.shape for column in columns.values()))
        place = np.ascontiguousarray(np.broadcast_to(position, (*shape, 2))).reshape(-1, 2)
        flat = {name: np.ascontiguousarray(np.broadcast_to(c, shape)).reshape(-1) for name, c in columns.items()}
        cell = self.tessellation.cell_of(place)
        modes = ModeTable(*self.compiled()[1:])
        found = modes.log_density(cell, place, flat.get("direction"), flat.get("speed"))
        return found.reshape(shape)

    def compiled(self) -> MapTable:
        """The parameters as the kernels take them, made at the first use."""
        if self._table is None:
            modes = ModeTable.of(self.modes, self.centers)
            object.__setattr__(self, "_table", MapTable(locator_of(self.tessellation), *modes))
        return cast(MapTable, self._table)

    def without_places(self) -> PrimitiveMap:
        """The same map with no cell: the ablation that shows what knowing the place is worth."""
        last, motion = np.array([-1]), self.motion.without_places()
        rows = {"modes": self.modes.take(last), "n_rows": self.n_rows[last]}
        return replace(self, tessellation=GridTessellation.empty(), motion=motion, **rows)
