"""The choices that held-out vehicles make: cells, and how strongly they lean on what is usual and on what is around."""

from __future__ import annotations

import logging
from functools import cache
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.primitives.assembly import Layout, fit_cells
from dirprim_filter.primitives.borrowing import N_LAYOUTS, SHARES
from dirprim_filter.primitives.cell_model import usual_of
from dirprim_filter.primitives.held_out import PLACE_FREE_STRENGTHS, HeldOut
from dirprim_filter.primitives.place_free import PlaceFree
from dirprim_filter.primitives.recipe import Recipe, Usual
from dirprim_filter.primitives.rows import TrackRows
from tessellation import VoronoiTessellation

logger = logging.getLogger(__name__)

MANY_GROUPS = 200
"""From so many groups or vehicles on one third is held out once; of fewer, each third in turn."""
WEAK = 0.002
"""Pseudo-vehicles that lean on nothing, while it is found out what is usual."""
TRIAL_ROWS = 100_000
"""So many rows are enough to find out what is usual, and how strongly cells lean on it: vehicles drawn at random."""
SOFTNESS = 0.25
"""Of a Voronoi cell's size: so far beyond its border it also learns from rows beside it, see `tessellation.gates`.
Where .1 and .5 could be chosen too, the densities of two towns were the same."""
REACH_M = 3.0
"""Metres around the data that Voronoi cells cover: about a lane."""


class Leaning(NamedTuple):
    """What cells lean on beside their own modes."""

    place_free: float = 1.0  # pseudo-vehicles of the place-free primitive
    borrowed: float = 0.0  # share of the other layouts' modes in the rest


def choose(
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
    recipes = [with_usual(rows, layout, recipe, free) for layout, *_ in candidates]
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


def other_layouts(rows: TrackRows, layout: Layout, recipe: Recipe, *, rng: np.random.Generator) -> list[Layout]:
    """Even cells to borrow from, as many as have rows; none for one cell, and none in the paper's recipe."""
    n_used = np.unique(layout.cells.cell_of(rows.position)).size
    if n_used < 2 or recipe.modes != "bic":
        return []
    place = rows.some(TRIAL_ROWS, rng=rng).position
    even = [
        VoronoiTessellation.lloyd(place, n_cells=n_used, rng=rng, reach=rows.scale.reach_m) for _ in range(N_LAYOUTS)
    ]
    return [Layout(cells, SOFTNESS) for cells in even]


def with_usual(rows: TrackRows, layout: Layout, recipe: Recipe, free: PlaceFree) -> Recipe:
    """The recipe whose modes lean on what is usual in these cells."""
    alone = recipe._replace(prior_strength=WEAK, usual=Usual(0.0, free.speed_spread), thorough=False)
    return recipe._replace(usual=usual_of(fit_cells(rows, layout, alone), alone))
