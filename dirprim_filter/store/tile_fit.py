"""Some cells of a map fitted to what vehicles did in and around a tile, and to nothing else.

So the same recordings of the tile and of those around it give the same bits, whatever else a store holds.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives.assembly import Layout, assemble
from dirprim_filter.primitives.borrowing import borrow
from dirprim_filter.primitives.cell_model import PrimitiveCells, PrimitiveModel
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.motion_learning import Labels, LearningKnobs, label_visits, modes_of, motion_of
from dirprim_filter.primitives.motion_sums import MotionSums
from dirprim_filter.primitives.place_free import PlaceFree
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.refit import Counted, Refit
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.schedule import Schedule
from dirprim_filter.primitives.visits import Visits
from dirprim_filter.store.by_hour import Strengths, fit_schedule
from dirprim_filter.store.fading import Fading, refreshed, refreshed_manoeuvres
from dirprim_filter.store.passages import STEP_NS, Passages
from dirprim_filter.store.recorded_ways import Pieces, Sample
from dirprim_filter.store.tiles import Tile
from dirprim_filter.store.withholding import kept_manoeuvres, vehicles_of_modes, without_modes
from tessellation import GridTessellation, Tessellation, VoronoiTessellation
from tessellation.gates import part_of_members
from tessellation.part import PartOfCells

SEED = 1 << 31
"""Makes numbers of tiles positive."""


class Finished(NamedTuple):
    """The cells of a tile as they are in the map, but for transitions from and to other tiles."""

    cells: IntArray  # (c,) of the map, ascending
    primitives: PrimitiveMap  # numbered from 0
    inner: csr_array  # (z, z) transitions
    ends: Passages  # that vehicles may come to from another tile, or go on from
    flow: FloatArray  # (z,) of manoeuvres: their visits by age, over those that were fitted to
    share: float  # of the ways, that was fitted to


class TileFit(NamedTuple):
    """What was fitted in the cells whose centres lie in a tile, before what is usual elsewhere enters."""

    cells: IntArray  # (c,) of the map, ascending
    fitted: PrimitiveMap  # of these cells, numbered from 0; without motion
    labels: Labels
    sums: MotionSums
    visits: Visits
    pieces: Pieces
    fading: Fading | None
    share: float  # of the ways

    @classmethod
    def of(
        cls, learned: PrimitiveMap, layouts: Layouts, cells: IntArray, tile: Tile, sample: Sample, *,
        fading: Fading | None,
    ) -> TileFit:  # fmt: skip
        """Fit cells of a map, in the recipe that it was learned by.

        Args:
            learned: the map; what its cells hold is not looked at.
            layouts: its cells and those that lend.
            cells: (c,) which to fit, ascending.
            tile: their tile.
            sample: of the ways of vehicles, around the tile.
            fading: how they age there; None where they do not.
        """
        part, pieces = PartOfCells.of(learned.tessellation, cells), Pieces.of(sample.ways)
        fitted = _primitives(layouts, part, pieces.rows)
        visits = Visits.of(pieces.rows, part)
        rng = np.random.default_rng((tile[0] + SEED, tile[1] + SEED))
        labels = label_visits(fitted, visits, rng=rng)
        sums = MotionSums.of(visits, *labels, fitted)
        none = csr_array((labels.cell.size, labels.cell.size))
        return cls(cells, fitted, labels, sums._replace(transition=none), visits, pieces, fading, sample.share)

    def finished(self, learned: PrimitiveMap, counted: Counted) -> Finished:
        """The cells with motion, without what few vehicles did, with weights and speeds by age and by the hour.

        Visits are as many as there would be of all ways.
        """
        min_vehicles = counted.min_vehicles
        motion = motion_of(
            self.sums, self.labels, self.fitted, _place_free_motion(learned.motion),
            LearningKnobs(learned.motion.strength, learned.motion.spread), usual=counted.usual_square,
        )  # fmt: skip
        n_modes = self.fitted.n_own_modes + self.fitted.n_borrowed_modes
        enough = np.ones((self.cells.size, n_modes), np.bool_)
        kept = np.ones(len(motion), np.bool_)
        mode = modes_of(self.fitted, self.visits)
        if min_vehicles > 1 and self.labels.cell.size:
            enough = vehicles_of_modes(self.fitted, self.visits, mode) >= min_vehicles
            kept = kept_manoeuvres(motion, enough, min_vehicles)
        elif min_vehicles > 1:
            enough[:] = False
        placed = replace(without_modes(self.fitted, enough), motion=_of_kept(motion, kept))
        number = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)[self.labels.label]
        passages = self._passages(number)
        inner = passages.followed().counted(len(placed.motion), min_vehicles)
        turned = placed if self.fading is None else self._refreshed(placed, mode, number, self.fading)
        if learned.schedule is not None:
            turned = replace(turned, schedule=self._schedule(turned, mode, learned.schedule, counted))
        motion = turned.motion
        of_all = replace(motion, visits=motion.visits / self.share, seconds=motion.seconds / self.share)
        return Finished(
            self.cells, replace(turned, motion=of_all), inner, passages.at_ends(),
            motion.visits / placed.motion.visits, self.share,
        )  # fmt: skip

    def _refreshed(self, placed: PrimitiveMap, mode: IntArray, number: IntArray, fading: Fading) -> PrimitiveMap:
        """By age; `number` (v,) is the manoeuvre of each visit, -1 where there is none."""
        hour = self.pieces.hour
        turned = refreshed(placed, self.visits, mode, hour, fading)
        there = np.flatnonzero(number >= 0)
        vehicle = self.visits.vehicle[self.visits.begin[there]]
        return replace(turned, motion=refreshed_manoeuvres(turned.motion, number[there], vehicle, hour, fading))

    def _schedule(self, turned: PrimitiveMap, mode: IntArray, whole: Schedule, counted: Counted) -> Schedule:
        flow, pace = counted.slot_strength.tolist()
        strengths = Strengths(flow, pace, counted.slot_share)
        return fit_schedule(
            turned, self.visits, mode, self.pieces.hour, strengths, by=whole.by, zone=whole.zone,
            min_vehicles=counted.min_vehicles,
        )  # fmt: skip

    def _passages(self, number: IntArray) -> Passages:
        visits = self.visits
        seen = np.flatnonzero(self.labels.label >= 0)
        segment = visits.segment[visits.begin[seen]]
        first = np.searchsorted(visits.segment, segment)
        begin_ns = self.pieces.begin_ns[segment] + (visits.begin[seen] - first) * STEP_NS
        end_ns = begin_ns + (visits.end[seen] - visits.begin[seen] - 1) * STEP_NS
        hour = self.pieces.hour[visits.vehicle[visits.begin[seen]]]
        by_age = np.ones(seen.size) if self.fading is None else self.fading.slowly.share(hour)
        return Passages(self.pieces.way[segment], begin_ns, end_ns, number[seen], self.share * by_age)


class Layouts(NamedTuple):
    """The cells of a map, those that they borrow from, and how both are fitted."""

    refit: Refit
    free: PlaceFree
    own: Layout
    lenders: list[Layout]

    @classmethod
    def of(cls, learned: PrimitiveMap, refit: Refit) -> Layouts:
        """Those of a map that was fitted so."""
        k, cells = learned.n_place_free_modes, learned.tessellation
        direction, speed = learned.direction, learned.speed
        weight, mean, concentration, shape, rate = (
            column[-1, -k:]
            for column in (direction.weight, direction.mean_direction, direction.concentration, speed.shape, speed.rate)
        )
        free = PlaceFree(weight, mean, concentration, shape, rate, refit.recipe.usual.speed_spread)
        region = cells.region if isinstance(cells, VoronoiTessellation) else cells
        if not isinstance(region, GridTessellation):
            raise TypeError(f"tessellation: expected cells that maps know, got {type(region).__name__}")
        softness = refit.softness or refit.recipe.config.softness[0]
        lenders = [Layout(VoronoiTessellation(generators=g, region=region), softness) for g in refit.lenders]
        return cls(refit, free, Layout(cells, refit.softness), lenders)

    @property
    def reach_m(self) -> float:
        """How far from the centre of a cell that lies what is learned from there, about: some cells away."""
        largest = max(float(layout.cells.area.max(initial=0.0)) for layout in (self.own, *self.lenders))
        return REACH * float(np.sqrt(largest))

    def fit(self, layout: Layout, cells: IntArray, rows: TrackRows) -> PrimitiveCells:
        """Some cells of a layout."""
        model = PrimitiveModel(self.refit.recipe, self.free, np.empty(0))
        return model.fit(rows.position, rows, part_of_members(layout.members(rows.position), cells))


REACH = 3.0
"""Sides of the largest cell, if it were a square."""


def _primitives(layouts: Layouts, part: PartOfCells, rows: TrackRows) -> PrimitiveMap:
    """What happens in a part of the cells; of places that no cell covers nothing is learned."""
    rows = rows[layouts.own.cells.cell_of(rows.position) >= 0]
    own = layouts.fit(layouts.own, part.cells, rows)
    home = rows[part.cell_of(rows.position) >= 0]
    lenders: list[tuple[Tessellation, PrimitiveCells]] = []
    for lender in layouts.lenders:
        there = lender.cells.cell_of(home.position)
        some = PartOfCells.of(lender.cells, np.unique(there[there >= 0]))
        lenders.append((some, layouts.fit(lender, some.cells, rows)))
    borrowed = borrow(home, part, lenders, layouts.refit.borrowed) if lenders else None
    fitted = assemble(part, own, layouts.free, layouts.refit.place_free, borrowed)
    n_rows = np.bincount(part.cell_of(home.position), minlength=part.n_cells)
    return replace(fitted, n_rows=np.append(n_rows, n_rows.sum()))


def _place_free_motion(motion: Motion) -> tuple[dict[str, FloatArray], csr_array]:
    """As `learn_place_free` gives it."""
    free = motion.without_places()
    columns = {name: getattr(free, name) for name in (*FLOATS, "cell", "mode")}
    return columns, csr_array((free.count, free.following, free.first), shape=(len(free), len(free)))


def _of_kept(motion: Motion, kept: BoolArray) -> Motion:
    """Some manoeuvres, without transitions."""
    columns = {name: getattr(motion, name)[kept] for name in (*FLOATS, "cell", "mode")}
    return replace(
        motion, **columns, first=np.zeros(int(kept.sum()) + 1, np.int64), following=np.empty(0, np.int64),
        count=np.empty(0),
    )  # fmt: skip
