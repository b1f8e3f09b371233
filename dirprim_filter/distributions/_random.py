"""Compiled random numbers: the generator and the samplers, for the loops of sampling and filtering.

Random numbers come from xoshiro256++ (Blackman and Vigna, 2019), whose state is a row of four uint64: one row for each
vehicle or block of rows, so that its draws depend on nothing but its own seed.

Where many draws are wanted at once they are those of splitmix64 from one drawn key (Steele, Lea and Flood 2014): no
draw waits for the one before it, so that several are made at a time; normals then by Box and Muller (1958).

The von Mises sampler is that of Best and Fisher (1979), the gamma sampler that of Marsaglia and Tsang (2000).
"""

import math

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions._elementary import TWO_PI, log, sin
from tessellation._compiling import compiled, inlined, pasted

UIntArray = npt.NDArray[np.uint64]

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_R27, _R30, _R31 = np.uint64(27), np.uint64(30), np.uint64(31)
_R11, _R17, _R19, _R23, _R41, _R45 = (np.uint64(n) for n in (11, 17, 19, 23, 41, 45))
_TO_UNIT = 2.0**-53
_SQUEEZE = 0.0331  # of Marsaglia and Tsang: accepts all but a few in a hundred without a logarithm


@compiled
def seed_state(key: np.uint64, state: UIntArray) -> None:
    """Fill a state row from a 64-bit key by splitmix64, as the generator's authors advise."""
    z = key
    for i in range(4):
        z = z + _GOLDEN
        state[i] = mixed(z)


@pasted
def mixed(z: np.uint64) -> np.uint64:
    """The output of splitmix64 in state `z`."""
    m = np.uint64((z ^ (z >> _R30)) * _MIX_1)
    m = np.uint64((m ^ (m >> _R27)) * _MIX_2)
    return np.uint64(m ^ (m >> _R31))


@inlined
def bits(state: UIntArray) -> np.uint64:
    """64 random bits."""
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
    return result


@pasted
def uniform(state: UIntArray) -> float:
    """A draw from the open interval (0, 1)."""
    return (float(bits(state) >> _R11) + 0.5) * _TO_UNIT


@compiled
def draw_normal(state: UIntArray) -> float:
    """A standard normal draw, by Box and Muller."""
    return math.sqrt(-2.0 * math.log(uniform(state))) * math.cos(TWO_PI * uniform(state))


_R12, _R63 = np.uint64(12), np.uint64(63)
_BITS_OF_ONE = np.uint64(0x3FF0000000000000)


@pasted
def from_one_to_two(drawn: np.uint64) -> float:
    """The upper 52 of 64 random bits as an even draw from [1, 2)."""
    return np.uint64((drawn >> _R12) | _BITS_OF_ONE).view(np.float64)


@compiled
def fill_normals(out: FloatArray, state: UIntArray) -> None:
    """Standard normal draws, (n,) of an even n: an even point of the right half circle, then which half it is."""
    half, z = out.size // 2, bits(state)
    for i in range(half):
        z = np.uint64(z + _GOLDEN)
        first = mixed(z)
        z = np.uint64(z + _GOLDEN)
        second = mixed(z)
        radius = math.sqrt(-2.0 * log(2.0 - from_one_to_two(first)))
        radius = np.uint64(np.float64(radius).view(np.uint64) ^ np.uint64(second << _R63)).view(np.float64)
        s = sin(math.pi * (from_one_to_two(second) - 1.5))
        out[i] = radius * s
        out[half + i] = radius * math.sqrt(max(1.0 - s * s, 0.0))


@compiled
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
        if u < 1.0 - _SQUEEZE * x * x * x * x or math.log(u) < 0.5 * x * x + d * (1.0 - v + math.log(v)):
            return boost * d * v


def wrapped_cauchy(k: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The envelope of Best and Fisher (1979) for concentration `k`: see `draw_turn`.

    Theirs is rho = (tau - sqrt(2 tau)) / (2 k), tau = 1 + sqrt(1 + 4 k^2), and r = (1 + rho^2) / (2 rho), which cancel
    where k is small and where it is large. Their proposal is tan(turn / 2) = q tan(phi / 2) with phi even on the circle
    and q = (1 - rho) / (1 + rho), their test takes c = k (r - cos(turn)) = b + k (1 - cos(turn)): in q and in
    b = k (1 - rho)^2 / (2 rho), rationalised, nothing cancels, from k = 0 (always accepted) to the largest.
    """
    root = np.hypot(1.0, 2.0 * k)  # whose square may overflow: the loop of `draw_turn` would never end
    wide = np.sqrt(2.0 + 2.0 * root)
    near = 1.0 + 1.0 / (root + 2.0 * k) + wide
    return near / (1.0 + root + wide + 2.0 * k), near * near / (4.0 * (1.0 + root + wide))


@compiled
def draw_turn(k: float, q: float, b: float, state: UIntArray) -> float:
    """A von Mises draw around 0 of concentration `k` and envelope `q, b`, radians in [-pi, pi].

    The tangent of half an even angle is the slope to an even point of the unit disc: no cosine is needed.
    """
    while True:
        x = 2.0 * uniform(state) - 1.0
        y = 2.0 * uniform(state) - 1.0
        xx, yy = x * x, y * y
        if xx + yy > 1.0:
            continue
        yy *= q * q
        c = b + 2.0 * k * yy / (xx + yy)
        u = uniform(state)
        if c * (2.0 - c) > u or math.log(c / u) + 1.0 >= c:
            return 2.0 * math.atan2(q * y, abs(x))
