"""How good are forecasts of where vehicles will be, a few seconds ahead?

Every method learns from the same vehicles and forecasts the same others from the same instants of the log, in samples;
it is scored by where those vehicles then were. The energy score (Gneiting and Raftery 2007, Eq. 22) is proper: no
method can raise it by being surer, or less sure, than it has reason to be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray
from dirprim_filter.evaluation import _kernels
from dirprim_filter.evaluation.forecast_cases import HORIZONS_S, Cases
from dirprim_filter.evaluation.forecast_methods import METHODS, Fit
from dirprim_filter.evaluation.splits import SplitBy, split
from dirprim_filter.evaluation.steps import StepCount
from dirprim_filter.tracks import Tracks

BATCH = 20
"""Samples that the best-of score may choose from."""
MIN_CASES = 20
"""Below it a horizon is not scored: too few vehicles are still there."""


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
        n_samples: rollouts for each case.
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
        n_seeds: number of random splits.
        n_samples: rollouts for each case, at least 20.
        methods: what to compare.
        progress: called with the number of steps done, and their total.
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
    steps: StepCount | None = None
    for child in rng.spawn(n_seeds):
        of_seed: dict[str, list[FloatArray]] = {}
        clusters_of_seed: list[AnyArray] = []
        dealt = split(tracks, by=split_by, n_folds=n_folds, rng=child)
        steps = steps or StepCount(n_seeds * len(dealt) * len(methods), progress)
        for fold in dealt:
            cases = Cases.of(fold.test, horizons_s=horizons, among=tracks)
            clusters_of_seed.append(cases.group if split_by == "group" else cases.name)
            n_vehicles += int(np.unique(cases.vehicle).size)
            for fit, own in zip(methods, child.spawn(len(methods)), strict=True):
                for name, sample in fit(fold.train, horizons, own).items():
                    scores = score_cases(sample(cases, n_samples, own), cases.later)
                    of_seed.setdefault(name, []).append(scores)
                steps.add()
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
        clusters: (n,) name of each case's cluster, the same in every seed.

    Returns:
        NaN of a single cluster.
    """
    share = [(values - values.mean()) / (values.size * len(seeds)) for values in seeds]
    names, number = np.unique(np.concatenate(clusters), return_inverse=True)
    off = np.bincount(number, np.concatenate(share))
    return float(np.sqrt(names.size / (names.size - 1) * (off**2).sum())) if names.size > 1 else float("nan")
