"""The trackers that an experiment compares: one tracker on five motion models, fitted to the same vehicles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import (
    BayesFilter,
    ConstantTurnUKF,
    ConstantVelocityKalman,
    InteractingModels,
    ParticleFilter,
    Tracker,
)
from dirprim_filter.filtering.manoeuvre import acceleration_density, pace_density, turn_density
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.tracks import Tracks

Method = Literal["prior", "place-free", "constant velocity", "constant turn", "interacting models"]
METHODS: tuple[Method, ...] = get_args(Method)
MakeFilter = Callable[[], BayesFilter]

SCALES = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Of the noise that the training vehicles' motion tells: the one that foresees their measurements best is taken."""
MAX_FITTED = 10
"""Vehicles to choose it by."""


def filters(
    methods: tuple[Method, ...], primitive_map: PrimitiveMap, train: Tracks, config: FilterConfig, *,
    rng: np.random.Generator,
) -> dict[Method, MakeFilter]:  # fmt: skip
    """What makes the filter of each method, fitted once.

    Args:
        methods: which.
        primitive_map: for the particle filters.
        train: vehicles that the Kalman filters are fitted to.
        config: measurements and particles.
        rng: the noise of the measurements they are fitted by.

    Raises:
        ValueError: no training vehicle has two rows near in time.
    """
    pace, turning, any_way = pace_density(train), turn_density(train), acceleration_density(train)
    kalman: dict[Method, Callable[[float], BayesFilter]] = {
        "constant velocity": lambda scale: ConstantVelocityKalman(acceleration_density=scale * any_way, config=config),
        "constant turn": lambda scale: ConstantTurnUKF(
            acceleration_density=scale * pace, turn_density=scale * turning, config=config
        ),
        "interacting models": lambda scale: InteractingModels(
            straight=scale * pace, acceleration_density=scale * pace, turn_density=scale * turning, config=config
        ),
    }
    seen = _reported(train, config, rng=rng)
    made: dict[Method, MakeFilter] = {}
    for method in methods:
        if method in kalman:
            made[method] = _best(kalman[method], seen, config)
        else:
            of = primitive_map if method == "prior" else primitive_map.without_places()
            made[method] = _particles(of, config)
    return made


def _particles(primitive_map: PrimitiveMap, config: FilterConfig) -> MakeFilter:
    return lambda: ParticleFilter(primitive_map, config)


def _best(of_scale: Callable[[float], BayesFilter], seen: list[Detections], config: FilterConfig) -> MakeFilter:
    """The filter under which the training vehicles' measurements are most likely."""
    scale = max(SCALES, key=lambda scale: _log_evidence(of_scale(scale), seen, config))
    return lambda: of_scale(scale)


def _log_evidence(bayes_filter: BayesFilter, seen: list[Detections], config: FilterConfig) -> float:
    tracker = Tracker(bayes_filter, config=config, tracking=TrackingConfig(), rng=np.random.default_rng(0))
    total = 0.0
    for frame in seen:
        tracker.predict(frame)
        tracker.weigh()
        total += float(tracker.estimate().log_evidence.sum())
    return total


def _reported(train: Tracks, config: FilterConfig, *, rng: np.random.Generator) -> list[Detections]:
    """Noisy positions of some training vehicles, frame by frame."""
    names = np.unique(train.track_id)
    some = train[np.isin(train.track_id, rng.permutation(names)[:MAX_FITTED])]
    noisy = some.position + config.noise_m * rng.standard_normal(some.position.shape)
    return list(replace(Detections.of(some), position=noisy).frames())
