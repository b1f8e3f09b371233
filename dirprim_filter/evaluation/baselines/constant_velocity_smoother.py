"""The Rauch-Tung-Striebel smoother of constant velocity, with the noise that turns out best: what a prior must beat.

Source: Rauch, Tung and Striebel, Maximum Likelihood Estimates of Linear Dynamic Systems, 1965.
"""

from __future__ import annotations

from collections.abc import Sequence

from dirprim_filter.evaluation.scenes import Scene, followed
from dirprim_filter.evaluation.scoring import TrackedWorld, report
from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment
from dirprim_filter.filtering import ConstantVelocityKalman

SCALES = (1.0, 3.0, 10.0, 30.0)
"""Factors on the noise estimated from the training vehicles."""


def best_in_hindsight(
    scenes: Sequence[Scene], experiment: TrackingExperiment, *, acceleration_density: float
) -> list[TrackedWorld]:
    """Scenes smoothed with the noise of which the positions are nearest to the truth: in this baseline's favour.

    Args:
        scenes: groups, at least one.
        experiment: what they follow from.
        acceleration_density: m^2/s^3 per axis, of which multiples are tried.
    """

    def smoothed(scale: float) -> list[TrackedWorld]:
        def make() -> ConstantVelocityKalman:
            return ConstantVelocityKalman(acceleration_density=scale * acceleration_density, config=experiment.filter)

        return followed(scenes, make, experiment, smooth=True, seed=0).smoothed

    def rmse(worlds: list[TrackedWorld]) -> float:
        found = report(worlds, with_ids=experiment.with_ids, scales=experiment.scales)
        return found.rmse if experiment.with_ids else found.gospa

    return min((smoothed(scale) for scale in SCALES), key=rmse)
