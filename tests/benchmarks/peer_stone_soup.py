"""Stone Soup's trackers behind `peers.py`: nearest neighbours, joint probabilities, and a PHD filter."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import numpy as np
from peer_scenes import Fold, Part, UnavailableError
from peer_trackers import HALF_DECADE, START_SPEED_M_S, Peer, Reported, Settings, Tracked

from dirprim_filter.evaluation.settings import Axis

START = datetime(2026, 1, 1)
NS_PER_US = 1000


def stone_soup(fold: Fold) -> dict[str, Peer]:
    """Global nearest neighbour, joint probabilistic data association, and the Gaussian mixture PHD filter.

    Raises:
        UnavailableError: it is not installed.
    """
    try:
        import stonesoup  # noqa: F401
    except ImportError as error:
        raise UnavailableError("stonesoup is not installed: the extra `peers`") from error
    acceleration, confirmed = Axis("acceleration", 1.0, HALF_DECADE), Axis("confirmed_after", 2.0, 1.5, 1.0)
    gate, deleted = Axis("gate", 4.0, 1.3), Axis("deleted_after", 10.0, 1.5, 1.0)
    first = "Stone Soup GNN"
    return {
        first: Peer(
            partial(_by_association, fold, is_joint=False),
            (acceleration, gate, deleted, confirmed),
        ),
        "Stone Soup JPDA": Peer(
            partial(_by_association, fold, is_joint=True),
            (gate, deleted, Axis("widest", 10.0)), after=first,
        ),
        "Stone Soup GM-PHD": Peer(
            partial(_by_phd, fold),
            (gate, Axis("merged_below", 8.0), Axis("pruned_below", 1e-5, 1e2, most=1e-2)), after=first,
        ),
    }  # fmt: skip


def _kalman(fold: Fold, acceleration: float) -> tuple[Any, Any, Any, Any]:
    """Stone Soup's predictor, updater and measurement of constant velocity, and the belief that a track starts from."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import KalmanUpdater

    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(acceleration), ConstantVelocity(acceleration)])
    measured = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=fold.noise_m**2 * np.eye(2))
    first = GaussianState(np.zeros((4, 1)), np.diag([0.0, START_SPEED_M_S**2] * 2), timestamp=START)
    return KalmanPredictor(motion), KalmanUpdater(measured), measured, first


def _stone_frames(part: Part) -> list[tuple[datetime, set[Any]]]:
    from stonesoup.types.detection import Detection

    return [
        (at, {Detection(place[:, None], timestamp=at) for place in seen.position})
        for time_ns, seen in part.frames()
        for at in [START + timedelta(microseconds=time_ns // NS_PER_US)]
    ]


def _by_association(fold: Fold, part: Part, settings: Settings, *, is_joint: bool) -> Tracked:
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.dataassociator.probability import JPDAwithEHM2
    from stonesoup.deleter.error import CovarianceBasedDeleter
    from stonesoup.deleter.multi import CompositeDeleter
    from stonesoup.deleter.time import UpdateTimeStepsDeleter
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.initiator.simple import MultiMeasurementInitiator
    from stonesoup.measures import Mahalanobis
    from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker

    predictor, updater, measured, first = _kalman(fold, settings["acceleration"])
    nearest = GNNWith2DAssignment(
        DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=settings["gate"])
    )
    initiator = MultiMeasurementInitiator(
        first, deleter=UpdateTimeStepsDeleter(2), data_associator=nearest, updater=updater, measurement_model=measured,
        min_points=round(settings["confirmed_after"]),
    )  # fmt: skip
    deleter = UpdateTimeStepsDeleter(round(settings["deleted_after"]))
    if is_joint:
        gate = float(-np.expm1(-0.5 * settings["gate"] ** 2))  # chi squared of two degrees of freedom
        likely = PDAHypothesiser(
            predictor, updater, clutter_spatial_density=fold.tracking.clutter_density,
            prob_detect=fold.tracking.detection_probability, prob_gate=min(gate, 1.0 - 1e-9),
        )  # fmt: skip
        wide = CovarianceBasedDeleter(2.0 * settings["widest"] ** 2, mapping=[0, 2])
        tracker = MultiTargetMixtureTracker(
            initiator, CompositeDeleter([deleter, wide], intersect=False), _stone_frames(part),
            JPDAwithEHM2(likely), updater,
        )  # fmt: skip
    else:
        tracker = MultiTargetTracker(initiator, deleter, _stone_frames(part), nearest, updater)
    return _listened(part, tracker)


def _by_phd(fold: Fold, part: Part, settings: Settings) -> Tracked:
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
    from stonesoup.tracker.pointprocess import PointProcessMultiTargetTracker
    from stonesoup.types.state import TaggedWeightedGaussianState
    from stonesoup.updater.pointprocess import PHDUpdater

    predictor, updater, _, _ = _kalman(fold, settings["acceleration"])
    config, low = fold.tracking, part.truth.position.min(axis=0)
    extent = np.ptp(part.truth.position, axis=0)
    middle, half = low + 0.5 * extent, 0.5 * extent
    birth = TaggedWeightedGaussianState(
        np.array([[middle[0]], [0.0], [middle[1]], [0.0]]),
        np.diag([half[0] ** 2, START_SPEED_M_S**2, half[1] ** 2, START_SPEED_M_S**2]),
        weight=max(config.birth_density * float(np.prod(extent)), 1e-3), tag=TaggedWeightedGaussianState.BIRTH,
        timestamp=START,
    )  # fmt: skip
    near = DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=settings["gate"])
    tracker = PointProcessMultiTargetTracker(
        detector=_stone_frames(part), birth_component=birth,
        hypothesiser=GaussianMixtureHypothesiser(near, order_by_detection=True),
        updater=PHDUpdater(
            updater, clutter_spatial_density=config.clutter_density, prob_detection=config.detection_probability,
            prob_survival=0.99,
        ),
        reducer=GaussianMixtureReducer(
            prune_threshold=settings["pruned_below"], merge_threshold=settings["merged_below"],
            max_number_components=100,
        ),
        extraction_threshold=0.9,
    )  # fmt: skip
    return _listened(part, tracker)


def _listened(part: Part, tracker: Iterable[tuple[datetime, set[Any]]]) -> Tracked:
    reported = Reported()
    for (time_ns, _), (_, tracks) in zip(part.frames(), tracker, strict=True):
        for track in tracks:
            state = track.state
            reported.add(track.id, time_ns, state.mean[[0, 2], 0], state.covar[np.ix_([0, 2], [0, 2])])
    return reported.done()
