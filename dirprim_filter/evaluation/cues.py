"""What the prior adds to an observation (the paper's Table II).

Source: Senanayake et al. 2020, section IV. A step is a visit of a cell by a held-out vehicle that comes from another
cell. At each step

- the truth is the vehicle's direction in the middle of the visit,
- the prior is the map's direction there,
- the observation is a von Mises around the most probable direction of the cell before (at the vehicle's last position
  in it), as in the paper; and, beside it, around the vehicle's own direction there, as a detector would report it,
- the posterior is the product of prior and observation (Eq. 4).

What the prior adds is the gain in log density: of the posterior over the observation, nat a step, with its interval
over vehicles. It is **not** the paper's gain of 54 %, and cannot be made so. The paper compares sums of densities under
an observation of a fixed concentration that it does not state, for each vehicle. Ours has the concentration that gives
the steps of the vehicles which the map was learned from the greatest likelihood; and sums of densities are ruled by
their largest terms, which grow without bound where directions repeat. The mean densities of prior, observation and
posterior (the paper prints their sums) stand beside, for themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.distributions import VonMisesMixture, von_mises
from dirprim_filter.distributions.angles import difference
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.distributions.von_mises_mixture import log_weights
from dirprim_filter.evaluation.density import rows_to_judge
from dirprim_filter.evaluation.intervals import Interval, mean_over
from dirprim_filter.evaluation.splits import Fold, SplitBy, honest_split, split, steps
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.learning import CellsRule, learn_primitives
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.track_ids import vehicle_numbers
from dirprim_filter.tracks import Tracks

MAX_STEP_S = 2.0
"""Visits further apart in time are no step: the log has lost the vehicle in between."""
ASCENT_STEPS = 30


class StepScore(NamedTuple):
    """What a belief gives to the true directions of all steps.

    Attributes:
        mean_log: mean natural log of the density, nat, with its interval over vehicles or groups.
        mean: mean density, per radian.
    """

    mean_log: Interval
    mean: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservationScore:
    """What the prior adds to one kind of observation, and that to the prior.

    Attributes:
        concentration: of the observation, mean over steps.
        log_gain: mean over steps of log posterior less log observation, nat.
        over_prior: mean over steps of log posterior less log prior, nat.
        observation: of the observation alone.
        posterior: of its product with the prior.
    """

    concentration: float
    log_gain: Interval
    over_prior: Interval
    observation: StepScore
    posterior: StepScore


@dataclass(frozen=True, slots=True, kw_only=True)
class CueTable:
    """Table II.

    Attributes:
        prior: of the map alone.
        cell_before: the paper's observation, the most probable direction of the cell before.
        own_course: a stronger one, the vehicle's own direction in the cell before.
        n_steps: steps of all held-out vehicles.
        n_vehicles: vehicles that have one.
        split_by: how vehicles were held out.
        n_folds: how many times.
    """

    prior: StepScore
    cell_before: ObservationScore
    own_course: ObservationScore
    n_steps: int
    n_vehicles: int
    split_by: SplitBy
    n_folds: int


class Steps(NamedTuple):
    """Visits of cells that follow on another one's, sorted by vehicle and time: (n,) each."""

    row: IntArray  # the middle of the visit
    before: IntArray  # the last row in the cell before


def evaluate_cues(
    tracks: Tracks,
    *,
    split_by: SplitBy | None = None,
    n_folds: int = 5,
    tessellation: CellsRule = "joint",
    progress: Callable[[int, int], None] | None = None,
    rng: np.random.Generator,
) -> CueTable:
    """Learn from a part of the vehicles, and follow the others from cell to cell.

    Args:
        tracks: observed motion.
        split_by: "vehicle" or "group"; left out, by group if there are several.
        n_folds: how many times.
        tessellation: the cells to learn, which are what vehicles step between; the paper's are "grid".
        progress: called with the number of steps done, and their total.
        rng: deals the folds and feeds the learning.

    Raises:
        ValueError: random rows were asked for, no row is left, or no held-out vehicle goes from cell to cell.
    """
    kept = rows_to_judge(tracks, interval_s=None)
    by = split_by or honest_split(kept)
    if by == "random":
        raise ValueError("split_by: expected 'vehicle' or 'group', got 'random': steps need whole vehicles")
    parts: list[tuple[AnyArray, ...]] = []
    folds = split(kept, by=by, n_folds=n_folds, rng=rng)
    done = steps(len(folds), progress)
    for fold, child in zip(folds, rng.spawn(len(folds)), strict=True):
        parts.append(_follow(learn_primitives(fold.train, tessellation=tessellation, rng=child), fold))
        done()
    track_id, group, prior, cell_before, own_course = (np.concatenate(column) for column in zip(*parts, strict=True))
    if prior.size == 0:
        raise ValueError("tracks: expected held-out vehicles that go from one cell to another, got none")
    vehicle = vehicle_numbers(track_id, group)
    cluster = group if by == "group" else vehicle
    return CueTable(
        prior=_step_score(prior, cluster),
        cell_before=_observation_score(prior, cell_before, cluster),
        own_course=_observation_score(prior, own_course, cluster),
        n_steps=prior.size,
        n_vehicles=np.unique(vehicle).size,
        split_by=by,
        n_folds=len(folds),
    )


def steps_between_cells(learned: PrimitiveMap, tracks: Tracks) -> Steps:
    """Where vehicles come from one cell into another; places that no cell covers are no visits."""
    vehicle = tracks.vehicle
    order = np.lexsort((tracks.time_ns, vehicle))
    cell = learned.tessellation.cell_of(tracks.position)[order]
    is_new = np.concatenate([[True], (np.diff(vehicle[order]) != 0) | (np.diff(cell) != 0)])[: len(tracks)]
    first = np.flatnonzero(is_new)
    last = np.append(first[1:], len(tracks)) - 1
    of = vehicle[order][first]
    pause_ns = tracks.time_ns[order][first[1:]] - tracks.time_ns[order][last[:-1]]
    follows = (of[1:] == of[:-1]) & (cell[first[1:]] >= 0) & (cell[first[:-1]] >= 0) & (pause_ns <= MAX_STEP_S * 1e9)
    middle = (first + last) // 2
    return Steps(row=order[middle[1:][follows]], before=order[last[:-1][follows]])


def observation_concentration(observed: FloatArray, truth: FloatArray) -> float:
    """Of the von Mises around what was observed: maximum likelihood over the steps. (n,), (n,) radians."""
    if truth.size == 0:
        return 0.0
    resultant = np.cos(difference(truth, observed)).mean()
    return float(von_mises.concentration_of(np.maximum(resultant, 0.0)))


def most_probable_direction(mixture: VonMisesMixture) -> FloatArray:
    """The direction of the greatest density of each mixture. (..., M) -> (...) radians.

    An ascent from the mode's mean where the density is greatest: at the top theta is the direction of
    sum_m w_m kappa_m VM_m(theta) e^{i mu_m}.
    """
    mean = mixture.mean_direction
    height = log_weights(mixture.weight) - von_mises.log_normaliser(mixture.concentration)
    between = 0.5 * difference(mean[..., :, None], mean[..., None, :])
    at_means = logsumexp(
        height[..., None, :] - 2.0 * mixture.concentration[..., None, :] * np.sin(between) ** 2, axis=-1
    )
    theta = np.take_along_axis(mean, at_means.argmax(axis=-1)[..., None], axis=-1)
    for _ in range(ASCENT_STEPS):
        half_turn = 0.5 * difference(theta, mean)
        pull = mixture.concentration * np.exp(height - 2.0 * mixture.concentration * np.sin(half_turn) ** 2)
        north, east = (pull * np.sin(mean)).sum(axis=-1), (pull * np.cos(mean)).sum(axis=-1)
        theta = np.arctan2(north, east)[..., None]
    return theta[..., 0]


def _follow(learned: PrimitiveMap, fold: Fold) -> tuple[AnyArray, ...]:
    """Follow the held-out vehicles from cell to cell; concentrations are learned from the others.

    Their ids and groups (n,), the prior's log density of the truth (n,), and by each observation (n, 3) log densities
    by itself and by the posterior, and its concentration.
    """
    known, own = steps_between_cells(learned, fold.train), steps_between_cells(learned, fold.test)
    truth = fold.test.direction[own.row]
    prior = learned.primitive_at(fold.test.position[own.row]).direction

    def judged(known_observed: FloatArray, observed: FloatArray) -> FloatArray:
        concentration = observation_concentration(known_observed, fold.train.direction[known.row])
        belief = Cue(turn=0.0, concentration=concentration).belief(observed)
        posterior = multiply_mixtures(prior, belief).mixture
        return np.column_stack(
            [belief.log_density(truth), posterior.log_density(truth), np.full(truth.shape, concentration)]
        )

    def usual(tracks: Tracks, row: IntArray) -> FloatArray:
        return most_probable_direction(learned.primitive_at(tracks.position[row]).direction)

    return (
        fold.test.track_id[own.row], fold.test.group[own.row], prior.log_density(truth),
        judged(usual(fold.train, known.before), usual(fold.test, own.before)),
        judged(fold.train.direction[known.before], fold.test.direction[own.before]),
    )  # fmt: skip


def _observation_score(prior: FloatArray, judged: FloatArray, cluster: IntArray) -> ObservationScore:
    observation, posterior, concentration = judged.T
    return ObservationScore(
        concentration=float(concentration.mean()),
        log_gain=mean_over(cluster, posterior - observation),
        over_prior=mean_over(cluster, posterior - prior),
        observation=_step_score(observation, cluster),
        posterior=_step_score(posterior, cluster),
    )


def _step_score(log_density: FloatArray, cluster: IntArray) -> StepScore:
    return StepScore(mean_over(cluster, log_density), float(np.exp(log_density).mean()))
