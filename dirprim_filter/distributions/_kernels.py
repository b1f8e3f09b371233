"""Compiled scalar functions of the distributions, for the loops of fitting and filtering."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numba import njit
from numpy.polynomial import chebyshev
from scipy.special import i0e as _i0e
from scipy.special import i1e as _i1e

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from tessellation._compiling import COMPILED

TWO_PI = 2.0 * math.pi
MAX_CONCENTRATION = 1e6
NEGLIGIBLE_CONCENTRATION = 1e-8  # below it the circle is uniform to double precision

_DEGREE_NEAR, _DEGREE_FAR = 32, 26


def _near(function: np.ufunc, t: FloatArray) -> FloatArray:
    """The function of k in [0, 8], for t in [-1, 1]."""
    return np.asarray(function(4.0 * (t + 1.0)), dtype=np.float64)


def _far(function: np.ufunc, t: FloatArray) -> FloatArray:
    """sqrt(k) times the function of k from 8 on, for t = 16 / k - 1 in (-1, 1]."""
    k = 16.0 / np.maximum(t + 1.0, 1e-12)
    return np.asarray(np.sqrt(k) * function(k), dtype=np.float64)


def _interpolant(function: Callable[[FloatArray], FloatArray], degree: int) -> FloatArray:
    """The coefficients of the Chebyshev series that meets the function of t in [-1, 1] at its nodes."""
    nodes = chebyshev.chebpts1(degree + 1)
    return np.asarray(chebyshev.chebfit(nodes, function(nodes), degree), dtype=np.float64)


_I0_NEAR = _interpolant(partial(_near, _i0e), _DEGREE_NEAR)
_I1_NEAR = _interpolant(partial(_near, _i1e), _DEGREE_NEAR)
_I0_FAR = _interpolant(partial(_far, _i0e), _DEGREE_FAR)
_I1_FAR = _interpolant(partial(_far, _i1e), _DEGREE_FAR)


def _variance_series(n_terms: int) -> FloatArray:
    """C of 1 - I1(k) / I0(k) ~ sum_n c_n k^-n, n from 1: of V' = V^2 - 2 V + (1 - V) / k, term by term."""
    c = [0.0, 0.5]
    for n in range(2, n_terms + 1):
        c.append(0.5 * ((n - 2) * c[n - 1] + sum(c[i] * c[n - i] for i in range(1, n))))
    return np.array(c[1:])


_VARIANCE_SERIES = _variance_series(22)


def _inverse(resultant: FloatArray) -> FloatArray:
    """The concentration of these mean resultant lengths, from 0 to 0.9995, by Newton from Best and Fisher's start."""
    r = resultant
    k = np.where(r < 0.53, 2 * r + r**3 + 5 * r**5 / 6, 0.5 / (1 - r) + 0.25)
    for _ in range(8):
        a = _i1e(k) / _i0e(k)
        k = k - (a - r) / (1 - a * a - a / k)
    return np.asarray(k, dtype=np.float64)


def _dispersed(t: FloatArray) -> FloatArray:
    """K / r of r^2 = (t + 1) / 8: an analytic function."""
    r = np.sqrt((t + 1.0) / 8.0)
    return _inverse(r) / r


def _concentrated(t: FloatArray) -> FloatArray:
    """2 k v of the circular variance v = (t + 1) / 4."""
    v = 0.25 * (t + 1.0)
    return 2.0 * v * _inverse(1.0 - v)


_DISPERSED = _interpolant(_dispersed, 14)
_CONCENTRATED = _interpolant(_concentrated, 24)


@njit(**COMPILED)
def _series(coefficient: FloatArray, t: float) -> float:
    """Clenshaw's sum of a Chebyshev series at t in [-1, 1]."""
    b1, b2 = 0.0, 0.0
    for i in range(coefficient.size - 1, 0, -1):
        b1, b2 = 2.0 * t * b1 - b2 + coefficient[i], b1
    return t * b1 - b2 + coefficient[0]


@njit(**COMPILED)
def i0e(k: float) -> float:
    """exp(-k) I0(k), k >= 0."""
    if k <= 8.0:
        return _series(_I0_NEAR, 0.25 * k - 1.0)
    return _series(_I0_FAR, 16.0 / k - 1.0) / math.sqrt(k)


@njit(**COMPILED)
def i1e(k: float) -> float:
    """exp(-k) I1(k), k >= 0."""
    if k <= 8.0:
        return _series(_I1_NEAR, 0.25 * k - 1.0)
    return _series(_I1_FAR, 16.0 / k - 1.0) / math.sqrt(k)


@njit(**COMPILED)
def log_normaliser(k: float) -> float:
    """log(2 pi I0(k)) - k: VM(d) = exp(k (cos d - 1) - log_normaliser)."""
    return math.log(TWO_PI * i0e(k))


@njit(**COMPILED)
def circular_variance(k: float) -> float:
    """1 - I1(k) / I0(k), without the cancellation: from 20 on by its asymptotic series, exact to the last bits."""
    if k < 20.0:
        return 1.0 - i1e(k) / i0e(k)
    total = 0.0
    for i in range(_VARIANCE_SERIES.size - 1, -1, -1):
        total = (total + _VARIANCE_SERIES[i]) / k
    return total


@njit(**COMPILED)
def circular_variances(k: FloatArray, out: FloatArray) -> None:
    """`circular_variance` of each element."""
    for i in range(out.size):
        out[i] = circular_variance(k[i])


@njit(**COMPILED)
def concentration_from(resultant: float, variance: float) -> float:
    """The concentration whose mean resultant length is `resultant` and whose circular variance `variance`.

    They add to one; where one is small it alone has the digits, so both are asked for. A Chebyshev series; where the
    angles are concentrated it is right to 1e-6, and a step of Newton, log k over log variance, does the rest.
    """
    if variance > 0.5:
        return resultant * _series(_DISPERSED, 8.0 * resultant * resultant - 1.0) if resultant > 0.0 else 0.0
    if variance <= 0.5 / MAX_CONCENTRATION:
        return MAX_CONCENTRATION
    k = _series(_CONCENTRATED, 4.0 * variance - 1.0) / (2.0 * variance)
    v = circular_variance(k)
    k *= math.exp(math.log(v / variance) * v / (k * v * (2.0 - v) - (1.0 - v)))
    return min(k, MAX_CONCENTRATION)


@njit(**COMPILED)
def concentration_of(resultant: float) -> float:
    """The concentration whose mean resultant length is `resultant`, bounded by `MAX_CONCENTRATION`."""
    return concentration_from(min(resultant, 1.0), max(1.0 - resultant, 0.0))


@njit(**COMPILED)
def concentrations_from(resultant: FloatArray, variance: FloatArray, out: FloatArray) -> None:
    """`concentration_from` of each element."""
    for i in range(out.size):
        out[i] = concentration_from(resultant[i], variance[i])


@njit(**COMPILED)
def digamma(x: float) -> float:
    """psi(x), x > 0: recurrence up to 8, then the asymptotic series."""
    result = 0.0
    while x < 8.0:
        result -= 1.0 / x
        x += 1.0
    f = 1.0 / (x * x)
    tail = f * (1 / 12 - f * (1 / 120 - f * (1 / 252 - f * (1 / 240 - f * (1 / 132 - f * (691 / 32760 - f / 12))))))
    return result + math.log(x) - 0.5 / x - tail


@njit(**COMPILED)
def log_less_digamma(x: float) -> float:
    """log(x) - psi(x), x > 0, which is near 1 / (2 x), without the cancellation."""
    result, y = 0.0, x
    while y < 8.0:
        result += 1.0 / y
        y += 1.0
    if y > x:
        result += math.log(x / y)
    f = 1.0 / (y * y)
    tail = f * (1 / 12 - f * (1 / 120 - f * (1 / 252 - f * (1 / 240 - f * (1 / 132 - f * (691 / 32760 - f / 12))))))
    return result + 0.5 / y + tail


@njit(**COMPILED)
def trigamma(x: float) -> float:
    """psi'(x), x > 0: recurrence up to 8, then the asymptotic series."""
    result = 0.0
    while x < 8.0:
        result += 1.0 / (x * x)
        x += 1.0
    f = 1.0 / (x * x)
    tail = f * (1 / 6 - f * (1 / 30 - f * (1 / 42 - f * (1 / 30 - f * (5 / 66 - f * (691 / 2730 - f * 7 / 6))))))
    return result + 1.0 / x + 0.5 * f + tail / x


@njit(**COMPILED)
def gamma_shapes(spread: FloatArray, low: float, high: float, out: FloatArray) -> None:
    """`gamma_shape` of each element."""
    for i in range(out.size):
        out[i] = gamma_shape(spread[i], low, high)


@njit(**COMPILED)
def gamma_shape(spread: float, low: float, high: float) -> float:
    """Maximum likelihood shape of a gamma from `spread` = log(mean) - mean(log), bounded to [low, high].

    Newton on log(a) - psi(a) = spread in 1 / a (Minka 2002), which converges from the closed start in a few steps.
    """
    if not spread > 0.5 / high:  # log(a) - psi(a) > 1 / (2 a): no shape below `high` has so little spread
        return high
    a = (3 - spread + math.sqrt((spread - 3) ** 2 + 24 * spread)) / (12 * spread)
    for _ in range(6):
        error = log_less_digamma(a) - spread
        slope = 1 / a - trigamma(a)
        inverse = 1 / a + error / (a * a * slope)
        if inverse <= 0:
            return high
        a = 1 / inverse
    return min(max(a, low), high)


@njit(inline="always", **COMPILED)
def wrap(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    if -math.pi < angle <= math.pi:
        return angle
    turned = math.pi - (math.pi - angle) % TWO_PI
    return math.pi if turned <= -math.pi else turned  # so that NaN stays NaN


# Modes ---------------------------------------------------------------------------------------------------------------


@njit(nogil=True, **COMPILED)
def dbscan_sorted(theta: FloatArray, index: IntArray, eps: float, min_samples: int, label: IntArray) -> int:
    """DBSCAN of ascending angles; see `modes.dbscan`. Fills `label[index[i]]`; returns the number of clusters."""
    n = theta.size
    core = np.zeros(n, np.bool_)
    low, high = (
        0,
        0,
    )  # the neighbourhood of i: unwrapped rows [low, high), row j standing for angle + 2 pi (j // n)
    for i in range(n):
        high = max(high, i + 1)
        low = max(low, i + 1 - n)
        if i == 0:
            while low > 1 - n and theta[0] - _unwrapped(theta, low - 1) <= eps:
                low -= 1
        else:
            while theta[i] - _unwrapped(theta, low) > eps:
                low += 1
        while high - low < n and _unwrapped(theta, high) - theta[i] <= eps:
            high += 1
        core[i] = high - low >= min_samples
    cluster = _chain_cores(theta, core, eps)
    return _number_clusters(theta, index, core, cluster, eps, label)


@njit(inline="always", **COMPILED)
def _unwrapped(theta: FloatArray, j: int) -> float:
    n = theta.size
    if j < 0:
        return theta[j + n] - TWO_PI
    if j >= n:
        return theta[j - n] + TWO_PI
    return theta[j]


@njit(**COMPILED)
def _chain_cores(theta: FloatArray, core: BoolArray, eps: float) -> IntArray:
    """Chains of core points no further apart than eps; the first and the last join across the wrap."""
    n = theta.size
    cluster = np.full(n, -1, np.int64)
    count, first, last = 0, -1, -1
    for i in range(n):
        if core[i]:
            if first < 0:
                first = i
            elif theta[i] - theta[last] > eps:
                count += 1
            cluster[i] = count
            last = i
    if first >= 0 and count > 0 and theta[first] + TWO_PI - theta[last] <= eps:
        joined = cluster[last]
        for i in range(n):
            if cluster[i] == joined:
                cluster[i] = 0
    return cluster


@njit(**COMPILED)
def _number_clusters(
    theta: FloatArray, index: IntArray, core: BoolArray, cluster: IntArray, eps: float, label: IntArray
) -> int:
    """Number the clusters by their first row of the unsorted data and give border points the lowest in reach."""
    n = theta.size
    place = np.empty(n, np.int64)
    for i in range(n):
        place[index[i]] = i
    number = np.full(n + 1, -1, np.int64)
    count = 0
    for row in range(n):
        i = place[row]
        if core[i] and number[cluster[i]] < 0:
            number[cluster[i]] = count
            count += 1
    for i in range(n):
        label[index[i]] = number[cluster[i]] if core[i] else n
    for sweep in (1, -1):  # the nearest core on either side, once around the circle and again
        last = -1
        for step in range(2 * n):
            i = step % n if sweep == 1 else n - 1 - step % n
            if core[i]:
                last = i
            elif last >= 0:
                gap = sweep * (theta[i] - theta[last])
                if gap < 0:
                    gap += TWO_PI
                if gap <= eps:
                    label[index[i]] = min(label[index[i]], number[cluster[last]])
    for i in range(n):
        if label[i] == n:
            label[i] = -1
    return count
