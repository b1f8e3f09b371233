"""Cells and what happens in them, learned together.

Senanayake et al. 2020, section VI, ask for the cells that minimise sum_c sum_x -log p(x_c | theta_c). Left to the data
that were fitted, that sum falls until each datum has a cell of its own. Here it is taken over data held out: a datum is
judged by its cell as fitted to the groups of the other folds. This **held-out objective** is the one criterion: it
places the generators and decides how many there are.

From even cells on, as long as the objective falls:

1. *split* cells in two, across their longest or their shortest axis, where the gain is greater than its own standard
   error over groups;
2. *move* generators along the gradient of the likelihood of softly gated cells: sum_i (r_ic - g_ic) (x_i - g_c), with
   gates g and responsibilities r (Jordan and Jacobs 1994), where it helps the cells around;
3. *merge* neighbours that do better as one, by as much; cells that starve go this way.

Every step is judged by the true objective of true Voronoi cells, and is taken back if that has risen: the trace never
rises. Where a number of cells is asked for, so many even ones are moved alone.
All steps of a kind are tried together, and only cells whose members have changed are fitted again.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from tessellation._arrays import FloatArray, IntArray, as_floats
from tessellation._search import LEAST_GAIN, Search, State
from tessellation.gates import nearest_generators
from tessellation.protocols import CellModel, Cells, Data_contra
from tessellation.voronoi import VoronoiTessellation, lloyd_generators

logger = logging.getLogger(__name__)

MAX_ROUNDS = 60
N_FOLDS = 3
SMALLEST = 0.03
"""Of the reach: no cell is split that is so small; parked vehicles jitter."""
FEWEST_ROWS = 8
"""For each cell, where the search begins."""
START_SHARE = 0.5
"""A search begins with so many of the even cells that do best, and splits them: where even ones are too few it gets
stuck, where they are too many they never find their shape."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFit:
    """Cells that were learned.

    Attributes:
        tessellation: the cells, none of them empty.
        trace: (n_steps,) the held-out objective after each step, per datum; it never rises. Empty where nothing could
            be held out.
        n_cells: (n_steps,) how many cells there were.
    """

    tessellation: VoronoiTessellation
    trace: FloatArray
    n_cells: IntArray


def fit_jointly(
    model: CellModel[Data_contra, Cells],
    position: FloatArray,
    data: Data_contra,
    *,
    group: IntArray | None = None,
    reach: float,
    n_cells: int | None = None,
    start: FloatArray | None = None,
    softness: float = 0.25,
    max_rows: int = 10_000,
    progress: Callable[[int, float], None] | None = None,
    rng: np.random.Generator,
) -> JointFit:
    """Voronoi cells and a model in each, learned together.

    Args:
        model: what happens in a cell.
        position: (n, 2) where each datum is, metres.
        data: what the model makes of it; row i belongs to position i.
        group: (n,) whole groups are held out, for data of one group repeat each other; each datum by itself if absent.
        reach: metres around the data that the cells cover; see `VoronoiTessellation.covering`.
        n_cells: how many cells, fewer where data are too few; left out, as many as lower the held-out objective.
        start: (k, 2) generators to begin with, where no number is asked for; left out, a few even ones.
        softness: of the gates, see `gates.members_of`.
        max_rows: the cells are laid out by so many data at most, drawn at random.
        progress: called with the number of cells and the objective after each step.
        rng: deals the folds and chooses the first generators.

    Raises:
        ValueError: no datum, a number that is not finite, or arguments out of range.
    """
    position = as_floats("position", position, "n 2")
    start = None if start is None else as_floats("start", start, "n 2")
    n = len(position)
    group = np.arange(n) if group is None else np.asarray(group)
    if n == 0 or group.shape != (n,):
        raise ValueError(f"position, group: expected at least one datum, and shape ({n},), got {group.shape}")
    for name, asked in (("max_rows", max_rows), ("n_cells", n_cells)):
        if asked is not None and asked < 1:
            raise ValueError(f"{name}: expected at least 1, got {asked}")
    if not softness >= 0:
        raise ValueError(f"softness: expected a number that is not negative, got {softness}")
    region = VoronoiTessellation.covering(position, generators=position[:1], reach=reach).region
    origin = np.round(position.mean(axis=0))  # so that no digit is lost far from it
    used = np.arange(n) if n <= max_rows else np.sort(rng.permutation(n)[:max_rows])
    names, number = np.unique(group[used], return_inverse=True)
    search = Search(
        model=model,
        position=position - origin,
        data=data,
        row=used,
        fold=(rng.permutation(names.size) % N_FOLDS)[number],  # whole groups, dealt at random
        group=number,
        salt=np.random.default_rng(0).random(n),
        softness=softness,
        smallest=SMALLEST * reach,
    )

    steps: list[tuple[int, float]] = []

    def report(state: State[Cells]) -> None:
        steps.append((len(state.generators), state.objective))
        if progress is not None:
            progress(*steps[-1])

    if search.n_folds > 1:
        if n_cells is not None:
            start = lloyd_generators(search.position[used], rng.random(n_cells)) + origin
        state = _first(search, rng) if start is None else search.evaluate(start - origin)
        state = _descend(search, state, n_cells is not None, report)
        generators = state.generators
    else:  # nothing can be held out, so the data do not determine the number of cells
        generators = lloyd_generators(search.position[used], rng.random(n_cells or 1))
    nearest = nearest_generators(search.position, generators, k=1)[1]
    generators = generators[np.bincount(nearest[:, 0], minlength=len(generators)) > 0]  # none that is empty
    logger.info("joint cells: %d, after %d steps", len(generators), len(steps))
    return JointFit(
        tessellation=VoronoiTessellation(generators=generators + origin, region=region),
        trace=np.array([objective for _, objective in steps]),
        n_cells=np.array([n for n, _ in steps], dtype=np.int64),
    )


def _first(search: Search[Data_contra, Cells], rng: np.random.Generator) -> State[Cells]:
    """Even cells to begin with, the best power of two: the objective may have several minima, so all are tried."""

    def evenly(uniform: FloatArray) -> State[Cells]:
        return search.evaluate(lloyd_generators(search.position[search.row], uniform))

    numbers = 2 ** np.arange(int(np.log2(max(1, search.row.size // FEWEST_ROWS))) + 1)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        tried = pool.map(lambda uniform: evenly(uniform).objective, [rng.random(n) for n in numbers])
    best = int(numbers[np.argmin(list(tried))])
    return evenly(rng.random(max(1, int(START_SHARE * best))))


def _descend(
    search: Search[Data_contra, Cells], state: State[Cells], only_move: bool, report: Callable[[State[Cells]], None]
) -> State[Cells]:
    """Step by step, until no kind of step lowers the objective by much."""
    report(state)
    for _ in range(MAX_ROUNDS):
        before = state
        state = search.move(state if only_move else search.split(state))
        stalls = state.objective >= before.objective - LEAST_GAIN
        state = search.merge(state) if stalls and not only_move else state
        if state is not before:
            report(state)
        if stalls and state.objective >= before.objective - LEAST_GAIN:
            break
    return state
