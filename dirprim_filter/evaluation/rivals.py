"""What a tracking experiment compares, and its Kalman filter, whose noise is fitted to training vehicles.

What is maximised is the evidence: the density of each measured position of a vehicle, given those before it, with the
gaps and misses that the filter will meet.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.filtering import BayesFilter, ConstantVelocityKalman
from dirprim_filter.filtering.kalman import acceleration_density
from dirprim_filter.tracks import Tracks

Method = Literal["prior", "place-free", "one cell", "constant velocity"]
"""The map, the same filter without the map, the same learning with a single cell; and the Kalman filter."""
METHODS: tuple[Method, ...] = get_args(Method)
CONSTANT_VELOCITY: Method = "constant velocity"
SMOOTHED: tuple[Method, ...] = ("prior", "place-free", CONSTANT_VELOCITY)
"""Those whose smoother is evaluated beside them."""
MakeFilter = Callable[[], BayesFilter]


def fitted_acceleration(seen: Detections, train: Tracks, config: FilterConfig) -> Choice:
    """The acceleration density of greatest evidence, and between which others it was chosen.

    Args:
        seen: labelled detections of training vehicles.
        train: their motion, which says where the search begins.
        config: noise of the measurements.

    Raises:
        ValueError: no training vehicle has two rows near in time, or no noise is best.
    """

    def evidence(values: tuple[float, ...]) -> float:
        return log_evidence(ConstantVelocityKalman(acceleration_density=values[0], config=config), seen) / len(seen)

    return choose([Axis("acceleration_density", acceleration_density(train))], evidence)[0]


def log_evidence(model: BayesFilter, seen: Detections) -> float:
    """Natural log of the density of all vehicles' measured positions; the first of each is given.

    Args:
        model: a filter without beliefs.
        seen: labelled, of one group; every row is of its vehicle.
    """
    vehicle = np.unique(seen.track_id, return_inverse=True)[1]
    order = np.lexsort((seen.time_ns, vehicle))
    n_rows = np.bincount(vehicle)
    first = np.cumsum(n_rows) - n_rows
    slot = np.arange(n_rows.size)
    model.reserve(slot.size)
    model.begin(slot, slot.astype(np.uint64), seen[order[first]])
    total = 0.0
    for k in range(1, int(n_rows.max(initial=0))):  # the next row of every vehicle that has one
        going = np.flatnonzero(n_rows > k)
        row, before = order[first[going] + k], order[first[going] + k - 1]
        model.predict(going, (seen.time_ns[row] - seen.time_ns[before]) * 1e-9)
        total += float(model.weigh(going, seen[row]).log_density.sum())
    return total
