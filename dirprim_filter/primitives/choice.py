"""The choices that held-out vehicles make: cells, and how strongly they lean on what is usual."""

from __future__ import annotations

import logging
from functools import cache
from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray
from dirprim_filter.primitives.assembly import Layout, background_share, fit_cells, gather
from dirprim_filter.primitives.background import Background
from dirprim_filter.primitives.cell_model import PrimitiveCells, fitted, usual_of
from dirprim_filter.primitives.recipe import Recipe, Usual
from dirprim_filter.primitives.rows import CellRows, TrackRows

logger = logging.getLogger(__name__)

MANY_GROUPS = 200
"""From so many groups or vehicles on one third is held out once; of fewer, each third in turn."""
BACKGROUND_STRENGTHS = np.geomspace(0.01, 10.0, 13)
"""Pseudo-vehicles with which the background model may enter a cell."""
WEAK = 0.002
"""Pseudo-vehicles that lean on nothing, while it is found out what is usual."""


class Fold(NamedTuple):
    """Vehicles held out, and the others."""

    seen: TrackRows
    kept: TrackRows
    background: Background

    @classmethod
    def of(cls, rows: TrackRows, held_out: BoolArray, background: Background) -> Self:
        """Of (n,) rows those where `held_out` is true are judged by what the others say."""
        return cls(rows[~held_out], rows[held_out], background)

    def scores(self, layout: Layout, fits: PrimitiveCells) -> FloatArray:
        """(n_strengths,) mean log density of the held-out rows by cells fitted to the others.

        For each of `BACKGROUND_STRENGTHS`, see `assembly.assemble`.
        """
        kept = self.kept
        cell = layout.cells.cell_of(kept.position)
        own = fits.log_density(cell, kept.position, kept.direction, kept.speed, float(self.background.rate[-1]))
        share = background_share(np.append(fits.n_vehicles, 0.0)[cell][:, None], BACKGROUND_STRENGTHS)
        with np.errstate(divide="ignore"):
            in_place, anywhere = (
                np.log1p(-share),
                np.log(share) + self.background.log_density(kept, kept.speed)[:, None],
            )
        return np.asarray(np.average(np.logaddexp(in_place + own[:, None], anywhere), axis=0, weights=kept.weight))


def choose(
    rows: TrackRows, candidates: list[Layout], recipe: Recipe, background: Background, *, rng: np.random.Generator
) -> tuple[Layout, Recipe, float]:
    """The cells, the strength of what is usual in their modes, and pseudo-vehicles of the background model.

    Args:
        rows: to be held out in turn.
        candidates: layouts.
        recipe: what it says of strengths is tried first.
        background: the background model.
        rng: draws the folds.
    """
    recipes = [with_usual(rows, layout, recipe, background) for layout in candidates]
    groups = np.unique(rows.group)
    if groups.size < 2:  # none to hold out
        return candidates[-1], recipes[-1], 1.0
    thirds = np.array_split(rng.permutation(groups), min(3, groups.size))
    thirds = thirds[: 1 if groups.size >= MANY_GROUPS else None]
    folds = [Fold.of(rows, np.isin(rows.group, third), background) for third in thirds]

    @cache
    def gathered(f: int, i: int) -> CellRows:
        return gather(folds[f].seen, candidates[i], recipe)

    @cache
    def scores(i: int, prior_strength: float, cost: float) -> FloatArray:
        trial = recipes[i]._replace(prior_strength=prior_strength, parameter_cost=cost, thorough=False)
        every = [fold.scores(candidates[i], fitted(gathered(f, i), trial)) for f, fold in enumerate(folds)]
        return np.asarray(np.mean(every, axis=0))

    # Each decides little about the others, so one after the other rather than all together.
    config = recipe.config
    best, prior_strength, cost = len(candidates) - 1, recipe.prior_strength, recipe.parameter_cost
    costs = config.parameter_costs if recipe.modes == "bic" else (cost,)
    for _ in range(2):
        if len(candidates) > 1:
            best = max(range(len(candidates)), key=lambda i: scores(i, prior_strength, cost).max())
        prior_strength = max(config.prior_strengths, key=lambda p: scores(best, p, cost).max())
        cost = max(costs, key=lambda c: scores(best, prior_strength, c).max())
    found = scores(best, prior_strength, cost)
    logger.info(
        "chosen: %d cells, what is usual counts as %g vehicles, %g of BIC's cost of a parameter, log density %.3f",
        candidates[best].cells.n_cells, prior_strength, cost, found.max(),
    )  # fmt: skip
    strength = float(BACKGROUND_STRENGTHS[int(found.argmax())])
    return candidates[best], recipes[best]._replace(prior_strength=prior_strength, parameter_cost=cost), strength


def with_usual(rows: TrackRows, layout: Layout, recipe: Recipe, background: Background) -> Recipe:
    """The recipe whose modes lean on what is usual in these cells."""
    alone = recipe._replace(prior_strength=WEAK, usual=Usual(0.0, background.speed_spread), thorough=False)
    return recipe._replace(usual=usual_of(fit_cells(rows, layout, alone), alone))
