"""Compiled merging of a cell's many rows into few columns that have the same sums.

A column holds the means of the cosines, sines, speeds and log speeds of rows that lie together, and has their weight:
so the maximisation is exact for flat modes, and only the responsibilities are those of the mean. What lies together is
decided by a grid over direction and log speed, and place for modes that bend; half of its lines follow the rows, half
are even.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions._elementary import EXACT, TWO_PI, log
from dirprim_filter.primitives._modes import COSINE, EAST, LOG_SPEED, NORTH, SINE, SPEED, WEIGHT

LOOKED_AT = 2048
"""Rows that decide where the grid's lines lie."""
FINE = 2048
_BLOCK = 256
_RECORD = 8  # weight, three powers of the angle, speed, log speed, east, north


@njit(nogil=True, **EXACT)
def merge(
    direction: FloatArray,
    speed: FloatArray,
    position: FloatArray,
    weight: FloatArray,
    row: IntArray,
    first: int,
    last: int,
    center: FloatArray,
    n_direction: int,
    n_speed: int,
    n_place: int,
    out: FloatArray,
    begin: int,
) -> int:
    """Fill the columns of `out` from `begin` on with what stands for rows row[first] to row[last].

    Args:
        direction: (n,) radians in [-pi, pi].
        speed: (n,) m/s, positive.
        position: (n, 2) metres.
        weight: (n_members,) of the rows in `row`, not negative.
        row: (n_members,) which rows.
        first: of `row`, the first that is meant.
        last: the one after the last.
        center: (2,) metres, of the cell.
        n_direction: bins of direction.
        n_speed: bins of log speed.
        n_place: bins of each axis of the place.
        out: (N_COLUMNS, any).
        begin: where `out` is filled from; there is room for as many columns as there are bins.

    Returns:
        Where the columns end.
    """
    of_direction, of_speed, middle = np.zeros(FINE, np.int64), np.zeros(FINE, np.int64), np.zeros(n_direction)
    edge = np.array([np.inf, -np.inf, np.inf, -np.inf, np.inf, -np.inf])  # of speed, east and north: least and most
    stride = max((last - first) // LOOKED_AT, 1)
    for a in range(first, last, stride):
        i = row[a]
        for q in range(3):
            x = speed[i] if q == 0 else position[i, q - 1]
            edge[2 * q], edge[2 * q + 1] = min(edge[2 * q], x), max(edge[2 * q + 1], x)
    low = math.log(edge[0])
    per_log = FINE / (math.log(edge[1]) - low + 1e-9)
    per_east, per_north = n_place / (edge[3] - edge[2] + 1e-9), n_place / (edge[5] - edge[4] + 1e-9)
    in_direction, in_speed = np.zeros(FINE), np.zeros(FINE)
    for a in range(first, last, stride):
        in_direction[_fine(direction[row[a]])] += weight[a]
        in_speed[min(max(int((math.log(speed[row[a]]) - low) * per_log), 0), FINE - 1)] += weight[a]
    _share_out(in_direction, n_direction, of_direction)
    _share_out(in_speed, n_speed, of_speed)
    begins = 0
    for f in range(1, FINE + 1):
        if f == FINE or of_direction[f] != of_direction[begins]:
            middle[of_direction[begins]] = 0.5 * (begins + f) * (TWO_PI / FINE) - math.pi
            begins = f
    record = np.zeros((n_direction * n_speed * n_place * n_place, _RECORD))
    v, log_v, off, bin_of = np.zeros(_BLOCK), np.zeros(_BLOCK), np.zeros(_BLOCK), np.zeros(_BLOCK, np.int64)
    fine_theta, fine_v = np.zeros(_BLOCK, np.int32), np.zeros(_BLOCK, np.int32)
    for b in range(first, last, _BLOCK):
        n = min(_BLOCK, last - b)
        for j in range(n):
            i = row[b + j]
            off[j], v[j] = direction[i], speed[i]
        for j in range(n):
            log_v[j] = log(v[j])
        for j in range(n):  # to 32 bits: there are vector instructions for that
            fine_theta[j] = np.int32((off[j] + math.pi) * (FINE / TWO_PI))
        for j in range(n):
            fine = (log_v[j] - low) * per_log
            fine = fine if fine > 0.0 else 0.0
            fine_v[j] = np.int32(fine if fine < FINE - 1.0 else FINE - 1.0)
        for j in range(n):
            of_theta = of_direction[fine_theta[j] & (FINE - 1)]
            off[j] -= middle[of_theta]
            bin_of[j] = of_theta * n_speed + of_speed[fine_v[j]]
        if n_place > 1:
            for j in range(n):
                east, north = position[row[b + j], 0], position[row[b + j], 1]
                x = min(max(int((east - edge[2]) * per_east), 0), n_place - 1)
                y = min(max(int((north - edge[4]) * per_north), 0), n_place - 1)
                bin_of[j] = (bin_of[j] * n_place + x) * n_place + y
                record[bin_of[j], 6] += weight[b + j] * (east - center[0])
                record[bin_of[j], 7] += weight[b + j] * (north - center[1])
        for j in range(n):
            w, d, into = weight[b + j], off[j], record[bin_of[j]]
            # Powers of the angle off the bin's middle instead of cosine and sine: narrow, it leaves 1e-6 of the fourth.
            into[0] += w
            into[1] += w * d
            into[2] += w * d * d
            into[3] += w * d * d * d
            into[4] += w * v[j]
            into[5] += w * log_v[j]
    per_direction = n_speed * n_place * n_place
    for j in range(record.shape[0]):
        w = record[j, 0]
        if w > 0.0:
            cosine, sine = math.cos(middle[j // per_direction]), math.sin(middle[j // per_direction])
            along, across = 1.0 - record[j, 2] / w / 2.0, (record[j, 1] - record[j, 3] / 6.0) / w
            out[COSINE, begin] = cosine * along - sine * across
            out[SINE, begin] = sine * along + cosine * across
            out[SPEED, begin] = record[j, 4] / w
            out[LOG_SPEED, begin] = record[j, 5] / w
            out[WEIGHT, begin] = w
            out[EAST, begin] = record[j, 6] / w
            out[NORTH, begin] = record[j, 7] / w
            begin += 1
    return begin


@njit(**EXACT)
def _fine(theta: float) -> int:
    return int((theta + math.pi) * (FINE / TWO_PI)) & (FINE - 1)


@njit(**EXACT)
def _share_out(weight: FloatArray, n_bins: int, out: IntArray) -> None:
    """Fine bins to bins: half of these by weight, so that they are fine where rows are dense, half by width."""
    total = 1e-300
    for f in range(weight.size):
        total += weight[f]
    below = 0.0
    for f in range(weight.size):
        share = 0.5 * (below + 0.5 * weight[f]) / total + 0.5 * f / weight.size
        out[f] = min(int(share * n_bins), n_bins - 1)
        below += weight[f]
