"""A map brought up to date with its store: cells are fitted anew where recordings were added or forgotten.

A map of a store has its cells, what was chosen by held-out vehicles, and of each tile of the lattice which recordings
it was learned from. What its cells hold is fitted tile by tile, each from its own and the surrounding tiles' recordings
alone (`tile_fit`). So to fit those tiles anew whose recordings are not the same gives what fitting all anew would, in
whatever order recordings came and went.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.primitives.motion_learning import usual_squares
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.refit import N_SPREADS, Counted, Refit
from dirprim_filter.primitives.schedule import By
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.learning import MIN_VEHICLES, learn_with_strengths, share_of_steps
from dirprim_filter.store.recorded_ways import Pieces, WayRows
from dirprim_filter.store.refitted import refitted
from dirprim_filter.store.store import Store
from dirprim_filter.store.stored_sums import StoredSums
from dirprim_filter.store.tile_fit import Layouts, TileFit
from dirprim_filter.store.tiles import TILE_SQUARES, Digests, Tile, around, ends_of, tiles_at

logger = logging.getLogger(__name__)

HALO_M = 96.0
"""Metres around a tile that are learned from, at least: what distinguishes manoeuvres lies so far ahead."""

Progress = Callable[[int, int], None]


class Updated(NamedTuple):
    """A map, and what was done to it."""

    primitive_map: PrimitiveMap
    n_cells: int  # fitted anew
    n_tiles: int  # whose recordings are not the same
    uncovered: float  # share of what vehicles did in these that no cell covers


def learn_from_store(
    store: Store, sums: StoredSums, *, min_vehicles: int = MIN_VEHICLES, fading: Fading | None = None,
    by: By | None = None, zone: str = "UTC", rng: np.random.Generator, **options: Any,
) -> PrimitiveMap:  # fmt: skip
    """Learn a map that `update_map` can keep up to date.

    Where cells are, and all that held-out vehicles choose, is learned from the sum of all recordings. What cells hold
    is then fitted tile by tile, each from its own and the surrounding tiles' recordings, and ages from when the last
    of these ended.

    Args:
        store: of recordings.
        sums: of it.
        min_vehicles: as for `learn_from_summary`.
        fading: as for `learn_from_summary`; age is counted from `now_ns` at the latest.
        by: as for `learn_from_summary`.
        zone: as for `learn_from_summary`.
        rng: as for `learn_primitives`.
        options: others of `learn_primitives`. With modes that cannot be refitted the map is learned as a whole.

    Raises:
        ValueError: as for `learn_from_summary`.
    """
    since = None
    if fading is not None:
        since = fading.until(max((entry.end_ns for entry in store.entries()), default=0))
    learned, strengths = learn_with_strengths(
        sums, min_vehicles=min_vehicles, fading=since, by=by, zone=zone, rng=rng, **options
    )
    if learned.refit is None:
        return learned
    counted = Counted(
        by=_counts_by(store), min_vehicles=min_vehicles, share=share_of_steps(sums, since and since.slowly),
        usual_square=np.zeros(N_SPREADS), tile=np.empty((0, 2), np.int64), digest=np.empty(0, np.int64),
    )  # fmt: skip
    if fading is not None:
        counted = replace(counted, half_life_s=fading.half_life_s, now_ns=fading.now_ns)
    if strengths is not None:
        counted = replace(counted, slot_strength=np.array(strengths[:2]), slot_share=strengths.share)
    return _updated(learned, learned.refit, counted, store, anew=True).primitive_map


def update_map(primitive_map: PrimitiveMap, store: Store, *, progress: Progress | None = None) -> Updated:
    """Fit a map's cells anew where its store has other recordings than it was learned from.

    The cells stay where they are, and so does all that is of no place or was chosen by held-out vehicles.

    Args:
        primitive_map: learned from this store, or from one that counts alike.
        store: it.
        progress: called with how many tiles are fitted, and of how many.

    Returns:
        The map: the same where nothing changed, and the same whatever order recordings were added and forgotten in.

    Raises:
        ValueError: a map that was not learned from a store, or of one that counts otherwise or in another frame.
        RecordingError: a recording is damaged.
        OSError: one cannot be read.
    """
    refit = primitive_map.refit
    turns = primitive_map.schedule is not None
    if refit is None or refit.counted is None or turns != (refit.counted.slot_strength.size > 0):
        raise ValueError(
            "map: expected one learned from a store, got one that cannot be fitted in parts; learn it with `dirprim "
            "learn STORE`"
        )
    if refit.counted.by != _counts_by(store):
        raise ValueError(
            f"{store.path}: expected a store that counts as {refit.counted.by}, as the map's, got {_counts_by(store)}; "
            "take the store that the map was learned from, or learn from this one"
        )
    return _updated(primitive_map, refit, refit.counted, store, progress=progress)


def _counts_by(store: Store) -> str:
    return f"configuration {store.config.digest} in frame {store.frame!r}"


def _updated(
    learned: PrimitiveMap, refit: Refit, counted: Counted, store: Store, *, anew: bool = False,
    progress: Progress | None = None,
) -> Updated:  # fmt: skip
    recorded = store.recorded()
    digests, ends = Digests.of(recorded), ends_of(recorded, store.entries(), store.archived())
    changed = digests.changed(Digests(counted.tile, counted.digest))
    if not (changed or anew):
        return Updated(learned, 0, 0, 0.0)
    layouts, lattice = Layouts.of(learned, refit), store.config.lattice
    homes = _homes(learned, lattice)
    halo_m = max(HALO_M, layouts.reach_m)
    rings = int(np.ceil(halo_m / (TILE_SQUARES * lattice.square_m)))
    stale = set(homes) if anew else set(homes) & around(changed, rings)
    beside = set(homes) & around(stale, rings)
    ways = WayRows.of(store, around(beside, rings) | changed, min_vehicles=counted.min_vehicles, share=counted.share)
    fits: dict[Tile, TileFit] = {}
    for tile in sorted(beside):
        low = np.array(tile) * (TILE_SQUARES * lattice.square_m)
        fading, left = None, ways
        if counted.half_life_s:
            end_ns = max((ends[near] for near in around({tile}, rings) & ends.keys()), default=0)
            fading = Fading(half_life_s=counted.half_life_s, now_ns=counted.now_ns).until(end_ns)
            left = ways.faded(counted.share, fading.slowly)
        pieces = Pieces.of(left, low - halo_m, low + TILE_SQUARES * lattice.square_m + halo_m)
        fits[tile] = TileFit.of(learned, layouts, homes[tile], tile, pieces, fading=fading)
        if progress is not None:
            progress(len(fits), len(beside))
    if anew:
        usual = usual_squares([(fit.sums, fit.labels, fit.fitted) for fit in fits.values()])
        counted = replace(counted, usual_square=usual)
    counted = replace(counted, tile=digests.tile, digest=digests.digest)
    found = refitted(learned, fits, stale, counted)
    n_cells = sum(homes[tile].size for tile in stale)
    logger.info("%d tiles have other recordings; %d cells are fitted anew", len(changed), n_cells)
    return Updated(
        replace(found, refit=replace(refit, counted=counted)), n_cells, len(changed),
        _uncovered(learned, ways, changed, lattice),
    )  # fmt: skip


def _homes(learned: PrimitiveMap, lattice: Lattice) -> dict[Tile, IntArray]:
    """The tiles that centres of cells lie in, and which cells these are."""
    tile, of = np.unique(tiles_at(learned.tessellation.centers, lattice), axis=0, return_inverse=True)
    order = np.argsort(of, kind="stable")
    cells = np.split(order, np.cumsum(np.bincount(of, minlength=len(tile)))[:-1])
    return {(east, north): own for (east, north), own in zip(tile.tolist(), cells, strict=True)}


def _uncovered(learned: PrimitiveMap, ways: WayRows, changed: set[Tile], lattice: Lattice) -> float:
    """The share of rows in some tiles that no cell covers."""
    there = np.array([tuple(tile) in changed for tile in tiles_at(ways.position, lattice).tolist()], np.bool_)
    outside = learned.tessellation.cell_of(ways.position[there]) < 0
    return float(outside.mean()) if outside.size else 0.0
