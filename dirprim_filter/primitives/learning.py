"""Learning a map of directional primitives from tracks.

Source: Senanayake et al. 2020, section III. Beyond it: direction and speed are fitted together, the number of modes by
BIC, cells that know little lean on the place-free primitive by a strength learned from held-out vehicles.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives import _kernels, _two_steps
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.relaxation import FALLBACK, learn_relaxation
from dirprim_filter.primitives.transitions import learn_transitions, learn_lanes, learn_slip, learn_speed_rates
from dirprim_filter.primitives.rows import CellRows, TrackRows, columns_of
from dirprim_filter.tracks import Tracks
from tessellation import GridTessellation, Tessellation
from tessellation.arrays import BoolArray, FloatArray, IntArray

logger = logging.getLogger(__name__)

ModesRule = Literal["bic", "dbscan"]

PLACE_FREE_STRENGTHS = np.geomspace(0.01, 10.0, 13)
"""Pseudo-vehicles with which the place-free primitive may enter a cell."""
PLACE_FREE_PRIOR = 0.1
"""Pseudo-vehicles in each place-free mode, which has all vehicles of the log to speak for it."""
MANY_GROUPS = 200
"""From so many groups or vehicles on, a third of them held out once tells enough; of fewer, each third in turn."""
MIN_STANDING_MEAN = 0.05
"""m/s; standing vehicles of a simulator have speed 0, which would make the density at 0 unbounded."""


def learn_primitives(
    tracks: Tracks | Iterable[Tracks],
    *,
    tessellation: Literal["grid"] | Tessellation = "grid",
    cell_size: float | None = None,
    n_cells: int | None = None,
    modes: ModesRule = "bic",
    primitive: Literal["flat", "curved"] = "curved",
    config: LearningConfig | None = None,
    rng: np.random.Generator,
) -> PrimitiveMap:
    """Learn how vehicles move at each place.

    Args:
        tracks: observed motion, at once or in parts.
        tessellation: "grid" for square cells where there are data, or cells that are given.
        cell_size: metres, side of the grid's cells; chosen by held-out vehicles if absent.
        n_cells: about how many cells the grid shall have, instead of `cell_size`.
        modes: "bic" fits direction and speed together and counts modes by BIC; "dbscan" is the paper's recipe.
        primitive: "curved", a mode's mean direction and log mean speed vary linearly across the cell where BIC says
            so; "flat", constant in a cell as in the paper. With "dbscan" cells are flat.
        config: every other knob.
        rng: chooses the held-out vehicles.

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
    candidates = _candidates(rows.position, tessellation, cell_size, n_cells, config)
    recipe = Recipe(modes, primitive == "curved" and modes == "bic", config.prior_strengths[0], config)
    cells, recipe, strength = _choose(rows, candidates, recipe, free, rng=rng)
    fitted = fit_cells(rows, cells, recipe, free)
    learned = assemble(cells, fitted, free, strength)
    relaxation = learn_relaxation(learned, rows, standing_speed=config.standing_speed)
    logger.info(
        "learned %d cells from %d vehicles; the place-free primitive enters as %.3g vehicles",
        cells.n_cells, rows.n_vehicles, strength,
    )  # fmt: skip
    anchor, lane = learn_lanes(learned, rows)
    from dirprim_filter.primitives.relaxation import pairs_at
    i, j = pairs_at(rows, 1.0)
    mv = (rows.speed[i] >= 0.3)
    i, j = i[mv], j[mv]
    learned = replace(learned, speed_rate=learn_speed_rates(learned, rows, i, j, 1.0, relaxation.speed_rate))
    learned = replace(learned, anchor=anchor, lane=lane, slip=learn_slip(learned, rows, relaxation.lead))
    return replace(learned, relaxation=relaxation, transitions=learn_transitions(learned, rows))


class Recipe(NamedTuple):
    """How cells are fitted."""

    modes: ModesRule
    curved: bool
    prior_strength: float
    config: LearningConfig


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
    if isinstance(tessellation, str) and tessellation != "grid":
        raise ValueError(f"tessellation: this version knows 'grid' or a Tessellation, got {tessellation!r}")
    if modes not in ("bic", "dbscan"):
        raise ValueError(f"modes: expected 'bic' or 'dbscan', got {modes!r}")
    if primitive not in ("curved", "flat"):
        raise ValueError(f"primitive: expected 'curved' or 'flat', got {primitive!r}")
    given = [name for name, value in (("cell_size", cell_size), ("n_cells", n_cells)) if value is not None]
    if len(given) > 1 or (given and not isinstance(tessellation, str)):
        raise ValueError("tessellation, cell_size, n_cells: at most one of them can decide the cells")
    if n_cells is not None and n_cells < 1:
        raise ValueError(f"n_cells: expected at least 1, got {n_cells}")


class PlaceFree(NamedTuple):
    """The primitive that holds where no cell does: modes of all tracks together; the last is for standing."""

    weight: FloatArray
    mean: FloatArray
    concentration: FloatArray
    shape: FloatArray
    rate: FloatArray
    speed_spread: float  # log(mean) - mean(log) of all moving speeds


class FittedCells(NamedTuple):
    """What the fit found in each cell, before the place-free primitive enters; the last mode is for standing."""

    modes: _kernels.Modes  # (n_cells, K + 1) each
    n_vehicles: FloatArray
    n_rows: IntArray


def bounds_of(recipe: Recipe, *, max_modes: int, speed_spread: float) -> _kernels.Bounds:
    """The priors and bounds of a fit, as the kernels take them."""
    config = recipe.config
    return _kernels.Bounds(
        max_modes, recipe.prior_strength, speed_spread,
        config.max_concentration, config.max_shape, config.dbscan_eps, config.dbscan_share,
        config.bend_scale, config.gain_scale, recipe.curved,
    )  # fmt: skip


def fit_place_free(rows: TrackRows, config: LearningConfig) -> PlaceFree:
    """Fit the place-free primitive to all rows.

    It always holds a uniform direction and a standing mode, so that its density is positive and finite everywhere.
    """
    moving = rows[rows.speed >= config.standing_speed]
    n_standing = len(rows) - len(moving)
    k = config.max_place_free_modes
    found = _no_modes(k)
    spread, mean_speed = 1.0, 1.0
    if len(moving):
        mean_speed = float(moving.speed.mean())
        spread = max(float(np.log(mean_speed) - np.log(moving.speed).mean()), 1e-3)
        bounds = bounds_of(Recipe("bic", False, PLACE_FREE_PRIOR, config), max_modes=k, speed_spread=spread)
        order = np.argsort(moving.direction)
        columns = columns_of(moving.direction[order], moving.speed[order], np.zeros((len(moving), 2)))
        _kernels.fit_at_once(columns, float(moving.n_vehicles), bounds, found)
    standing = (n_standing + 1) / (len(rows) + 2)
    anywhere = 1.0 / (moving.n_vehicles + 1)  # the next vehicle may do what none has done
    used = np.flatnonzero(found.weight)
    share = np.concatenate([(1 - anywhere) * found.weight[used], [anywhere if used.size else 1.0]])
    return PlaceFree(
        weight=np.append((1 - standing) * share, standing),
        mean=np.concatenate([found.mean[used], [0.0, 0.0]]),
        concentration=np.concatenate([found.concentration[used], [0.0, 0.0]]),
        shape=np.concatenate([found.shape[used], [1.0, 1.0]]),
        rate=np.concatenate([found.rate[used], [1.0 / mean_speed, 1.0 / _standing_mean(rows, config)]]),
        speed_spread=spread,
    )


def _standing_mean(rows: TrackRows, config: LearningConfig) -> float:
    standing = rows.speed[rows.speed < config.standing_speed]
    return max(float(standing.mean()) if standing.size else 0.0, MIN_STANDING_MEAN)


def _no_modes(*shape: int) -> _kernels.Modes:
    zeros = [np.zeros(shape) for _ in range(7)]
    return _kernels.Modes(zeros[0], zeros[1], zeros[2], np.ones(shape), np.ones(shape), *zeros[3:])


def fit_cells(rows: TrackRows, cells: Tessellation, recipe: Recipe, free: PlaceFree) -> FittedCells:
    """Fit each cell's modes to its own rows."""
    config = recipe.config
    in_cells = CellRows.of(rows, cells, standing_speed=config.standing_speed)
    n, k = cells.n_cells, config.max_modes
    found = _no_modes(n, k)
    bounds = bounds_of(recipe, max_modes=k, speed_spread=free.speed_spread)
    fit = _two_steps.fit_cells_in_two_steps if recipe.modes == "dbscan" else _kernels.fit_cells_at_once
    fit(in_cells.rows, in_cells.start, in_cells.n_vehicles, bounds, found)
    used = max(int((found.weight > 0).sum(axis=1).max(initial=0)), 1)
    order = np.argsort(-found.weight, axis=1, kind="stable")[:, :used]  # heaviest first
    n_rows = in_cells.n_rows
    standing = (in_cells.n_standing / np.maximum(n_rows, 1))[:, None]
    heaviest = _kernels.Modes(*(np.take_along_axis(column, order, 1) for column in found))
    of_standing = (free.mean[-1], free.concentration[-1], free.shape[-1], free.rate[-1], 0.0, 0.0, 0.0, 0.0)
    modes = _kernels.Modes(
        np.hstack([heaviest.weight * (1 - standing), standing]),
        *(np.hstack([own, np.full((n, 1), last)]) for own, last in zip(heaviest[1:], of_standing, strict=True)),
    )
    vehicles = np.where(n_rows > 0, np.maximum(in_cells.n_vehicles, 1.0), 0.0)
    return FittedCells(modes, vehicles, n_rows)


def place_free_share(n_vehicles: FloatArray, strength: FloatArray | float) -> FloatArray:
    """The weight of the place-free primitive in a cell that `n_vehicles` passed, entering as `strength` vehicles."""
    return np.asarray(strength / (n_vehicles + strength))


def assemble(cells: Tessellation, fitted: FittedCells, free: PlaceFree, strength: float) -> PrimitiveMap:
    """A map of each cell's own modes, then the place-free ones; its relaxation is still to be learned."""
    n, own = fitted.modes.weight.shape
    share = place_free_share(fitted.n_vehicles, strength)[:, None]
    weight = np.zeros((n + 1, own + free.weight.size))
    weight[:n, :own] = (1 - share) * fitted.modes.weight
    weight[:n, own:] = share * free.weight
    weight[n, own:] = free.weight
    weight /= weight.sum(axis=1, keepdims=True)

    def column(of_cells: FloatArray, of_free: FloatArray, filler: float) -> FloatArray:
        placed = np.vstack([of_cells, np.full(own, filler)])
        return np.column_stack([placed, np.tile(of_free, (n + 1, 1))])

    def slope(east: FloatArray, north: FloatArray) -> FloatArray:
        flat = np.zeros_like(free.weight)
        return np.stack([column(east, flat, 0.0), column(north, flat, 0.0)], axis=-1)

    modes = fitted.modes
    return PrimitiveMap(
        tessellation=cells,
        direction=VonMisesMixture(
            weight=weight,
            mean_direction=column(modes.mean, free.mean, 0.0),
            concentration=column(modes.concentration, free.concentration, 0.0),
        ),
        speed=Gamma(shape=column(modes.shape, free.shape, 1.0), rate=column(modes.rate, free.rate, 1.0)),
        n_rows=np.append(fitted.n_rows, fitted.n_rows.sum()),
        n_place_free_modes=free.weight.size,
        relaxation=FALLBACK,
        bend=slope(modes.bend_east, modes.bend_north),
        gain=slope(modes.gain_east, modes.gain_north),
    )


def _candidates(
    position: FloatArray,
    tessellation: str | Tessellation,
    cell_size: float | None,
    n_cells: int | None,
    config: LearningConfig,
) -> list[Tessellation]:
    """The tessellations to choose from."""
    if not isinstance(tessellation, str):
        return [tessellation]
    if n_cells is not None:
        return [_grid_of_about(position, n_cells)]
    sizes = config.cell_sizes if cell_size is None else (cell_size,)
    return [GridTessellation.covering(position, cell_size=size) for size in sizes]


def _choose(
    rows: TrackRows, candidates: list[Tessellation], recipe: Recipe, free: PlaceFree, *, rng: np.random.Generator
) -> tuple[Tessellation, Recipe, float]:
    """What held-out vehicles like best: the cells, the prior in their modes, and the strength of the place-free one."""
    groups = np.unique(rows.group)
    if groups.size < 2:  # nobody to hold out
        return candidates[-1], recipe, 1.0
    thirds = np.array_split(rng.permutation(groups), min(3, groups.size))
    folds = [np.isin(rows.group, third) for third in thirds][: 1 if groups.size >= MANY_GROUPS else None]
    scores: dict[tuple[int, float], FloatArray] = {}

    def score(size: int, prior_strength: float) -> float:
        if (size, prior_strength) not in scores:
            trial = recipe._replace(prior_strength=prior_strength)
            of_folds = [_held_out_scores(rows, held_out, candidates[size], trial, free) for held_out in folds]
            scores[size, prior_strength] = np.mean(of_folds, axis=0)
        return float(scores[size, prior_strength].max())

    # Either decides little about the other, so each in turn rather than all pairs.
    size, prior_strength = len(candidates) - 1, recipe.prior_strength
    for _ in range(2):
        size = max(range(len(candidates)), key=lambda s: score(s, prior_strength))
        prior_strength = max(recipe.config.prior_strengths, key=lambda p: score(size, p))
    logger.info(
        "chosen: %d cells, prior of %g vehicles, held-out log density %.3f",
        candidates[size].n_cells, prior_strength, score(size, prior_strength),
    )  # fmt: skip
    share = float(PLACE_FREE_STRENGTHS[np.argmax(scores[size, prior_strength])])
    return candidates[size], recipe._replace(prior_strength=prior_strength), share


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


def _held_out_scores(
    rows: TrackRows, held_out: BoolArray, cells: Tessellation, recipe: Recipe, free: PlaceFree
) -> FloatArray:
    """Mean log density of the held-out rows for each of `PLACE_FREE_STRENGTHS`."""
    fitted = fit_cells(rows[~held_out], cells, recipe, free)
    own = assemble(cells, fitted, free, strength=1e-12)
    kept = rows[held_out]
    place_free = own.without_places().log_density(kept.position, kept.direction, kept.speed)
    placed = own.log_density(kept.position, kept.direction, kept.speed)
    n_vehicles = np.append(fitted.n_vehicles, 0.0)[cells.cell_of(kept.position)]
    share = place_free_share(n_vehicles[:, None], PLACE_FREE_STRENGTHS)
    with np.errstate(divide="ignore"):
        mixed = np.logaddexp(np.log1p(-share) + placed[:, None], np.log(share) + place_free[:, None])
    return np.asarray(mixed.mean(axis=0))
