"""How good are forecasts of where vehicles will be, a few seconds ahead?

Every method learns from the same vehicles and forecasts the same others from the same instants of the log, in samples;
it is scored by where those vehicles then were. The energy score (Gneiting and Raftery 2007, Eq. 22) is proper: no
method can raise it by being surer, or less sure, than it has reason to be.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray
from dirprim_filter.evaluation.baselines.trajectory_memory import States, TrajectoryMemory
from dirprim_filter.evaluation.belief_forecasts import NOISE, chosen_noise, forecast_beliefs
from dirprim_filter.evaluation.forecast_cases import FEWEST_CASES, HORIZONS_S, SCORES, Cases, score_cases
from dirprim_filter.evaluation.intervals import Interval, paired, reduction_of_mean
from dirprim_filter.evaluation.settings import Choice
from dirprim_filter.evaluation.splits import SplitBy, split, steps
from dirprim_filter.primitives.learning import learn_primitives
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks

SampleRollouts = Callable[[Cases, int, np.random.Generator], FloatArray]
"""Cases, number of samples -> (n, n_samples, n_horizons, 2) metres."""


class Forecaster(NamedTuple):
    """A method that was fitted.

    Attributes:
        sample: forecasts.
        settings: what was searched for, by name; empty where nothing was.
    """

    sample: SampleRollouts
    settings: tuple[Choice, ...] = ()


Fit = Callable[[Tracks, tuple[float, ...], np.random.Generator], Mapping[str, Forecaster]]
"""Learns from tracks to forecast to some horizons, seconds: one or more rows of the table, by name."""


def by_map(train: Tracks, horizons_s: tuple[float, ...], rng: np.random.Generator) -> dict[str, Forecaster]:
    """The map as it is learned by default, the same without its cells, and where vehicles respond to those ahead."""
    learned, known = learn_primitives(train, rng=rng), Cases.of(train, horizons_s=horizons_s)
    prior = from_beliefs(learned, known, horizons_s, rng)
    behind_leaders = rollouts_of(learned, horizons_s, noise_m=noise_of(prior.settings), leaders=True)
    return {
        "prior": prior,
        "place-free": from_beliefs(learned.without_places(), known, horizons_s, rng),
        "prior, leaders": Forecaster(behind_leaders, prior.settings),
    }


def by_one_cell(train: Tracks, horizons_s: tuple[float, ...], rng: np.random.Generator) -> dict[str, Forecaster]:
    """The same learning with a single cell for all places: the negative control. What is left owes nothing to cells."""
    learned = learn_primitives(train, tessellation="grid", n_cells=1, rng=rng)
    return {"one cell": from_beliefs(learned, Cases.of(train, horizons_s=horizons_s), horizons_s, rng)}


def from_beliefs(
    primitive_map: PrimitiveMap, known: Cases, horizons_s: tuple[float, ...], rng: np.random.Generator
) -> Forecaster:
    """On a map, with the noise of positions that suits cases of training vehicles."""
    settings = chosen_noise(primitive_map, known, horizons_s, rng=rng)
    return Forecaster(rollouts_of(primitive_map, horizons_s, noise_m=noise_of(settings)), settings)


def noise_of(settings: tuple[Choice, ...]) -> float:
    """Metres: as chosen, where it could be."""
    return settings[0].chosen if settings else NOISE.start


def rollouts_of(
    primitive_map: PrimitiveMap, horizons_s: tuple[float, ...], *, noise_m: float = NOISE.start, leaders: bool = False
) -> SampleRollouts:
    """Forecasts on a map; see `forecast_beliefs`."""
    return partial(forecast_beliefs, primitive_map, horizons_s=horizons_s, noise_m=noise_m, leaders=leaders)


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
    """On as now, with Gaussian errors along the course and across it as large as training vehicles' at each horizon.

    Fitted to each horizon by itself, not to the changes from one row to the next: those are smooth, and white
    acceleration fitted to them falls short at once.
    """
    known = Cases.of(train, horizons_s=horizons_s)
    error = _turned(known.later - _straight_on(known, horizons_s), -known.direction)
    seen = np.maximum(np.isfinite(error).sum(axis=0), 1)
    std = np.sqrt(np.nansum(error**2, axis=0) / seen)  # (n_horizons, 2)

    def sample(cases: Cases, n_samples: int, rng: np.random.Generator) -> FloatArray:
        drawn = std * rng.standard_normal((cases.speed.size, n_samples, *std.shape))
        return np.asarray(_straight_on(cases, horizons_s)[:, None] + _turned(drawn, cases.direction))

    return {"constant velocity": Forecaster(sample)}


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

MIN_SAMPLES = 20
"""Fewer say little of a region that holds 90 % of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HorizonScore:
    """What one method reached at one horizon: means over all cases.

    Attributes:
        horizon_s: seconds ahead.
        n_cases: forecasts that were scored.
        energy: metres, energy score.
        gain: share by which the first method's energy is below this one's, with its interval over vehicles, or groups
            where these were held out.
        ade: metres from the samples' mean to the truth, mean over the horizons up to this one.
        fde: metres from the samples' mean to the truth.
        coverage_50: share of truths in the highest-density region of probability 0.5.
        coverage_90: the same of 0.9.
    """

    horizon_s: float
    n_cases: int
    energy: float
    gain: Interval
    ade: float
    fde: float
    coverage_50: float
    coverage_90: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodForecasts:
    """A method's scores.

    Attributes:
        name: of the method.
        horizons: a score for each horizon at which enough vehicles are still there.
        settings: for each fold what was searched for, by name; empty where nothing was.
    """

    name: str
    horizons: tuple[HorizonScore, ...]
    settings: tuple[tuple[Choice, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ForecastTable:
    """All methods on the same vehicles.

    Attributes:
        methods: the rows.
        split_by: how vehicles were held out.
        n_folds: so many times, another part of the vehicles each time.
        n_samples: rollouts for each case.
        n_vehicles: held-out vehicles with a forecast.
    """

    methods: tuple[MethodForecasts, ...]
    split_by: SplitBy
    n_folds: int
    n_samples: int
    n_vehicles: int


def evaluate_forecasts(
    tracks: Tracks,
    *,
    split_by: Literal["vehicle", "group"] = "vehicle",
    horizons_s: Sequence[float] = HORIZONS_S,
    n_folds: int = 4,
    n_samples: int = 100,
    methods: Sequence[Fit] = METHODS,
    progress: Callable[[int, int], None] | None = None,
    rng: np.random.Generator,
) -> ForecastTable:
    """Learn from a part of the vehicles by every method, and forecast the others.

    Args:
        tracks: observed motion.
        split_by: whether vehicles are held out one by one or with their group.
        horizons_s: ascending, seconds ahead.
        n_folds: in how many parts they are dealt; each is held out once.
        n_samples: rollouts for each case, at least 20.
        methods: what to compare with the first.
        progress: called with the number of steps done, and their total.
        rng: deals the folds and feeds the methods; what one draws changes no other's.

    Raises:
        ValueError: horizons that do not ascend, too few samples, nothing to hold out, or nothing that is seen so long.
    """
    horizons = tuple(float(h) for h in horizons_s)
    if not horizons or horizons[0] <= 0 or (np.diff(horizons) <= 0).any():
        raise ValueError(f"horizons_s: expected ascending positive seconds, got {list(horizons_s)}")
    if n_samples < MIN_SAMPLES:
        raise ValueError(f"n_samples: expected at least {MIN_SAMPLES}, got {n_samples}")
    scores: dict[str, list[FloatArray]] = {}
    settings: dict[str, list[tuple[Choice, ...]]] = {}
    clusters: list[AnyArray] = []
    n_vehicles = 0
    (child,) = rng.spawn(1)
    folds = split(tracks, by=split_by, n_folds=n_folds, rng=child)
    done = steps(len(folds) * len(methods), progress)
    held_out = [Cases.of(fold.test, horizons_s=horizons, among=tracks) for fold in folds]
    if sum(np.count_nonzero(np.isfinite(cases.later[:, 0, 0])) for cases in held_out) < FEWEST_CASES:
        raise ValueError(f"tracks: expected {FEWEST_CASES} held-out forecasts {horizons[0]:g} s ahead, got fewer")
    for fold, cases in zip(folds, held_out, strict=True):
        clusters.append(cases.group if split_by == "group" else cases.name)
        n_vehicles += int(np.unique(cases.vehicle).size)
        for fit, own in zip(methods, child.spawn(len(methods)), strict=True):
            for name, found in fit(fold.train, horizons, own).items():
                scores.setdefault(name, []).append(score_cases(found.sample(cases, n_samples, own), cases.later))
                settings.setdefault(name, []).extend([found.settings] if found.settings else [])
            done()
    scored = {name: np.concatenate(folds) for name, folds in scores.items()}
    first = next(iter(scored.values()))
    at = np.flatnonzero(np.isfinite(first[..., 0]).sum(axis=0) >= FEWEST_CASES)
    cluster = np.concatenate(clusters)
    rows = [
        MethodForecasts(
            name=name, settings=tuple(settings[name]),
            horizons=tuple(_at_horizon(horizons[h], first[:, h], own[:, h], cluster) for h in at),
        )
        for name, own in scored.items()
    ]  # fmt: skip
    return ForecastTable(
        methods=tuple(rows), split_by=split_by, n_folds=n_folds, n_samples=n_samples, n_vehicles=n_vehicles
    )


def _at_horizon(horizon_s: float, first: FloatArray, own: FloatArray, cluster: AnyArray) -> HorizonScore:
    """Of a method beside the first: (n, 5) scores of both, (n,) what is independent."""
    known = np.isfinite(own[:, 0])
    means = np.nanmean(own[known], axis=0)  # past a hole in the log there is no mean over the horizons so far
    return HorizonScore(
        horizon_s=horizon_s, n_cases=int(known.sum()), gain=paired(cluster, first[:, 0], own[:, 0], reduction_of_mean),
        **{name: float(value) for name, value in zip(SCORES, means, strict=True)},
    )  # fmt: skip
