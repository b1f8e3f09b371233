"""Which track is which true vehicle, frame by frame: by name, or where detections have no ids by place, as CLEAR MOT.

Source: Bernardin and Stiefelhagen, Evaluating Multiple Object Tracking Performance: The CLEAR MOT Metrics, 2008.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.evaluation.metrics.clear_mot import MATCH_FROM, UNMATCHED, matched_at_once
from dirprim_filter.evaluation.metrics.comparison import SIMILARITY_M
from dirprim_filter.evaluation.tracking_report import normalised_squared
from dirprim_filter.evaluation.truth import INTERVALS, LEAST_GAP_S, interpolated, known_at, usual_interval_s
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks


class Matched(NamedTuple):
    """The true vehicles of one frame, and their tracks.

    Attributes:
        names: n ids of the vehicles.
        position: (n, 2) metres.
        row: (n,) of the frame's estimates; `UNMATCHED` where there is none.
        error: (n,) metres from the track; NaN without one.
        nees: (n,) the same squared, in units of the track's covariance.
    """

    names: Sequence[str]
    position: FloatArray
    row: IntArray
    error: FloatArray
    nees: FloatArray


class Matcher:
    """Follows from frame to frame which track each vehicle has.

    Args:
        truth: of one group, or with names that no two groups share. Between two rows that are near enough it is
            interpolated, as `evaluation.truth` does.
    """

    def __init__(self, truth: Tracks) -> None:
        self._truth = replace(truth, track_id=as_texts(truth.track_id), group=np.zeros(len(truth), np.int64))
        self._longest_gap_s = max(LEAST_GAP_S, INTERVALS * usual_interval_s(self._truth))
        self._names, self._last = frozenset(self._truth.track_id.tolist()), dict[str, str]()

    def match(self, frames: Sequence[TrackedFrame]) -> list[Matched]:
        """The vehicles of frames, ascending in time."""
        times = np.array([frame.time_ns for frame in frames], np.int64)
        known = known_at(self._truth, np.zeros_like(times), times, longest_gap_s=self._longest_gap_s)
        order = np.argsort(known.instant, kind="stable")
        instant, before, after = (column[order] for column in known)
        there = interpolated(self._truth, before, after, times[instant])
        ends = np.searchsorted(instant, np.arange(len(frames) + 1))
        return [
            self._of(frame, there.track_id[first:last], there.position[first:last])
            for frame, first, last in zip(frames, ends, ends[1:], strict=False)
        ]

    def _of(self, frame: TrackedFrame, names: AnyArray, position: FloatArray) -> Matched:
        estimates, vehicles, tracks = frame.estimates, as_texts(names).tolist(), frame.names
        place = {name: i for i, name in enumerate(tracks)}
        if self._names.intersection(tracks):
            row = np.array([place.get(name, UNMATCHED) for name in vehicles], np.int64)
        else:
            before = [place.get(self._last.get(name, ""), UNMATCHED) for name in vehicles]
            of = [np.array([name.rpartition("/")[0] for name in names], np.str_) for names in (vehicles, tracks)]
            is_near = (of[0][:, None] == of[1]) | (of[0] == "")[:, None] | (of[1] == "")  # no two groups
            row = _nearest(position, estimates, np.array(before, np.int64), is_near)
        own = np.flatnonzero(row >= 0)
        self._last |= {vehicles[i]: tracks[row[i]] for i in own.tolist()}
        error, nees = (np.full(len(vehicles), np.nan) for _ in range(2))
        off = position[own] - estimates.position[row[own]]
        error[own] = np.hypot(*off.T)
        nees[own] = normalised_squared(off, estimates.covariance[row[own]])
        return Matched(names=vehicles, position=position, row=row, error=error, nees=nees)


def _nearest(position: FloatArray, estimates: Estimates, before: IntArray, is_near: BoolArray) -> IntArray:
    """(n,) rows of the estimates: those `before` while they are near enough, and of the others the best assignment.

    Near is as `dirprim score` counts exchanges, or within 99.9 % of the track's Gaussian of the plane.
    """
    off = position[:, None] - estimates.position
    precision = np.linalg.inv(estimates.covariance + 1e-12 * np.eye(2))
    distance = np.hypot(off[..., 0], off[..., 1])
    squared = np.einsum("vti,tij,vtj->vt", off, precision, off)
    is_near &= (distance <= (1.0 - MATCH_FROM) * SIMILARITY_M) | (squared <= 13.8)
    vehicle, track = np.nonzero(is_near)
    matched = matched_at_once(vehicle, track, 1.0 / (1.0 + distance[vehicle, track]), before)
    row = np.full(len(position), UNMATCHED)
    row[vehicle[matched]] = track[matched]
    return row
