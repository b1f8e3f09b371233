"""Which detection is of which true vehicle, and by how much do the clocks differ?"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial import KDTree

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.filtering.association import Pairs, best_assignment
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

APART_M = 1e6
"""Between frames, in a tree of all: no detection is near a vehicle of another instant."""
LONGEST_GAP_S = 1.0
"""Between two rows of the truth: across more it is not known where a vehicle was."""
SEARCH_S = 60.0
"""Clocks are looked at up to so far apart."""
NEAR_S = 2.0
"""A lag of a sensor: one that fits nearly as well as the best is preferred to a clock that is wrong."""
NEARLY = 0.8
COARSE_S, FINE_S = 0.4, 0.05
COARSE_GATE_M, FINE_GATE_M = 8.0, 3.0
FRAMES_SEARCHED = 200
LEAP = 10.0
"""m/s, by which a step of the truth may differ from the usual pace about it: a satellite fix leaps when it is lost."""
ABOUT = 51
"""Rows about a step from which the usual pace is taken."""
LEAP_S = 0.5
"""Seconds before and after a leap for which the truth is none."""
LONGEST_PAUSE_S = 5.0
"""Between two frames with detections; in shorter ones there were frames that held none."""
SAME_NAMES = 0.5
"""Share of the nearest pairs with equal ids, above which pairs are made by id."""
SHORTEST_FRAME_NS = 5e6
"""Where detections come at times of their own, their gaps may be of nanoseconds: no frames fit in between."""


class TruthRows(NamedTuple):
    """Where true vehicles were at the instants of frames. (n,) rows.

    Attributes:
        frame: (n,) index of the frame.
        vehicle: (n,) index of the vehicle.
        position: (n, 2) metres.
        course: (n, 2) unit vector along the way.
        speed: (n,) m/s.
    """

    frame: IntArray
    vehicle: IntArray
    position: FloatArray
    course: FloatArray
    speed: FloatArray


class Scene:
    """Detections beside the truth.

    Args:
        detections: what the sensor reported.
        truth: where vehicles were, on any clock.

    Attributes:
        frame_s: (f,) seconds of the frames, from the first; frames of different groups are different.
        frame_group: (f,) of them.
        frame_of: (n,) index of the frame of each detection.
        truth_s: (m,) seconds of the truth's rows, vehicle after vehicle.
        names: (v,) of the true vehicles.

    Raises:
        ValueError: one of both is empty.
    """

    def __init__(self, detections: Detections, truth: Tracks) -> None:
        if len(detections) == 0 or len(truth) == 0:
            raise ValueError("expected detections and a truth, got none of one of them")
        self.detections = detections
        epoch_ns = int(detections.time_ns.min())
        frames = frames_of(detections)
        self.frame_group = frames[:, 0]
        self.frame_s: FloatArray = np.asarray((frames[:, 1] - epoch_ns) * 1e-9, np.float64)
        number = {(group, time_ns): i for i, (group, time_ns) in enumerate(frames.tolist())}
        keys = zip(detections.group.tolist(), detections.time_ns.tolist(), strict=True)
        self.frame_of = np.array([number[key] for key in keys], np.int64)
        self._tree = KDTree(self._keyed(detections.position, self.frame_of))
        order = np.lexsort((truth.time_ns, truth.vehicle))
        self.truth_s: FloatArray = np.asarray((truth.time_ns[order] - epoch_ns) * 1e-9, np.float64)
        self._group = truth.group[order]
        self._motion = np.column_stack(
            [truth.position, np.cos(truth.direction), np.sin(truth.direction), truth.speed]
        )[order]  # fmt: skip
        first = np.flatnonzero(np.diff(truth.vehicle[order], prepend=-1))
        self._spans = list(zip(first.tolist(), [*first[1:].tolist(), len(truth)], strict=True))
        self._leaps = [_leaps(self.truth_s[i:j], self._motion[i:j, :2]) for i, j in self._spans]
        self.names = as_texts(truth.track_id[order[first]])

    def truth_at(self, lag_s: float, frames: BoolArray | None = None) -> TruthRows:
        """Where vehicles were `lag_s` before each frame; of the chosen frames (f,)."""
        parts = []
        for vehicle, (start, end) in enumerate(self._spans):
            times, of_group = self.truth_s[start:end], self.frame_group == self._group[start]
            wanted = of_group if frames is None else of_group & frames
            frame = np.flatnonzero(wanted & (self.frame_s - lag_s >= times[0]) & (self.frame_s - lag_s <= times[-1]))
            if frame.size == 0:
                continue
            at = self.frame_s[frame] - lag_s
            after = np.clip(np.searchsorted(times, at), 1, max(times.size - 1, 1))
            known = times[after] - times[after - 1] <= LONGEST_GAP_S if times.size > 1 else np.ones(at.size, np.bool_)
            for leap in self._leaps[vehicle]:
                known &= np.abs(at - leap) > LEAP_S
            frame, at = frame[known], at[known]
            found = np.column_stack([np.interp(at, times, column) for column in self._motion[start:end].T])
            length = np.maximum(np.hypot(*found[:, 2:4].T), 1e-9)
            course = found[:, 2:4] / length[:, None]
            parts.append(TruthRows(frame, np.full(frame.size, vehicle), found[:, :2], course, found[:, 4]))
        nothing = np.empty(0, np.int64)
        none = TruthRows(nothing, nothing, np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
        return TruthRows(*(np.concatenate(column) for column in zip(none, *parts, strict=True)))

    def agreement(self, lag_s: float, frames: BoolArray, *, gate_m: float) -> float:
        """How many of the true rows have a detection near, the nearer the more."""
        distance, _ = self._nearest(self.truth_at(lag_s, frames), gate_m)
        return float(np.maximum(1.0 - (distance / gate_m) ** 2, 0.0).sum())

    def matched(self, rows: TruthRows, *, gate_m: float) -> Pairs:
        """Rows of the truth, each with a detection: by id where ids agree, else the best assignment in a gate."""
        by_name = self._by_name(rows)
        if by_name is not None:
            return by_name
        near: Any = self._tree.query_ball_point(self._keyed(rows.position, rows.frame), gate_m)
        one = np.repeat(np.arange(rows.frame.size), [len(found) for found in near])
        other = np.array([row for found in near for row in found], np.int64)
        distance = np.hypot(*(self.detections.position[other] - rows.position[one]).T)
        return best_assignment(Pairs(one, other), gate_m**2 - distance**2)

    def _by_name(self, rows: TruthRows) -> Pairs | None:
        """The pairs of the same name, if most detections near a vehicle bear its name."""
        reported = as_texts(self.detections.track_id)
        if not np.isin(self.names, reported[reported != NO_ID]).any():
            return None
        distance, nearest = self._nearest(rows, COARSE_GATE_M)
        near = np.isfinite(distance)
        same = self.names[rows.vehicle[near]] == reported[nearest[near]]
        if same.sum() < SAME_NAMES * near.sum():
            return None
        wanted = {key: i for i, key in enumerate(zip(rows.frame.tolist(), self.names[rows.vehicle], strict=True))}
        keys = zip(self.frame_of.tolist(), reported, strict=True)
        pairs = [(wanted[key], row) for row, key in enumerate(keys) if key in wanted]
        return Pairs(*np.array(pairs, np.int64).reshape(-1, 2).T)

    def are_named(self, rows: TruthRows) -> bool:
        """Whether the ids of detections identify the vehicles of the truth."""
        return self._by_name(rows) is not None

    def _nearest(self, rows: TruthRows, gate_m: float) -> tuple[FloatArray, IntArray]:
        """(n,) distance to the nearest detection, infinite beyond the gate, and (n,) which it is."""
        distance, nearest = self._tree.query(self._keyed(rows.position, rows.frame), distance_upper_bound=gate_m)
        return np.asarray(distance, np.float64), np.asarray(nearest, np.int64)

    @staticmethod
    def _keyed(position: FloatArray, frame: IntArray) -> FloatArray:
        return np.column_stack([position, frame * APART_M])


def frames_of(detections: Detections) -> IntArray:
    """(f, 2) group and time of all frames, of those that held no detection as well."""
    parts = []
    for group in np.unique(detections.group):
        times = np.unique(detections.time_ns[detections.group == group])
        gaps = np.diff(times)
        usual = max(float(np.median(gaps)), SHORTEST_FRAME_NS) if gaps.size else 1.0
        empty = [
            np.linspace(start, start + gap, round(gap / usual) + 1)[1:-1].astype(np.int64)
            for start, gap in zip(times[:-1].tolist(), gaps.tolist(), strict=True)
            if 1.5 * usual < gap <= LONGEST_PAUSE_S * 1e9
        ]
        times = np.unique(np.concatenate([times, *empty]))
        parts.append(np.column_stack([np.full(times.size, group), times]))
    return np.concatenate(parts)


def _leaps(time_s: FloatArray, position: FloatArray) -> FloatArray:
    """Times (k,) of steps of one vehicle's truth that no vehicle makes."""
    if time_s.size < 3:
        return np.empty(0)
    pace = np.hypot(*np.diff(position, axis=0).T) / np.maximum(np.diff(time_s), 1e-3)
    return np.asarray(time_s[1:][np.abs(pace - median_filter(pace, ABOUT, mode="nearest")) > LEAP], np.float64)


def find_lag(scene: Scene) -> float:
    """Seconds by which detections are later than the truth: of the sensor, of the clocks, or of both.

    Raises:
        ValueError: they do not overlap in time, or no vehicle is common to both.
    """
    seen, true = ((float(of.min()), float(of.max())) for of in (scene.frame_s, scene.truth_s))
    if seen[0] - SEARCH_S > true[1] or seen[1] + SEARCH_S < true[0]:
        raise ValueError(
            f"truth: expected times like those of the detections, {seen[0]:.1f} to {seen[1]:.1f} s, got "
            f"{true[0]:.1f} to {true[1]:.1f} s by the same clock; are the clocks hours apart?"
        )
    frames = np.zeros(scene.frame_s.size, np.bool_)
    frames[np.linspace(0, frames.size - 1, min(FRAMES_SEARCHED, frames.size)).astype(np.int64)] = True
    lags = COARSE_S * np.arange(-round(SEARCH_S / COARSE_S), round(SEARCH_S / COARSE_S) + 1)
    found = np.array([scene.agreement(lag, frames, gate_m=COARSE_GATE_M) for lag in lags])
    near = np.abs(lags) <= NEAR_S
    best = lags[near][np.argmax(found[near])] if found[near].max() >= NEARLY * found.max() else lags[np.argmax(found)]
    fine = best + np.arange(-COARSE_S, COARSE_S + FINE_S / 2, FINE_S)
    agreement = [scene.agreement(lag, frames, gate_m=FINE_GATE_M) for lag in fine]
    if max(agreement) <= 0.0:
        raise ValueError(
            "truth: expected vehicles that the detections show, got none that is within "
            f"{FINE_GATE_M:g} m of one: is the truth of this place, in the same frame or origin, and of this time?"
        )
    return float(fine[int(np.argmax(agreement))])
