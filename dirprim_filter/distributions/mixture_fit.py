"""Fitting a von Mises mixture to directions by EM, weighted and penalised (Eq. 1).

Source: Banerjee, Dhillon, Ghosh and Sra, Clustering on the unit hypersphere using von Mises-Fisher distributions, 2005;
the prior is the conjugate one of Guttorp and Lockhart, Finding the location of a signal, 1988.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import FloatArray, as_floats
from dirprim_filter.distributions import _expectation
from dirprim_filter.distributions._expectation import Angles, Mixture
from dirprim_filter.distributions.von_mises import MAX_CONCENTRATION
from dirprim_filter.distributions.von_mises_mixture import VonMisesMixture
from dirprim_filter.distributions.weights import counted

_ROUGH_ITERATIONS = 30
_ROUGH_TOLERANCE = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class MixtureFit:
    """A mixture and how it was found.

    Attributes:
        mixture: without leading axes, its modes by falling weight.
        log_likelihood: sum_i weight_i log p(direction_i), natural, without the prior.
        trace: (n_iterations,) the objective at each iteration of the best start: `log_likelihood`, less the prior's
            prior_strength sum_m log I0(concentration_m). It never falls.
        converged: whether the last iteration gained less than the tolerance.
    """

    mixture: VonMisesMixture
    log_likelihood: float
    trace: FloatArray
    converged: bool


def fit_mixture(
    direction: FloatArray,
    *,
    n_modes: int,
    weight: FloatArray | None = None,
    n_starts: int = 8,
    tolerance: float = 1e-8,
    max_iterations: int = 1000,
    max_concentration: float = 1e4,
    prior_strength: float = 0.0,
    rng: np.random.Generator,
) -> MixtureFit:
    """The mixture of `n_modes` modes under which the directions are likeliest.

    From each start EM runs until it gains little; the best goes on until it has converged. Fewer distinct directions
    than modes leave modes equal, or of weight 0; equal directions give `max_concentration`, unless there is a prior.

    Args:
        direction: (n,) radians.
        n_modes: how many modes.
        weight: (n,) how often each counts; left out, once.
        n_starts: how many times the means are drawn anew, far from each other.
        tolerance: of the gain in the mean objective per unit of weight.
        max_iterations: of the best start.
        max_concentration: bound of the concentrations: without it, a mode on equal angles had an infinite density.
        prior_strength: how many angles without a direction each mode has seen before: it shrinks concentrations.
        rng: what starts are drawn from.

    Raises:
        ValueError: no angle, one that is not finite, weights that are negative or all 0, or an option out of range.
    """
    theta = as_floats("direction", direction, "n")
    w = counted("direction", theta, weight)
    for name, count in (("n_modes", n_modes), ("n_starts", n_starts), ("max_iterations", max_iterations)):
        if count < 1:
            raise ValueError(f"{name}: expected at least 1, got {count}")
    if not 0.0 < max_concentration <= MAX_CONCENTRATION:
        raise ValueError(f"max_concentration: expected a number in (0, {MAX_CONCENTRATION:g}], got {max_concentration}")
    if not (np.isfinite(prior_strength) and prior_strength >= 0 and tolerance >= 0):
        raise ValueError(
            f"prior_strength, tolerance: expected no negative number, got {prior_strength} and {tolerance}"
        )
    theta, w = theta[w > 0], w[w > 0]
    angles = Angles(theta, np.cos(theta), np.sin(theta), w)

    def run(mixture: Mixture, n_iterations: int, until: float) -> tuple[FloatArray, bool]:
        trace = np.empty(n_iterations)
        n, converged = _expectation.expectation_maximisation(
            angles, max_concentration, prior_strength, until, mixture, trace
        )
        return trace[:n], converged

    found = []
    for key in rng.integers(0, 2**64, size=n_starts, dtype=np.uint64):
        mixture = Mixture(np.empty(n_modes), np.empty(n_modes), np.empty(n_modes))
        _expectation.start(angles, key, mixture)
        mixture.concentration[:] = np.minimum(mixture.concentration, max_concentration)
        rough, _ = run(mixture, min(_ROUGH_ITERATIONS, max_iterations), max(tolerance, _ROUGH_TOLERANCE))
        found.append((rough, mixture))
    rough, best = max(found, key=lambda each: float(each[0][-1]))
    fine, converged = run(best, max(max_iterations - len(rough) + 1, 1), tolerance)
    log_likelihood = _expectation.expectation(angles, best, np.empty((n_modes, 3)))
    order = np.argsort(-best.weight, kind="stable")
    return MixtureFit(
        mixture=VonMisesMixture(
            weight=best.weight[order] / best.weight.sum(),
            mean_direction=best.mean[order],
            concentration=best.concentration[order],
        ),
        log_likelihood=log_likelihood,
        trace=np.concatenate([rough[:-1], fine]),  # the fine run begins where the rough one stopped
        converged=converged,
    )
