"""Compiled fitting of every cell's modes: direction by von Mises (Eq. 1), speed by gamma (Eq. 3)."""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions._elementary import EXACT, TWO_PI, wrap
from dirprim_filter.distributions._estimates import shape_from
from dirprim_filter.primitives._ascent import ascend
from dirprim_filter.primitives._modes import (
    COSINE,
    LOG_CONCENTRATION,
    LOG_MEAN_SPEED,
    LOG_SHAPE,
    LOG_WEIGHT,
    MEAN,
    N_CURVED,
    N_FLAT,
    NO_MODE,
    SINE,
    SPEED,
    WEIGHT,
    Bounds,
)

COMPARED = 0.03
"""A climb of flat modes that gains less than this share of what a parameter costs is over as far as BIC shows."""
FAR = 10.0
"""Of the objective: so far past the best number of modes, more only cost more. A rough fit stops one past the best."""
ON_CIRCLE = 1024
"""Bins in which modes' first places are looked for."""


@njit(nogil=True, **EXACT)
def fit_cells_at_once(
    columns: FloatArray,
    start: IntArray,
    n_vehicles: FloatArray,
    bounds: Bounds,
    first: int,
    last: int,
    out: FloatArray,
) -> None:
    """Direction and speed together, modes by BIC, of the cells from `first` to `last`.

    Args:
        columns: (N_COLUMNS, n) what stands for the rows, sorted by cell.
        start: (n_cells + 1,) cell c has those from start[c] to start[c + 1].
        n_vehicles: (n_cells,) the vehicles they are of.
        bounds: priors and bounds.
        first: the first cell to fit.
        last: the one after the last.
        out: (n_cells, max_modes, N_CURVED) `empty_table`; filled where a cell has rows of any weight.
    """
    for c in range(first, last):
        fit_at_once(columns, start[c], start[c + 1] - start[c], n_vehicles[c], bounds, out[c])


@njit(inline="always", **EXACT)
def fit_at_once(columns: FloatArray, at: int, n: int, n_vehicles: float, bounds: Bounds, out: FloatArray) -> None:
    """Joint EM of direction and speed, flat and curved, with the number of modes that BIC prefers, of n columns.

    Rows of one vehicle repeat each other, so the objective and BIC count vehicles; BIC takes the objective for the
    likelihood: a mode that the prior thinks little of has to gain that as well.
    """
    filled = np.empty((3, ON_CIRCLE))
    used, total, mean_speed = sort_around(columns, at, n, filled)
    trial = np.zeros((bounds.max_modes, N_CURVED))
    best, chosen = -np.inf, 0
    cost = bounds.parameter_cost * 0.5 * math.log(max(n_vehicles, 2.0))
    enough = 0.0 if bounds.curved else COMPARED * cost
    for k in range(1, bounds.max_modes + 1):
        if k > max(n_vehicles, 1.0) or mean_speed == 0.0:
            break
        start_evenly(filled, used, total, mean_speed, bounds, trial[:k])
        highest = -np.inf
        for stage in range(1 + bounds.curved):  # flat, and curved from there on
            penalty = ((N_FLAT + (N_CURVED - N_FLAT) * stage) * k - 1) * cost
            last_stage = stage == bounds.curved  # of flat ones that may yet bend it is never plain
            needed = best + penalty if last_stage and not (bounds.curved and bounds.thorough) else -np.inf
            curved = stage == 1
            found = ascend(columns, at, n, n_vehicles, curved, needed, enough, bounds, trial[:k])
            found -= penalty
            highest = max(highest, found)
            if found > best:
                best, chosen = found, k
                for m in range(bounds.max_modes):
                    for q in range(N_CURVED):
                        out[m, q] = trial[m, q] if m < k else (NO_MODE if q == LOG_WEIGHT else 0.0)
        if k > 1 + bounds.thorough and highest < best - FAR * bounds.thorough:
            break
    if enough > 0.0 and chosen > 0:  # none of them bends
        ascend(columns, at, n, n_vehicles, bounds.curved, -np.inf, 0.0, bounds, out[:chosen])


@njit(**EXACT)
def sort_around(columns: FloatArray, at: int, n: int, filled: FloatArray) -> tuple[int, float, float]:
    """Fill `filled` (3, ON_CIRCLE) with the bins of directions in use, counted from the middle of the widest gap.

    Of each its number, which may be past the last bin, the weight before it, and its own.

    Returns:
        How many there are, the weight of all, and the mean speed; none where no row has any weight.
    """
    weight = np.zeros(ON_CIRCLE)
    total, speed = 0.0, 0.0
    for i in range(at, at + n):
        turn = math.atan2(columns[SINE, i], columns[COSINE, i]) / TWO_PI
        weight[int((turn + 0.5) * ON_CIRCLE) % ON_CIRCLE] += columns[WEIGHT, i]
        total += columns[WEIGHT, i]
        speed += columns[WEIGHT, i] * columns[SPEED, i]
    if total == 0.0:
        return 0, 0.0, 0.0
    last = -1
    cut, widest = 0, 0
    after = 0.0  # of gaps of one width the one before the fullest bin, for that is the same however the data are turned
    for f in range(2 * ON_CIRCLE):  # once around, and on to where it began
        here = weight[f % ON_CIRCLE]
        if here > 0.0:
            gap = f - last - 1
            if widest < gap or (widest == gap > 0 and here > after):
                cut, widest, after = f - 1 - gap // 2, gap, here
            last = f
            if f >= ON_CIRCLE:
                break
    used, below = 0, 0.0
    for f in range(cut, cut + ON_CIRCLE):
        here = weight[f % ON_CIRCLE]
        if here > 0.0:
            filled[0, used], filled[1, used], filled[2, used] = f, below, here
            below += here
            used += 1
    return used, total, speed / total


@njit(**EXACT)
def start_evenly(
    filled: FloatArray, used: int, total: float, mean_speed: float, bounds: Bounds, table: FloatArray
) -> None:
    """Modes at even quantiles of the circle, which `sort_around` has found."""
    k = table.shape[0]
    i = 0
    for m in range(k):
        below = int((m + 0.5) * ON_CIRCLE / k) / ON_CIRCLE * total
        while i < used - 1 and filled[1, i] + filled[2, i] < below * (1.0 - 1e-12):
            i += 1
        inside = min(max((below - filled[1, i]) / filled[2, i], 0.0), 1.0)
        for q in range(N_FLAT, N_CURVED):
            table[m, q] = 0.0
        table[m, LOG_WEIGHT] = -math.log(k)
        table[m, MEAN] = wrap(((filled[0, i] + inside) / ON_CIRCLE - 0.5) * TWO_PI)
        table[m, LOG_CONCENTRATION] = math.log1p(1.0 * k * k)
        table[m, LOG_SHAPE] = math.log(shape_from(bounds.speed_spread, bounds.max_shape))
        table[m, LOG_MEAN_SPEED] = math.log(mean_speed)
