"""What an experiment of forecasting compares: the map, what it must beat, and its negative control."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.evaluation.baselines.trajectory_memory import States, TrajectoryMemory
from dirprim_filter.evaluation.forecast_cases import Cases
from dirprim_filter.evaluation.settings import Choice
from dirprim_filter.filtering.rollouts import forecast_states
from dirprim_filter.primitives import PrimitiveMap, learn_primitives
from dirprim_filter.tracks import Tracks

SampleFutures = Callable[[Cases, int, np.random.Generator], FloatArray]
"""Cases, number of samples -> (n, n_samples, n_horizons, 2) metres."""


class Forecaster(NamedTuple):
    """A method that was fitted.

    Attributes:
        sample: forecasts.
        settings: what was searched for, by name; empty where nothing was.
    """

    sample: SampleFutures
    settings: tuple[Choice, ...] = ()


Fit = Callable[[Tracks, tuple[float, ...], np.random.Generator], Mapping[str, Forecaster]]
"""Learns from tracks to forecast to some horizons, seconds: one or more rows of the table, by name."""


def by_map(
    train: Tracks, horizons_s: tuple[float, ...], rng: np.random.Generator, *, leaders: bool = False
) -> dict[str, Forecaster]:
    """The map as it is learned by default, the same without its cells, and where vehicles respond to those ahead."""
    learned = learn_primitives(train, rng=rng)
    rows = {"prior": futures_of(learned, horizons_s), "place-free": futures_of(learned.without_places(), horizons_s)}
    if leaders:
        rows["prior, leaders"] = futures_in_worlds(learned, horizons_s)
    return {name: Forecaster(sample) for name, sample in rows.items()}


def by_one_cell(train: Tracks, horizons_s: tuple[float, ...], rng: np.random.Generator) -> dict[str, Forecaster]:
    """The same learning with a single cell for all places: the negative control. What is left owes nothing to cells."""
    learned = learn_primitives(train, tessellation="grid", n_cells=1, rng=rng)
    return {"one cell": Forecaster(futures_of(learned, horizons_s))}


def futures_of(primitive_map: PrimitiveMap, horizons_s: tuple[float, ...]) -> SampleFutures:
    """Forecasts on a map."""

    def sample(cases: Cases, n_samples: int, rng: np.random.Generator) -> FloatArray:
        return forecast_states(
            primitive_map, position=cases.position, direction=cases.direction, speed=cases.speed,
            time_s=horizons_s, n_samples=n_samples, rng=rng,
        )  # fmt: skip

    return sample


def futures_in_worlds(primitive_map: PrimitiveMap, horizons_s: tuple[float, ...]) -> SampleFutures:
    """Forecasts on a map of all vehicles that were there at an instant together."""

    def sample(cases: Cases, n_samples: int, rng: np.random.Generator) -> FloatArray:
        path = np.empty((cases.speed.size, n_samples, len(horizons_s), 2))
        instant = cases.around.instant[cases.at]
        for i in np.unique(instant):
            first, end = cases.around.first[i : i + 2]
            east, north, direction, speed = cases.around.state[first:end].T
            here = np.flatnonzero(instant == i)
            path[here] = forecast_states(
                primitive_map, position=np.column_stack([east, north]), direction=direction, speed=speed,
                time_s=horizons_s, n_samples=n_samples, config=FilterConfig(interaction="leader"), rng=rng,
            )[cases.at[here] - first]  # fmt: skip
        return path

    return sample


def by_trajectory_memory(
    train: Tracks, horizons_s: tuple[float, ...], rng: np.random.Generator
) -> dict[str, Forecaster]:
    """Each vehicle goes on as a training vehicle that moved like it at this place."""
    memory, settings = TrajectoryMemory.of(train).chosen(Cases.of(train, horizons_s=horizons_s), horizons_s, rng=rng)

    def sample(cases: Cases, n_samples: int, rng: np.random.Generator) -> FloatArray:
        now = States(cases.position, cases.direction, cases.speed)
        return memory.sample(now, time_s=np.asarray(horizons_s), n_samples=n_samples, rng=rng)

    return {"trajectory memory": Forecaster(sample, settings)}


def by_constant_velocity(
    train: Tracks, horizons_s: tuple[float, ...], _rng: np.random.Generator
) -> dict[str, Forecaster]:
    """On as now, with errors as large as the training vehicles'."""
    return {"constant velocity": Forecaster(straight_on_as(Cases.of(train, horizons_s=horizons_s), horizons_s))}


def straight_on_as(known: Cases, horizons_s: tuple[float, ...]) -> SampleFutures:
    """On as now, with Gaussian errors along the course and across it as large as those of known cases at each horizon.

    Fitted to each horizon by itself, not to the changes from one row to the next: those are smooth, and white
    acceleration fitted to them falls short at once.
    """
    error = _turned(known.later - _straight_on(known, horizons_s), -known.direction)
    seen = np.maximum(np.isfinite(error).sum(axis=0), 1)
    std = np.sqrt(np.nansum(error**2, axis=0) / seen)  # (n_horizons, 2)

    def sample(cases: Cases, n_samples: int, rng: np.random.Generator) -> FloatArray:
        drawn = std * rng.standard_normal((cases.speed.size, n_samples, *std.shape))
        return np.asarray(_straight_on(cases, horizons_s)[:, None] + _turned(drawn, cases.direction))

    return sample


def _straight_on(cases: Cases, horizons_s: Sequence[float]) -> FloatArray:
    """(n, n_horizons, 2) where the vehicles would be as they move now."""
    velocity = cases.speed[:, None] * np.column_stack([np.cos(cases.direction), np.sin(cases.direction)])
    return np.asarray(cases.position[:, None] + velocity[:, None] * np.asarray(horizons_s)[:, None])


def _turned(vector: FloatArray, angle: FloatArray) -> FloatArray:
    """(n, ..., 2) vectors, each turned by its angle, (n,) radians counter-clockwise."""
    shape = (angle.size, *[1] * (vector.ndim - 2))
    cosine, sine = np.cos(angle).reshape(shape), np.sin(angle).reshape(shape)
    x, y = vector[..., 0], vector[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


METHODS: tuple[Fit, ...] = (by_map, by_one_cell, by_trajectory_memory, by_constant_velocity)
WITH_LEADERS: tuple[Fit, ...] = (partial(by_map, leaders=True), *METHODS[1:])
