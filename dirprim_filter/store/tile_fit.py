"""Some cells of a map fitted to what vehicles did in and around a tile, and to nothing else.

So the same recordings of the tile and of those around it give the same bits, whatever else a store holds.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.motion_learning import (
    Deviations,
    Labels,
    label_visits,
    modes_of,
    motion_of,
)
from dirprim_filter.primitives.motion_sums import MotionSums
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.refit import Counted
from dirprim_filter.primitives.schedule import Schedule
from dirprim_filter.primitives.visits import Visits
from dirprim_filter.store.basis import Basis, Turning
from dirprim_filter.store.by_hour import Strengths, fit_schedule
from dirprim_filter.store.contents import Contents
from dirprim_filter.store.fading import Fading, refreshed, refreshed_manoeuvres
from dirprim_filter.store.passages import STEP_NS, Passages
from dirprim_filter.store.recorded_ways import Pieces, Sample
from dirprim_filter.store.tiles import Tile
from dirprim_filter.store.withholding import kept_manoeuvres, vehicles_of_modes, without_modes
from tessellation.part import PartOfCells

SEED = 1 << 31
"""Makes numbers of tiles positive."""


class Finished(NamedTuple):
    """The cells of a tile as they are in the map, but for transitions from and to other tiles."""

    cells: IntArray  # (c,) of the map, ascending
    contents: Contents  # of these cells, numbered from 0; manoeuvres' spreads lean on what is usual among them
    deviations: Deviations  # of manoeuvres of a cell
    inner: csr_array  # (z, z) transitions
    ends: Passages  # that vehicles may come to from another tile, or go on from
    flow: FloatArray  # (z,) of manoeuvres: their visits by age, over those that were fitted to
    share: float  # of the ways, that was fitted to

    def leaning_on(self, usual_square: FloatArray) -> Finished:
        """The same with spreads that lean on what is usual in the whole map, see `Deviations`."""
        motion, placed = self.contents.motion, self.contents.motion.n_placed
        spreads: dict[str, Any] = {
            name: np.append(own, getattr(motion, name)[placed:])
            for name, own in self.deviations.spreads(usual_square, motion.spread).items()
        }
        return self._replace(contents=self.contents._replace(motion=replace(motion, **spreads)))


class TileFit(NamedTuple):
    """What was fitted in the cells whose centres lie in a tile."""

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
        cls, basis: Basis, cells: IntArray, tile: Tile, sample: Sample, *, fading: Fading | None
    ) -> TileFit:  # fmt: skip
        """Fit cells of a map, in the recipe that it was learned by.

        Args:
            basis: of the map.
            cells: (c,) which to fit, ascending.
            tile: their tile.
            sample: of the ways of vehicles, around the tile.
            fading: how they age there; None where they do not.
        """
        part, pieces = PartOfCells.of(basis.own.cells, cells), Pieces.of(sample.ways)
        fitted = basis.primitives(part, pieces.rows)
        visits = Visits.of(pieces.rows, part)
        rng = np.random.default_rng((tile[0] + SEED, tile[1] + SEED))
        labels = label_visits(fitted, visits, rng=rng)
        sums = MotionSums.of(visits, *labels, fitted)
        none = csr_array((labels.cell.size, labels.cell.size))
        return cls(cells, fitted, labels, sums._replace(transition=none), visits, pieces, fading, sample.share)

    def finished(self, basis: Basis, counted: Counted) -> Finished:
        """The cells with motion, without what few vehicles did, with weights and speeds by age and by the hour.

        Visits are as many as there would be of all ways.
        """
        min_vehicles, free = counted.min_vehicles, basis.motion
        motion = motion_of(
            self.sums, self.labels, self.fitted, basis.place_free_motion(), strength=free.strength, spread=free.spread
        )
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
        if basis.turning is not None:
            turned = replace(turned, schedule=self._schedule(turned, mode, basis.turning, counted))
        motion = turned.motion
        of_all = replace(motion, visits=motion.visits / self.share, seconds=motion.seconds / self.share)
        deviations = Deviations.of(self.sums, self.labels, self.fitted)
        return Finished(
            self.cells, Contents.of(turned)._replace(motion=of_all), deviations.some(kept[: self.labels.cell.size]),
            inner, passages.at_ends(), motion.visits / placed.motion.visits, self.share,
        )  # fmt: skip

    def _refreshed(self, placed: PrimitiveMap, mode: IntArray, number: IntArray, fading: Fading) -> PrimitiveMap:
        """By age; `number` (v,) is the manoeuvre of each visit, -1 where there is none."""
        hour = self.pieces.hour
        turned = refreshed(placed, self.visits, mode, hour, fading)
        there = np.flatnonzero(number >= 0)
        vehicle = self.visits.vehicle[self.visits.begin[there]]
        return replace(turned, motion=refreshed_manoeuvres(turned.motion, number[there], vehicle, hour, fading))

    def _schedule(self, turned: PrimitiveMap, mode: IntArray, turning: Turning, counted: Counted) -> Schedule:
        flow, pace = counted.slot_strength.tolist()
        strengths = Strengths(flow, pace, counted.slot_share)
        return fit_schedule(
            turned, self.visits, mode, self.pieces.hour, strengths, by=turning.by, zone=turning.zone,
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


def _of_kept(motion: Motion, kept: BoolArray) -> Motion:
    """Some manoeuvres, without transitions."""
    columns = {name: getattr(motion, name)[kept] for name in (*FLOATS, "cell", "mode")}
    return replace(
        motion, **columns, first=np.zeros(int(kept.sum()) + 1, np.int64), following=np.empty(0, np.int64),
        count=np.empty(0),
    )  # fmt: skip
