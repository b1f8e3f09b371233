"""Exponential, logarithm and sine as plain arithmetic: loops over arrays of them are compiled to vector instructions.

A call into the mathematical library keeps the compiler from doing several rows at once, and a density costs little
else. Reduction as Cody and Waite (1980), then the series to the last bit: errors are a few units in the last place.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from tessellation._compiling import COMPILED

EXACT: dict[str, Any] = COMPILED | {"error_model": "numpy", "fastmath": {"contract"}}
"""Additions stay in order: rounding by a large constant depends on it. Division by zero gives infinity."""
SUMMING: dict[str, Any] = EXACT | {"fastmath": {"contract", "reassoc", "nsz"}}
"""For loops that sum: the compiler may add in any order, always the same one. What they call stays exact."""

_ROUND = 1.5 * 2.0**52  # adding it rounds to an integer, which then stands in the low bits of the sum
_LOG2_E = 1.0 / math.log(2.0)
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # n * high is exact to n = 2^20
_PI_HIGH, _PI_LOW = 3.14159265346825122833e00, 1.21542010130123844986e-10
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12, _E13 = (1.0 / math.factorial(n) for n in range(2, 14))
_S3, _S5, _S7, _S9, _S11, _S13, _S15, _S17, _S19, _S21 = (
    (-1.0) ** (n // 2) / math.factorial(n) for n in range(3, 22, 2)
)
_L3, _L5, _L7, _L9, _L11, _L13, _L15, _L17, _L19, _L21 = (2.0 / n for n in range(3, 22, 2))
_MANTISSA, _SHIFT = np.uint64(0x000FFFFFFFFFFFFF), np.uint64(52)
_SQRT_HALF = np.uint64(0x3FE6A09E667F3BCD)  # the bits of sqrt(1/2)
_ONE_ABOVE = np.uint64(0x3FF0000000000000 - 0x3FE6A09E667F3BCD)  # from there to the bits of 1
_TO_SIGN = np.uint64(63)
_EXPONENT_ONLY, _EXPONENT_OF_ONE = np.uint64(0x4330000000000000), 2.0**52 + 1023.0

# The same in single precision, in which twice as many are done at a time.
single: Any = np.float32
"""A number in single precision, which Python's types do not distinguish from others."""
_ROUND_S, _LOG2_E_S, _ONE_S = single(1.5 * 2.0**23), single(_LOG2_E), single(1.0)
_LN2_HIGH_S, _LN2_LOW_S = single(0.693359375), single(-2.12194440e-4)
_PI_HIGH_S, _PI_LOW_S, _PER_PI_S = single(3.140625), single(math.pi - 3.140625), single(1.0 / math.pi)
_E2_S, _E3_S, _E4_S, _E5_S, _E6_S, _E7_S = (single(1.0 / math.factorial(n)) for n in range(2, 8))
_S3_S, _S5_S, _S7_S, _S9_S, _S11_S = (single((-1.0) ** (n // 2) / math.factorial(n)) for n in range(3, 12, 2))
_LEAST_S, _MOST_S = single(-87.0), single(88.0)
_TO_EXPONENT_S = np.int32(23)


@njit(**EXACT)
def exp(x: float) -> float:
    """The exponential; below -650 that of -650, 5e-283: products of it stay clear of the slow subnormal numbers."""
    x = min(max(x, -650.0), 709.0)
    rounded = x * _LOG2_E + _ROUND
    n = rounded - _ROUND
    r = (x - n * _LN2_HIGH) - n * _LN2_LOW
    p = (((((_E13 * r + _E12) * r + _E11) * r + _E10) * r + _E9) * r + _E8) * r + _E7
    p = ((((((p * r + _E6) * r + _E5) * r + _E4) * r + _E3) * r + _E2) * r + 1.0) * r + 1.0
    times_2_to_n = np.int64(np.float64(p).view(np.int64) + (np.float64(rounded).view(np.int64) << 52))
    return times_2_to_n.view(np.float64)


@njit(**EXACT)
def sin(x: float) -> float:
    """The sine, for |x| up to a million: of the distance to the nearest multiple of pi, negated by the odd ones."""
    rounded = x * (1.0 / math.pi) + _ROUND
    n = rounded - _ROUND
    y = (x - n * _PI_HIGH) - n * _PI_LOW
    t = y * y
    p = ((((_S21 * t + _S19) * t + _S17) * t + _S15) * t + _S13) * t + _S11
    p = (((p * t + _S9) * t + _S7) * t + _S5) * t + _S3
    s = y + y * t * p
    sign = np.float64(rounded).view(np.uint64) << _TO_SIGN
    return np.uint64(np.float64(s).view(np.uint64) ^ sign).view(np.float64)


@njit(**EXACT)
def cos(x: float) -> float:
    """The cosine, likewise: 1 - 2 sin(x / 2)^2."""
    return 1.0 - 2.0 * squared_sine(0.5 * x)


@njit(**EXACT)
def squared_sine(x: float) -> float:
    """sin(x)^2, for |x| up to a million: by the distance to the nearest multiple of pi."""
    n = (x * (1.0 / math.pi) + _ROUND) - _ROUND
    y = (x - n * _PI_HIGH) - n * _PI_LOW
    t = y * y
    p = ((((_S21 * t + _S19) * t + _S17) * t + _S15) * t + _S13) * t + _S11
    p = (((p * t + _S9) * t + _S7) * t + _S5) * t + _S3
    s = y + y * t * p
    return s * s


@njit(**EXACT)
def log(x: float) -> float:
    """The natural logarithm of a normal positive number: x = 2^n m, m from sqrt(1/2) to sqrt(2); anything of others."""
    bits = np.uint64(np.float64(x).view(np.uint64) + _ONE_ABOVE)
    exponent = np.uint64((bits >> _SHIFT) | _EXPONENT_ONLY)
    n = exponent.view(np.float64) - _EXPONENT_OF_ONE
    mantissa = np.uint64((bits & _MANTISSA) + _SQRT_HALF)
    f = mantissa.view(np.float64) - 1.0
    s = f / (2.0 + f)
    t = s * s
    p = ((((_L21 * t + _L19) * t + _L17) * t + _L15) * t + _L13) * t + _L11
    p = (((p * t + _L9) * t + _L7) * t + _L5) * t + _L3
    return n * _LN2_HIGH + (2.0 * s + (s * t * p + n * _LN2_LOW))


@njit(**EXACT)
def exp_single(x: float) -> float:
    """The exponential in single precision, from -87 to 88; beyond, that of the nearer."""
    x = min(max(x, _LEAST_S), _MOST_S)
    rounded = x * _LOG2_E_S + _ROUND_S
    n = rounded - _ROUND_S
    r = (x - n * _LN2_HIGH_S) - n * _LN2_LOW_S
    p = ((((((_E7_S * r + _E6_S) * r + _E5_S) * r + _E4_S) * r + _E3_S) * r + _E2_S) * r + _ONE_S) * r + _ONE_S
    times_2_to_n = np.int32(np.float32(p).view(np.int32) + (np.float32(rounded).view(np.int32) << _TO_EXPONENT_S))
    exponential: float = times_2_to_n.view(single)
    return exponential


@njit(**EXACT)
def squared_sine_single(x: float) -> float:
    """sin(x)^2 in single precision, for |x| up to a hundred."""
    n = nearest_integer_single(x * _PER_PI_S)
    y = (x - n * _PI_HIGH_S) - n * _PI_LOW_S
    t = y * y
    s = y + y * t * ((((_S11_S * t + _S9_S) * t + _S7_S) * t + _S5_S) * t + _S3_S)
    return s * s


@njit(**EXACT)
def nearest_integer_single(x: float) -> float:
    """The integer nearest to x in single precision, for |x| up to a million."""
    return (x + _ROUND_S) - _ROUND_S
