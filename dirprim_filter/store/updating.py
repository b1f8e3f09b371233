"""A map brought up to date with its store: cells are fitted anew where recordings were added or forgotten.

A map of a store has its cells, what was chosen by held-out vehicles, and of each tile of the lattice which recordings
it was learned from. What its cells hold is fitted tile by tile, each from its own and the surrounding tiles' recordings
alone (`tile_fit`). So to fit those tiles anew whose recordings are not the same gives what fitting all anew would, in
whatever order recordings came and went.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.arrays import IntArray
from dirprim_filter.primitives.leader_learning import LeaderSums
from dirprim_filter.primitives.motion_learning import usual_squares
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.refit import N_SPREADS, Counted, Refit
from dirprim_filter.primitives.schedule import By
from dirprim_filter.store.blocks import blocks_of, laid_out_in_blocks
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.learning import MIN_VEHICLES, MOST_STEPS, learn_from_visible
from dirprim_filter.store.recorded_ways import EVERYWHERE, Box, Sample, sampled
from dirprim_filter.store.refitted import refitted
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import as_leader_sums
from dirprim_filter.store.table import read_counts
from dirprim_filter.store.tallies import Tally
from dirprim_filter.store.tile_fit import Finished, Layouts, TileFit
from dirprim_filter.store.tiles import HALO_M, TILE_SQUARES, Digests, Tile, around, ends_of, tiles_at
from dirprim_filter.store.workers import InProcess, Workers

logger = logging.getLogger(__name__)

MOST_ROWS = 500_000
"""Around a tile, of vehicles drawn evenly: more tell next to nothing new."""
USUAL_TILES = 8
"""Of as many as that, about, it is learned what is usual of manoeuvres."""
READ_TILES = 4
"""Side of the squares of tiles whose recordings are read once for all of them."""

LAID_OUT_BY = ("tessellation", "cell_size", "modes", "primitive", "config")
"""Options of `learn_primitives` that say how cells are laid out."""
WHERE = ("tessellation", "cell_size", "progress")
"""Those that are of no use once they are."""

Progress = Callable[[int, int], None]


class Updated(NamedTuple):
    """A map, and what was done to it."""

    primitive_map: PrimitiveMap
    n_cells: int  # fitted anew
    n_tiles: int  # whose recordings are not the same
    uncovered: float  # share of what vehicles did in these that no cell covers


def learn_from_store(
    store: Store, *, min_vehicles: int = MIN_VEHICLES, fading: Fading | None = None,
    by: By | None = None, zone: str = "UTC", workers: Workers | None = None, rng: np.random.Generator, **options: Any,
) -> PrimitiveMap:  # fmt: skip
    """Learn a map that `update_map` can keep up to date.

    Where cells are, and all that held-out vehicles choose, is learned from all recordings, of `MOST_STEPS` steps
    drawn evenly; where there are more, and of more than one kilometre, cells are laid out block by block. What cells
    hold is then fitted tile by tile, each from its own and the surrounding tiles' recordings, and ages from when the
    last of these ended.

    Args:
        store: of recordings.
        min_vehicles: as for `learn_from_summary`.
        fading: as for `learn_from_summary`; age is counted from `now_ns` at the latest.
        by: as for `learn_from_summary`.
        zone: as for `learn_from_summary`.
        workers: who lay out blocks; left out, this process.
        rng: as for `learn_primitives`.
        options: others of `learn_primitives`. With modes that cannot be refitted the map is learned as a whole.

    Raises:
        ValueError: as for `learn_from_summary`.
    """
    since = None
    if fading is not None:
        since = fading.until(max((entry.end_ns for entry in store.entries()), default=0))
    whole = EVERYWHERE._replace(fading=since and since.slowly)
    (everywhere,) = sampled(store, [whole], most_rows=MOST_STEPS, min_vehicles=min_vehicles)
    blocks = blocks_of((east, north) for tiles in store.recorded().values() for east, north in tiles)
    by_search = options.get("tessellation", "joint") in ("joint", "voronoi") and options.get("n_cells") is None
    if everywhere.share < 1.0 and len(blocks) > 1 and by_search:
        said = {name: options[name] for name in LAID_OUT_BY if name in options}
        options = {name: value for name, value in options.items() if name not in WHERE}
        options["tessellation"] = laid_out_in_blocks(
            store, blocks, workers=workers or InProcess(), min_vehicles=min_vehicles, fading=whole.fading,
            seed=int(rng.integers(1 << 31)), **said,
        )  # fmt: skip
    learned, strengths = learn_from_visible(
        everywhere.ways.visible(), _leader_sums(store), min_vehicles=min_vehicles, fading=since, by=by, zone=zone,
        rng=rng, **options,
    )  # fmt: skip
    if learned.refit is None:
        return learned
    counted = Counted(
        by=_counts_by(store), min_vehicles=min_vehicles, most_rows=MOST_ROWS,
        usual_square=np.zeros(N_SPREADS), tile=np.empty((0, 2), np.int64), digest=np.empty(0, np.int64),
    )  # fmt: skip
    if fading is not None:
        counted = replace(counted, half_life_s=fading.half_life_s, now_ns=fading.now_ns)
    if strengths is not None:
        counted = replace(counted, slot_strength=np.array(strengths[:2]), slot_share=strengths.share)
    return _updated(learned, learned.refit, counted, store, anew=True).primitive_map


def _leader_sums(store: Store) -> LeaderSums:
    """What the response to leaders is learned from."""
    lattice = store.config.lattice
    each = [read_counts(store.recording(rows), lattice).leader for rows in store.rows()]
    return as_leader_sums(Tally.total([Tally.none(1, 2), *each]))


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
    homes = _homes(learned, store.config.lattice)
    fitting = _Fitting(learned, Layouts.of(learned, refit), homes, store, counted, ends)
    stale = set(homes) if anew else set(homes) & around(changed, fitting.rings)
    beside = set(homes) & around(stale, fitting.rings)
    finished: dict[Tile, Finished] = {}
    if anew:
        some = sorted(homes)[:: max(-(-len(homes) // USUAL_TILES), 1)]
        samples = (each for tiles in _read_together(some) for each in fitting.samples(tiles).items())
        fits = {tile: fitting.fitted(tile, sample) for tile, sample in samples}
        usual = usual_squares([(fit.sums, fit.labels, fit.fitted) for fit in fits.values()])
        fitting = fitting._replace(counted=replace(counted, usual_square=usual))
        finished = {tile: fit.finished(learned, fitting.counted) for tile, fit in fits.items()}
    outside, n_rows = 0, 0
    for tiles in _read_together((beside | changed) - finished.keys()):
        for tile, sample in fitting.samples(tiles).items():
            if tile in beside:
                finished[tile] = fitting.fitted(tile, sample).finished(learned, fitting.counted)
                if progress is not None:
                    progress(len(finished), len(beside))
            if tile in changed:
                here = sample.ways.position[(tiles_at(sample.ways.position, store.config.lattice) == tile).all(axis=1)]
                outside += int(np.count_nonzero(learned.tessellation.cell_of(here) < 0))
                n_rows += len(here)
    counted = replace(fitting.counted, tile=digests.tile, digest=digests.digest)
    found = refitted(learned, dict(sorted(finished.items())), stale, counted.min_vehicles)
    n_cells = sum(homes[tile].size for tile in stale)
    logger.info("%d tiles have other recordings; %d cells are fitted anew", len(changed), n_cells)
    return Updated(
        replace(found, refit=replace(refit, counted=counted)), n_cells, len(changed), outside / max(n_rows, 1)
    )


class _Fitting(NamedTuple):
    """What the tiles of a map are fitted by."""

    learned: PrimitiveMap
    layouts: Layouts
    homes: dict[Tile, IntArray]  # which cells have their centres there
    store: Store
    counted: Counted
    ends: dict[Tile, int]  # see `ends_of`

    @property
    def halo_m(self) -> float:
        """Metres around a tile that are learned from."""
        return max(HALO_M, self.layouts.reach_m)

    @property
    def rings(self) -> int:
        """Tiles around one that its halo reaches into."""
        return int(np.ceil(self.halo_m / _side_m(self.store)))

    def samples(self, tiles: list[Tile]) -> dict[Tile, Sample]:
        """What vehicles did in and around tiles."""
        side_m, halo_m = _side_m(self.store), self.halo_m
        boxes = []
        for tile in tiles:
            low, fading = np.array(tile) * side_m, self.fading(tile)
            boxes.append(Box(low - halo_m, low + side_m + halo_m, fading and fading.slowly))
        most, least = self.counted.most_rows, self.counted.min_vehicles
        return dict(zip(tiles, sampled(self.store, boxes, most_rows=most, min_vehicles=least), strict=True))

    def fading(self, tile: Tile) -> Fading | None:
        """How vehicles age there: a place ages as it is seen anew."""
        if not self.counted.half_life_s:
            return None
        end_ns = max((self.ends[near] for near in around({tile}, self.rings) & self.ends.keys()), default=0)
        return Fading(half_life_s=self.counted.half_life_s, now_ns=self.counted.now_ns).until(end_ns)

    def fitted(self, tile: Tile, sample: Sample) -> TileFit:
        """The cells of a tile."""
        return TileFit.of(self.learned, self.layouts, self.homes[tile], tile, sample, fading=self.fading(tile))


def _side_m(store: Store) -> float:
    return TILE_SQUARES * store.config.lattice.square_m


def _read_together(tiles: Iterable[Tile]) -> list[list[Tile]]:
    """Tiles whose recordings are read once for all of them."""
    found: defaultdict[Tile, list[Tile]] = defaultdict(list)
    for east, north in sorted(tiles):
        found[east // READ_TILES, north // READ_TILES].append((east, north))
    return list(found.values())


def _homes(learned: PrimitiveMap, lattice: Lattice) -> dict[Tile, IntArray]:
    """The tiles that centres of cells lie in, and which cells these are."""
    tile, of = np.unique(tiles_at(learned.tessellation.centers, lattice), axis=0, return_inverse=True)
    order = np.argsort(of, kind="stable")
    cells = np.split(order, np.cumsum(np.bincount(of, minlength=len(tile)))[:-1])
    return {(east, north): own for (east, north), own in zip(tile.tolist(), cells, strict=True)}
