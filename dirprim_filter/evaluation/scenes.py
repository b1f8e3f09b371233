"""The groups of a log as a tracking experiment shows them to every method, and each method's way through them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray
from dirprim_filter.config import TrackingConfig
from dirprim_filter.detections import NO_TIME, Detections
from dirprim_filter.estimates import EstimateList, EstimateSink
from dirprim_filter.evaluation.scores import TrackedScene
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment
from dirprim_filter.filtering import BayesFilter, Tracker
from dirprim_filter.filtering.smoother import Smoother
from dirprim_filter.replay import Look, follow
from dirprim_filter.simulation.sensor import detect
from dirprim_filter.tracks import Tracks

MakeFilter = Callable[[], BayesFilter]
MARGIN_S = 2.0
"""A gap leaves the vehicle in sight so long before and after it: what is lost must have been found, and be found."""

LEAST_SIDE_M = 1.0
"""Of the area in which false detections lie: vehicles that stand, or drive straight east, span none."""


def gaps(tracks: Tracks, *, gap_s: float, rng: np.random.Generator) -> BoolArray:
    """(n,) rows in which a vehicle is out of sight: once each, for `gap_s`, away from the ends of its track."""
    if gap_s <= 0:
        return np.zeros(len(tracks), np.bool_)
    vehicle, first = tracks.vehicle, tracks.first_rows
    where = rng.random(first.size)  # drawn for all, so that no vehicle's gap depends on another's length
    last_ns = np.full(first.size, NO_TIME)
    np.maximum.at(last_ns, vehicle, tracks.time_ns)
    since_s = (tracks.time_ns - tracks.time_ns[first][vehicle]) * 1e-9
    room_s = (last_ns - tracks.time_ns[first]) * 1e-9 - gap_s - 2.0 * MARGIN_S
    start_s = (MARGIN_S + where * room_s)[vehicle]
    return np.asarray((room_s[vehicle] >= 0) & (since_s > start_s) & (since_s <= start_s + gap_s))


def honest_tracking(tracks: Tracks, experiment: TrackingExperiment) -> TrackingConfig:
    """The true parameters of the sensor in one group, for the association of every method."""
    area = float(np.prod(np.maximum(np.ptp(tracks.position, axis=0), LEAST_SIDE_M)))
    instants = np.unique(tracks.time_ns).size
    n_new = tracks.n_tracks - np.count_nonzero(tracks.time_ns == tracks.time_ns.min())
    occlusion = 1.0 / 20.0 if experiment.gap_s > 0 else 1e-3
    return TrackingConfig(
        detection_probability=min(1.0 - experiment.miss_rate, 0.99),
        clutter_density=max(experiment.false_per_frame, 1e-6) / area,
        birth_density=max(n_new / instants, 1e-3) / area,
        vehicle_density=len(tracks) / instants / area,
        occlusion_rate=occlusion,
        reappearance_rate=1.0 / max(experiment.gap_s, 1.0),
    )


class Scene(NamedTuple):
    """One group of the log as all methods get it.

    Attributes:
        truth: where its vehicles were.
        is_hidden: (n,) in which rows the sensor did not see them.
        seen: what the sensor reports.
        tracking: parameters of the association.
    """

    truth: Tracks
    is_hidden: BoolArray
    seen: Detections
    tracking: TrackingConfig

    @classmethod
    def of(cls, truth: Tracks, experiment: TrackingExperiment, *, seed: int) -> Scene:
        """The scene of a group's tracks: it follows from the seed and its number, whatever the other groups are."""
        rng = np.random.default_rng(_seed_of(seed, int(truth.group[0])))
        hidden = gaps(truth, gap_s=experiment.gap_s, rng=rng)
        return cls(
            truth=truth, is_hidden=hidden, seen=_report_of(truth, hidden, experiment, rng=rng),
            tracking=experiment.tracking or honest_tracking(truth, experiment),
        )  # fmt: skip

    @property
    def group(self) -> int:
        """Its number."""
        return int(self.truth.group[0])

    def tracked(self, rows: TrackedRows) -> TrackedScene:
        """The scene beside what a tracker says of it; rows of other groups are left out."""
        return TrackedScene(self.truth, self.is_hidden, rows[rows.group == self.group])


def _seed_of(seed: int, group: int) -> list[int]:
    return [seed, group % (1 << 64)]


def _report_of(
    tracks: Tracks, hidden: BoolArray, experiment: TrackingExperiment, *, rng: np.random.Generator
) -> Detections:
    """What the sensor reports, less what is out of its sight."""
    seen = detect(
        tracks, noise_m=experiment.noise_m, miss_rate=experiment.miss_rate,
        false_per_frame=experiment.false_per_frame, rng=rng,
    )  # fmt: skip
    behind = {(str(name), t) for name, t in zip(tracks.track_id[hidden], tracks.time_ns[hidden].tolist(), strict=True)}
    shown = [(name, t) not in behind for name, t in zip(seen.track_id.tolist(), seen.time_ns.tolist(), strict=True)]
    seen = seen[np.array(shown, dtype=np.bool_)]
    seen = replace(seen, group=np.full(len(seen), tracks.group[0]))
    return seen if experiment.with_ids else seen.without_ids()


class Followed(NamedTuple):
    """The groups as a method tracked them, and as its smoother did, where one was asked for."""

    filtered: list[TrackedScene]
    smoothed: list[TrackedScene]


def followed(
    scenes: Sequence[Scene], make: MakeFilter, experiment: TrackingExperiment, *, smooth: bool = False, seed: int
) -> Followed:
    """Each group tracked by a tracker of its own, at every instant of its truth: those with nothing seen included."""
    result = Followed([], [])
    for scene in scenes:
        found, later = EstimateList(), EstimateList()
        smoother = Smoother(sinks=[later.write])
        sinks: list[EstimateSink] = [found, smoother] if smooth else [found]
        tracker = (partial(smoother.tracker, 0) if smooth else Tracker)(
            make(), config=experiment.filter, tracking=scene.tracking,
            rng=np.random.default_rng(_seed_of(seed, scene.group)),
        )  # fmt: skip
        frames = {int(frame.time_ns[0]): frame for frame in scene.seen.frames()}
        with smoother:
            instants = np.unique(scene.truth.time_ns).tolist()
            follow((Look(at, frames.get(at, Detections.none()), [0]) for at in instants), tracker, sinks)
        result.filtered.append(scene.tracked(TrackedRows.of(found.all(), group=scene.group)))
        if smooth:
            result.smoothed.append(scene.tracked(TrackedRows.of(later.all(), group=scene.group)))
    return result
