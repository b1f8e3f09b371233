"""Compiled resampling of particles that carry the correlated part of a sensor's error.

Where errors last, detections show where a vehicle and its error are together, and hardly either alone. So what tells
the particles apart in that direction is lost to resampling and never comes back: a belief of a thousand particles would
soon be sure of one error that is wrong. Copies are spread in that direction, which leaves all detections as likely.

Source: Liu and West, Combined parameter and state estimation in simulation-based filtering, 2001, for the kernel.
"""

import math

import numpy as np
from numba import njit

from dirprim_filter.arrays import IntArray
from dirprim_filter.distributions import _random as random
from dirprim_filter.filtering._kernels import (
    KERNEL_SHARE,
    Cloud,
    effective_sample_size,
    resample_vehicle,
    room_to_resample,
)
from dirprim_filter.filtering._sensing import Axes, Carried, correlated_share

FEW = 0.1
"""Share of the particles: where effectively fewer are left, as of a vehicle found again after a gap, errors are drawn
anew."""


@njit(cache=True, nogil=True)
def resample(cloud: Cloud, carried: Carried, vehicle: IntArray, axes: Axes, below: float) -> None:
    """`_kernels.resample`, with the error that each survivor carries.

    Of the way by which a copy is put beside its survivor, its error makes up for the correlated share: as at birth.
    """
    n = cloud.position.shape[1]
    room, place = room_to_resample(n), np.empty((n, 2))
    parent, share, share_across = room.parent, correlated_share(axes, 0), correlated_share(axes, 1)
    for v in vehicle:
        effective = effective_sample_size(cloud.weight[v])
        if effective >= below:
            continue
        place[:] = cloud.position[v]
        resample_vehicle(cloud, v, effective, room)
        mean, direction = carried.mean[v], cloud.direction[v]
        for p in range(n):
            a = parent[p]
            if a != p:
                dx, dy = cloud.position[v, p, 0] - place[a, 0], cloud.position[v, p, 1] - place[a, 1]
                c, s = math.cos(direction[p]), math.sin(direction[p])
                mean[p, 0] = mean[a, 0] - share * (dx * c + dy * s)
                mean[p, 1] = mean[a, 1] - share_across * (dy * c - dx * s)
        if effective < FEW * n:
            spread_anew(cloud, carried, v, parent, axes)
        else:
            tell_apart(cloud, carried, v, parent, KERNEL_SHARE * effective ** (-1.0 / 6.0))


@njit(cache=True)
def spread_anew(cloud: Cloud, carried: Carried, v: int, parent: IntArray, axes: Axes) -> None:
    """Draw the errors of copies as at birth: the few that are left tell how the vehicle moves, not how it is seen."""
    state = cloud.state[v].copy()
    for a in range(2):
        spread = axes.correlated[a] / math.sqrt(axes.correlated[a] + axes.white[a])
        if spread > 0.0:
            for p in range(parent.size):
                if parent[p] != p:
                    slide(cloud, carried, v, p, a, spread * random.draw_normal(state))
    cloud.state[v] = state


@njit(cache=True)
def tell_apart(cloud: Cloud, carried: Carried, v: int, parent: IntArray, bandwidth: float) -> None:
    """Spread the errors of copies by a kernel: nothing else would tell them apart if errors last.

    The kernel shrinks to the mean as it spreads, so that the spread stays as it is (Liu and West 2001).
    """
    n, mean, kept = parent.size, carried.mean[v], math.sqrt(1.0 - bandwidth * bandwidth)
    state = cloud.state[v].copy()
    for a in range(2):
        middle, squared = 0.0, 0.0
        for p in range(n):
            middle += mean[p, a] / n
        for p in range(n):
            squared += (mean[p, a] - middle) ** 2 / n
        spread = bandwidth * math.sqrt(squared)
        if spread > 0.0:
            for p in range(n):
                if parent[p] != p:
                    error = middle + kept * (mean[p, a] - middle) + spread * random.draw_normal(state)
                    slide(cloud, carried, v, p, a, error)
    cloud.state[v] = state


@njit(cache=True)
def slide(cloud: Cloud, carried: Carried, v: int, p: int, a: int, error: float) -> None:
    """Give a particle another error, and the place from which detections fit as they did."""
    off, c, s = carried.mean[v, p, a] - error, math.cos(cloud.direction[v, p]), math.sin(cloud.direction[v, p])
    cloud.position[v, p, 0] += off * (c if a == 0 else -s)
    cloud.position[v, p, 1] += off * (s if a == 0 else c)
    carried.mean[v, p, a] = error
