"""Compiled fitting of every cell's modes: direction by von Mises (Eq. 1), speed by gamma (Eq. 3), their number by BIC.

EM is accelerated by Anderson (1965) mixing of the last steps, as Henderson and Varadhan (2019) use it; a point that
lies lower than the one before is given up for EM's own, so the objective never falls.
"""

import math

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.distributions._elementary import TWO_PI, wrap
from dirprim_filter.distributions._estimates import concentration_from, shape_from
from dirprim_filter.primitives._em import (
    BLOCK,
    CURVED_SUMS,
    REST,
    SUMS,
    bend,
    expectation,
    log_prior,
    maximisation,
    usual_log_density,
)
from dirprim_filter.primitives._modes import (
    COSINE,
    LOG_CONCENTRATION,
    LOG_MEAN_SPEED,
    LOG_SHAPE,
    LOG_WEIGHT,
    MEAN,
    N_CURVED,
    N_FLAT,
    N_OF_ROW,
    NO_MODE,
    SINE,
    SPEED,
    WEIGHT,
    Bounds,
)
from tessellation._compiling import compiled

COMPARED = 0.03
"""A climb of flat modes that gains less than this share of what a parameter costs is over as far as BIC shows."""
FAR = 10.0
"""Of the objective: so far past the best number of modes, more only cost more. A rough fit stops one past the best."""
ON_CIRCLE = 1024
"""Bins in which modes' first places are looked for."""
DEPTH = 4  # steps that are mixed
PATIENCE = 5  # iterations before modes may be given up as hopeless
HORIZON = 30.0  # they are if so many gains like the last would not do
MAX_HALVINGS = 12


@compiled
def fit_cells_at_once(
    columns: FloatArray, start: IntArray, n_vehicles: FloatArray, bounds: Bounds, first: int, last: int, out: FloatArray
) -> None:
    """Joint EM of direction and speed, flat and curved, with the number of modes that BIC prefers, of some cells.

    Rows of one vehicle repeat each other, so the objective and BIC count vehicles; BIC takes the objective for the
    likelihood: a mode that the prior thinks little of has to gain that as well. `columns` and `start` are those of
    `rows.CellRows`, `out` an `empty_table`.
    """
    for c in range(first, last):
        at, n, vehicles = start[c], start[c + 1] - start[c], n_vehicles[c]
        filled, trial = np.empty((3, ON_CIRCLE)), np.empty((bounds.max_modes, N_CURVED))
        used, total, mean_speed = sort_around(columns, at, n, filled)
        best, chosen = -np.inf, 0
        cost = bounds.parameter_cost * 0.5 * math.log(max(vehicles, 2.0))
        enough = 0.0 if bounds.curved else COMPARED * cost
        for k in range(1, bounds.max_modes + 1):
            if k > max(vehicles, 1.0) or mean_speed == 0.0:
                break
            start_evenly(filled, used, total, mean_speed, bounds, trial[:k])
            highest = -np.inf
            for stage in range(1 + bounds.curved):  # flat, and curved from there on
                penalty = ((N_FLAT + (N_CURVED - N_FLAT) * stage) * k - 1) * cost
                last_stage = stage == bounds.curved  # of flat ones that may yet bend it is never plain
                needed = best + penalty if last_stage and not (bounds.curved and bounds.thorough) else -np.inf
                curved = stage == 1
                found = ascend(columns, at, n, vehicles, curved, needed, enough, bounds, trial[:k])
                found -= penalty
                highest = max(highest, found)
                if found > best:
                    best, chosen = found, k
                    for m in range(bounds.max_modes):
                        for q in range(N_CURVED):
                            out[c, m, q] = trial[m, q] if m < k else (NO_MODE if q == LOG_WEIGHT else 0.0)
            if k > 1 + bounds.thorough and highest < best - FAR * bounds.thorough:
                break
        if enough > 0.0 and chosen > 0:  # none of them bends
            ascend(columns, at, n, vehicles, bounds.curved, -np.inf, 0.0, bounds, out[c, :chosen])


@compiled
def sort_around(columns: FloatArray, at: int, n: int, filled: FloatArray) -> tuple[int, float, float]:
    """Fill `filled` (3, ON_CIRCLE) with the bins of directions in use, counted from the middle of the widest gap.

    Of each its number, which may be past the last bin, the weight before it, and its own.

    Returns:
        How many there are, the weight of all, and the mean speed; none where no row has any weight.
    """
    weight = np.empty(ON_CIRCLE)
    weight[:] = 0.0  # `zeros` would compile three functions of numba
    total, speed = 0.0, 0.0
    for i in range(at, at + n):
        turn = math.atan2(columns[SINE, i], columns[COSINE, i]) / TWO_PI
        weight[np.int64((turn + 0.5) * ON_CIRCLE) % ON_CIRCLE] += columns[WEIGHT, i]
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


@compiled
def start_evenly(
    filled: FloatArray, used: int, total: float, mean_speed: float, bounds: Bounds, table: FloatArray
) -> None:
    """Modes at even quantiles of the circle, which `sort_around` has found."""
    k = table.shape[0]
    i = 0
    for m in range(k):
        below = np.int64((m + 0.5) * ON_CIRCLE / k) / ON_CIRCLE * total
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


@compiled
def ascend(
    columns: FloatArray,
    at: int,
    n: int,
    n_vehicles: float,
    curved: bool,
    needed: float,
    enough: float,
    bounds: Bounds,
    table: FloatArray,
) -> float:
    """Climb from the modes given, in place, until an iteration gains less than `enough`.

    Returns the objective, or one less than `needed` as soon as it is plain that `needed` is out of reach.
    """
    k, width = table.shape[0], N_CURVED if curved else N_FLAT
    total = 0.0
    for i in range(at, at + n):
        total += columns[WEIGHT, i]
    sums = np.empty((k, CURVED_SUMS if curved else SUMS))
    shape, concentration = shape_from(bounds.speed_spread, bounds.max_shape), concentration_from(bounds.usual_resultant)
    usual = usual_log_density(math.log1p(concentration), math.log(shape), bounds)
    room = np.empty((REST + k * (1 + N_OF_ROW), BLOCK))  # of `expectation`, kept from one iteration to the next
    history = np.empty((2 * DEPTH + 4, k, width))  # how places changed, how steps did, then what they were last
    history[:] = 0.0
    here, step = 2 * DEPTH, 2 * DEPTH + 1
    was, would = step + 1, step + 2
    mixed, halvings, driven = -1, 0, k  # mixed: changes that are known; -1 before the first step
    best, last_gained = -np.inf, 0.0
    most = bounds.max_iterations
    for iteration in range(most):
        objective = expectation(columns, at, n, bounds.with_speed, table, room, sums) / total * n_vehicles
        if bounds.with_speed:
            objective += log_prior(bounds, usual, table)
        gained = objective - best
        if gained >= -1e-12 * abs(objective):
            best, halvings = objective, 0
            slows = gained < last_gained  # on a saddle gains grow
            if iteration + 1 == most or gained < bounds.tolerance * n_vehicles or (gained < enough and slows):
                return best
            if iteration >= PATIENCE and best + HORIZON * gained < needed:
                return best + HORIZON * gained
            last_gained = gained
            for m in range(k):
                for q in range(width):
                    history[was, m, q], history[would, m, q] = history[here, m, q], history[step, m, q]
                    history[here, m, q] = table[m, q]
            still = maximisation(sums, n_vehicles, bounds, table)
            if curved:
                bend(sums, n_vehicles / total, bounds, table)
            if still < driven:  # a mode takes its prior with it: another objective
                driven, best, mixed = still, -np.inf, -2
            slot = max(mixed, 0) % DEPTH
            for m in range(k):
                for q in range(width):
                    moved, to = history[here, m, q] - history[was, m, q], table[m, q] - history[here, m, q]
                    if q == MEAN:  # the short way round
                        moved, to = wrap(moved), wrap(to)
                    history[step, m, q] = to
                    history[slot, m, q], history[DEPTH + slot, m, q] = moved, to - history[would, m, q]
                    table[m, q] = history[here, m, q] + to
            mixed += 1
            if mixed > 0:
                _mix(history, min(mixed, DEPTH), bounds, table)
        else:  # too far: back to EM's point or, where a slope of that was too steep, towards where it came from
            halvings += mixed <= 0
            mixed = -1
            share = 0.5**halvings if halvings <= MAX_HALVINGS and iteration + 1 < most else 0.0
            for m in range(k):
                for q in range(width):
                    table[m, q] = history[here, m, q] + share * history[step, m, q]
            if share == 0.0:
                return best
    return best


@compiled
def _mix(history: FloatArray, n: int, bounds: Bounds, table: FloatArray) -> None:
    """Move from EM's point to that where the last n steps, each linear in its place, would shrink most."""
    a, share = np.empty((n, n)), np.empty(n)
    a[:], share[:] = 0.0, 0.0
    reach = 0.5 / bounds.bend_scale  # metres by which a slope is weighed against the mean: half a cell
    k, width = history.shape[1], history.shape[2]
    for m in range(k):
        weight = math.exp(table[m, LOG_WEIGHT])
        of_mean = weight * math.exp(table[m, LOG_CONCENTRATION])
        of_speed = weight * math.exp(table[m, LOG_SHAPE])
        for q in range(width):  # about the information on each number, which makes all comparable
            unit = weight if q == LOG_WEIGHT else 0.5 * weight
            if q == MEAN:
                unit = of_mean
            elif q == LOG_MEAN_SPEED:
                unit = of_speed
            elif q >= N_FLAT:
                unit = (of_mean if q < N_FLAT + 2 else of_speed) * reach * reach
            for i in range(n):
                turned = history[DEPTH + i, m, q] * unit
                share[i] += turned * history[2 * DEPTH + 1, m, q]
                for j in range(i + 1):
                    a[i, j] += turned * history[DEPTH + j, m, q]
    for i in range(n):  # Cholesky, with a ridge for steps that repeat each other
        a[i, i] = a[i, i] * (1.0 + 1e-8) + 1e-300
        for j in range(i + 1):
            for q in range(j):
                a[i, j] -= a[i, q] * a[j, q]
            a[i, j] = math.sqrt(max(a[i, i], 1e-300)) if i == j else a[i, j] / a[j, j]
        for j in range(i):
            share[i] -= a[i, j] * share[j]
        share[i] /= a[i, i]
    norm = 0.0
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            share[i] -= a[j, i] * share[j]
        share[i] /= a[i, i]
        for m in range(k):
            for q in range(width):
                table[m, q] -= share[i] * (history[i, m, q] + history[DEPTH + i, m, q])
    for m in range(k):
        table[m, MEAN] = wrap(table[m, MEAN])
        table[m, LOG_CONCENTRATION] = min(max(table[m, LOG_CONCENTRATION], 0.0), math.log1p(bounds.max_concentration))
        table[m, LOG_SHAPE] = min(max(table[m, LOG_SHAPE], 0.0), math.log(bounds.max_shape))
        norm += math.exp(min(table[m, LOG_WEIGHT], 300.0))
    for m in range(k):
        if table[m, LOG_WEIGHT] > NO_MODE / 2:
            table[m, LOG_WEIGHT] -= math.log(norm)
