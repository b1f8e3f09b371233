"""How good are forecasts of where vehicles will be, a few seconds ahead?

Every method learns from the same vehicles and forecasts the same others from the same instants of the log, in samples;
it is scored by where those vehicles then were. The energy score (Gneiting and Raftery 2007, Eq. 22) is proper: no
method can raise it by being surer, or less sure, than it has reason to be.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from dirprim_filter.evaluation import _kernels
from dirprim_filter.evaluation.baselines.trajectory_memory import States, TrajectoryMemory
from dirprim_filter.evaluation.splits import SplitBy, split
from dirprim_filter.evaluation.steps import StepCount
from dirprim_filter.filtering.futures import forecast_states
from dirprim_filter.primitives import PrimitiveMap, learn_primitives
from dirprim_filter.tracks import Tracks, world_names
from tessellation.arrays import AnyArray, FloatArray, IntArray

HORIZONS_S = tuple(0.5 * i for i in range(1, 17))
START_EVERY_S = 1.0
MAX_STARTS = 8
"""Of a vehicle: that one which waits for minutes does not outweigh all others."""
MAX_MATCH_S = 0.25
"""Between rows further from an instant than this, where the vehicle was is not known."""
BATCH = 20
"""Samples that the best-of score may choose from."""
MIN_CASES = 20
"""Below it a horizon is not scored: too few vehicles are still there."""


class Cases(NamedTuple):
    """Instants from which forecasts are made, and what came after.

    Attributes:
        vehicle: (n,) number of the vehicle, (group, id), among those forecast.
        name: (n,) str, the vehicle's id, with its group's: the same whichever vehicles it is forecast with.
        group: (n,) the vehicle's.
        position: (n, 2) metres.
        direction: (n,) radians.
        speed: (n,) m/s.
        later: (n, n_horizons, 2) metres, where the vehicle was that much later; NaN where the log does not say.
    """

    vehicle: IntArray
    name: AnyArray
    group: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    later: FloatArray

    @classmethod
    def of(cls, tracks: Tracks, *, horizons_s: Sequence[float] = HORIZONS_S) -> Cases:
        """Up to `MAX_STARTS` instants of each vehicle, `START_EVERY_S` apart, spread over its track."""
        vehicle = tracks.vehicle
        order = np.lexsort((tracks.time_ns, vehicle))
        first = np.searchsorted(vehicle[order], np.arange(tracks.n_tracks + 1))
        starts: list[IntArray] = []
        later: list[FloatArray] = []
        for v in range(first.size - 1):
            rows = order[first[v] : first[v + 1]]
            time_s = (tracks.time_ns[rows] - tracks.time_ns[rows[0]]) * 1e-9
            at = _spread(time_s, horizon_s=min(horizons_s))
            starts.append(rows[at])
            wanted = time_s[at][:, None] + np.asarray(horizons_s)
            later.append(_position_at(wanted, time_s, tracks.position[rows]))
        row = np.concatenate(starts)
        return cls(
            vehicle=np.asarray(vehicle[row], np.int64),
            name=world_names(tracks.track_id[row], tracks.group[row]),
            group=tracks.group[row],
            position=tracks.position[row],
            direction=tracks.direction[row],
            speed=tracks.speed[row],
            later=np.concatenate(later),
        )


def _spread(time_s: FloatArray, *, horizon_s: float) -> IntArray:
    """Rows at which to start, so that at least the nearest horizon is seen."""
    last = time_s[-1] - horizon_s
    if last < 0:
        return np.empty(0, np.int64)
    instants = np.arange(0.0, last + 1e-6, START_EVERY_S)
    chosen = np.unique(np.linspace(0, instants.size - 1, min(instants.size, MAX_STARTS)).round().astype(np.int64))
    return np.unique(np.searchsorted(time_s, instants[chosen] - 1e-6)).astype(np.int64)


def _position_at(wanted: FloatArray, time_s: FloatArray, position: FloatArray) -> FloatArray:
    """(...) seconds -> (..., 2), linear between rows at most `MAX_MATCH_S` away; NaN elsewhere."""
    found = np.stack([np.interp(wanted, time_s, position[:, axis]) for axis in (0, 1)], axis=-1)
    after = np.clip(np.searchsorted(time_s, wanted - 1e-6), 0, time_s.size - 1)
    before = np.maximum(after - 1, 0)
    near = np.abs(time_s[after] - wanted) <= 1e-6
    between = (time_s[before] <= wanted) & (wanted <= time_s[after])
    near |= between & (wanted - time_s[before] <= MAX_MATCH_S) & (time_s[after] - wanted <= MAX_MATCH_S)
    return np.where(near[..., None], found, np.nan)


SampleFutures = Callable[[Cases, int, np.random.Generator], FloatArray]
"""Cases, number of samples -> (n, n_samples, n_horizons, 2) metres."""
Fit = Callable[[Tracks, tuple[float, ...], np.random.Generator], Mapping[str, SampleFutures]]
"""Learns from tracks to forecast to some horizons, seconds: one or more rows of the table, by name."""


def by_map(train: Tracks, horizons_s: tuple[float, ...], rng: np.random.Generator) -> dict[str, SampleFutures]:
    """The map as it is learned by default, and the same without its cells."""
    learned = learn_primitives(train, rng=rng)
    return {"prior": futures_of(learned, horizons_s), "place-free": futures_of(learned.without_places(), horizons_s)}


def by_one_cell(train: Tracks, horizons_s: tuple[float, ...], rng: np.random.Generator) -> dict[str, SampleFutures]:
    """The same learning with a single cell for all places: the negative control. What is left owes nothing to cells."""
    learned = learn_primitives(train, tessellation="grid", n_cells=1, rng=rng)
    return {"one cell": futures_of(learned, horizons_s)}


def futures_of(primitive_map: PrimitiveMap, horizons_s: tuple[float, ...]) -> SampleFutures:
    """Forecasts on a map."""

    def sample(cases: Cases, n_samples: int, rng: np.random.Generator) -> FloatArray:
        return forecast_states(
            primitive_map, position=cases.position, direction=cases.direction, speed=cases.speed,
            time_s=horizons_s, n_samples=n_samples, rng=rng,
        )  # fmt: skip

    return sample


def by_trajectory_memory(
    train: Tracks, horizons_s: tuple[float, ...], rng: np.random.Generator
) -> dict[str, SampleFutures]:
    """Each vehicle goes on as a training vehicle that moved like it at this place."""
    memory = TrajectoryMemory.of(train).chosen(rng=rng)

    def sample(cases: Cases, n_samples: int, rng: np.random.Generator) -> FloatArray:
        now = States(cases.position, cases.direction, cases.speed)
        return memory.sample(now, time_s=np.asarray(horizons_s), n_samples=n_samples, rng=rng)

    return {"trajectory memory": sample}


def by_constant_velocity(
    train: Tracks, horizons_s: tuple[float, ...], _rng: np.random.Generator
) -> dict[str, SampleFutures]:
    """On as now, with Gaussian errors along the way and across it as large as the training vehicles' at each horizon.

    Fitted to each horizon by itself, not to the changes from one row to the next: those are smooth, and white
    acceleration fitted to them falls short at once.
    """
    cases = Cases.of(train, horizons_s=horizons_s)
    error = _turned(cases.later - _straight_on(cases, horizons_s), -cases.direction)
    seen = np.maximum(np.isfinite(error).sum(axis=0), 1)
    std = np.sqrt(np.nansum(error**2, axis=0) / seen)  # (n_horizons, 2)

    def sample(cases: Cases, n_samples: int, rng: np.random.Generator) -> FloatArray:
        drawn = std * rng.standard_normal((cases.speed.size, n_samples, *std.shape))
        return np.asarray(_straight_on(cases, horizons_s)[:, None] + _turned(drawn, cases.direction))

    return {"constant velocity": sample}


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


@dataclass(frozen=True, slots=True, kw_only=True)
class HorizonScore:
    """What one method reached at one horizon: the mean over seeds of the mean over cases.

    Attributes:
        horizon_s: seconds ahead.
        n_cases: forecasts that were scored, over all seeds.
        energy: metres, energy score.
        energy_se: its standard error, by what the vehicles (or the groups, where these were held out) differ from each
            other; forecasts of one vehicle are not independent, nor are those of a vehicle in two seeds. NaN for one.
        energy_std: its standard deviation over seeds; NaN for one.
        ade: metres from the samples' mean to the truth, mean over the horizons up to this one.
        fde: metres from the samples' mean to the truth.
        best_of_20: metres from the truth to the nearest of 20 samples.
        nll: negative log of the samples' kernel density at the truth, per square metre; kernels are at least 0.1 m
            wide, and a hundredth of each 20 m, of every method.
        coverage_50: share of truths in the highest-density region of probability 0.5.
        coverage_90: the same of 0.9.
    """

    horizon_s: float
    n_cases: int
    energy: float
    energy_se: float
    energy_std: float
    ade: float
    fde: float
    best_of_20: float
    nll: float
    coverage_50: float
    coverage_90: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodForecasts:
    """A method's scores.

    Attributes:
        name: of the method.
        horizons: a score for each horizon at which enough vehicles are still there.
    """

    name: str
    horizons: tuple[HorizonScore, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ForecastTable:
    """All methods on the same vehicles.

    Attributes:
        methods: the rows.
        split_by: how vehicles were held out.
        n_folds: so many times in each split, another part of the vehicles each time.
        n_seeds: how many splits, each with random numbers of its own.
        n_samples: futures for each case.
        n_vehicles: held-out vehicles with a forecast, over all seeds.
    """

    methods: tuple[MethodForecasts, ...]
    split_by: SplitBy
    n_folds: int
    n_seeds: int
    n_samples: int
    n_vehicles: int

    def relative_energy(self, of: str, to: str) -> tuple[float, ...]:
        """The energy score of a method over that of another, at each horizon that both have."""
        rows = {row.name: {score.horizon_s: score.energy for score in row.horizons} for row in self.methods}
        return tuple(energy / rows[to][h] for h, energy in rows[of].items() if h in rows[to])


def evaluate_forecasts(
    tracks: Tracks,
    *,
    split_by: Literal["vehicle", "group"] = "vehicle",
    horizons_s: Sequence[float] = HORIZONS_S,
    n_folds: int = 4,
    n_seeds: int = 1,
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
        n_seeds: how many times they are dealt anew.
        n_samples: futures for each case, at least 20.
        methods: what to compare.
        progress: told how many of how many steps are done.
        rng: deals the splits and feeds the methods; what one draws changes no other's.

    Raises:
        ValueError: horizons that do not ascend, too few samples, nothing to hold out, or nothing that is seen so long.
    """
    horizons = tuple(float(h) for h in horizons_s)
    if not horizons or horizons[0] <= 0 or (np.diff(horizons) <= 0).any():
        raise ValueError(f"horizons_s: expected ascending positive seconds, got {list(horizons_s)}")
    if n_samples < BATCH or n_seeds < 1:
        raise ValueError(f"n_samples, n_seeds: expected at least {BATCH} and 1, got {n_samples} and {n_seeds}")
    found: dict[str, list[FloatArray]] = {}
    clusters: list[AnyArray] = []
    n_vehicles = 0
    told: StepCount | None = None
    for child in rng.spawn(n_seeds):
        of_seed: dict[str, list[FloatArray]] = {}
        clusters_of_seed: list[AnyArray] = []
        dealt = split(tracks, by=split_by, n_folds=n_folds, rng=child)
        told = told or StepCount(n_seeds * len(dealt) * len(methods), progress)
        for fold in dealt:
            cases = Cases.of(fold.test, horizons_s=horizons)
            clusters_of_seed.append(cases.group if split_by == "group" else cases.name)
            n_vehicles += int(np.unique(cases.vehicle).size)
            for fit, own in zip(methods, child.spawn(len(methods)), strict=True):
                for name, sample in fit(fold.train, horizons, own).items():
                    scores = score_cases(sample(cases, n_samples, own), cases.later)
                    of_seed.setdefault(name, []).append(scores)
                told.add()
        clusters.append(np.concatenate(clusters_of_seed))
        for name, folds in of_seed.items():
            found.setdefault(name, []).append(np.concatenate(folds))
    rows = {name: _over_seeds(seeds, clusters, horizons) for name, seeds in found.items()}
    if not any(rows.values()):
        raise ValueError(f"tracks: expected {MIN_CASES} held-out forecasts {horizons[0]:g} s ahead, got fewer")
    return ForecastTable(
        methods=tuple(MethodForecasts(name=name, horizons=scores) for name, scores in rows.items()),
        split_by=split_by,
        n_folds=n_folds,
        n_seeds=n_seeds,
        n_samples=n_samples,
        n_vehicles=n_vehicles,
    )


SCORES = ("energy", "ade", "fde", "best_of_20", "nll", "coverage_50", "coverage_90")


def score_cases(sample: FloatArray, later: FloatArray) -> FloatArray:
    """Every score of every case and horizon, in the order of `SCORES`; NaN where the truth is not known.

    Args:
        sample: (n, n_samples, n_horizons, 2) metres.
        later: (n, n_horizons, 2) metres.

    Returns:
        (n, n_horizons, 7).
    """
    n, n_samples, n_horizons, _ = sample.shape
    known = np.isfinite(later[..., 0])
    of_samples = np.full((n, n_horizons, 3), np.nan)
    for h in range(n_horizons):
        rows = np.flatnonzero(known[:, h])
        out = np.empty((rows.size, 3))
        _kernels.score_samples(np.ascontiguousarray(sample[rows, :, h]), later[rows, h], out)
        of_samples[rows, h] = out
    off = np.linalg.norm(sample.mean(axis=1) - later, axis=-1)
    n_batches = n_samples // BATCH
    each = np.linalg.norm(sample[:, : n_batches * BATCH] - later[:, None], axis=-1)
    best = each.reshape(n, n_batches, BATCH, n_horizons).min(axis=2).mean(axis=1)
    rank = of_samples[..., 2]
    inside = [np.where(known, rank < probability, np.nan) for probability in (0.5, 0.9)]
    so_far = np.cumsum(off, axis=1) / np.arange(1, n_horizons + 1)
    return np.stack([of_samples[..., 0], so_far, off, best, of_samples[..., 1], *inside], axis=-1)


def _over_seeds(
    seeds: list[FloatArray], clusters: list[AnyArray], horizons_s: Sequence[float]
) -> tuple[HorizonScore, ...]:
    rows = []
    for h, horizon_s in enumerate(horizons_s):
        known = [np.isfinite(scores[:, h, 0]) for scores in seeds]
        kept = [(scores[k, h], of[k]) for scores, of, k in zip(seeds, clusters, known, strict=True)]
        kept = [(scores, of) for scores, of in kept if len(scores) >= MIN_CASES]
        if not kept:
            continue
        means = np.array([np.nanmean(scores, axis=0) for scores, _ in kept])
        rows.append(
            HorizonScore(
                horizon_s=horizon_s,
                n_cases=sum(len(scores) for scores, _ in kept),
                energy_se=standard_error([scores[:, 0] for scores, _ in kept], [of for _, of in kept]),
                energy_std=float(means[:, 0].std(ddof=1)) if len(means) > 1 else float("nan"),
                **{name: float(value) for name, value in zip(SCORES, means.mean(axis=0), strict=True)},
            )
        )
    return tuple(rows)


def standard_error(seeds: Sequence[FloatArray], clusters: Sequence[AnyArray]) -> float:
    """Standard error of the mean over seeds of the mean over cases, where only clusters are independent.

    Liang and Zeger 1986, of a mean: the deviations of a cluster's cases are added before they are squared.

    Args:
        seeds: a score of each case, (n,) in each seed.
        clusters: (n,) whose each is, by the same names in every seed.

    Returns:
        NaN of a single cluster.
    """
    share = [(values - values.mean()) / (values.size * len(seeds)) for values in seeds]
    names, number = np.unique(np.concatenate(clusters), return_inverse=True)
    off = np.bincount(number, np.concatenate(share))
    return float(np.sqrt(names.size / (names.size - 1) * (off**2).sum())) if names.size > 1 else float("nan")
