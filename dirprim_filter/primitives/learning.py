"""Learning a map of directional primitives from tracks.

Source: Senanayake et al. 2020, section III. Beyond it: direction and speed are fitted together, the number of modes by
BIC; cells are learned jointly with what happens in them (the paper's section VI); modes that few vehicles drive lean on
what is usual, and cells that know little on their parents and the background model.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from os import PathLike
from typing import Literal

import numpy as np

from dirprim_filter.arrays import FloatArray, as_floats, require
from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions import von_mises
from dirprim_filter.primitives._modes import Bounds, Modes
from dirprim_filter.primitives.background import Background, learn_background
from dirprim_filter.primitives.fitting import (
    LEAST_SPEED,
    ROUGH,
    Layout,
    Level,
    PrimitiveModel,
    bounds_of,
    fit_levels,
    fitted,
)
from dirprim_filter.primitives.leader_learning import LeaderSums
from dirprim_filter.primitives.motion_learning import learn_motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.tracks import Tracks
from tessellation import GridTessellation, Tessellation, VoronoiTessellation, fit_jointly
from tessellation.gates import residents
from tessellation.protocols import checked

logger = logging.getLogger(__name__)

CellsRule = Literal["joint", "voronoi", "grid"]
ModesRule = Literal["bic", "dbscan"]
Progress = Callable[[int, float], None]
STAGES = ("cells", "how much each leans on what is usual", "primitives", "how vehicles go on")
"""What is learned, one after the other."""
TRIAL_ROWS = 100_000
"""So many rows are enough to find out what is usual, and which cells are likeliest: vehicles drawn at random."""
LEAST_ROWS, ROWS_PER_SQUARE = 10_000, 15
"""Cells are laid out by so many rows, and by more where vehicles drive on many squares as wide as a cell reaches: by
10,000 rows of seven junctions held-out rows were .5 to .65 nat less likely than by 70,000."""
SOFTNESS = 0.25
"""Of a Voronoi cell's size: so far beyond its border it also learns from rows beside it, see `tessellation.gates`.
Where .1 and .5 could be chosen too, the densities of two towns were the same."""
MANY_GROUPS = 200
"""From so many groups or vehicles on one third is held out once; of fewer, each third in turn."""
MIN_MODE_VEHICLES = 3.0
"""A mode that fewer drive says nothing of what is usual."""
WEAK = 0.002
"""Pseudo-vehicles that lean on nothing, while it is found out what is usual."""
BROADER = 16.0
"""Tails have so many times a mode's variance of direction and of log speed; 8 and 32 give the same to .005 nat."""


def learn_primitives(
    tracks: Tracks | Iterable[Tracks],
    *,
    tessellation: CellsRule | Tessellation = "joint",
    cell_size: float | None = None,
    n_cells: int | None = None,
    modes: ModesRule = "bic",
    primitive: Literal["curved", "flat"] = "curved",
    config: LearningConfig | None = None,
    weight: FloatArray | None = None,
    progress: Progress | None = None,
    stage: Callable[[int], None] | None = None,
    rng: np.random.Generator,
) -> PrimitiveMap:
    """Learn how vehicles move at each place.

    Args:
        tracks: observed motion, at once or in parts.
        tessellation: "joint" for Voronoi cells learned together with the primitives, "voronoi" for such by positions
            alone, "grid" for square cells where there are data, or cells that are given: each learns from what is in
            it alone.
        cell_size: metres, side of the grid's cells, or of squares as many as there shall be Voronoi cells; learned from
            held-out vehicles if absent.
        n_cells: about how many cells there shall be, instead of `cell_size`.
        modes: "bic" fits direction and speed together and counts modes by BIC; "dbscan" is the paper's recipe.
        primitive: "curved", a mode's mean direction and log mean speed vary linearly across the cell where BIC says
            so; "flat", constant in a cell as in the paper. With "dbscan" cells are flat.
        config: every other knob.
        weight: (n_tracks,) positive, how many vehicles each stands for: where some were drawn with a known
            probability, its inverse. Of no place, only the primitive takes it into account.
        progress: called with the number of cells and the held-out objective while cells are learned.
        stage: called with the number of each of `STAGES` as it begins.
        rng: chooses the held-out vehicles and the first cells.

    Returns:
        The map; the same for the same tracks and the same state of `rng`.

    Raises:
        ValueError: no rows, options that do not exist or exclude each other, weights that are none, or cells that do
            not say which covers a row.
        TypeError: no tracks, no configuration, or no generator.
    """
    require("rng", rng, np.random.Generator)
    config = require("config", LearningConfig() if config is None else config, LearningConfig)
    if isinstance(tracks, Tracks | str | PathLike):
        tracks = require("tracks", tracks, Tracks)
    else:
        tracks = Tracks.concatenate(require("tracks", part, Tracks) for part in tracks)
    if len(tracks) == 0:
        raise ValueError("tracks: expected at least one row, got none")
    _check_options(tessellation, cell_size, n_cells, modes, primitive)
    if weight is not None:
        weight = as_floats("weight", weight, f"{tracks.n_tracks}")
        if not (weight > 0).all():
            raise ValueError(f"weight: expected positive numbers, got {weight.min()} for track {weight.argmin()}")
    if not isinstance(tessellation, str):
        tessellation = checked(tessellation, tracks.position)
    rows = TrackRows.thinned(tracks, interval_s=config.row_interval_s, weight=weight)
    config = config.scaled(rows.scale.length)
    background = learn_background(rows, config, rng=rng.spawn(1)[0])  # what it draws changes no cell
    begin = stage or (lambda _: None)
    begin(0)
    at_once = modes == "bic"
    bounds = bounds_of(
        config, speed_spread=background.speed_spread, curved=at_once and primitive == "curved",
        parameter_cost=config.parameter_cost, with_speed=at_once,
    )  # fmt: skip
    layout, strength = lay_out(
        rows, tessellation, bounds, background, config, cell_size=cell_size, n_cells=n_cells, progress=progress, rng=rng
    )
    begin(1)
    bounds = leaning(rows.some(TRIAL_ROWS, rng=rng), layout, bounds, background)
    begin(2)
    learned = assemble(layout.cells, fit_levels(rows, layout, bounds), background, config, strength)
    logger.info("learned %d cells from %d vehicles", layout.cells.n_cells, rows.n_vehicles)
    n_rows = residents(layout.cells.cell_of(rows.position), layout.cells.centers).start
    begin(3)
    return replace(
        learned,
        motion=replace(learn_motion(learned, rows, background, rng=rng), leader=LeaderSums.of(tracks).response()),
        n_rows=np.append(np.diff(n_rows), len(rows)),
        origin=tracks.origin,
    )


def _check_options(
    tessellation: object, cell_size: float | None, n_cells: int | None, modes: str, primitive: str
) -> None:  # fmt: skip
    ours = isinstance(tessellation, str)
    if ours and tessellation not in ("joint", "voronoi", "grid"):
        raise ValueError(f"tessellation: expected 'joint', 'voronoi', 'grid' or a Tessellation, got {tessellation!r}")
    for name, value, either in (("modes", modes, ("bic", "dbscan")), ("primitive", primitive, ("curved", "flat"))):
        if value not in either:
            raise ValueError(f"{name}: expected {either[0]!r} or {either[1]!r}, got {value!r}")
    if (cell_size is not None) + (n_cells is not None) > ours:
        raise ValueError("tessellation, cell_size, n_cells: at most one of them can decide the cells")
    if n_cells is not None and n_cells < 1:
        raise ValueError(f"n_cells: expected at least 1, got {n_cells}")


def lay_out(
    rows: TrackRows, tessellation: str | Tessellation, bounds: Bounds, background: Background, config: LearningConfig,
    *, cell_size: float | None, n_cells: int | None, progress: Progress | None, rng: np.random.Generator,
) -> tuple[Layout, float]:  # fmt: skip
    """The cells: those given, those learned, or the likeliest of several sizes; and how much they lean on parents."""
    position, reach = rows.position, rows.scale.reach_m
    few, joint = rows.some(TRIAL_ROWS, rng=rng), tessellation == "joint"
    if not isinstance(tessellation, str):
        candidates = [Layout(tessellation, 0.0)]
    elif tessellation == "grid" and n_cells is not None:
        candidates = [Layout(_grid_of_about(position, n_cells), 0.0)]
    elif tessellation == "grid":
        sizes = config.cell_sizes if cell_size is None else (cell_size,)
        candidates = [Layout(GridTessellation.covering(position, cell_size=size), 0.0) for size in sizes]
    else:
        if cell_size is not None:
            n_cells = GridTessellation.covering(position, cell_size=cell_size).n_cells
        placed, sizes = (few.position, config.rows_per_cell[:1]) if joint else (position, config.rows_per_cell)
        numbers = [n_cells] if n_cells and not joint else [1 + int(len(placed) / each) for each in sizes]
        even = [VoronoiTessellation.lloyd(placed, n_cells=n, rng=rng, reach=reach) for n in numbers]
        candidates = [Layout(cells, SOFTNESS) for cells in even]
    layout, strength, backing = _likeliest(rows, candidates, bounds, background, config, rng=rng)
    if not joint:
        return layout, strength
    rough = leaning(few, layout, bounds, background)._replace(**ROUGH)
    model = PrimitiveModel(rough, float(background.modes.rate[0, -1]), strength, backing)
    found = fit_jointly(
        model, position, rows, group=rows.group, reach=reach, n_cells=n_cells, softness=SOFTNESS, progress=progress,
        rng=rng, max_rows=enough_rows(position, reach), start=layout.cells.centers if n_cells is None else None,
    )  # fmt: skip
    return Layout(found.tessellation, SOFTNESS), strength


def enough_rows(position: FloatArray, reach: float) -> int:
    """Rows that cells are laid out by, of (n, 2) places whose cells reach so many metres beyond them."""
    return max(LEAST_ROWS, ROWS_PER_SQUARE * GridTessellation.covering(position, cell_size=reach).n_cells)


def leaning(rows: TrackRows, layout: Layout, bounds: Bounds, background: Background) -> Bounds:
    """Bounds whose priors are the median spreads of these cells' modes that several vehicles drive.

    That is empirical Bayes (Efron and Morris 1973). What the fit is bounded by is left out; where too few modes are
    left, nothing is usual but the background model's spread of speeds.
    """
    alone = bounds._replace(prior_strength=WEAK, usual_resultant=0.0, speed_spread=background.speed_spread)
    cells = fitted(rows, layout.members(rows.position), rows.position, alone._replace(**ROUGH))
    modes = cells.modes
    vehicles = cells.n_vehicles[:, None] * modes.weight
    is_inner = (
        (vehicles >= MIN_MODE_VEHICLES)
        & (modes.concentration > 0)
        & (modes.concentration < 0.99 * bounds.max_concentration)
        & (modes.shape > 1.0 + 1e-4)
        & (modes.shape < 0.99 * bounds.max_shape)
    )
    usual = alone._replace(prior_strength=bounds.prior_strength)
    if is_inner.sum() < 5:
        return usual
    spreads = von_mises.circular_variance(modes.concentration[is_inner]), 0.5 / modes.shape[is_inner]
    variance, spread = (
        float(np.quantile(of, 0.5, weights=vehicles[is_inner], method="inverted_cdf")) for of in spreads
    )
    return usual._replace(usual_resultant=1.0 - variance, speed_spread=spread)


def _likeliest(
    rows: TrackRows, candidates: list[Layout], bounds: Bounds, background: Background, config: LearningConfig, *,
    rng: np.random.Generator,
) -> tuple[Layout, float, FloatArray]:  # fmt: skip
    """The layout and the strength by which vehicles are likeliest that were held out; (n,) how likely by parents alone.

    The last of both where none can be held out.
    """
    speed = np.maximum(rows.speed, LEAST_SPEED)
    alone = background.log_density(rows, speed)
    best, found = -np.inf, (candidates[-1], config.strengths[-1], alone)
    groups, few = np.unique(rows.group), rows.some(TRIAL_ROWS, rng=rng)
    thirds = np.array_split(rng.permutation(groups), min(3, groups.size))
    masks = [np.isin(rows.group, third) for third in thirds if groups.size > 1]
    if groups.size >= MANY_GROUPS and len(candidates) > 1:
        masks = masks[:1]
    for layout in candidates if masks else ():
        rough = leaning(few, layout, bounds, background)._replace(**ROUGH)
        log_p = np.full((2, len(config.strengths), len(rows)), np.nan)
        log_p[1] = alone  # of few cells without parents
        for mask in masks:
            levels = fit_levels(few[~np.isin(few.group, rows.group[mask])], layout, rough)
            for of, part in zip(log_p, (levels, levels[1:])[: len(levels)], strict=False):
                for i, strength in enumerate(config.strengths):
                    made = assemble(layout.cells, part, background, config, strength)
                    of[i, mask] = made.log_density(rows.position[mask], rows.direction[mask], speed[mask])
        judged = np.isfinite(log_p[0, 0])
        means = np.average(log_p[0][:, judged], axis=1, weights=rows.weight[judged])
        if means.max() > best:
            best, i = means.max(), int(means.argmax())
            found = layout, config.strengths[i], log_p[1, i]
    return found


def assemble(
    cells: Tessellation, levels: list[Level], background: Background, config: LearningConfig, strength: float
) -> PrimitiveMap:
    """A map before its motion is learned: each cell's modes, heaviest first, one for standing, and what it leans on.

    That are tails of the modes, the modes of its parents with theirs, and the background ones.

    Args:
        cells: (n,) of the map.
        levels: what they hold, and what their parents do.
        background: the background model.
        config: how much tails weigh.
        strength: pseudo-vehicles with which its parent enters each cell, and the background model the last of them.
    """
    n_rows = np.round(levels[0].fits.n_rows[levels[0].of]).astype(np.int64)
    left, standing, cores, tails = np.ones((cells.n_cells, 1)), list[FloatArray](), list[Modes](), list[Modes]()
    for fits, of in levels:
        known = np.where(n_rows > 0, (fits.n_vehicles / (fits.n_vehicles + strength))[of], 0.0)[:, None]
        standing.append(left * known * fits.standing[of][:, None])
        core = fits.heaviest_at(cells.centers, of).times(left * known - standing[-1])
        shape = np.maximum(core.shape / BROADER, 1.0)
        tails.append(core.times(config.broad_share)._replace(
            concentration=core.concentration / BROADER, shape=shape, rate=core.rate * shape / core.shape
        ))  # fmt: skip
        cores.append(core.times(1.0 - config.broad_share))
        left = left * (1.0 - known)
    behind = background.modes.take(np.zeros(cells.n_cells, np.int64)).times(left)
    still = behind.take((slice(None), slice(-1, None)))._replace(weight=standing[0])
    behind.weight[:, -1:] += sum(standing[1:])
    modes = Modes.beside([cores[0], still, *tails, *cores[1:], behind])
    width = modes.weight.shape[1]
    nothing = (1, width - background.modes.weight.size)  # the background row has no other modes
    nowhere = Modes.beside([Modes.flat(*np.zeros((3, *nothing)), *np.ones((2, *nothing))), background.modes])
    modes = Modes(*map(np.concatenate, zip(modes, nowhere, strict=True)))
    return PrimitiveMap(
        tessellation=cells,
        modes=modes._replace(weight=modes.weight / modes.weight.sum(axis=1, keepdims=True)),
        n_rows=np.append(n_rows, n_rows.sum()),
        n_background_modes=width - cores[0].weight.shape[1] - 1,
    )


def _grid_of_about(position: FloatArray, n_cells: int) -> GridTessellation:
    """The grid whose number of cells is nearest to `n_cells`, by bisection on the logarithm of its cell size."""
    low, high = 0.1, float(np.ptp(position, axis=0).max()) + 1.0
    if n_cells == 1:  # lines of a grid go through the origin, so around it there would be four
        return GridTessellation(
            origin=position.min(axis=0) - 0.5, cell_size=high, n_x=1, n_y=1, square=np.zeros(1, np.int64)
        )
    nearest = GridTessellation.covering(position, cell_size=high)
    for _ in range(30):
        middle = float(np.sqrt(low * high))
        grid = GridTessellation.covering(position, cell_size=middle)
        nearest = min(nearest, grid, key=lambda tried: abs(tried.n_cells - n_cells))
        if grid.n_cells == n_cells:
            break
        low, high = (middle, high) if grid.n_cells > n_cells else (low, middle)
    return nearest
