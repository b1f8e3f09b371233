"""What cells hold, without where they are."""

from __future__ import annotations

from typing import NamedTuple, Self

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.motion import Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.schedule import Schedule

FILLERS = {
    "weight": 0.0, "mean_direction": 0.0, "concentration": 0.0, "shape": 1.0, "rate": 1.0, "bend": 0.0, "gain": 0.0,
}  # fmt: skip
"""Of modes that a cell does not have."""


class Contents(NamedTuple):
    """Of a map, or of some of its cells; rows and modes as of `PrimitiveMap`."""

    column: dict[str, FloatArray]  # (n_cells + 1, modes, ...), named as `FILLERS`
    n_rows: IntArray  # (n_cells + 1,)
    n_own_modes: int
    n_borrowed_modes: int
    motion: Motion
    schedule: Schedule | None

    @classmethod
    def of(cls, m: PrimitiveMap) -> Self:
        """Of a map."""
        d, s = m.direction, m.speed
        values = (d.weight, d.mean_direction, d.concentration, s.shape, s.rate, m.bend, m.gain)
        column = dict(zip(FILLERS, values, strict=True))
        return cls(column, m.n_rows, m.n_own_modes, m.n_borrowed_modes, m.motion, m.schedule)
