"""What cells of a map are fitted by, wherever they are: small beside what they hold."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.primitives.assembly import Layout, assemble
from dirprim_filter.primitives.borrowing import borrow
from dirprim_filter.primitives.cell_model import PrimitiveCells, PrimitiveModel
from dirprim_filter.primitives.choice import SOFTNESS
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.place_free import PlaceFree
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.refit import Refit
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.schedule import By
from tessellation import GridTessellation, Tessellation, VoronoiTessellation
from tessellation.gates import part_of_members
from tessellation.part import PartOfCells

REACH = 3.0
"""Sides of the largest cell, if it were a square."""


class Turning(NamedTuple):
    """How a map turns with the hour."""

    by: By
    zone: str


class Basis(NamedTuple):
    """The cells of a map and those that they borrow from, how both are fitted, and what is of no place."""

    refit: Refit
    free: PlaceFree
    own: Layout
    lenders: list[Layout]
    motion: Motion  # of no place
    turning: Turning | None

    @classmethod
    def of(cls, learned: PrimitiveMap, refit: Refit) -> Basis:
        """That of a map that was fitted so."""
        k, cells = learned.n_place_free_modes, learned.tessellation
        direction, speed = learned.direction, learned.speed
        weight, mean, concentration, shape, rate = (
            column[-1, -k:].copy()
            for column in (direction.weight, direction.mean_direction, direction.concentration, speed.shape, speed.rate)
        )
        free = PlaceFree(weight, mean, concentration, shape, rate, refit.recipe.usual.speed_spread)
        region = cells.region if isinstance(cells, VoronoiTessellation) else cells
        if not isinstance(region, GridTessellation):
            raise TypeError(f"tessellation: expected cells that maps know, got {type(region).__name__}")
        softness = refit.softness or SOFTNESS
        lenders = [Layout(VoronoiTessellation(generators=g, region=region), softness) for g in refit.lenders]
        turning = None if learned.schedule is None else Turning(learned.schedule.by, learned.schedule.zone)
        own = Layout(cells, refit.softness)
        return cls(replace(refit, counted=None), free, own, lenders, learned.motion.without_places(), turning)

    @property
    def reach_m(self) -> float:
        """How far from the centre of a cell that lies what is learned from there, about: some cells away."""
        largest = max(float(layout.cells.area.max(initial=0.0)) for layout in (self.own, *self.lenders))
        return REACH * float(np.sqrt(largest))

    def place_free_motion(self) -> tuple[dict[str, FloatArray], csr_array]:
        """As `learn_place_free` gives it."""
        free = self.motion
        columns = {name: getattr(free, name) for name in (*FLOATS, "cell", "mode")}
        return columns, csr_array((free.count, free.following, free.first), shape=(len(free), len(free)))

    def primitives(self, part: PartOfCells, rows: TrackRows) -> PrimitiveMap:
        """What happens in a part of the cells; of places that no cell covers nothing is learned."""
        rows = rows[self.own.cells.cell_of(rows.position) >= 0]
        own = self._fitted(self.own, part.cells, rows)
        home = rows[part.cell_of(rows.position) >= 0]
        lenders: list[tuple[Tessellation, PrimitiveCells]] = []
        for lender in self.lenders:
            there = lender.cells.cell_of(home.position)
            some = PartOfCells.of(lender.cells, np.unique(there[there >= 0]))
            lenders.append((some, self._fitted(lender, some.cells, rows)))
        borrowed = borrow(home, part, lenders, self.refit.borrowed) if lenders else None
        fitted = assemble(part, own, self.free, self.refit.place_free, borrowed)
        n_rows = np.bincount(part.cell_of(home.position), minlength=part.n_cells)
        return replace(fitted, n_rows=np.append(n_rows, n_rows.sum()))

    def _fitted(self, layout: Layout, cells: IntArray, rows: TrackRows) -> PrimitiveCells:
        """Some cells of a layout."""
        model = PrimitiveModel(self.refit.recipe, self.free, np.empty(0))
        return model.fit(rows.position, rows, part_of_members(layout.members(rows.position), cells))
