"""Scores of a tracked log: errors where vehicles are seen and where they are not, GOSPA, and identity switches."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.evaluation.gospa import SwitchCount, gospa
from dirprim_filter.evaluation.tracking import TrackingScore, rmse_by_vehicle, score
from dirprim_filter.tracks import Tracks, as_texts
from tessellation.arrays import AnyArray, BoolArray


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


def report(frames: Iterable[TrackedFrame], truth: Truth, *, cutoff_m: float) -> TrackingReport:
    """Score frames against the truth.

    An estimate is of the vehicle whose name it bears; where no estimate bears the name of a vehicle, as with a sensor
    without ids, it is of the vehicle that GOSPA gives it to.

    Args:
        frames: one at each instant of the truth.
        truth: where vehicles were.
        cutoff_m: GOSPA's, metres.
    """
    tracks, ids = truth.tracks, as_texts(truth.tracks.track_id)
    known = set(np.unique(ids).tolist())
    starts = {int(t): i for t, i in zip(*np.unique(tracks.time_ns, return_index=True), strict=True)}
    ends = np.searchsorted(tracks.time_ns, tracks.time_ns, side="right")
    squared, parts, kept, switches = [], [], [], SwitchCount()
    for frame in frames:
        first = starts[frame.time_ns]
        rows = slice(first, int(ends[first]))
        believed = frame.estimates
        found = gospa(tracks.position[rows], believed.position, cutoff_m=cutoff_m)
        vehicles, names = ids[rows][found.vehicle].tolist(), believed.track_id[found.estimate]
        switches.add(vehicles, as_texts(names).tolist())
        squared.append(found.distance**2)
        parts.append((found.localisation, found.missed, found.false))
        kept.append(_of_vehicles(believed, known, vehicles, found.estimate))
    estimates = Estimates.concatenate(kept)
    seen, hidden = (_scored(estimates, tracks[rows]) for rows in (~truth.is_hidden, truth.is_hidden))
    everything = _scored(estimates, tracks)
    localisation, missed, false = np.mean(parts, axis=0)
    return TrackingReport(
        seen_rmse=seen.position_rmse, hidden_rmse=hidden.position_rmse, seen_nees=seen.nees, hidden_nees=hidden.nees,
        coverage_50=everything.coverage_50, coverage_90=everything.coverage_90, hidden_coverage_90=hidden.coverage_90,
        reported=everything.n_rows / len(tracks), gospa=float(np.sqrt(np.mean(squared))),
        localisation=float(localisation), missed=float(missed), false=float(false), switches=switches.n_switches,
        gap_rmse=tuple(rmse_by_vehicle(estimates, tracks[truth.is_hidden]).tolist()),
    )  # fmt: skip


def _of_vehicles(believed: Estimates, known: set[str], vehicles: list[str], given: AnyArray) -> Estimates:
    """The estimates of known vehicles, under their names."""
    named = np.array([str(name) in known for name in believed.track_id], dtype=np.bool_)
    if named.any():
        return believed[named]
    chosen = believed[given]
    return replace(chosen, track_id=np.array(vehicles, dtype=np.str_))


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
