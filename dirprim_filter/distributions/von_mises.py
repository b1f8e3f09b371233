"""The von Mises distribution on the circle (Eq. 1), in log space and stable from concentration 0 to 1e6.

Source: Mardia and Jupp, Directional Statistics, 2000, sections 3.5.4 and 5.3.1.
"""

import numpy as np
from scipy.special import i0e, i1e

from dirprim_filter.distributions.angles import TWO_PI, wrap
from tessellation.arrays import FloatArray

MAX_CONCENTRATION = 1e6


def log_normaliser(concentration: FloatArray) -> FloatArray:
    """log(2 pi I0(kappa)) - kappa: what `kappa (cos(d) - 1)` lacks to be a log density. (...) -> (...).

    I0 overflows at 713; the scaled i0e never does.
    """
    return np.log(TWO_PI * i0e(concentration))


def log_density(direction: FloatArray, mean: FloatArray, concentration: FloatArray) -> FloatArray:
    """Natural log of VM(direction; mean, concentration), per radian. Broadcasts.

    `-2 sin^2(d / 2)` is `cos(d) - 1` without its cancellation near the mean.
    """
    half_turn = 0.5 * (np.asarray(direction) - mean)
    log_p: FloatArray = -2.0 * concentration * np.sin(half_turn) ** 2 - log_normaliser(concentration)
    return log_p


def mean_resultant_length(concentration: FloatArray) -> FloatArray:
    """I1(kappa) / I0(kappa), 0 for kappa 0 and towards 1; one less the circular variance. (...) -> (...)."""
    return np.asarray(i1e(concentration) / i0e(concentration), dtype=np.float64)


def concentration_of(resultant: FloatArray) -> FloatArray:
    """The concentration whose mean resultant length is `resultant`: the maximum likelihood estimate. (...) -> (...).

    Best and Fisher's approximation, then Newton steps with A'(k) = 1 - A(k)^2 - A(k) / k; the relative error is
    below 1e-9 up to `MAX_CONCENTRATION`, where it is bounded.
    """
    r = np.clip(np.asarray(resultant, dtype=np.float64), 0.0, 1.0 - 1e-15)
    k = np.where(r < 0.53, 2 * r + r**3 + 5 * r**5 / 6, -0.4 + 1.39 * r + 0.43 / (1 - r))
    k = np.where(r > 0.85, 1 / (r**3 - 4 * r**2 + 3 * r + 1e-300), k)
    k = np.clip(k, 1e-12, 2 * MAX_CONCENTRATION)
    for _ in range(8):
        a = mean_resultant_length(k)
        slope = 1 - a * a - a / k
        step = (a - r) / np.where(np.abs(slope) > 1e-300, slope, 1.0)
        k = np.clip(k - np.clip(step, -0.5 * k, k), 1e-12, 2 * MAX_CONCENTRATION)
    return np.where(r < 1e-12, 0.0, np.minimum(k, MAX_CONCENTRATION))


def sample(mean: FloatArray, concentration: FloatArray, *, rng: np.random.Generator) -> FloatArray:
    """One draw per element, radians in (-pi, pi]. Broadcasts.

    The generator may return exactly -pi: wrapped.
    """
    return wrap(np.asarray(rng.vonmises(mean, concentration)))
