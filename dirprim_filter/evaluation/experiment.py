"""Tracking experiments: what a sensor would report of known traffic, given to every method and scored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Protocol

import numpy as np

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateSink, TrackedFrame
from dirprim_filter.evaluation.methods import METHODS, Method, filters
from dirprim_filter.evaluation.scoring import TrackingReport, Truth, report
from dirprim_filter.evaluation.splits import honest_split
from dirprim_filter.evaluation.steps import StepCount
from dirprim_filter.filtering import Tracker
from dirprim_filter.primitives import PrimitiveMap, learn_primitives
from dirprim_filter.tracks import Tracks
from tessellation.arrays import BoolArray, FloatArray

MARGIN_S = 2.0
"""A gap leaves the vehicle in sight so long before and after it: what is lost must have been found, and be found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingExperiment:
    """All that a result follows from, beside the log and the map.

    Attributes:
        noise_m: metres, standard deviation of a reported position in each axis.
        miss_rate: probability that a vehicle is not reported in a frame.
        false_per_frame: mean number of false detections in a frame, anywhere among the tracks.
        gap_s: seconds for which each vehicle is out of sight once; 0 for never. Vehicles watched for less than that and
            two seconds before and after it have no gap.
        with_ids: the sensor names its vehicles; false detections then have names of their own.
        learn: share of the vehicles, or groups, that a map is learned from where none is given; the others are tracked.
        n_seeds: how many times all is drawn anew.
        seed: of the first.
        cutoff_m: metres, farther than which an estimate is not of a vehicle, in GOSPA.
        methods: which are compared.
        filter: knobs of the filters; its noise is the sensor's.
        tracking: knobs of association; left out, what is true of the sensor.
    """

    noise_m: float = 0.5
    miss_rate: float = 0.0
    false_per_frame: float = 0.0
    gap_s: float = 3.0
    with_ids: bool = True
    learn: float = 0.7
    n_seeds: int = 5
    seed: int = 0
    cutoff_m: float = 5.0
    methods: tuple[Method, ...] = METHODS
    filter: FilterConfig = field(default_factory=FilterConfig)
    tracking: TrackingConfig | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "methods", tuple(self.methods))
        unknown = [name for name in self.methods if name not in METHODS]
        if unknown or not self.methods:
            raise ValueError(f"methods: expected some of {', '.join(METHODS)}, got {', '.join(unknown) or 'none'}")
        for name in ("noise_m", "cutoff_m", "n_seeds"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: expected a positive number, got {getattr(self, name)}")
        for name in ("false_per_frame", "gap_s", "seed"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: expected at least 0, got {getattr(self, name)}")
        if not 0 <= self.miss_rate < 1:
            raise ValueError(f"miss_rate: expected a probability below 1, got {self.miss_rate}")
        if not 0 < self.learn < 1:
            raise ValueError(f"learn: expected a share between 0 and 1, got {self.learn}")
        object.__setattr__(self, "filter", replace(self.filter, noise_m=self.noise_m))

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> TrackingExperiment:
        """The experiment of a configuration file: its names are the attributes', `filter` and `tracking` are tables.

        Raises:
            ValueError: an unknown name, or a value out of range.
        """
        plain = dict(told)
        for name, kind in (("filter", FilterConfig), ("tracking", TrackingConfig)):
            if plain.get(name) is not None:
                plain[name] = _config_of(kind, plain[name], where=name)
        made: TrackingExperiment = _config_of(cls, plain, where="experiment")
        return made


def _config_of(kind: type[Any], told: object, *, where: str) -> Any:
    """A configuration from the names and values of a file.

    Raises:
        ValueError: a name that is none of its knobs, or a value of another type.
    """
    if not isinstance(told, Mapping):
        raise ValueError(f"{where}: expected a table of names and values, got {told!r}")  # noqa: TRY004 - a file's, no caller's
    known = {f.name: f.type for f in fields(kind)}
    for name, value in told.items():
        if name not in known:
            raise ValueError(f"{where}: {name}: expected one of {', '.join(known)}")
        plain = {"float": (int, float), "int": (int,), "bool": (bool,)}.get(str(known[name]), (object,))
        if not isinstance(value, plain) or (isinstance(value, bool) and bool not in plain and object not in plain):
            raise ValueError(f"{where}: {name}: expected a value of type {known[name]}, got {value!r}")
    return kind(**told)


class Sensor(Protocol):
    """Reports tracks: `simulation.sensor.detect`."""

    def __call__(
        self, tracks: Tracks, *, noise_m: float, miss_rate: float, false_per_frame: float, rng: np.random.Generator
    ) -> Detections:
        """What is reported, in order of time."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodResult:
    """One method's reports, one for each seed."""

    name: Method
    reports: tuple[TrackingReport, ...]

    def mean(self, figure: str) -> float:
        """Of a figure of the reports, over the seeds that have it; NaN where none has."""
        values = self._told(figure)
        return float(np.mean(values)) if values.size else float("nan")

    def std(self, figure: str) -> float:
        """Standard deviation over those seeds."""
        values = self._told(figure)
        return float(np.std(values, ddof=1)) if values.size > 1 else float("nan")

    def _told(self, figure: str) -> FloatArray:
        """A seed may have drawn vehicles without a gap: then it tells nothing of gaps."""
        values = np.array([getattr(r, figure) for r in self.reports], dtype=np.float64)
        return values[~np.isnan(values)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingTable:
    """Every method on the same vehicles, the same measurements, the same gaps.

    Attributes:
        experiment: what it follows from.
        map_learned: whether the map was learned from vehicles of the log that were then not tracked.
        split_by: what these were dealt by; empty where the map was given.
        n_vehicles: how many were tracked, over all seeds.
        n_gaps: how many of them were out of sight once.
        methods: their results.
    """

    experiment: TrackingExperiment
    map_learned: bool
    split_by: str
    n_vehicles: int
    n_gaps: int
    methods: tuple[MethodResult, ...]


def evaluate_tracking(
    tracks: Tracks,
    experiment: TrackingExperiment,
    *,
    sensor: Sensor,
    primitive_map: PrimitiveMap | None = None,
    sinks: tuple[EstimateSink, ...] = (),
    progress: Callable[[int, int], None] | None = None,
) -> TrackingTable:
    """Run the experiment.

    Args:
        tracks: the truth.
        experiment: what to do.
        sensor: makes detections of tracks.
        primitive_map: the prior; left out, it is learned from a part of the vehicles, and the others are tracked. Where
            it is given, the Kalman filters are fitted to the very vehicles they track, which is in their favour.
        sinks: take the frames of the first method in the first seed.
        progress: told how many of how many steps are done.

    Raises:
        ValueError: too few vehicles to learn from and to track.
    """
    reports: dict[Method, list[TrackingReport]] = {method: [] for method in experiment.methods}
    n_vehicles = n_gaps = 0
    told = StepCount(experiment.n_seeds * (2 + len(experiment.methods)), progress)
    for i in range(experiment.n_seeds):
        deal, learn, sense, fit, filtering = np.random.default_rng([experiment.seed, i]).spawn(5)
        train, test = (tracks, tracks) if primitive_map else held_out(tracks, share=experiment.learn, rng=deal)
        learned = primitive_map or learn_primitives(train, rng=learn)
        told.add()
        hidden = gaps(test, gap_s=experiment.gap_s, rng=sense)
        seen = _report_of(test, hidden, experiment, sensor, rng=sense)
        truth = Truth(tracks=test, is_hidden=hidden)
        tracking = experiment.tracking or honest_tracking(test, experiment)
        n_vehicles += test.n_tracks
        n_gaps += int(np.unique(test.track_id[hidden]).size)
        seeds = filtering.integers(2**63, size=len(experiment.methods))
        made = filters(experiment.methods, learned, train, experiment.filter, rng=fit)
        told.add()
        for number, (method, make) in enumerate(made.items()):
            tracker = Tracker(
                make(), config=experiment.filter, tracking=tracking, rng=np.random.default_rng(seeds[number])
            )
            listening = sinks if i == 0 and number == 0 else ()
            reports[method].append(
                report(_followed(tracker, seen, test, listening), truth, cutoff_m=experiment.cutoff_m)
            )
            told.add()
    return TrackingTable(
        experiment=experiment, map_learned=primitive_map is None,
        split_by="" if primitive_map else honest_split(tracks), n_vehicles=n_vehicles, n_gaps=n_gaps,
        methods=tuple(MethodResult(name=name, reports=tuple(found)) for name, found in reports.items()),
    )  # fmt: skip


def held_out(tracks: Tracks, *, share: float, rng: np.random.Generator) -> tuple[Tracks, Tracks]:
    """Tracks to learn from, and tracks to be judged by: whole groups where there are several, else whole vehicles.

    Raises:
        ValueError: there is only one.
    """
    column = tracks.group if honest_split(tracks) == "group" else tracks.track_id
    kinds = np.unique(column)
    if kinds.size < 2:
        raise ValueError(
            f"tracks: expected at least two {honest_split(tracks)}s, got {kinds.size}: give a map to track it with"
        )
    n_train = int(np.clip(round(share * kinds.size), 1, kinds.size - 1))
    is_train = np.isin(column, rng.permutation(kinds)[:n_train])
    return tracks[is_train], tracks[~is_train]


def gaps(tracks: Tracks, *, gap_s: float, rng: np.random.Generator) -> BoolArray:
    """(n,) rows in which a vehicle is out of sight: once each, for `gap_s`, away from the ends of its track."""
    hidden = np.zeros(len(tracks), np.bool_)
    if gap_s <= 0:
        return hidden
    names, first, vehicle = np.unique(tracks.track_id, return_index=True, return_inverse=True)
    where = rng.random(names.size)  # drawn for all, so that no vehicle's gap depends on another's length
    last_ns = np.zeros(names.size, np.int64)
    np.maximum.at(last_ns, vehicle, tracks.time_ns)
    since_s = (tracks.time_ns - tracks.time_ns[first][vehicle]) * 1e-9
    room_s = (last_ns - tracks.time_ns[first]) * 1e-9 - gap_s - 2.0 * MARGIN_S
    start_s = (MARGIN_S + where * room_s)[vehicle]
    hidden[:] = (room_s[vehicle] >= 0) & (since_s > start_s) & (since_s <= start_s + gap_s)
    return hidden


def honest_tracking(tracks: Tracks, experiment: TrackingExperiment) -> TrackingConfig:
    """The association's knobs as they are true of the sensor, the same for every method."""
    area = float(np.prod(np.ptp(tracks.position, axis=0)))
    instants = np.unique(tracks.time_ns).size
    occlusion = 1.0 / 20.0 if experiment.gap_s > 0 else 1e-3
    return TrackingConfig(
        detection_probability=min(1.0 - experiment.miss_rate, 0.99),
        clutter_density=max(experiment.false_per_frame, 0.01) / area,
        birth_density=max(tracks.n_tracks / instants, 1e-3) / area,
        occlusion_rate=occlusion,
        reappearance_rate=1.0 / max(experiment.gap_s, 1.0),
    )


def _report_of(
    tracks: Tracks, hidden: BoolArray, experiment: TrackingExperiment, sensor: Sensor, *, rng: np.random.Generator
) -> Detections:
    """What the sensor reports, less what is out of its sight."""
    seen = sensor(
        tracks, noise_m=experiment.noise_m, miss_rate=experiment.miss_rate,
        false_per_frame=experiment.false_per_frame, rng=rng,
    )  # fmt: skip
    behind = {(str(name), t) for name, t in zip(tracks.track_id[hidden], tracks.time_ns[hidden].tolist(), strict=True)}
    shown = [(name, t) not in behind for name, t in zip(seen.track_id.tolist(), seen.time_ns.tolist(), strict=True)]
    seen = seen[np.array(shown, dtype=np.bool_)]
    return seen if experiment.with_ids else seen.without_ids()


def _followed(
    tracker: Tracker, seen: Detections, truth: Tracks, sinks: tuple[EstimateSink, ...]
) -> Iterator[TrackedFrame]:
    """The tracked frames at every instant of the truth, those in which nothing was seen included."""
    frames = {int(frame.time_ns[0]): frame for frame in seen.frames()}
    for time_ns in np.unique(truth.time_ns).tolist():
        detections = frames.get(time_ns, Detections.none())
        tracker.predict(detections, time_ns=time_ns)
        tracker.weigh()
        frame = TrackedFrame(
            time_ns=time_ns, detections=detections, estimates=tracker.estimate(), particles=tracker.particles()
        )
        for sink in sinks:
            sink.write(frame)
        yield frame
        tracker.resample()
