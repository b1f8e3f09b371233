"""A map brought up to date with its store: cells are fitted anew where recordings were added or forgotten.

A map of a store has its cells, what was chosen by held-out vehicles, and of each tile of the lattice which recordings
it was learned from. What its cells hold is fitted tile by tile, each from its own and the surrounding tiles' recordings
alone (`tile_fit`). So to fit those tiles anew whose recordings are not the same gives what fitting all anew would, in
whatever order recordings came and went.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dirprim_filter.primitives.assembly import Layout
from dirprim_filter.primitives.leader_learning import LeaderSums
from dirprim_filter.primitives.motion_learning import Deviations
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.refit import N_SPREADS, Counted, Refit
from dirprim_filter.primitives.schedule import By
from dirprim_filter.store.blocks import blocks_of, drawn_places, laid_out_in_blocks
from dirprim_filter.store.by_hour import Strengths
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.fitting import Fitted, Fitting, Square, fitted_square
from dirprim_filter.store.learning import MIN_VEHICLES, MOST_STEPS, Learned, learn_from_visible, n_steps_left
from dirprim_filter.store.recorded_ways import EVERYWHERE, Box, WayRows, recordings_at, sampled
from dirprim_filter.store.refitted import refitted
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import as_leader_sums
from dirprim_filter.store.table import Counts, read_counts
from dirprim_filter.store.tallies import Tally
from dirprim_filter.store.tile_fit import Finished
from dirprim_filter.store.tiles import Digests, Tile, Whereabouts, around, ends_of, traffic_of
from dirprim_filter.store.workers import InProcess, Workers

logger = logging.getLogger(__name__)

MOST_ROWS = 500_000
"""Around a tile, of vehicles drawn evenly: more tell next to nothing new."""

LAID_OUT_BY = ("tessellation", "cell_size", "modes", "primitive", "config")
"""Options of `learn_primitives` that say how cells are laid out."""
WHERE = ("tessellation", "cell_size", "progress")
"""Those that are of no use once they are."""
CALLED = ("progress", "stage")
"""Those that other processes cannot call."""

Progress = Callable[[int, int], None]
Recorded = Mapping[str, list[list[int]]]
"""See `Store.recorded`."""


class Updated(NamedTuple):
    """A map, and what was done to it."""

    primitive_map: PrimitiveMap
    n_cells: int  # fitted anew
    n_tiles: int  # whose recordings are not the same
    uncovered: float  # share of what vehicles did in these that no cell covers


def learn_from_store(
    store: Store, *, min_vehicles: int = MIN_VEHICLES, fading: Fading | None = None,
    by: By | None = None, zone: str = "UTC", workers: Workers | None = None, fitted: Progress | None = None,
    rng: np.random.Generator, **options: Any,
) -> PrimitiveMap:  # fmt: skip
    """Learn a map that `update_map` can keep up to date.

    Where cells are, and all that held-out vehicles choose, is learned from all recordings, of `MOST_STEPS` steps
    drawn evenly. Where there are more, cells are laid out block by block, and held-out vehicles choose at so many
    places as have half of these steps. What cells hold is then fitted tile by tile, each from its own and the
    surrounding tiles' recordings, and ages from when the last of these ended.

    Args:
        store: of recordings.
        min_vehicles: as for `learn_from_summary`.
        fading: as for `learn_from_summary`; age is counted from `now_ns` at the latest.
        by: as for `learn_from_summary`.
        zone: as for `learn_from_summary`.
        workers: who lay out blocks, choose, and fit tiles; left out, this process. The map is the same.
        fitted: called with how many tiles are fitted, and of how many.
        rng: as for `learn_primitives`.
        options: others of `learn_primitives`, which calls `progress` and `stage` in this process alone. With modes that
            cannot be refitted the map is learned as a whole.

    Raises:
        ValueError: as for `learn_from_summary`, or workers see nothing of the store.
    """
    workers = workers or InProcess()
    store.check_seen_by(workers)
    since = None
    if fading is not None:
        since = fading.until(max((entry.end_ns for entry in store.entries()), default=0))
    slowly, recorded = since and since.slowly, store.recorded()
    there, (counts, traffic) = Whereabouts.of_all(recorded), _counts(store, recorded)
    chosen_at, n_steps = [EVERYWHERE._replace(fading=slowly)], n_steps_left(counts.whens, store.config.lattice, slowly)
    if n_steps > MOST_STEPS and _is_searched(**options):
        lay_out = partial(
            laid_out_in_blocks, store, blocks_of(traffic, n_steps), there, workers=workers, min_vehicles=min_vehicles,
            fading=slowly, seed=int(rng.integers(1 << 31)),
        )  # fmt: skip
        options = _laid_out(lay_out, **options)
        centers, share = options["tessellation"].cells.centers, 0.5 * MOST_STEPS / n_steps  # one of them may have more
        chosen_at = drawn_places(centers, traffic, store.config.lattice, slowly, share=share, rng=rng)
    if not workers.in_process:
        options = {name: value for name, value in options.items() if name not in CALLED}
    choose = partial(
        _chosen, store=store, sums=as_leader_sums(counts.leader), min_vehicles=min_vehicles, fading=since, by=by,
        zone=zone, rng=rng, **options,
    )  # fmt: skip
    (chosen,) = workers.each(choose, [(chosen_at, recordings_at(chosen_at, there, store.config.lattice))])
    learned, strengths = chosen
    if learned.refit is None:
        return learned
    counted = _counted(store, recorded, min_vehicles, fading, strengths)
    fitting = Fitting.of(learned, learned.refit, counted, store, _ends(store, recorded))
    every = set(fitting.homes)
    done = _fitted(fitting, fitting.squares(every, set(), there), workers, fitted)
    usual = Deviations.together(tile.deviations for tile in done.tiles.values()).usual_squares()
    return _refitted(learned, learned.refit, replace(counted, usual_square=usual), done.tiles, every)


def _is_searched(*, tessellation: object = "joint", n_cells: int | None = None, **_: object) -> bool:
    """Whether it is learned where cells are, and how many."""
    return isinstance(tessellation, str) and n_cells is None


def _laid_out(lay_out: Callable[..., list[Layout]], **options: Any) -> dict[str, Any]:
    """The options of `learn_primitives` once it is known where cells are."""
    cells, *lenders = lay_out(**{name: options[name] for name in LAID_OUT_BY if name in options})
    rest = {name: value for name, value in options.items() if name not in WHERE}
    return rest | {"tessellation": cells, "lenders": lenders}


def _counted(
    store: Store, recorded: Recorded, min_vehicles: int, fading: Fading | None, strengths: Strengths | None
) -> Counted:
    """Before it is known what is usual of manoeuvres."""
    digests = Digests.of(recorded)
    counted = Counted(
        by=_counts_by(store), min_vehicles=min_vehicles, most_rows=MOST_ROWS, usual_square=np.zeros(N_SPREADS),
        tile=digests.tile, digest=digests.digest,
    )  # fmt: skip
    if fading is not None:
        counted = replace(counted, half_life_s=fading.half_life_s, now_ns=fading.now_ns)
    if strengths is not None:
        counted = replace(counted, slot_strength=np.array(strengths[:2]), slot_share=strengths.share)
    return counted


def _counts(store: Store, recorded: Recorded) -> tuple[Counts, Tally]:
    """Beside steps and places, of all recordings; and `tiles.traffic_of` all."""
    total, traffic = Counts.none(), Tally.none(2, 1)
    for rows in sorted(recorded):
        counts = read_counts(store.recording(rows), store.config.lattice)
        total = Counts.total([total, counts._replace(passed=total.passed)])
        traffic += traffic_of(counts.passed)
    return total, traffic


def _chosen(
    task: tuple[list[Box], list[tuple[int, str]]], *, store: Store, sums: LeaderSums, min_vehicles: int,
    rng: np.random.Generator, **options: Any,
) -> Learned:  # fmt: skip
    """All that held-out vehicles choose at some places, by their recordings; cells too unless they are given."""
    places, recordings = task
    samples = sampled(
        store, places, most_rows=MOST_STEPS // len(places), min_vehicles=min_vehicles, recordings=recordings
    )
    visible = WayRows.together([sample.ways for sample in samples]).visible()
    return learn_from_visible(visible, sums, min_vehicles=min_vehicles, rng=rng, fitted_anew=True, **options)


def update_map(
    primitive_map: PrimitiveMap, store: Store, *, workers: Workers | None = None, progress: Progress | None = None
) -> Updated:
    """Fit a map's cells anew where its store has other recordings than it was learned from.

    The cells stay where they are, and so does all that is of no place or was chosen by held-out vehicles.

    Args:
        primitive_map: learned from this store, or from one that counts alike.
        store: it.
        workers: who fit tiles; left out, this process. The map is the same.
        progress: called with how many tiles are fitted, and of how many.

    Returns:
        The map: the same where nothing changed, and the same whatever order recordings were added and forgotten in.

    Raises:
        ValueError: a map that was not learned from a store, or of one that counts otherwise or in another frame; or
            workers see nothing of the store.
        RecordingError: a recording is damaged.
        OSError: one cannot be read.
    """
    workers = workers or InProcess()
    store.check_seen_by(workers)
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
    recorded = store.recorded()
    digests = Digests.of(recorded)
    changed = digests.changed(Digests(refit.counted.tile, refit.counted.digest))
    if not changed:
        return Updated(primitive_map, 0, 0, 0.0)
    fitting = Fitting.of(primitive_map, refit, refit.counted, store, _ends(store, recorded))
    stale = set(fitting.homes) & around(changed, fitting.rings)
    beside = set(fitting.homes) & around(stale, fitting.rings)
    squares = fitting.squares(beside | changed, changed, Whereabouts.of_all(recorded))
    done = _fitted(fitting, squares, workers, progress)
    counted = replace(refit.counted, tile=digests.tile, digest=digests.digest)
    n_cells = sum(fitting.homes[tile].size for tile in stale)
    logger.info("%d tiles have other recordings; %d cells are fitted anew", len(changed), n_cells)
    found = _refitted(primitive_map, refit, counted, done.tiles, stale)
    return Updated(found, n_cells, len(changed), done.n_outside / max(done.n_rows, 1))


def _counts_by(store: Store) -> str:
    return f"configuration {store.config.digest} in frame {store.frame!r}"


def _ends(store: Store, recorded: Recorded) -> dict[Tile, int]:
    return ends_of(recorded, store.entries(), store.archived())


def _fitted(fitting: Fitting, squares: list[Square], workers: Workers, progress: Progress | None) -> Fitted:
    """Tiles, and what no cell covers in those that changed."""
    found, n_rows, n_outside = {}, 0, 0
    n_tiles = len(fitting.homes.keys() & {tile for square in squares for tile in square.tiles})
    for done in workers.each(fitted_square, squares, fitting):
        found.update(done.tiles)
        n_rows, n_outside = n_rows + done.n_rows, n_outside + done.n_outside
        if progress is not None:
            progress(len(found), n_tiles)
    return Fitted(dict(sorted(found.items())), n_rows, n_outside)


def _refitted(
    learned: PrimitiveMap, refit: Refit, counted: Counted, finished: dict[Tile, Finished], stale: set[Tile]
) -> PrimitiveMap:
    """The map with the cells of stale tiles fitted anew."""
    leaning = {tile: each.leaning_on(counted.usual_square) for tile, each in finished.items()}
    found = refitted(learned, leaning, stale, counted.min_vehicles)
    return replace(found, refit=replace(refit, counted=counted))
