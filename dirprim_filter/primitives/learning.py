"""Learning a map of directional primitives from tracks.

Source: Senanayake et al. 2020, section III. Beyond it: direction and speed are fitted together, the number of modes by
BIC; cells are learned jointly with what happens in them (the paper's section VI); modes that few vehicles drive lean on
what is usual, and cells that know little on the place-free primitive, by strengths learned from held-out vehicles.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from typing import Literal, NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives.assembly import Layout, assemble, fit_cells
from dirprim_filter.primitives.borrowing import N_LAYOUTS, SHARES, borrow
from dirprim_filter.primitives.cell_model import PrimitiveModel, usual_of
from dirprim_filter.primitives.held_out import PLACE_FREE_STRENGTHS, HeldOut
from dirprim_filter.primitives.leader_learning import learn_leader
from dirprim_filter.primitives.motion_choice import learn_motion
from dirprim_filter.primitives.place_free import PlaceFree, fit_place_free
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.recipe import CellsRule, ModesRule, Recipe, Usual
from dirprim_filter.primitives.refit import Refit
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.tracks import Tracks
from tessellation import GridTessellation, Tessellation, VoronoiTessellation, fit_jointly
from tessellation.gates import residents

logger = logging.getLogger(__name__)

MANY_GROUPS = 200
"""From so many groups or vehicles on one third is held out once; of fewer, each third in turn."""
WEAK = 0.002
"""Pseudo-vehicles that lean on nothing, while it is found out what is usual."""
MANY_ROWS = 5000
"""From so many on, joint cells are better than even ones."""
TRIAL_ROWS = 100_000
"""So many rows are enough to find out what is usual, and how strongly cells lean on it: vehicles drawn at random."""
REACH_M = 3.0
"""Metres around the data that Voronoi cells cover: about a lane."""

Progress = Callable[[int, float], None]
STAGES = ("cells", "how much each leans on what is usual", "primitives", "how vehicles go on")
"""What is learned, one after the other."""


def learn_primitives(
    tracks: Tracks | Iterable[Tracks],
    *,
    tessellation: CellsRule | Tessellation | Layout = "joint",
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
    free = fit_place_free(rows, config)
    begin = stage or (lambda _: None)
    begin(0)
    recipe = _first_recipe(modes, primitive, free, config)
    layouts = _layouts(
        rows, tessellation, recipe, free, cell_size=cell_size, n_cells=n_cells, progress=progress, rng=rng
    )
    begin(1)
    few = rows.some(TRIAL_ROWS, rng=rng)
    candidates = [[layout, *_other_layouts(rows, layout, recipe, rng=rng)] for layout in layouts]
    (layout, *others), recipe, lean = _choose(few, candidates, recipe, free, rng=rng)
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
) -> Layout:
    """The cells that `learn_primitives` chooses, and how much they learn from beside them; arguments as there.

    Raises:
        ValueError: as there.
    """
    config = config or LearningConfig()
    _check_options(
        tracks, tessellation=tessellation, cell_size=cell_size, n_cells=None, modes=modes, primitive=primitive
    )
    rows = TrackRows.thinned(tracks, interval_s=config.row_interval_s)
    free = fit_place_free(rows, config)
    recipe = _first_recipe(modes, primitive, free, config)
    layouts = _layouts(rows, tessellation, recipe, free, cell_size=cell_size, n_cells=None, progress=None, rng=rng)
    if len(layouts) == 1:
        return layouts[0]
    few = rows.some(TRIAL_ROWS, rng=rng)
    return _choose(few, [[layout] for layout in layouts], recipe, free, rng=rng)[0][0]


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


# Where? --------------------------------------------------------------------------------------------------------------


def _layouts(
    rows: TrackRows, tessellation: str | Tessellation | Layout, recipe: Recipe, free: PlaceFree, *,
    cell_size: float | None, n_cells: int | None, progress: Progress | None, rng: np.random.Generator,
) -> list[Layout]:  # fmt: skip
    """The cells to choose from; joint ones are chosen as they are laid out."""
    position, config = rows.position, recipe.config
    if isinstance(tessellation, Layout):
        return [tessellation]
    if not isinstance(tessellation, str):
        return [Layout(tessellation, 0.0)]
    if tessellation == "grid":
        if n_cells is not None:
            return [Layout(_grid_of_about(position, n_cells), 0.0)]
        sizes = config.cell_sizes if cell_size is None else (cell_size,)
        return [Layout(GridTessellation.covering(position, cell_size=size), 0.0) for size in sizes]
    if cell_size is not None:
        n_cells = GridTessellation.covering(position, cell_size=cell_size).n_cells
    if tessellation == "voronoi" or (n_cells is None and not _joint_is_worth_it(rows, recipe, free, rng=rng)):
        return _lay_out_evenly(rows, n_cells, config, rng=rng)
    return [_lay_out_jointly(rows, n_cells, recipe, free, progress=progress, rng=rng)]


def _lay_out_evenly(
    rows: TrackRows, n_cells: int | None, config: LearningConfig, *, rng: np.random.Generator
) -> list[Layout]:
    """Cells by positions alone, behind gates of every softness."""
    numbers = [_even_cells(rows, each) for each in config.rows_per_cell] if n_cells is None else [n_cells]
    cells = [VoronoiTessellation.lloyd(rows.position, n_cells=n, rng=rng, reach=REACH_M) for n in numbers]
    return [Layout(tessellation, softness) for tessellation in cells for softness in config.softness]


def _even_cells(rows: TrackRows, rows_per_cell: float) -> int:
    """How many cells of so many rows each there are: a number that does not change when the data are moved."""
    return 1 + int(len(rows) / rows_per_cell)


def _joint_is_worth_it(rows: TrackRows, recipe: Recipe, free: PlaceFree, *, rng: np.random.Generator) -> bool:
    """Whether vehicles that neither has seen like joint cells better than even ones.

    The search picks what the held-out vehicles like, among thousands of layouts: with few vehicles, by luck. With
    many it never lost, and to ask would cost as much again.
    """
    groups = np.unique(rows.group)
    if len(rows) >= MANY_ROWS or groups.size < 4:
        return True
    unseen = np.isin(rows.group, rng.permutation(groups)[: groups.size // 3])
    seen = rows[~unseen]
    joint = [_lay_out_jointly(seen, None, recipe, free, progress=None, rng=rng)]
    scores = []
    for layouts in (joint, _lay_out_evenly(seen, None, recipe.config, rng=rng)):
        candidates = [[layout, *_other_layouts(seen, layout, recipe, rng=rng)] for layout in layouts]
        found, chosen, _ = _choose(seen, candidates, recipe, free, rng=rng)
        scores.append(float(HeldOut(rows, unseen, free).scores(found, chosen).max()))
    logger.info("unseen vehicles: joint cells %.3f, even ones %.3f", *scores)
    return scores[0] >= scores[1]


def _lay_out_jointly(
    rows: TrackRows, n_cells: int | None, recipe: Recipe, free: PlaceFree, *, progress: Progress | None,
    rng: np.random.Generator,
) -> Layout:  # fmt: skip
    """Cells learned together with the primitives."""
    config = recipe.config
    few = rows.some(TRIAL_ROWS, rng=rng)
    n_even = _even_cells(few, config.rows_per_cell[0])
    even = VoronoiTessellation.lloyd(few.position, n_cells=n_even, rng=rng, reach=REACH_M)
    recipe = _with_usual(few, Layout(even, config.softness[0]), recipe, free)
    model = PrimitiveModel.of(rows, recipe._replace(thorough=False), free)
    found = fit_jointly(
        model, rows.position, rows, group=rows.group, reach=REACH_M, n_cells=n_cells, softness=config.softness,
        progress=progress, rng=rng,
    )  # fmt: skip
    return Layout(found.tessellation, found.softness)


def _grid_of_about(position: FloatArray, n_cells: int) -> GridTessellation:
    """The grid whose number of cells is nearest to `n_cells`, by bisection on the logarithm of its cell size."""
    low, high = 0.1, float(np.ptp(position, axis=0).max()) + 1.0
    nearest = GridTessellation.covering(position, cell_size=high)
    for _ in range(30):
        middle = float(np.sqrt(low * high))
        grid = GridTessellation.covering(position, cell_size=middle)
        nearest = min(nearest, grid, key=lambda tried: abs(tried.n_cells - n_cells))
        if grid.n_cells == n_cells:
            break
        low, high = (middle, high) if grid.n_cells > n_cells else (low, middle)
    return nearest


# What happens there? -------------------------------------------------------------------------------------------------


def _with_usual(rows: TrackRows, layout: Layout, recipe: Recipe, free: PlaceFree) -> Recipe:
    """The recipe whose modes lean on what is usual in these cells."""
    alone = recipe._replace(prior_strength=WEAK, usual=Usual(0.0, free.speed_spread), thorough=False)
    return recipe._replace(usual=usual_of(fit_cells(rows, layout, alone), alone))


# What held-out vehicles like best ------------------------------------------------------------------------------------


class Leaning(NamedTuple):
    """What cells lean on beside their own modes."""

    place_free: float = 1.0  # pseudo-vehicles of the place-free primitive
    borrowed: float = 0.0  # share of the other layouts' modes in the rest


def _choose(
    rows: TrackRows, candidates: list[list[Layout]], recipe: Recipe, free: PlaceFree, *, rng: np.random.Generator
) -> tuple[list[Layout], Recipe, Leaning]:
    """The cells, the strength of what is usual in their modes, and how much they lean on what else.

    Args:
        rows: to be held out in turn.
        candidates: layouts, each with those to borrow from.
        recipe: what it says of strengths is tried first.
        free: the place-free primitive.
        rng: draws the folds.
    """
    recipes = [_with_usual(rows, layout, recipe, free) for layout, *_ in candidates]
    groups = np.unique(rows.group)
    if groups.size < 2:  # none to hold out
        return candidates[-1], recipes[-1], Leaning()
    thirds = np.array_split(rng.permutation(groups), min(3, groups.size))
    folds = [HeldOut(rows, np.isin(rows.group, third), free) for third in thirds]
    folds = folds[: 1 if groups.size >= MANY_GROUPS else None]

    @cache
    def scores(i: int, n_layouts: int, prior_strength: float, cost: float) -> FloatArray:
        trial = recipes[i]._replace(prior_strength=prior_strength, parameter_cost=cost, thorough=False)
        return np.asarray(np.mean([fold.scores(candidates[i][:n_layouts], trial) for fold in folds], axis=0))

    # Each decides little about the others, so one after the other rather than all together.
    config, every = recipe.config, len(candidates[0])
    best, prior_strength, cost = len(candidates) - 1, recipe.prior_strength, recipe.parameter_cost
    costs = config.parameter_costs if recipe.modes == "bic" else (cost,)
    for _ in range(2):
        if len(candidates) > 1:
            best = max(range(len(candidates)), key=lambda i: scores(i, every, prior_strength, cost).max())
        prior_strength = max(config.prior_strengths, key=lambda p: scores(best, 1, p, cost).max())
        cost = max(costs, key=lambda c: scores(best, 1, prior_strength, c).max())
    found = scores(best, every, prior_strength, cost)
    borrowed, strength = np.unravel_index(int(found.argmax()), found.shape)
    logger.info(
        "chosen: %d cells, what is usual counts as %g vehicles, %g of BIC's cost of a parameter, log density %.3f",
        candidates[best][0].cells.n_cells, prior_strength, cost, found.max(),
    )  # fmt: skip
    lean = Leaning(float(PLACE_FREE_STRENGTHS[strength]), SHARES[borrowed])
    return candidates[best], recipes[best]._replace(prior_strength=prior_strength, parameter_cost=cost), lean


def _other_layouts(rows: TrackRows, layout: Layout, recipe: Recipe, *, rng: np.random.Generator) -> list[Layout]:
    """Even cells to borrow from, as many as have rows; none for one cell, and none in the paper's recipe."""
    n_used = np.unique(layout.cells.cell_of(rows.position)).size
    if n_used < 2 or recipe.modes != "bic":
        return []
    softness = layout.softness or recipe.config.softness[0]
    place = rows.some(TRIAL_ROWS, rng=rng).position
    even = [VoronoiTessellation.lloyd(place, n_cells=n_used, rng=rng, reach=REACH_M) for _ in range(N_LAYOUTS)]
    return [Layout(cells, softness) for cells in even]


def _learned(rows: TrackRows, layouts: list[Layout], recipe: Recipe, free: PlaceFree, lean: Leaning) -> PrimitiveMap:
    """The primitives of the first layout's cells."""
    own, *others = layouts if lean.borrowed > 0 else layouts[:1]
    lenders = [(other.cells, fit_cells(rows, other, recipe)) for other in others]
    borrowed = borrow(rows, own.cells, lenders, lean.borrowed) if lenders else None
    return assemble(own.cells, fit_cells(rows, own, recipe), free, lean.place_free, borrowed)
