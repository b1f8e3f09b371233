"""Products of densities: what is known now times what is usual here (Eq. 4).

The product of two von Mises densities is von Mises: kappa e^{i mu} add as vectors, and I0 of the three concentrations
gives the constant (Mardia and Jupp 2000, section 3.5.4). So the product of two mixtures is a mixture of all pairs, in
closed form, and its samples are exact. The paper samples it by rejection, which the tests compare with. Gibbs sampling
of products on a k-d tree, which it suggests for many factors, gains nothing here: two factors of at most a dozen modes
have at most 144 pairs, and all of them are weighed at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from dirprim_filter.arrays import FloatArray
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
