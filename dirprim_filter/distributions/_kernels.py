"""Compiled scalar functions of the distributions and their samplers, for the loops of fitting and filtering.

Random numbers come from xoshiro256++ (Blackman and Vigna, 2019), whose state is a row of four uint64: one row for each
vehicle, so that its draws depend on nothing but its own seed.

The von Mises sampler is that of Best and Fisher (1979), the gamma sampler that of Marsaglia and Tsang (2000), the
Poisson sampler PTRS of Hoermann (1993).
"""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from numba import njit
from numpy.polynomial import chebyshev
from scipy.special import i0e as _i0e
from scipy.special import i1e as _i1e

from tessellation.arrays import BoolArray, FloatArray, IntArray

UIntArray = npt.NDArray[np.uint64]

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


def _interpolant(part: Callable[[np.ufunc, FloatArray], FloatArray], function: np.ufunc, degree: int) -> FloatArray:
    nodes = chebyshev.chebpts1(degree + 1)
    return np.asarray(chebyshev.chebfit(nodes, part(function, nodes), degree), dtype=np.float64)


_I0_NEAR = _interpolant(_near, _i0e, _DEGREE_NEAR)
_I1_NEAR = _interpolant(_near, _i1e, _DEGREE_NEAR)
_I0_FAR = _interpolant(_far, _i0e, _DEGREE_FAR)
_I1_FAR = _interpolant(_far, _i1e, _DEGREE_FAR)


@njit(cache=True)
def _series(coefficient: FloatArray, t: float) -> float:
    """Clenshaw's sum of a Chebyshev series at t in [-1, 1]."""
    b1, b2 = 0.0, 0.0
    for i in range(coefficient.size - 1, 0, -1):
        b1, b2 = 2.0 * t * b1 - b2 + coefficient[i], b1
    return t * b1 - b2 + coefficient[0]


@njit(cache=True)
def i0e(k: float) -> float:
    """exp(-k) I0(k), k >= 0."""
    if k <= 8.0:
        return _series(_I0_NEAR, 0.25 * k - 1.0)
    return _series(_I0_FAR, 16.0 / k - 1.0) / math.sqrt(k)


@njit(cache=True)
def i1e(k: float) -> float:
    """exp(-k) I1(k), k >= 0."""
    if k <= 8.0:
        return _series(_I1_NEAR, 0.25 * k - 1.0)
    return _series(_I1_FAR, 16.0 / k - 1.0) / math.sqrt(k)


@njit(cache=True)
def log_normaliser(k: float) -> float:
    """log(2 pi I0(k)) - k: VM(d) = exp(k (cos d - 1) - log_normaliser)."""
    return math.log(TWO_PI * i0e(k))


@njit(cache=True)
def concentration_of(resultant: float) -> float:
    """The concentration whose mean resultant length is `resultant`; see `von_mises.concentration_of`."""
    r = min(max(resultant, 0.0), 1.0 - 1e-15)
    if r < 1e-12:
        return 0.0
    if r < 0.53:
        k = 2 * r + r**3 + 5 * r**5 / 6
    elif r < 0.85:
        k = -0.4 + 1.39 * r + 0.43 / (1 - r)
    else:
        k = 1 / (r**3 - 4 * r**2 + 3 * r)
    for _ in range(8):
        a = i1e(k) / i0e(k)
        slope = 1 - a * a - a / k
        if slope < 1e-15:
            break
        step = (a - r) / slope
        step = min(max(step, -k), 0.5 * k)
        k = min(k - step, 2 * MAX_CONCENTRATION)
        if abs(step) < 1e-12 * k:
            break
    return min(k, MAX_CONCENTRATION)


@njit(cache=True)
def digamma(x: float) -> float:
    """psi(x), x > 0: recurrence up to 8, then the asymptotic series."""
    result = 0.0
    while x < 8.0:
        result -= 1.0 / x
        x += 1.0
    f = 1.0 / (x * x)
    tail = f * (1 / 12 - f * (1 / 120 - f * (1 / 252 - f * (1 / 240 - f * (1 / 132 - f * (691 / 32760 - f / 12))))))
    return result + math.log(x) - 0.5 / x - tail


@njit(cache=True)
def trigamma(x: float) -> float:
    """psi'(x), x > 0: recurrence up to 8, then the asymptotic series."""
    result = 0.0
    while x < 8.0:
        result += 1.0 / (x * x)
        x += 1.0
    f = 1.0 / (x * x)
    tail = f * (1 / 6 - f * (1 / 30 - f * (1 / 42 - f * (1 / 30 - f * (5 / 66 - f * (691 / 2730 - f * 7 / 6))))))
    return result + 1.0 / x + 0.5 * f + tail / x


@njit(cache=True)
def gamma_shape(spread: float, low: float, high: float) -> float:
    """Maximum likelihood shape of a gamma from `spread` = log(mean) - mean(log), bounded to [low, high].

    Newton on log(a) - psi(a) = spread in 1 / a (Minka 2002), which converges from the closed start in a few steps.
    """
    if not spread > 0.5 / high:  # log(a) - psi(a) > 1 / (2 a): no shape below `high` has so little spread
        return high
    a = (3 - spread + math.sqrt((spread - 3) ** 2 + 24 * spread)) / (12 * spread)
    for _ in range(6):
        error = math.log(a) - digamma(a) - spread
        slope = 1 / a - trigamma(a)
        inverse = 1 / a + error / (a * a * slope)
        if inverse <= 0:
            return high
        a = 1 / inverse
    return min(max(a, low), high)


# Random numbers ------------------------------------------------------------------------------------------------------

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_R27, _R30, _R31 = np.uint64(27), np.uint64(30), np.uint64(31)
_R11, _R17, _R19, _R23, _R41, _R45 = (np.uint64(n) for n in (11, 17, 19, 23, 41, 45))
_TO_UNIT = 2.0**-53


@njit(cache=True)
def seed_state(key: np.uint64, state: UIntArray) -> None:
    """Fill a state row from a 64-bit key by splitmix64, as the generator's authors advise."""
    z = key
    for i in range(4):
        z = z + _GOLDEN
        m = (z ^ (z >> _R30)) * _MIX_1
        m = (m ^ (m >> _R27)) * _MIX_2
        state[i] = m ^ (m >> _R31)


@njit(cache=True, inline="always")
def uniform(state: UIntArray) -> float:
    """A draw from the open interval (0, 1)."""
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    total = s0 + s3
    result = ((total << _R23) | (total >> _R41)) + s0
    shifted = s1 << _R17
    s2 ^= s0
    s3 ^= s1
    s1 ^= s2
    s0 ^= s3
    s2 ^= shifted
    state[0], state[1], state[2] = s0, s1, s2
    state[3] = (s3 << _R45) | (s3 >> _R19)
    return (float(result >> _R11) + 0.5) * _TO_UNIT


@njit(cache=True)
def draw_normal(state: UIntArray) -> float:
    """A standard normal draw, by Marsaglia's polar method."""
    while True:
        u = 2.0 * uniform(state) - 1.0
        v = 2.0 * uniform(state) - 1.0
        q = u * u + v * v
        if 0.0 < q < 1.0:
            return u * math.sqrt(-2.0 * math.log(q) / q)


@njit(cache=True)
def draw_gamma(shape: float, state: UIntArray) -> float:
    """A draw from the gamma distribution of rate one."""
    boost = 1.0
    if shape < 1.0:
        boost = uniform(state) ** (1.0 / shape)
        shape += 1.0
    d = shape - 1.0 / 3.0
    c = 1.0 / math.sqrt(9.0 * d)
    while True:
        x = draw_normal(state)
        v = 1.0 + c * x
        if v <= 0.0:
            continue
        v = v * v * v
        u = uniform(state)
        if math.log(u) < 0.5 * x * x + d * (1.0 - v + math.log(v)):
            return boost * d * v


@njit(cache=True)
def draw_poisson(mean: float, state: UIntArray) -> float:
    """A Poisson draw, as a float: it only enters sums."""
    if mean < 10.0:
        floor, product, count = math.exp(-mean), uniform(state), 0.0
        while product > floor:
            product *= uniform(state)
            count += 1.0
        return count
    root = math.sqrt(mean)
    b = 0.931 + 2.53 * root
    a = -0.059 + 0.02483 * b
    inverse_alpha = 1.1239 + 1.1328 / (b - 3.4)
    v_r = 0.9277 - 3.6224 / (b - 2.0)
    log_mean = math.log(mean)
    while True:
        u = uniform(state) - 0.5
        v = uniform(state)
        us = 0.5 - abs(u)
        k = math.floor((2.0 * a / us + b) * u + mean + 0.43)
        if us >= 0.07 and v <= v_r:
            return k
        if k < 0.0 or (us < 0.013 and v > us):
            continue
        if math.log(v * inverse_alpha / (a / (us * us) + b)) <= k * log_mean - mean - math.lgamma(k + 1.0):
            return k


@njit(cache=True)
def draw_von_mises(mean: float, k: float, state: UIntArray) -> float:
    """A von Mises draw around `mean`, radians, not wrapped."""
    if k < NEGLIGIBLE_CONCENTRATION:
        return mean + math.pi * (2.0 * uniform(state) - 1.0)
    if k > 1e4:  # the wrapped normal is nearer than the draws can tell, and 1 - f^2 below would cancel
        return mean + draw_normal(state) / math.sqrt(k)
    tau = 1.0 + math.sqrt(1.0 + 4.0 * k * k)
    rho = (tau - math.sqrt(2.0 * tau)) / (2.0 * k)
    r = (1.0 + rho * rho) / (2.0 * rho)
    while True:
        z = math.cos(math.pi * uniform(state))
        f = (1.0 + r * z) / (r + z)
        c = k * (r - f)
        u = uniform(state)
        if c * (2.0 - c) > u or math.log(c / u) + 1.0 >= c:
            turn = math.acos(min(max(f, -1.0), 1.0))
            return mean + (turn if uniform(state) > 0.5 else -turn)


@njit(cache=True, inline="always")
def wrap(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    if -math.pi < angle <= math.pi:
        return angle
    turned = math.pi - (math.pi - angle) % TWO_PI
    return turned if turned > -math.pi else math.pi


# Modes ---------------------------------------------------------------------------------------------------------------


@njit(cache=True, nogil=True)
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


@njit(cache=True, inline="always")
def _unwrapped(theta: FloatArray, j: int) -> float:
    n = theta.size
    if j < 0:
        return theta[j + n] - TWO_PI
    if j >= n:
        return theta[j - n] + TWO_PI
    return theta[j]


@njit(cache=True)
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


@njit(cache=True)
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
