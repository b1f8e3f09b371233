"""Some cells of a tessellation with a raster of their own: what compiled code asks for the cell of a point."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Self

import numpy as np

from tessellation._arrays import FloatArray, IntArray
from tessellation._kernels import Locator
from tessellation._pickling import from_fields
from tessellation.locate import locator_of, renumbered
from tessellation.part import PartOfCells
from tessellation.protocols import OUTSIDE, Tessellation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocatedPart(PartOfCells):
    """Some cells, with the borders that they have among all.

    Attributes:
        known_area: (n_cells,) square metres; more than in the whole, where that is itself a part of more.
        locator: answers as that of all cells, to the last bit.
    """

    known_area: FloatArray
    locator: Locator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "locator", renumbered(locator_of(self.whole), self.number))

    def __reduce__(self) -> tuple[partial[Self], tuple[()]]:
        """Without its rasters: see `_pickling`."""
        return from_fields(self)

    @classmethod
    def of(cls, whole: Tessellation, cells: IntArray, area: FloatArray | None = None) -> Self:
        """The cells (n,), ascending; of other areas (n,) than in the whole where they are given."""
        number = np.full(whole.n_cells + 1, OUTSIDE)
        number[cells] = np.arange(cells.size)
        known = whole.area[cells] if area is None else area
        return cls(whole=whole, cells=cells, number=number, known_area=known)

    @property
    def area(self) -> FloatArray:
        """(n_cells,) square metres."""
        return self.known_area
