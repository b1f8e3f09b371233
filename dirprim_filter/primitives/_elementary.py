"""Elementary functions without branches or calls, so that loops over them compile to vector instructions.

numba calls the C library for exp and its like, one number at a time; these take a fifth of that in a loop. Errors are
a few units in the last place, which the tests hold against numpy. Ranges: |x| <= 700 for `exp_of` (below, the value at
-700), normal positive numbers for `log_of`, |x| < 1e6 for `cos_of` and `sin_of`.
"""

import math
from typing import Any

import numpy as np
from numba import njit

# Additions must stay in order here: rounding by a large constant depends on it. Division by zero gives infinity.
EXACT: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": {"contract"}}
SUMMING: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz"}}
"""For loops that sum: the compiler may add in any order, always the same one."""

_ROUND = 1.5 * 2.0**52  # added and taken away again, it leaves the nearest integer
_LOG2_E, _LN2, _TWO_PI = math.log2(math.e), math.log(2.0), 2.0 * math.pi
_SQRT_HALF = np.uint64(np.float64(math.sqrt(0.5)).view(np.uint64))
_SHIFT = np.uint64(np.float64(1.0).view(np.uint64)) - _SQRT_HALF
_MANTISSA, _52 = np.uint64(2**52 - 1), np.uint64(52)
_TWO_52 = np.uint64(np.float64(2.0**52).view(np.uint64))


@njit(**EXACT)
def exp_of(x: float) -> float:
    """The exponential, 2^k e^r, |r| <= log(2) / 2, by Taylor's polynomial of degree 11."""
    x = x if x > -700.0 else -700.0
    k = x * _LOG2_E + _ROUND
    r = x - (k - _ROUND) * _LN2
    p = 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    return np.int64(np.float64(p).view(np.int64) + (np.float64(k).view(np.int64) << 52)).view(np.float64)


@njit(**EXACT)
def log_of(x: float) -> float:
    """Natural logarithm: of x = 2^e m, m in [sqrt(1/2), sqrt(2)), by the series of the inverse hyperbolic tangent."""
    shifted = np.float64(x).view(np.uint64) + _SHIFT
    e = np.uint64((shifted >> _52) | _TWO_52).view(np.float64) - (2.0**52 + 1023.0)
    m = np.uint64((shifted & _MANTISSA) + _SQRT_HALF).view(np.float64)
    z = (m - 1.0) / (m + 1.0)
    q = z * z
    p = 2.0 / 17.0
    p = p * q + 2.0 / 15.0
    p = p * q + 2.0 / 13.0
    p = p * q + 2.0 / 11.0
    p = p * q + 2.0 / 9.0
    p = p * q + 2.0 / 7.0
    p = p * q + 2.0 / 5.0
    p = p * q + 2.0 / 3.0
    p = p * q + 2.0
    return p * z + e * _LN2


@njit(**EXACT)
def _sin_of_quarter(y: float) -> float:
    q = y * y
    p = 1.0 / 6227020800.0
    p = p * q - 1.0 / 39916800.0
    p = p * q + 1.0 / 362880.0
    p = p * q - 1.0 / 5040.0
    p = p * q + 1.0 / 120.0
    p = p * q - 1.0 / 6.0
    return y + y * (p * q)


@njit(**EXACT)
def _cos_of_quarter(y: float) -> float:
    q = y * y
    p = -1.0 / 87178291200.0
    p = p * q + 1.0 / 479001600.0
    p = p * q - 1.0 / 3628800.0
    p = p * q + 1.0 / 40320.0
    p = p * q - 1.0 / 720.0
    p = p * q + 1.0 / 24.0
    p = p * q - 0.5
    return 1.0 + p * q


@njit(**EXACT)
def sin_of(x: float) -> float:
    """Sine: of a quarter of the angle, at most pi / 4, and doubled twice."""
    k = x / _TWO_PI + _ROUND
    y = 0.25 * (x - (k - _ROUND) * _TWO_PI)
    s, c = _sin_of_quarter(y), _cos_of_quarter(y)
    return 4.0 * (s * c) * (1.0 - 2.0 * s * s)


@njit(**EXACT)
def cos_of(x: float) -> float:
    """Cosine, likewise."""
    k = x / _TWO_PI + _ROUND
    y = 0.25 * (x - (k - _ROUND) * _TWO_PI)
    s, c = _sin_of_quarter(y), _cos_of_quarter(y)
    s2 = 2.0 * s * c
    return 1.0 - 2.0 * s2 * s2
