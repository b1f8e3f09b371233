"""Learning a map of directional primitives from tracks.

Source: Senanayake et al. 2020, section III. Beyond it: direction and speed are fitted together, the number of modes by
BIC; cells are learned jointly with what happens in them (the paper's section VI); modes that few vehicles drive lean on
what is usual, and cells that know little on the place-free primitive, by strengths learned from held-out vehicles.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.assembly import Layout, assemble, fit_cells
from dirprim_filter.primitives.borrowing import borrow
from dirprim_filter.primitives.choice import TRIAL_ROWS, Leaning, choose, other_layouts
from dirprim_filter.primitives.layouts import Progress, layouts_of
from dirprim_filter.primitives.leader_learning import learn_leader
from dirprim_filter.primitives.motion_learning import learn_motion
from dirprim_filter.primitives.place_free import PlaceFree, fit_place_free
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.recipe import CellsRule, ModesRule, Recipe, Usual
from dirprim_filter.primitives.refit import Refit
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.tracks import Tracks
from tessellation import Tessellation
from tessellation.gates import residents

logger = logging.getLogger(__name__)


STAGES = ("cells", "how much each leans on what is usual", "primitives", "how vehicles go on")
"""What is learned, one after the other."""


def learn_primitives(
    tracks: Tracks | Iterable[Tracks],
    *,
    tessellation: CellsRule | Tessellation | Layout = "joint",
    lenders: Sequence[Layout] | None = None,
    cell_size: float | None = None,
    n_cells: int | None = None,
    modes: ModesRule = "bic",
    primitive: Literal["curved", "flat"] = "curved",
    config: LearningConfig | None = None,
    progress: Progress | None = None,
    stage: Callable[[int], None] | None = None,
    rng: np.random.Generator,
) -> PrimitiveMap:
    """Learn how vehicles move at each place.

    Args:
        tracks: observed motion, at once or in parts.
        tessellation: "joint" for Voronoi cells learned together with the primitives, "voronoi" for such by positions
            alone, "grid" for square cells where there are data, or cells that are given: each learns from what is in
            it alone, or of a `Layout` from what is beside it too.
        lenders: other cells, of which cells that are given borrow; left out, even ones.
        cell_size: metres, side of the grid's cells, or of squares as many as there shall be Voronoi cells; learned from
            held-out vehicles if absent.
        n_cells: about how many cells there shall be, instead of `cell_size`.
        modes: "bic" fits direction and speed together and counts modes by BIC; "dbscan" is the paper's recipe.
        primitive: "curved", a mode's mean direction and log mean speed vary linearly across the cell where BIC says
            so; "flat", constant in a cell as in the paper. With "dbscan" cells are flat.
        config: every other knob.
        progress: called with the number of cells and the held-out objective while cells are learned.
        stage: called with the number of each of `STAGES` as it begins.
        rng: chooses the held-out vehicles and the first cells.

    Returns:
        The map; the same for the same tracks and the same state of `rng`.

    Raises:
        ValueError: no rows, or options that do not exist or exclude each other.
    """
    config = config or LearningConfig()
    tracks = tracks if isinstance(tracks, Tracks) else Tracks.concatenate(tracks)
    _check_options(
        tracks, tessellation=tessellation, cell_size=cell_size, n_cells=n_cells, modes=modes, primitive=primitive
    )
    rows = TrackRows.thinned(tracks, interval_s=config.row_interval_s)
    config = config.scaled(rows.scale.length)
    free = fit_place_free(rows, config)
    begin = stage or (lambda _: None)
    begin(0)
    recipe = _first_recipe(modes, primitive, free, config)
    layouts = layouts_of(
        rows, tessellation, recipe, free, cell_size=cell_size, n_cells=n_cells, progress=progress, rng=rng
    )
    begin(1)
    few = rows.some(TRIAL_ROWS, rng=rng)
    candidates = [
        [layout, *(other_layouts(rows, layout, recipe, rng=rng) if lenders is None else lenders)] for layout in layouts
    ]
    (layout, *others), recipe, lean = choose(few, candidates, recipe, free, rng=rng)
    begin(2)
    learned = _learned(rows, [layout, *others], recipe, free, lean)
    logger.info(
        "learned %d cells from %d vehicles; %g of their weight borrowed, the place-free primitive as %.3g vehicles",
        layout.cells.n_cells, rows.n_vehicles, lean.borrowed, lean.place_free,
    )  # fmt: skip
    n_rows = residents(layout.cells.cell_of(rows.position), layout.cells.centers).start
    begin(3)
    return replace(
        learned,
        motion=replace(learn_motion(learned, rows, rng=rng), leader=learn_leader(tracks)),
        n_rows=np.append(np.diff(n_rows), len(rows)),
        refit=Refit(
            recipe=recipe, softness=layout.softness, place_free=lean.place_free, borrowed=lean.borrowed,
            lenders=tuple(other.cells.centers for other in others) if lean.borrowed > 0 else (),
        ),
    )  # fmt: skip


def lay_out(
    tracks: Tracks,
    *,
    tessellation: CellsRule = "joint",
    cell_size: float | None = None,
    modes: ModesRule = "bic",
    primitive: Literal["curved", "flat"] = "curved",
    config: LearningConfig | None = None,
    rng: np.random.Generator,
) -> list[Layout]:
    """The cells that `learn_primitives` chooses, and those that they borrow from; arguments as there.

    Raises:
        ValueError: as there.
    """
    config = config or LearningConfig()
    _check_options(
        tracks, tessellation=tessellation, cell_size=cell_size, n_cells=None, modes=modes, primitive=primitive
    )
    rows = TrackRows.thinned(tracks, interval_s=config.row_interval_s)
    config = config.scaled(rows.scale.length)
    free = fit_place_free(rows, config)
    recipe = _first_recipe(modes, primitive, free, config)
    layouts = layouts_of(rows, tessellation, recipe, free, cell_size=cell_size, n_cells=None, progress=None, rng=rng)
    if len(layouts) > 1:
        few = rows.some(TRIAL_ROWS, rng=rng)
        layouts, _, _ = choose(few, [[layout] for layout in layouts], recipe, free, rng=rng)
    return [layouts[0], *other_layouts(rows, layouts[0], recipe, rng=rng)]


def _first_recipe(modes: ModesRule, primitive: str, free: PlaceFree, config: LearningConfig) -> Recipe:
    """How modes are fitted, before held-out vehicles choose."""
    is_curved = primitive == "curved" and modes == "bic"
    return Recipe(modes, is_curved, config.prior_strengths[0], Usual(0.0, free.speed_spread), config)


def _check_options(
    tracks: Tracks,
    *,
    tessellation: object,
    cell_size: float | None,
    n_cells: int | None,
    modes: str,
    primitive: str,
) -> None:
    if len(tracks) == 0:
        raise ValueError("tracks: expected at least one row, got none")
    if isinstance(tessellation, str) and tessellation not in ("joint", "voronoi", "grid"):
        raise ValueError(f"tessellation: expected 'joint', 'voronoi', 'grid' or a Tessellation, got {tessellation!r}")
    if modes not in ("bic", "dbscan"):
        raise ValueError(f"modes: expected 'bic' or 'dbscan', got {modes!r}")
    if primitive not in ("curved", "flat"):
        raise ValueError(f"primitive: expected 'curved' or 'flat', got {primitive!r}")
    given = [name for name, value in (("cell_size", cell_size), ("n_cells", n_cells)) if value is not None]
    if len(given) > 1 or (given and not isinstance(tessellation, str)):
        raise ValueError("tessellation, cell_size, n_cells: at most one of them can decide the cells")
    if n_cells is not None and n_cells < 1:
        raise ValueError(f"n_cells: expected at least 1, got {n_cells}")


def _learned(rows: TrackRows, layouts: list[Layout], recipe: Recipe, free: PlaceFree, lean: Leaning) -> PrimitiveMap:
    """The primitives of the first layout's cells."""
    own, *others = layouts if lean.borrowed > 0 else layouts[:1]
    lenders = [(other.cells, fit_cells(rows, other, recipe)) for other in others]
    borrowed = borrow(rows, own.cells, lenders, lean.borrowed) if lenders else None
    return assemble(own.cells, fit_cells(rows, own, recipe), free, lean.place_free, borrowed)
