"""Compiled: visits of one cell grouped into manoeuvres.

DP-means (Kulis and Jordan 2012): k-means in which a visit too far from every mean opens a group of its own.
"""

import math

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from tessellation._compiling import compiled

PASSES = 8
OPENING_PASSES = 2


@compiled
def dp_means(feature: FloatArray, order: IntArray, opens_at: float, most: int, label: IntArray) -> None:
    """Fill `label` (n,) with the groups of visits, at most so many, some of them empty.

    Features are (n, f), NaN where not known; visits are looked at in this order. From the squared distance `opens_at`
    on, a mean over the known features, a visit opens a group.
    """
    f = feature.shape[1]
    total, known = np.empty((most, f)), np.empty((most, f))
    total[:], known[:], label[:] = 0.0, 0.0, -1
    n_groups = 0
    for number in range(PASSES):
        changed = False
        for i in order:
            best, least = -1, np.inf
            for k in range(n_groups):
                distance, count = 0.0, 0
                for q in range(f):
                    if not math.isnan(feature[i, q]) and known[k, q] > 0.0:
                        off = feature[i, q] - total[k, q] / known[k, q]
                        distance += off * off
                        count += 1
                distance /= max(count, 1)
                if distance < least and count > 0:
                    best, least = k, distance
            if n_groups < most and (best < 0 or (least > opens_at and number < OPENING_PASSES)):
                best = n_groups
                n_groups += 1
            best = max(best, 0)
            if best != label[i]:
                changed = True
                for q in range(f):
                    if not math.isnan(feature[i, q]):
                        if label[i] >= 0:
                            total[label[i], q] -= feature[i, q]
                            known[label[i], q] -= 1.0
                        total[best, q] += feature[i, q]
                        known[best, q] += 1.0
                label[i] = best
        if not changed:
            break
