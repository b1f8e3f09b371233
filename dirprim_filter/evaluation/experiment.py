"""Tracking experiments: what a sensor would report of known traffic, given to every method and scored."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.estimates import EstimateSink
from dirprim_filter.evaluation.baselines.constant_velocity_smoother import best_in_hindsight
from dirprim_filter.evaluation.baselines.raw_detections import as_reported
from dirprim_filter.evaluation.methods import ON_A_MAP, RAW, SMOOTHED, filters
from dirprim_filter.evaluation.scenes import Scene, followed
from dirprim_filter.evaluation.scoring import TrackedWorld, report
from dirprim_filter.evaluation.splits import honest_split
from dirprim_filter.evaluation.steps import StepCount
from dirprim_filter.evaluation.tracking_experiment import Detector, TrackingExperiment
from dirprim_filter.evaluation.tracking_report import TrackingReport
from dirprim_filter.filtering.manoeuvre import acceleration_density
from dirprim_filter.primitives import PrimitiveMap, learn_primitives
from dirprim_filter.tracks import Tracks

BEST = "best CV smoother"
"""Of constant velocity, with the noise that is best in hindsight."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodResult:
    """What one method reached.

    Attributes:
        name: of the method, and whether it is its smoother's.
        reports: one for each seed, pooled over the groups that were tracked.
        by_group: for each seed one for each group that was tracked, in order of the groups.
    """

    name: str
    reports: tuple[TrackingReport, ...]
    by_group: tuple[tuple[TrackingReport, ...], ...] = ()

    def mean(self, figure: str) -> float:
        """Of a figure of the reports, over the seeds that have it; NaN where none has."""
        values = _values(self.reports, figure)
        return float(np.mean(values)) if values.size else float("nan")

    def std(self, figure: str) -> float:
        """Standard deviation over those seeds."""
        return _deviation(_values(self.reports, figure))

    def group_std(self, figure: str) -> float:
        """Standard deviation over the groups of a seed, root mean square over the seeds; NaN of a single group."""
        values = np.array([_deviation(_values(reports, figure)) for reports in self.by_group])
        values = values[~np.isnan(values)]
        return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _values(reports: Sequence[TrackingReport], figure: str) -> FloatArray:
    """A run may have no vehicle with a gap: then its figures of gaps are undefined."""
    values = np.array([getattr(report, figure) for report in reports], dtype=np.float64)
    return values[~np.isnan(values)]


def _deviation(values: FloatArray) -> float:
    return float(np.std(values, ddof=1)) if values.size > 1 else float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingTable:
    """Every method on the same vehicles, the same measurements, the same gaps.

    Attributes:
        experiment: what it follows from.
        map_learned: whether the map was learned from vehicles of the log that were then not tracked.
        split_by: what these were dealt by; empty where the map was given.
        n_groups: how many groups were tracked, each by itself, over all seeds.
        n_vehicles: how many vehicles, over all seeds.
        n_gaps: how many of them were out of sight once.
        methods: their results.
    """

    experiment: TrackingExperiment
    map_learned: bool
    split_by: str
    n_groups: int
    n_vehicles: int
    n_gaps: int
    methods: tuple[MethodResult, ...]


def evaluate_tracking(
    tracks: Tracks,
    experiment: TrackingExperiment,
    *,
    sensor: Detector,
    primitive_map: PrimitiveMap | None = None,
    sinks: tuple[EstimateSink, ...] = (),
    progress: Callable[[int, int], None] | None = None,
) -> TrackingTable:
    """Run the experiment.

    Args:
        tracks: the truth.
        experiment: what to do.
        sensor: makes detections of tracks, by the experiment's model of it where there is one.
        primitive_map: the prior; left out, it is learned from a part of the vehicles, and the others are tracked. Where
            it is given, the Kalman filters are fitted to the very vehicles they track, which is in their favour.
        sinks: take the frames of the first method in the first seed.
        progress: called with the number of steps done, and their total.

    Raises:
        ValueError: too few vehicles to learn from and to track, or sinks where the first method has no frames.
    """
    if sinks and experiment.methods[0] == RAW:
        raise ValueError(f"methods: expected a tracker first, whose run can be written, got {RAW}")
    pooled: dict[str, list[TrackingReport]] = {}
    by_group: dict[str, list[tuple[TrackingReport, ...]]] = {}
    scored = partial(report, with_ids=experiment.with_ids, scales=experiment.scales)

    def add(name: str, tracked: list[TrackedWorld]) -> None:
        pooled.setdefault(name, []).append(scored(tracked))
        by_group.setdefault(name, []).append(tuple(scored([world]) for world in tracked))

    n_groups = n_vehicles = n_gaps = 0
    steps = StepCount(experiment.n_seeds * (2 + len(experiment.methods)), progress)
    for i in range(experiment.n_seeds):
        deal, learn, sense, fit, filtering = np.random.default_rng([experiment.seed, i]).spawn(5)
        train, test = (tracks, tracks) if primitive_map else held_out(tracks, share=experiment.learn, rng=deal)
        learned = primitive_map
        if learned is None and not set(ON_A_MAP).isdisjoint(experiment.methods):
            learned = learn_primitives(train, rng=learn)
        steps.add()
        sensing = int(sense.integers(2**63))
        scenes = [Scene.of(world, experiment, sensor, seed=sensing) for world in test.worlds()]
        n_groups += len(scenes)
        n_vehicles += test.n_tracks
        n_gaps += sum(np.unique(scene.truth.tracks.vehicle[scene.truth.is_hidden]).size for scene in scenes)
        seeds = filtering.integers(2**63, size=len(experiment.methods))
        made = filters(experiment.methods, learned, train, experiment.filter, sensor=experiment.sensor, rng=fit)
        steps.add()
        for number, method in enumerate(experiment.methods):
            listening = sinks if i == 0 and number == 0 else ()
            if method == RAW:
                add(method, as_reported(scenes, noise_m=experiment.noise_m))
                steps.add()
                continue
            smooth = experiment.smooth and method in SMOOTHED
            tracked = followed(scenes, made[method], experiment, listening, smooth=smooth, seed=int(seeds[number]))
            add(method, tracked.filtered)
            if smooth:
                add(f"{method} smoothed", tracked.smoothed)
            steps.add()
        if experiment.smooth:
            add(BEST, best_in_hindsight(scenes, experiment, acceleration_density=acceleration_density(train)))
    return TrackingTable(
        experiment=experiment, map_learned=primitive_map is None,
        split_by="" if primitive_map else honest_split(tracks), n_groups=n_groups, n_vehicles=n_vehicles, n_gaps=n_gaps,
        methods=tuple(
            MethodResult(name=name, reports=tuple(pooled[name]), by_group=tuple(by_group[name])) for name in pooled
        ),
    )  # fmt: skip


def held_out(tracks: Tracks, *, share: float, rng: np.random.Generator) -> tuple[Tracks, Tracks]:
    """Tracks to learn from, and tracks to be judged by: whole groups where there are several, else whole vehicles.

    Raises:
        ValueError: there is only one.
    """
    column = tracks.group if honest_split(tracks) == "group" else tracks.vehicle
    kinds = np.unique(column)
    if kinds.size < 2:
        raise ValueError(
            f"tracks: expected at least two {honest_split(tracks)}s, got {kinds.size}: give a map to track it with"
        )
    n_train = int(np.clip(round(share * kinds.size), 1, kinds.size - 1))
    is_train = np.isin(column, rng.permutation(kinds)[:n_train])
    return tracks[is_train], tracks[~is_train]
