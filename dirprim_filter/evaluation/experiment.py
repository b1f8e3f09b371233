"""Tracking experiments: what a sensor would report of known traffic, given to every method and scored."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateSink
from dirprim_filter.evaluation.rivals import RAW, RIVALS, SMOOTHED, FittedRival, MakeFilter, Method, fitted
from dirprim_filter.evaluation.scenes import Scene, as_reported, followed
from dirprim_filter.evaluation.scoring import RowErrors, TrackedWorld, report, row_errors
from dirprim_filter.evaluation.settings import Choice
from dirprim_filter.evaluation.splits import held_out, honest_split, steps
from dirprim_filter.evaluation.tracking_experiment import Detector, TrackingExperiment
from dirprim_filter.evaluation.tracking_report import TrackingReport
from dirprim_filter.filtering.particle_filter import bayes_filter_of
from dirprim_filter.primitives import PrimitiveMap, learn_primitives
from dirprim_filter.tracks import Tracks

SMOOTHED_SUFFIX = " smoothed"
"""Ends the name of what a method's smoother wrote."""
MOST_FITTED = 20
"""Training vehicles that the Kalman filters are fitted to, drawn at random."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodResult:
    """What one method reached.

    Attributes:
        name: of the method, and whether it is its smoother's.
        reports: one for each seed, pooled over the groups that were tracked.
        by_group: for each seed one for each group that was tracked, in order of the groups.
        errors: for each seed those of the truth's rows, the same rows for every method.
    """

    name: str
    reports: tuple[TrackingReport, ...]
    by_group: tuple[tuple[TrackingReport, ...], ...] = ()
    errors: tuple[RowErrors, ...] = field(default=(), repr=False, compare=False)

    def mean(self, figure: str) -> float:
        """Of a figure of the reports, over the seeds that have it; NaN where none has."""
        values = _values(self.reports, figure)
        return float(np.mean(values)) if values.size else float("nan")

    def std(self, figure: str) -> float:
        """Standard deviation over those seeds."""
        values = _values(self.reports, figure)
        return float(np.std(values, ddof=1)) if values.size > 1 else float("nan")


def _values(reports: Sequence[TrackingReport], figure: str) -> FloatArray:
    """A run may have no vehicle with a gap: then its figures of gaps are undefined."""
    values = np.array([getattr(report, figure) for report in reports], dtype=np.float64)
    return values[~np.isnan(values)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingTable:
    """Every method on the same vehicles, the same measurements, the same gaps.

    Attributes:
        experiment: what it follows from.
        map_learned: whether the map was learned from vehicles of the log that were then not tracked.
        split_by: what these were dealt by; empty where the map was given.
        groups: of each seed those that were tracked, each by itself.
        n_vehicles: how many vehicles, over all seeds.
        n_gaps: how many of them were out of sight once.
        methods: their results.
        settings: of each seed those of the fitted rivals, by the rival's name.
    """

    experiment: TrackingExperiment
    map_learned: bool
    split_by: str
    groups: tuple[tuple[int, ...], ...]
    n_vehicles: int
    n_gaps: int
    methods: tuple[MethodResult, ...]
    settings: tuple[Mapping[str, tuple[Choice, ...]], ...]

    @property
    def n_groups(self) -> int:
        """Groups that were tracked, over all seeds."""
        return sum(map(len, self.groups))


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
            it is given, the rivals and the single cell learn from the very vehicles they track, in their favour.
        sinks: take the frames of the first method in the first seed.
        progress: called with the number of steps done, and their total.

    Raises:
        ValueError: too few vehicles to learn from and to track, or sinks where the first method has no frames.
    """
    if sinks and experiment.methods[0] == RAW:
        raise ValueError(f"methods: expected a tracker first, whose run can be written, got {RAW}")
    runs: dict[str, list[tuple[TrackingReport, tuple[TrackingReport, ...], RowErrors]]] = {}

    def add(name: str, tracked: list[TrackedWorld]) -> None:
        scored = partial(report, with_ids=experiment.with_ids, scales=experiment.scales)
        errors = row_errors(tracked, with_ids=experiment.with_ids, scales=experiment.scales)
        runs.setdefault(name, []).append((scored(tracked), tuple(scored([world]) for world in tracked), errors))

    groups: list[tuple[int, ...]] = []
    settings: list[dict[str, tuple[Choice, ...]]] = []
    n_vehicles = n_gaps = 0
    done = steps(experiment.n_seeds * (1 + len(experiment.methods)), progress)
    for i in range(experiment.n_seeds):
        deal, learn, sense, fit, filtering, one_cell = np.random.default_rng([experiment.seed, i]).spawn(6)
        train, test = (tracks, tracks) if primitive_map else held_out(tracks, share=experiment.learn, rng=deal)
        scenes = _scenes(test, experiment, sensor, seed=int(sense.integers(2**63)))
        made = _on_map(experiment, primitive_map, train, rng=learn, one_cell_rng=one_cell)
        rivals = [name for name in RIVALS if name in experiment.methods]
        seen = _seen_in_training(train, experiment, sensor, rng=fit)
        made |= {name: fitted(name, seen, train, experiment.filter) for name in rivals}
        done()
        groups.append(tuple(scene.group for scene in scenes))
        settings.append({name: of.settings for name, of in made.items() if isinstance(of, FittedRival)})
        n_vehicles += test.n_tracks
        n_gaps += sum(np.unique(scene.truth.tracks.vehicle[scene.truth.is_hidden]).size for scene in scenes)
        seeds = filtering.integers(2**63, size=len(experiment.methods))
        for number, method in enumerate(experiment.methods):
            listening = sinks if i == 0 and number == 0 else ()
            if method == RAW:
                add(method, as_reported(scenes, noise_m=experiment.noise_m))
            else:
                smooth = experiment.smooth and method in SMOOTHED
                tracked = followed(scenes, made[method], experiment, listening, smooth=smooth, seed=int(seeds[number]))
                add(method, tracked.filtered)
                if smooth:
                    add(method + SMOOTHED_SUFFIX, tracked.smoothed)
            done()
    results = [
        MethodResult(name=name, reports=reports, by_group=by_group, errors=errors)
        for name, of in runs.items() for reports, by_group, errors in [zip(*of, strict=True)]
    ]  # fmt: skip
    return TrackingTable(
        experiment=experiment, map_learned=primitive_map is None,
        split_by="" if primitive_map else honest_split(tracks), groups=tuple(groups), n_vehicles=n_vehicles,
        n_gaps=n_gaps, methods=tuple(results), settings=tuple(settings),
    )  # fmt: skip


def _on_map(
    experiment: TrackingExperiment, given: PrimitiveMap | None, train: Tracks, *, rng: np.random.Generator,
    one_cell_rng: np.random.Generator,
) -> dict[Method, MakeFilter]:  # fmt: skip
    """What makes the filters of the methods on a map: given, or learned from the training vehicles."""
    maps: dict[Method, PrimitiveMap] = {}
    if {"prior", "place-free"}.intersection(experiment.methods):
        learned = given or learn_primitives(train, rng=rng)
        maps = {"prior": learned, "place-free": learned.without_places()}
    if "one cell" in experiment.methods:
        maps["one cell"] = learn_primitives(train, tessellation="grid", n_cells=1, rng=one_cell_rng)
    return {name: partial(bayes_filter_of, of, experiment.filter, experiment.sensor) for name, of in maps.items()}


def _scenes(tracks: Tracks, experiment: TrackingExperiment, sensor: Detector, *, seed: int) -> list[Scene]:
    return [Scene.of(world, experiment, sensor, seed=seed) for world in tracks.worlds()]


def _seen_in_training(
    train: Tracks, experiment: TrackingExperiment, sensor: Detector, *, rng: np.random.Generator
) -> Detections:
    """What the sensor reports of some training vehicles, with their gaps, under their names and without clutter."""
    some = train[np.isin(train.vehicle, rng.permutation(train.n_tracks)[:MOST_FITTED])]
    scenes = _scenes(some, replace(experiment, with_ids=True), sensor, seed=int(rng.integers(2**63)))
    seen = Detections.concatenate([scene.seen for scene in scenes])
    return seen[np.isin(seen.track_id, some.track_id.astype(np.str_))].in_one_world()
