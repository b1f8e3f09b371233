"""Expectation-maximisation, accelerated: the objective of a cell's modes climbed until it gains no more.

Source: Anderson (1965) mixing of the last steps, as Henderson and Varadhan (2019) use it for EM; a point that lies
lower than the one before is given up for EM's own, so the objective never falls.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions._elementary import EXACT, wrap
from dirprim_filter.primitives._expectation import CURVED_SUMS, SUMS, expectation, room_for
from dirprim_filter.primitives._maximisation import bend, log_prior, maximisation, usual_log_density
from dirprim_filter.primitives._modes import (
    LOG_CONCENTRATION,
    LOG_MEAN_SPEED,
    LOG_SHAPE,
    LOG_WEIGHT,
    MEAN,
    N_CURVED,
    N_FLAT,
    NO_MODE,
    WEIGHT,
    Bounds,
)

DEPTH = 4  # steps that are mixed
PATIENCE = 5  # iterations before modes may be given up as hopeless
HORIZON = 30.0  # they are if so many gains like the last would not do
MAX_HALVINGS = 12


@njit(nogil=True, **EXACT)
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
    sums, room, usual = np.zeros((k, CURVED_SUMS if curved else SUMS)), room_for(k), usual_log_density(bounds)
    history = np.zeros((2 * DEPTH + 4, k, width))  # how places changed, how steps did, then what they were last
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


@njit(**EXACT)
def _mix(history: FloatArray, n: int, bounds: Bounds, table: FloatArray) -> None:
    """Move from EM's point to that where the last n steps, each linear in its place, would shrink most."""
    a, share = np.zeros((n, n)), np.zeros(n)
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
