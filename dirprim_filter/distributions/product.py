"""Products of densities: what is known now times what is usual here (Eq. 4).

The product of two von Mises densities is von Mises: kappa e^{i mu} add as vectors, and I0 of the three concentrations
gives the constant (Mardia and Jupp 2000, section 3.5.4). So the product of two mixtures is a mixture of all pairs, in
closed form, and its samples are exact. The paper samples it by rejection; that sampler stays, as the oracle and for
reproduction. Gibbs sampling of products on a k-d tree, which the paper suggests for many factors, gains nothing here:
two factors of at most a dozen modes have at most 144 pairs, and all of them are weighed at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from dirprim_filter.arrays import BoolArray, FloatArray
from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.distributions.von_mises_mixture import VonMisesMixture, log_weights


class MixtureProduct(NamedTuple):
    """A normalised product of mixtures (..., M1 * M2) and the log of what it was normalised by (...)."""

    mixture: VonMisesMixture
    log_evidence: FloatArray


def multiply_mixtures(prior: VonMisesMixture, belief: VonMisesMixture) -> MixtureProduct:
    """p*(theta) proportional to prior(theta) belief(theta), Eq. 4 in closed form; leading axes broadcast.

    The evidence is the integral of the product: how well the belief fits the prior.
    """
    k1, k2 = prior.concentration[..., :, None], belief.concentration[..., None, :]
    m1, m2 = prior.mean_direction[..., :, None], belief.mean_direction[..., None, :]
    x = k1 * np.cos(m1) + k2 * np.cos(m2)
    y = k1 * np.sin(m1) + k2 * np.sin(m2)
    concentration = np.hypot(x, y)
    # log I0(k) = log i0e(k) + k, and the k's belong together: k - k1 - k2 never overflows.
    log_weight = (
        (log_weights(prior.weight) - von_mises.log_normaliser(prior.concentration))[..., :, None]
        + (log_weights(belief.weight) - von_mises.log_normaliser(belief.concentration))[..., None, :]
        + von_mises.log_normaliser(concentration)
        + (concentration - k1 - k2)
    )
    shape = (*log_weight.shape[:-2], log_weight.shape[-2] * log_weight.shape[-1])
    log_weight = log_weight.reshape(shape)
    log_evidence = np.asarray(logsumexp(log_weight, axis=-1))
    mixture = VonMisesMixture(
        weight=np.exp(log_weight - log_evidence[..., None]),
        mean_direction=wrap(np.arctan2(y, x)).reshape(shape),
        concentration=concentration.reshape(shape),
    )
    return MixtureProduct(mixture, log_evidence)


LogDensity = Callable[[FloatArray], FloatArray]
"""Natural log of a density that need not be normalised. (n,) radians -> (n,)."""


class Proposals(NamedTuple):
    """Points under k times a proposal, evenly spread: those under the target as well are accepted. (n,) each.

    Attributes:
        direction: radians.
        log_height: natural log of the height above the axis, in the unit of the target.
        accepted: whether the point is under the target.
    """

    direction: FloatArray
    log_height: FloatArray
    accepted: BoolArray


def propose(
    log_target: LogDensity, proposal: VonMisesMixture, *, log_envelope: float, n: int, rng: np.random.Generator
) -> Proposals:
    """The points of rejection sampling: a direction from the proposal, a uniform height under k times its density.

    Args:
        log_target: the product, not normalised.
        proposal: the mixture to propose from, without leading axes.
        log_envelope: log of a k for which k times the proposal is nowhere below the target.
        n: how many.
        rng: what is drawn from.

    Raises:
        ValueError: the envelope is below the target at a proposed direction.
    """
    theta, _ = proposal.sample(n_samples=n, rng=rng)
    log_top = log_envelope + proposal.log_density(theta)
    log_ratio = log_target(theta) - log_top
    if (log_ratio > 1e-9).any():
        worst = int(np.argmax(log_ratio))
        raise ValueError(
            f"log_envelope: expected target <= k proposal everywhere, got {np.exp(log_ratio[worst]):.3g} times "
            f"k proposal at {theta[worst]:.3f} rad; raise k"
        )
    log_share = np.log(rng.random(n))
    return Proposals(theta, log_top + log_share, log_share < log_ratio)


class Accepted(NamedTuple):
    """Samples that passed, and what share of the proposals did."""

    direction: FloatArray
    acceptance: float


def sample_by_rejection(
    log_target: LogDensity, proposal: VonMisesMixture, *, log_envelope: float, n_samples: int, rng: np.random.Generator
) -> Accepted:
    """The paper's sampler: propose from a broad von Mises, accept by target / (envelope proposal).

    Args:
        log_target: the product, not normalised.
        proposal: the mixture to propose from, without leading axes.
        log_envelope: log of a k for which k times the proposal is nowhere below the target.
        n_samples: how many to return.
        rng: what is drawn from.

    Raises:
        ValueError: the envelope is below the target at a proposed direction, or nothing is accepted.
    """
    parts: list[FloatArray] = []
    found, proposed = 0, 0
    while found < n_samples:
        n = max(2 * (n_samples - found), 1000)
        points = propose(log_target, proposal, log_envelope=log_envelope, n=n, rng=rng)
        kept = points.direction[points.accepted]
        parts.append(kept)
        found, proposed = found + kept.size, proposed + n
        if found == 0 and proposed > 1_000_000:
            raise ValueError("log_envelope: none of a million proposals was accepted; lower k")
    return Accepted(np.concatenate(parts)[:n_samples], found / proposed)


def kernel_density(sample: FloatArray, *, concentration: float) -> VonMisesMixture:
    """The kernel density estimate that the paper draws through its samples (Fig. 8): a von Mises on each. (n,)."""
    return VonMisesMixture(
        weight=np.full(sample.size, 1.0 / sample.size),
        mean_direction=sample,
        concentration=np.full(sample.size, concentration),
    )
