"""What a tracking experiment compares, and the Kalman filters among it, fitted to training vehicles.

The Kalman filters are in `filtering.kalman`. What is maximised is the evidence: the density of each
measured position of a vehicle, given those before it, with the gaps and misses that the filter will meet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.filtering import BayesFilter, ConstantVelocityKalman, InteractingModels
from dirprim_filter.filtering.kalman import acceleration_density
from dirprim_filter.tracks import Tracks

Rival = Literal["constant velocity", "interacting models"]
RIVALS: tuple[Rival, ...] = get_args(Rival)
OnMap = Literal["prior", "place-free", "one cell"]
"""The map, the same filter without the map, and the same learning with a single cell."""
Method = Literal[OnMap, Rival]
METHODS: tuple[Method, ...] = (*get_args(OnMap), *RIVALS)
SMOOTHED: tuple[Method, ...] = ("prior", "place-free", "constant velocity")
"""Those whose smoother is evaluated beside them."""
MakeFilter = Callable[[], BayesFilter]
FIRST_TURN = 0.03
"""rad^2/s^3, where the search for the noise of the rate of turn begins."""
MODELS: dict[Rival, Callable[..., BayesFilter]] = {
    "constant velocity": ConstantVelocityKalman,
    "interacting models": InteractingModels,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedRival:
    """Makes a Kalman filter whose noise was fitted.

    Attributes:
        name: of the rival.
        settings: its parameters, and between which others they were chosen.
        config: noise of the measurements.
    """

    name: Rival
    settings: tuple[Choice, ...]
    config: FilterConfig

    def __call__(self) -> BayesFilter:
        """The filter, without beliefs."""
        return MODELS[self.name](**{of.name: of.chosen for of in self.settings}, config=self.config)


def fitted(name: Rival, seen: Detections, train: Tracks, config: FilterConfig) -> FittedRival:
    """The rival with the noise of greatest evidence.

    Args:
        name: which.
        seen: labelled detections of training vehicles.
        train: their motion, which says where the search begins.
        config: noise of the measurements.

    Raises:
        ValueError: no training vehicle has two rows near in time, or no noise is best.
    """
    pace = acceleration_density(train, along=True)
    start = {
        "constant velocity": {"acceleration_density": acceleration_density(train)},
        "interacting models": {"straight": pace, "acceleration_density": pace, "turn_density": FIRST_TURN},
    }[name]

    def evidence(values: tuple[float, ...]) -> float:
        return log_evidence(MODELS[name](**dict(zip(start, values, strict=True)), config=config), seen) / len(seen)

    axes = [Axis(parameter, value) for parameter, value in start.items()]
    return FittedRival(name=name, settings=choose(axes, evidence), config=config)


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
