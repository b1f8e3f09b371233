"""Particle weights by a cue such as a turn signal (Senanayake et al. 2020, Eq. 4).

p_t is the cue: a mixture of von Mises over the direction some seconds later, relative to the current one. p_0 is given
by the particles: how far vehicles on their manoeuvre have turned by then.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.primitives._manoeuvres import MotionTable
from dirprim_filter.primitives.cues import Cue


def weigh_by_cue(table: MotionTable, cloud: Cloud, vehicle: IntArray, cue: Cue) -> FloatArray:
    """Multiply the weights of vehicles (v,) by the cue's density, and normalise.

    Returns:
        (v,) natural log of the density of the cue under each belief, per radian.
    """
    log_fit = cue.belief(0.0).log_density(table.ahead[cloud.manoeuvre[vehicle]])
    top = log_fit.max(axis=1)
    weight = cloud.weight[vehicle] * np.exp(log_fit - top[:, None])
    total = weight.sum(axis=1)
    cloud.weight[vehicle] = weight / total[:, None]
    return np.asarray(top + np.log(total))
