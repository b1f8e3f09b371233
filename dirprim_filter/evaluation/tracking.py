"""Tracking experiments: what a sensor would report of known traffic, given to every method and scored.

Two methods are compared on the same rows. With ids each row of the truth in which both have an estimate counts; what is
independent are vehicles, or groups where there are several. Without ids which estimate is of which vehicle is for the
tracker to say, so HOTA is compared: group by group, or in a log of one group run by run, which separates noise from
noise and holds for its traffic alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.intervals import Interval, difference_of_means, mean_over, paired, reduction_of_rmse
from dirprim_filter.evaluation.scenes import MakeFilter, Scene, followed
from dirprim_filter.evaluation.scores import RowErrors, TrackedScene, scored
from dirprim_filter.evaluation.settings import Choice
from dirprim_filter.evaluation.splits import held_out, honest_split, steps
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_experiment import CONSTANT_VELOCITY, SMOOTHED, Method, TrackingExperiment
from dirprim_filter.evaluation.tracking_report import TrackingReport
from dirprim_filter.evaluation.without_map import MOST_FITTED, fitted_acceleration
from dirprim_filter.filtering import ConstantVelocityKalman
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.primitives.learning import learn_primitives
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks

Other = Callable[[Sequence[Scene], int], TrackedRows]
"""A tracker of others: scenes of a run, each a group, and the run's seed -> what it says of all of them."""
SMOOTHED_SUFFIX = " smoothed"
"""Ends the name of what a method's smoother wrote."""
SAID = {"prior": "the map", "place-free": "the same filter without the map"}
"""What sentences call methods."""


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
        split_by: how vehicles that the map is learned from were held out of those tracked; empty where it was given.
        groups: of each seed those that were tracked, each by itself.
        n_vehicles: how many vehicles, over all seeds.
        n_gaps: how many of them were out of sight once.
        methods: their results.
        settings: of each seed those of the Kalman filter, by its name.
    """

    experiment: TrackingExperiment
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
    primitive_map: PrimitiveMap | None = None,
    others: Mapping[str, Other] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TrackingTable:
    """Run the experiment.

    Args:
        tracks: the truth.
        experiment: what to do.
        primitive_map: the prior; left out, it is learned from a part of the vehicles, and the others are tracked. Where
            it is given, the Kalman filter and the single cell learn from the very vehicles they track, in their favour.
        others: trackers of others by name, which get the same scenes; their seeds are that of the first run, and on.
        progress: called with the number of steps done, and their total.

    Raises:
        ValueError: too few vehicles to learn from and to track.
    """
    runs: dict[str, list[tuple[TrackingReport, tuple[TrackingReport, ...], RowErrors]]] = {}
    score = partial(scored, with_ids=experiment.with_ids, similarity_m=experiment.similarity_m)

    def add(name: str, tracked: list[TrackedScene]) -> None:
        of_all, errors = score(tracked)
        runs.setdefault(name, []).append((of_all, tuple(score([scene])[0] for scene in tracked), errors))

    groups: list[tuple[int, ...]] = []
    settings: list[Mapping[str, tuple[Choice, ...]]] = []
    n_vehicles = n_gaps = 0
    done = steps(experiment.n_seeds * (1 + len(experiment.methods) + len(others or {})), progress)
    for i in range(experiment.n_seeds):
        deal, learn, sense, fit, filtering, one_cell = np.random.default_rng([experiment.seed, i]).spawn(6)
        train, test = (tracks, tracks) if primitive_map else held_out(tracks, share=experiment.learn, rng=deal)
        scenes = _scenes(test, experiment, seed=int(sense.integers(2**63)))
        made = _on_map(experiment, primitive_map, train, rng=learn, one_cell_rng=one_cell)
        fits: dict[str, tuple[Choice, ...]] = {}
        if CONSTANT_VELOCITY in experiment.methods:
            noise = fitted_acceleration(_seen_in_training(train, experiment, rng=fit), train, experiment.filter)
            fits[CONSTANT_VELOCITY] = (noise,)
            made[CONSTANT_VELOCITY] = partial(
                ConstantVelocityKalman, acceleration_density=noise.chosen, config=experiment.filter
            )
        done()
        groups.append(tuple(scene.group for scene in scenes))
        settings.append(fits)
        n_vehicles += test.n_tracks
        n_gaps += sum(np.unique(scene.truth.vehicle[scene.is_hidden]).size for scene in scenes)
        seeds = filtering.integers(2**63, size=len(experiment.methods))
        for number, method in enumerate(experiment.methods):
            smooth = experiment.smooth and method in SMOOTHED
            tracked = followed(scenes, made[method], experiment, smooth=smooth, seed=int(seeds[number]))
            add(method, tracked.filtered)
            if smooth:
                add(method + SMOOTHED_SUFFIX, tracked.smoothed)
            done()
        for name, track in (others or {}).items():
            rows = track(scenes, experiment.seed + i)
            add(name, [scene.tracked(rows) for scene in scenes])
            done()
    results = [
        MethodResult(name=name, reports=reports, by_group=by_group, errors=errors)
        for name, of in runs.items() for reports, by_group, errors in [zip(*of, strict=True)]
    ]  # fmt: skip
    return TrackingTable(
        experiment=experiment, split_by="" if primitive_map else honest_split(tracks), groups=tuple(groups),
        n_vehicles=n_vehicles, n_gaps=n_gaps, methods=tuple(results), settings=tuple(settings),
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
    return {name: partial(ParticleFilter, of, experiment.filter) for name, of in maps.items()}


def _scenes(tracks: Tracks, experiment: TrackingExperiment, *, seed: int) -> list[Scene]:
    return [Scene.of(group, experiment, seed=seed) for group in tracks.by_group()]


def _seen_in_training(train: Tracks, experiment: TrackingExperiment, *, rng: np.random.Generator) -> Detections:
    """What the sensor reports of some training vehicles, with their gaps, under their names and without clutter."""
    some = train[np.isin(train.vehicle, rng.permutation(train.n_tracks)[:MOST_FITTED])]
    scenes = _scenes(some, replace(experiment, with_ids=True), seed=int(rng.integers(2**63)))
    seen = Detections.concatenate([scene.seen for scene in scenes])
    return seen[np.isin(seen.track_id, some.track_id.astype(np.str_))].in_one_group()


class TrackingComparison(NamedTuple):
    """One method beside another; None where nothing can be compared.

    Attributes:
        first: name of a method,
        other: and of another.
        in_sight: share by which the first's RMSE in sight is below the other's.
        in_gaps: the same in gaps.
        hota: HOTA of the first less that of the other.
    """

    first: str
    other: str
    in_sight: Interval | None
    in_gaps: Interval | None
    hota: Interval | None

    @property
    def sentence(self) -> str:
        """What a reader wants to know; empty where nothing can be compared."""
        of_both = f"{_said(self.first)} against {_said(self.other)}"
        parts = [
            f"{where} {_percent(found)}"
            for where, found in (("in gaps", self.in_gaps), ("in sight", self.in_sight))
            if found is not None
        ]
        if parts:
            return f"{of_both}: error {', '.join(parts)}"
        if self.hota is None:
            return ""
        value, low, high, _ = self.hota
        return f"{of_both}: HOTA {value:+.3f} ({low:+.3f} to {high:+.3f}){_chance(self.hota)}"


def comparisons(table: TrackingTable) -> list[TrackingComparison]:
    """The first method beside each other, filters with filters and smoothers with smoothers."""
    names = [method.name for method in table.methods]
    first = names[0] + SMOOTHED_SUFFIX
    pairs = [(names[0], name) for name in names[1:] if not name.endswith(SMOOTHED_SUFFIX)]
    pairs += [(first, name) for name in names if name.endswith(SMOOTHED_SUFFIX) and name != first and first in names]
    return [compared(table, *pair) for pair in pairs]


def compared(table: TrackingTable, first: str, other: str) -> TrackingComparison:
    """Two methods of a table, over all its seeds."""
    a, b = (next(of for of in table.methods if of.name == name) for name in (first, other))
    if not table.experiment.with_ids:
        hota = paired(_hota_clusters(table), _hotas(a), _hotas(b), difference_of_means)
        return TrackingComparison(first, other, in_sight=None, in_gaps=None, hota=hota)
    in_sight, in_gaps = (_nearer(a, b, is_hidden=is_hidden) for is_hidden in (False, True))
    return TrackingComparison(first, other, in_sight, in_gaps, hota=None)


def _nearer(first: MethodResult, other: MethodResult, *, is_hidden: bool) -> Interval | None:
    columns = [
        (a.cluster[rows], a.squared[rows], b.squared[rows])
        for a, b in zip(first.errors, other.errors, strict=True) for rows in [a.is_hidden == is_hidden]
    ]  # fmt: skip
    cluster, own, others = (np.concatenate(column) for column in zip(*columns, strict=True))
    found = paired(cluster, own, others, reduction_of_rmse)
    return found if found.n_clusters else None


def hota_of(table: TrackingTable, method: MethodResult) -> Interval:
    """Of one method of a table: over groups, the runs' mean of each; of a single group over runs."""
    return mean_over(_hota_clusters(table), _hotas(method))


def _hotas(method: MethodResult) -> FloatArray:
    return np.array([report.hota for seed in method.by_group for report in seed])


def _hota_clusters(table: TrackingTable) -> IntArray:
    groups = np.array([group for seed in table.groups for group in seed])
    runs = np.repeat(np.arange(len(table.groups)), [len(seed) for seed in table.groups])
    return groups if np.unique(groups).size > 1 else runs


def _said(name: str) -> str:
    method, smoothed, _ = name.partition(SMOOTHED_SUFFIX)
    return SAID.get(method, method) + smoothed


def _percent(found: Interval) -> str:
    """A share by which errors are smaller."""
    sign, word = (1.0, "smaller") if found.value >= 0 else (-1.0, "larger")
    return f"{sign * found.value:.0%} {word} ({found.ends('.0%', sign)}){_chance(found)}"


def _chance(found: Interval) -> str:
    return "" if found.is_apart else ", not distinguishable"
