"""Exponential and sine as plain arithmetic, so that loops over an array of them are compiled to vector instructions.

A call into the mathematical library keeps the compiler from doing several rows at once, and a density costs little
else. Reduction as Cody and Waite (1980), then Taylor's series to the last bit: errors are a few units in the last place.
"""

import math

import numpy as np
from numba import njit

_ROUND = 1.5 * 2.0**52  # adding it rounds to an integer, which then stands in the low bits of the sum
_LOG2_E = 1.0 / math.log(2.0)
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # n * high is exact to n = 2^20
_PI_HIGH, _PI_LOW = 3.14159265346825122833e00, 1.21542010130123844986e-10
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12, _E13 = (1.0 / math.factorial(n) for n in range(2, 14))
_S3, _S5, _S7, _S9, _S11, _S13, _S15, _S17, _S19, _S21 = (
    (-1.0) ** (n // 2) / math.factorial(n) for n in range(3, 22, 2)
)


@njit(fastmath={"contract"}, inline="always")
def exp(x: float) -> float:
    """The exponential; below -708, where it leaves the normal numbers, that of -708: 3e-308."""
    x = min(max(x, -708.0), 709.0)
    rounded = x * _LOG2_E + _ROUND
    n = rounded - _ROUND
    r = (x - n * _LN2_HIGH) - n * _LN2_LOW
    p = (((((_E13 * r + _E12) * r + _E11) * r + _E10) * r + _E9) * r + _E8) * r + _E7
    p = ((((((p * r + _E6) * r + _E5) * r + _E4) * r + _E3) * r + _E2) * r + 1.0) * r + 1.0
    times_2_to_n = np.int64(np.float64(p).view(np.int64) + (np.float64(rounded).view(np.int64) << 52))
    return times_2_to_n.view(np.float64)


@njit(fastmath={"contract"}, inline="always")
def squared_sine(x: float) -> float:
    """sin(x)^2, for |x| up to a million: by the distance to the nearest multiple of pi."""
    n = (x * (1.0 / math.pi) + _ROUND) - _ROUND
    y = (x - n * _PI_HIGH) - n * _PI_LOW
    t = y * y
    p = ((((_S21 * t + _S19) * t + _S17) * t + _S15) * t + _S13) * t + _S11
    p = (((p * t + _S9) * t + _S7) * t + _S5) * t + _S3
    s = y + y * t * p
    return s * s
