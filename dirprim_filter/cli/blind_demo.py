"""`dirprim demo --scene blind`: which tracks last through a ring about a junction in which nothing is detected."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.tracks import Tracks

if TYPE_CHECKING:
    from dirprim_filter.evaluation.tracking_report import TrackingReport

NEAR_M, FAR_M = 25.0, 45.0
"""Borders of the ring, a square about the junction's middle: max(|x|, |y|)."""
MOVING_FROM = 3.0
"""m/s; a picture of tracking shows vehicles that go somewhere."""


def in_ring(position: FloatArray) -> BoolArray:
    """(n, 2) metres -> (n,) whether a place is in the ring."""
    reach = np.abs(position).max(axis=1, initial=0.0)
    return np.asarray((reach >= NEAR_M) & (reach <= FAR_M))


def with_blind_ring(seen: Detections) -> Detections:
    """What is detected outside of the ring, without ids."""
    return seen[~in_ring(seen.position)].without_ids()


def departure_rate(tracks: Tracks) -> float:
    """1/s, how often a vehicle leaves: one time each in all the time that they are watched.

    Where they leave is what a map knows; a tracker without one is given how often.
    """
    vehicle = tracks.vehicle
    last_ns = np.zeros(tracks.n_tracks, np.int64)
    np.maximum.at(last_ns, vehicle, tracks.time_ns)
    watched_s = float((last_ns - tracks.time_ns[tracks.first_rows]).sum()) * 1e-9
    return tracks.n_tracks / watched_s


def busiest_instant(truth: Tracks) -> int:
    """The time at which most moving vehicles are in the ring, ns."""
    times, number = np.unique(truth.time_ns, return_inverse=True)
    there = in_ring(truth.position) & (truth.speed >= MOVING_FROM)
    return int(times[np.argmax(np.bincount(number, there))])


class FrameAt:
    """An `EstimateSink` that keeps the frame of an instant.

    Args:
        time_ns: the instant.

    Attributes:
        frame: the frame kept; None before.
    """

    def __init__(self, time_ns: int) -> None:
        self.frame: TrackedFrame | None = None
        self._time_ns = time_ns

    def write(self, frame: TrackedFrame) -> None:
        """Keep the frame if it is of the instant."""
        if frame.time_ns == self._time_ns:
            self.frame = frame


def blind_report(estimates: Estimates, truth: Tracks) -> TrackingReport:
    """The figures of a tracker that knows no ids."""
    from dirprim_filter.evaluation.tracked_rows import TrackedRows
    from dirprim_filter.evaluation.tracking_report import Scales, TrackingReport

    return TrackingReport.of(
        TrackedRows.of(estimates), truth, is_hidden=in_ring(truth.position), with_ids=False, scales=Scales()
    )


def followers(estimates: Estimates, truth: Tracks) -> AnyArray:
    """(n,) str, the track that follows each row of the truth, as CLEAR MOT matches them; empty where none does."""
    from dirprim_filter.evaluation.metrics.clear_mot import clear_mot
    from dirprim_filter.evaluation.tracked_rows import TrackedRows
    from dirprim_filter.evaluation.tracking_report import Scales

    matched = clear_mot(Scales().comparison(TrackedRows.of(estimates), truth)).matches
    names = estimates.track_id.astype(np.str_)
    of_row = np.full(len(truth), "", names.dtype)
    of_row[matched.row] = names[matched.column]
    return of_row
