"""The von Mises distribution on the circle (Eq. 1), in log space and stable from concentration 0 to 1e6.

Source: Mardia and Jupp, Directional Statistics, 2000, sections 3.5.4 and 5.3.1.
"""

import numpy as np
from scipy.special import i0e, i1e

from dirprim_filter.arrays import FloatArray, as_floats
from dirprim_filter.distributions import _kernels
from dirprim_filter.distributions._blocks import ROWS, block_keys, over_blocks
from dirprim_filter.distributions._samplers import draw_von_mises
from dirprim_filter.distributions.angles import TWO_PI, mean_direction, wrap
from dirprim_filter.distributions.weights import counted

MAX_CONCENTRATION: float = _kernels.MAX_CONCENTRATION


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
    """1 - I1(kappa) / I0(kappa), from 1 for kappa 0 towards 0, to a relative error of 1e-13. (...) -> (...)."""
    k = np.asarray(concentration, dtype=np.float64)
    out = np.empty(k.size)
    _kernels.circular_variances(k.ravel(), out)
    return out.reshape(k.shape)


def mean_resultant_length(concentration: FloatArray) -> FloatArray:
    """I1(kappa) / I0(kappa), 0 for kappa 0 and towards 1; one less the circular variance. (...) -> (...)."""
    return np.asarray(i1e(concentration) / i0e(concentration), dtype=np.float64)


def concentration_of(resultant: FloatArray) -> FloatArray:
    """The concentration whose mean resultant length is `resultant`: the maximum likelihood estimate. (...) -> (...).

    From 0 to `MAX_CONCENTRATION`, where it is bounded, to a relative error of 1e-13 as far as `resultant` has the
    digits: near 1 it has few, and an error of one unit in its last place is 2e-10 of a concentration of 1e6. Who knows
    the circular variance asks `concentration_of_variance`.
    """
    r = np.clip(np.asarray(resultant, dtype=np.float64), 0.0, 1.0)
    return _concentration_from(r, 1.0 - r)


def concentration_of_variance(variance: FloatArray) -> FloatArray:
    """The concentration whose circular variance is `variance`, to a relative error of 1e-13. (...) -> (...).

    Near 1 it is the variance that has few digits: see `concentration_of`.
    """
    v = np.clip(np.asarray(variance, dtype=np.float64), 0.0, 1.0)
    return _concentration_from(1.0 - v, v)


def fit(
    direction: FloatArray, *, weight: FloatArray | None = None, max_concentration: float = MAX_CONCENTRATION
) -> tuple[FloatArray, FloatArray]:
    """Maximum likelihood over the last axis: mean direction and concentration. (..., n) -> (...), (...).

    One angle, or equal ones, give `max_concentration`. Where angles cancel, as antipodal pairs do, the concentration is
    0 to rounding and the mean direction says nothing.

    Args:
        direction: (..., n) radians.
        weight: (..., n) how often each counts; left out, once.
        max_concentration: bound of the concentration, without which equal angles had an infinite density.

    Raises:
        ValueError: no angle, one that is not finite, a negative weight, or none that is positive.
    """
    theta = as_floats("direction", direction, "... n")
    w = counted("direction", theta, weight)
    mean, resultant = mean_direction(theta, w)
    # 1 - R as a mean of positive terms keeps the digits that R near 1 has lost.
    variance = (w * 2.0 * np.sin(0.5 * (theta - mean[..., None])) ** 2).sum(axis=-1) / w.sum(axis=-1)
    return mean, np.minimum(_concentration_from(resultant, np.minimum(variance, 1.0)), max_concentration)


def sample(mean: FloatArray, concentration: FloatArray, *, rng: np.random.Generator) -> FloatArray:
    """One draw per element, radians in (-pi, pi]. Broadcasts.

    By the method of Best and Fisher (1979), exact for every concentration. The draws depend on the generator and on
    the order of the elements, not on the number of threads.

    Raises:
        ValueError: a mean that is not finite, or a concentration that is negative or not finite.
    """
    m, k = as_floats("mean", mean, "..."), as_floats("concentration", concentration, "...")
    if (k < 0).any():
        raise ValueError(f"concentration: expected no negative number, got {k.min()}")
    shape = np.broadcast_shapes(m.shape, k.shape)
    m, k = (np.broadcast_to(column, shape).ravel() for column in (m, k))
    out, key = np.empty(m.size), block_keys(m.size, rng)
    over_blocks(
        lambda first, last: draw_von_mises(m[first:last], k[first:last], key[first // ROWS :], out[first:last]), m.size
    )
    return wrap(out).reshape(shape)


def _concentration_from(resultant: FloatArray, variance: FloatArray) -> FloatArray:
    out = np.empty(resultant.size)
    _kernels.concentrations_from(resultant.ravel(), variance.ravel(), out)
    return out.reshape(resultant.shape)
