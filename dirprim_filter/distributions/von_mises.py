"""The von Mises distribution on the circle (Eq. 1), in log space and stable from concentration 0 to 1e6.

Source: Mardia and Jupp, Directional Statistics, 2000, sections 3.5.4 and 5.3.1.
"""

import numpy as np
from scipy.special import i0e, i1e

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions.angles import TWO_PI

MAX_CONCENTRATION = 1e6


def log_normaliser(concentration: FloatArray) -> FloatArray:
    """log(2 pi I0(kappa)) - kappa: what `kappa (cos(d) - 1)` lacks to be a log density. (...) -> (...).

    I0 overflows at 713; the scaled i0e never does.
    """
    return np.log(TWO_PI * i0e(concentration))


def log_density(direction: FloatArray, mean: FloatArray, concentration: FloatArray) -> FloatArray:
    """Natural log of VM(direction; mean, concentration), per radian. Broadcasts; NaN gives NaN.

    `-2 sin^2(d / 2)` is `cos(d) - 1` without its cancellation near the mean.
    """
    half_turn = 0.5 * (np.asarray(direction) - mean)
    log_p: FloatArray = -2.0 * concentration * np.sin(half_turn) ** 2 - log_normaliser(concentration)
    return log_p


def circular_variance(concentration: FloatArray) -> FloatArray:
    """1 - I1(kappa) / I0(kappa), from 1 for kappa 0 towards 0, to an error of 2e-16. (...) -> (...)."""
    return 1.0 - mean_resultant_length(concentration)


def mean_resultant_length(concentration: FloatArray) -> FloatArray:
    """I1(kappa) / I0(kappa), 0 for kappa 0 and towards 1; one less the circular variance. (...) -> (...)."""
    return np.asarray(i1e(concentration) / i0e(concentration), dtype=np.float64)


def concentration_of(resultant: FloatArray) -> FloatArray:
    """The concentration whose mean resultant length is `resultant`: the maximum likelihood estimate. (...) -> (...).

    From 0 to `MAX_CONCENTRATION`, where it is bounded. An error of one unit in the last place of a `resultant` near 1
    is 2e-10 of a concentration of 1e6. Newton from the start of Best and Fisher (1981), in log k over log variance
    where directions are concentrated.
    """
    r = np.clip(np.asarray(resultant, dtype=np.float64), 0.0, 1.0)
    variance = np.maximum(1.0 - r, 0.25 / MAX_CONCENTRATION)
    k = np.where(r < 0.53, 2.0 * r + r**3 + 5.0 * r**5 / 6.0, 0.5 / variance + 0.25)
    for _ in range(_NEWTON_STEPS):
        v, a = circular_variance(k), mean_resultant_length(k)
        of_variance = k * np.exp(np.log(v / variance) * v / np.maximum(k * v * (2.0 - v) - (1.0 - v), 1e-300))
        of_resultant = k - (a - r) / np.maximum(1.0 - a * a - a / np.maximum(k, 1e-300), 0.1)
        k = np.where(r < 0.53, np.where(k > 0.0, of_resultant, 0.0), of_variance)
    return np.minimum(k, MAX_CONCENTRATION)


_NEWTON_STEPS = 6
