"""Which track is which true vehicle, and what happens to both: exchanges of ids, vehicles that are lost, ghosts.

They are matched frame by frame: by name, or where detections have no ids by place, as CLEAR MOT does.

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


class Event(NamedTuple):
    """What has happened: a line; and on the map a word at a place, (2,) metres, None for what the map does not show."""

    level: str
    text: str
    word: str = ""
    place: FloatArray | None = None


class Events:
    """Compares each frame with those before."""

    def __init__(self) -> None:
        self._coasting: dict[str, bool] = {}
        self._track_of: dict[str, str] = {}
        self._alone_since: dict[tuple[str, str], int] = {}

    def of(self, frame: TrackedFrame, matched: Matched | None) -> list[Event]:
        """What has changed."""
        now = dict(zip(frame.names, frame.estimates.is_coasting.tolist(), strict=True))
        before, self._coasting = self._coasting, now
        said = [f"{name} ended" for name in before if name not in now]
        said += [f"{name} initialised" for name in now if name not in before]
        changed = (name for name, coasts in now.items() if coasts != before.get(name, False))
        said += [f"{name} {'coasts' if now[name] else 'measured again'}" for name in changed]
        found = [Event("INFO", text) for text in said]
        anew = "reinitialised: its belief did not explain its measurements"
        found += [Event("WARN", f"{name} {anew}") for name in frame.reinitialised if name in now]
        return found if matched is None else found + self._against(frame, matched)

    def _against(self, frame: TrackedFrame, matched: Matched) -> list[Event]:
        """Exchanges of ids; vehicles without a track for 1 s, which are lost, tracks without a vehicle, ghosts."""
        found, alone = [], dict[tuple[str, str], FloatArray]()
        vehicle_of = {frame.names[row]: name for name, row in zip(matched.names, matched.row, strict=True) if row >= 0}
        for name, row, place in zip(matched.names, matched.row.tolist(), matched.position, strict=True):
            if row < 0:
                alone["lost", f"vehicle {name}: lost, no track near it for 1 s"] = place
                continue
            own, last = frame.names[row], self._track_of.get(name, frame.names[row])
            self._track_of[name] = own
            if own != last:
                other = f"; {last} now follows {vehicle_of[last]}" if last in vehicle_of else ""
                found.append(Event("WARN", f"vehicle {name}: exchange, {last} was its track, now {own}{other}",
                                   "exchange", place))  # fmt: skip
        places = dict(zip(frame.names, frame.estimates.position, strict=True))
        alone |= {
            ("ghost", f"{name}: ghost, no vehicle near it for 1 s"): place
            for name, place in places.items()
            if name not in vehicle_of
        }
        self._alone_since = {who: self._alone_since.get(who, frame.time_ns) for who in alone}
        for (word, text), since_ns in self._alone_since.items():
            if frame.time_ns - since_ns >= 1_000_000_000:
                self._alone_since[word, text] = np.iinfo(np.int64).max  # once
                found.append(Event("WARN", text, word, alone[word, text]))
        return found
