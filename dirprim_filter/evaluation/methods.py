"""What an experiment compares: a tracker on five motion models, fitted to the same vehicles, and no tracker at all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Literal, get_args

import numpy as np

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import (
    BayesFilter,
    ConstantTurnUKF,
    ConstantVelocityKalman,
    InteractingModels,
    Tracker,
    Worlds,
)
from dirprim_filter.filtering.manoeuvre import acceleration_density, pace_density
from dirprim_filter.filtering.tracker import bayes_filter_of
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.sensor import Sensor
from dirprim_filter.tracks import Tracks

RAW: Literal["raw detections"] = "raw detections"
"""No filter: what is reported is what is believed."""
Method = Literal["prior", "place-free", "constant velocity", "constant turn", "interacting models", "raw detections"]
METHODS: tuple[Method, ...] = get_args(Method)
SMOOTHED: tuple[Method, ...] = ("prior", "place-free", "constant velocity")
"""Those that have a smoother."""
ON_A_MAP: tuple[Method, ...] = ("prior", "place-free")
"""Those that need a map."""
MakeFilter = Callable[[], BayesFilter]

SCALES = (0.1, 0.3, 1.0, 3.0)
"""Factors on the noise estimated from the training vehicles, chosen by the likelihood of their measurements."""
TURNS = (0.003, 0.03, 0.3)
"""rad^2/s^3, noise of the rate of turn to choose among likewise."""
MAX_FITTED = 10
"""Vehicles to choose it by."""


def filters(
    methods: tuple[Method, ...], primitive_map: PrimitiveMap | None, train: Tracks, config: FilterConfig, *,
    sensor: Sensor | None = None, rng: np.random.Generator,
) -> dict[Method, MakeFilter]:  # fmt: skip
    """What makes the filter of each method that has one, fitted once.

    Args:
        methods: which.
        primitive_map: for those of `ON_A_MAP`; None without them.
        train: vehicles that the Kalman filters are fitted to.
        config: measurements and particles.
        sensor: errors of the measurements, for those of `ON_A_MAP`; None: the noise of `config`.
        rng: the noise of the measurements they are fitted by.

    Raises:
        ValueError: no training vehicle has two rows near in time.
    """
    pace, any_way = pace_density(train), acceleration_density(train)
    kalman: dict[Method, Callable[[float, float], BayesFilter]] = {
        "constant velocity": lambda scale, _: ConstantVelocityKalman(
            acceleration_density=scale * any_way, config=config
        ),
        "constant turn": lambda scale, turn: ConstantTurnUKF(
            acceleration_density=scale * pace, turn_density=turn, config=config
        ),
        "interacting models": lambda scale, turn: InteractingModels(
            straight=scale * pace, acceleration_density=scale * pace, turn_density=turn, config=config
        ),
    }
    seen = _reported(train, config, rng=rng)
    made: dict[Method, MakeFilter] = {}
    for method in methods:
        if method in kalman:
            turns = TURNS if method != "constant velocity" else TURNS[:1]
            made[method] = _best(kalman[method], turns, seen, config)
        elif primitive_map is not None and method in ON_A_MAP:
            of = primitive_map if method == "prior" else primitive_map.without_places()
            made[method] = _particles(of, config, sensor)
    return made


def _particles(primitive_map: PrimitiveMap, config: FilterConfig, sensor: Sensor | None) -> MakeFilter:
    return lambda: bayes_filter_of(primitive_map, config, sensor)


def _best(
    of_noise: Callable[[float, float], BayesFilter],
    turns: tuple[float, ...],
    seen: list[Detections],
    config: FilterConfig,
) -> MakeFilter:
    """The filter under which the training vehicles' measurements are most likely."""
    best = max(product(SCALES, turns), key=lambda noise: _log_evidence(lambda: of_noise(*noise), seen, config))
    return lambda: of_noise(*best)


def _log_evidence(make: Callable[[], BayesFilter], seen: list[Detections], config: FilterConfig) -> float:
    trusting = TrackingConfig(clutter_density=1e-12)  # every row counts, under every filter
    worlds = Worlds(lambda _: Tracker(make(), config=config, tracking=trusting, rng=np.random.default_rng(0)))
    total = 0.0
    for frame in seen:
        worlds.predict(frame)
        worlds.weigh()
        total += sum(float(of.estimates.log_evidence.sum()) for of in worlds.frames().values())
    return total


def _reported(train: Tracks, config: FilterConfig, *, rng: np.random.Generator) -> list[Detections]:
    """Noisy positions of some training vehicles, frame by frame."""
    vehicle = train.vehicle
    some = train[np.isin(vehicle, rng.permutation(train.n_tracks)[:MAX_FITTED])]
    noisy = some.position + config.noise_m * rng.standard_normal(some.position.shape)
    return list(replace(Detections.of(some), position=noisy).frames())
