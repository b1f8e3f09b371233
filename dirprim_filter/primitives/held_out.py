"""Vehicles held out, and how likely layouts and recipes make them that learned from the others."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray
from dirprim_filter.primitives.assembly import Layout, assemble, gather, place_free_share
from dirprim_filter.primitives.cell_model import PrimitiveCells, fitted
from dirprim_filter.primitives.place_free import PlaceFree
from dirprim_filter.primitives.recipe import Recipe
from dirprim_filter.primitives.rows import CellRows, TrackRows

PLACE_FREE_STRENGTHS = np.geomspace(0.01, 10.0, 13)
"""Pseudo-vehicles with which the place-free primitive may enter a cell."""
NO_STRENGTH = 1e-12
"""Pseudo-vehicles of the place-free primitive in a map that it shall have no say in."""


class HeldOut:
    """Rows to learn from and rows that are held out. What many recipes need alike is found once."""

    def __init__(self, rows: TrackRows, held_out: BoolArray, free: PlaceFree) -> None:
        """Of (n,) rows those where `held_out` is true are judged by what the others say."""
        self._seen, self._kept, self._free = rows[~held_out], rows[held_out], free
        self._gathered: dict[int, tuple[Layout, CellRows]] = {}  # the layout too: its number stays its own
        self._fits: dict[tuple[int, Recipe], PrimitiveCells] = {}
        self._place_free: FloatArray | None = None

    def scores(self, layout: Layout, recipe: Recipe) -> FloatArray:
        """(n_strengths,) mean log density of the held-out rows, for each of `PLACE_FREE_STRENGTHS`."""
        fits = self._fitted(layout, recipe)
        placed = self._log_density(layout, fits)
        cell = layout.cells.cell_of(self._kept.position)
        share = place_free_share(np.append(fits.n_vehicles, 0.0)[cell][:, None], PLACE_FREE_STRENGTHS)
        with np.errstate(divide="ignore"):
            in_place, anywhere = np.log1p(-share), np.log(share) + self._place_free_log_density(layout, fits)[:, None]
            score = np.logaddexp(in_place + placed[:, None], anywhere)
        return np.asarray(np.average(score, axis=0, weights=self._kept.weight))

    def _fitted(self, layout: Layout, recipe: Recipe) -> PrimitiveCells:
        """Each cell's modes, as the other rows have them."""
        number = id(layout)
        if number not in self._gathered:
            self._gathered[number] = layout, gather(self._seen, layout, recipe)
        if (number, recipe) not in self._fits:
            self._fits[number, recipe] = fitted(self._gathered[number][1], recipe)
        return self._fits[number, recipe]

    def _log_density(self, layout: Layout, fits: PrimitiveCells) -> FloatArray:
        """Of the held-out rows, where the place-free primitive has no say."""
        made = assemble(layout.cells, fits, self._free, NO_STRENGTH)
        return made.log_density(self._kept.position, self._kept.direction, self._kept.speed)

    def _place_free_log_density(self, layout: Layout, fits: PrimitiveCells) -> FloatArray:
        """Of the held-out rows, where nothing else has any."""
        if self._place_free is None:
            made = assemble(layout.cells, fits, self._free, NO_STRENGTH).without_places()
            self._place_free = made.log_density(self._kept.position, self._kept.direction, self._kept.speed)
        return self._place_free
