"""Scores of a tracked log: errors where vehicles are seen and where they are not, GOSPA, and identity switches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.evaluation.gospa import SwitchCount, gospa
from dirprim_filter.evaluation.tracking import TrackingScore, rmse_by_vehicle, score
from dirprim_filter.tracks import Tracks, as_texts
from tessellation.arrays import BoolArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Where vehicles were, and in which rows (n,) they were out of the sensor's sight."""

    tracks: Tracks
    is_hidden: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingReport:
    """One method's errors in one run.

    Attributes:
        seen_rmse: metres, of vehicles in sight.
        hidden_rmse: metres, inside gaps; NaN where there are none.
        seen_nees: mean normalised squared error; 2 where the covariances tell the truth.
        hidden_nees: inside gaps.
        coverage_50: share of the true positions in the ellipses that should hold half of them, seen and hidden.
        coverage_90: likewise, nine tenths.
        hidden_coverage_90: inside gaps.
        reported: share of the truth's rows that have an estimate.
        gospa: metres, root mean square over the frames.
        localisation: square metres per frame, its part of `gospa` squared.
        missed: likewise.
        false: likewise.
        switches: how often a vehicle went over to another track.
        gap_rmse: (g,) metres, inside the gap of each vehicle that has one, by name; NaN where nothing was told of it.
    """

    seen_rmse: float
    hidden_rmse: float
    seen_nees: float
    hidden_nees: float
    coverage_50: float
    coverage_90: float
    hidden_coverage_90: float
    reported: float
    gospa: float
    localisation: float
    missed: float
    false: float
    switches: float
    gap_rmse: tuple[float, ...]


class WorldScore:
    """Scores the frames of one group against its truth, as they come.

    An estimate is of the vehicle whose name it bears, with a sensor that names vehicles; else of the vehicle that GOSPA
    gives it to.

    Args:
        truth: where the group's vehicles were.
        cutoff_m: GOSPA's, metres.
        with_ids: whether names are the sensor's; those that the tracker makes up mean nothing.
    """

    def __init__(self, truth: Truth, *, cutoff_m: float, with_ids: bool) -> None:
        self.truth = truth
        self.squared: list[float] = []
        self.parts: list[tuple[float, float, float]] = []
        self.kept: list[Estimates] = []
        self.switches = SwitchCount()
        self._cutoff_m = cutoff_m
        self._with_ids = with_ids
        tracks = truth.tracks
        self._ids = as_texts(tracks.track_id)
        times, starts = np.unique(tracks.time_ns, return_index=True)
        ends = [*starts[1:].tolist(), len(tracks)]
        self._rows = dict(zip(times.tolist(), map(slice, starts.tolist(), ends), strict=True))

    def add(self, frame: TrackedFrame) -> None:
        """Take the frame of one of the truth's instants."""
        rows, believed = self._rows[frame.time_ns], frame.estimates
        ids = self._ids[rows]
        found = gospa(self.truth.tracks.position[rows], believed.position, cutoff_m=self._cutoff_m)
        vehicles, names = ids[found.vehicle].tolist(), as_texts(believed.track_id[found.estimate])
        self.switches.add(vehicles, names.tolist())
        self.squared.append(found.distance**2)
        self.parts.append((found.localisation, found.missed, found.false))
        if self._with_ids:
            self.kept.append(believed)
        else:
            self.kept.append(replace(believed[found.estimate], track_id=np.array(vehicles, dtype=np.str_)))


def report(worlds: Sequence[WorldScore]) -> TrackingReport:
    """The errors in one group, or pooled over all: each row, frame and switch counts as in any other group."""
    estimates = Estimates.concatenate([_apart(part, i) for i, world in enumerate(worlds) for part in world.kept])
    tracks = Tracks.concatenate([_apart(world.truth.tracks, i) for i, world in enumerate(worlds)])
    is_hidden = np.concatenate([world.truth.is_hidden for world in worlds])
    if len(worlds) > 1:  # as the tracks were put in order of time
        is_hidden = is_hidden[np.argsort(np.concatenate([w.truth.tracks.time_ns for w in worlds]), kind="stable")]
    seen, hidden = (_scored(estimates, tracks[rows]) for rows in (~is_hidden, is_hidden))
    everything = _scored(estimates, tracks)
    localisation, missed, false = np.mean([part for world in worlds for part in world.parts], axis=0)
    squared = np.concatenate([world.squared for world in worlds])
    return TrackingReport(
        seen_rmse=seen.position_rmse, hidden_rmse=hidden.position_rmse, seen_nees=seen.nees, hidden_nees=hidden.nees,
        coverage_50=everything.coverage_50, coverage_90=everything.coverage_90, hidden_coverage_90=hidden.coverage_90,
        reported=everything.n_rows / len(tracks), gospa=float(np.sqrt(squared.mean())),
        localisation=float(localisation), missed=float(missed), false=float(false),
        switches=sum(world.switches.n_switches for world in worlds),
        gap_rmse=tuple(rmse_by_vehicle(estimates, tracks[is_hidden]).tolist()),
    )  # fmt: skip


Rows = TypeVar("Rows", Estimates, Tracks)


def _apart(rows: Rows, world: int) -> Rows:
    """The rows under names that no other world has."""
    return replace(rows, track_id=np.char.add(f"{world}/", as_texts(rows.track_id)))


def _scored(estimates: Estimates, truth: Tracks) -> TrackingScore:
    """The score, of NaN where no estimate has a truth."""
    try:
        return score(estimates, truth)
    except ValueError:
        nan = float("nan")
        return TrackingScore(
            n_rows=0, n_vehicles=0, position_rmse=nan, direction_rmse=nan, speed_rmse=nan, nees=nan,
            coverage_50=nan, coverage_90=nan,
        )  # fmt: skip
