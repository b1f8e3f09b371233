"""`dirprim demo --scene blind`: which tracks last through a ring about a junction in which nothing is detected."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray
from dirprim_filter.detections import Detections
from dirprim_filter.distributions.angles import difference
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.tracks import Tracks

if TYPE_CHECKING:
    from dirprim_filter.evaluation.tracking_report import TrackingReport

NEAR_M, FAR_M = 25.0, 45.0
"""Borders of the ring, a square about the junction's middle: max(|x|, |y|)."""
MOVING_FROM = 3.0
"""m/s; a picture of tracking shows vehicles that go somewhere."""
COMPANY = 4
"""So many vehicles are traffic; more make the picture no better, but where they hide from each other in the ring."""
TURN_RATE = 0.17
"""rad/s, of a vehicle on a bend."""


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


def telling_instant(truth: Tracks, *, is_blind: bool) -> tuple[int, str]:
    """The time, ns, and the vehicle that a picture shows: where most moving vehicles are in the ring, or in the middle.

    Of these instants one is better where a vehicle turns, nearest to the middle: there a map beats a straight line.
    """
    times, number = np.unique(truth.time_ns, return_inverse=True)
    moves = truth.speed >= MOVING_FROM
    reach = np.abs(truth.position).max(axis=1)
    there = moves & (in_ring(truth.position) if is_blind else reach <= FAR_M)
    company = np.minimum(np.bincount(number, there)[number], len(times) if is_blind else COMPANY)
    order = np.lexsort((truth.time_ns, truth.vehicle))
    turned = np.zeros(len(truth))
    turned[order[2:]] = np.abs(difference(truth.direction[order[2:]], truth.direction[order[:-2]]))
    turned[order[2:]] /= np.maximum(1e-9 * (truth.time_ns[order[2:]] - truth.time_ns[order[:-2]]), 1e-3)
    same = truth.vehicle[order[2:]] == truth.vehicle[order[:-2]]
    turns = np.zeros(len(truth), np.bool_)
    turns[order[2:]] = same & (turned[order[2:]] >= TURN_RATE)
    row = np.lexsort((reach, ~(turns & moves), -company))[0]
    return int(truth.time_ns[row]), str(truth.track_id[row])


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
        """Keep the frame, and a copy of its particles, if it is of the instant."""
        if frame.time_ns == self._time_ns:
            self.frame = replace(frame, particles=frame.particles.thinned(1))


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
