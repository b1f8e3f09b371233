"""Which detection is of which true vehicle, and by how much do the clocks differ?"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial import KDTree

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.evaluation.truth import interpolated, known_at
from dirprim_filter.filtering.association import Pairs, best_pairs
from dirprim_filter.track_ids import as_texts, rows_of_each
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
        course: (n, 2) unit vector along the course.
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
        truth_s: (m,) seconds of the truth's rows.
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
        self.frame_group, self._frame_ns = frames.T
        self.frame_s: FloatArray = np.asarray((self._frame_ns - epoch_ns) * 1e-9, np.float64)
        own = np.column_stack([detections.group, detections.time_ns])
        _, number = np.unique(np.concatenate([frames, own]), axis=0, return_inverse=True)  # as frames are sorted
        self.frame_of: IntArray = number.ravel()[len(frames) :].astype(np.int64)
        self._tree = KDTree(self._keyed(detections.position, self.frame_of))
        self.truth_s: FloatArray = np.asarray((truth.time_ns - epoch_ns) * 1e-9, np.float64)
        self.names = as_texts(truth.track_id[truth.first_rows])
        self._truth, self._vehicle = truth, truth.vehicle
        self._is_sure = ~_leaps(truth)

    def truth_at(self, lag_s: float, frames: BoolArray | None = None) -> TruthRows:
        """Where vehicles were `lag_s` before each frame; of the chosen frames (f,)."""
        frame = np.arange(self.frame_s.size) if frames is None else np.flatnonzero(frames)
        time_ns = self._frame_ns[frame] - round(lag_s * 1e9)
        found = known_at(self._truth, self.frame_group[frame], time_ns, longest_gap_s=LONGEST_GAP_S)
        kept = np.flatnonzero(self._is_sure[found.before] & self._is_sure[found.after])
        kept = kept[np.argsort(time_ns[found.instant[kept]], kind="stable")]  # as tracks are
        instant, before, after = (column[kept] for column in found)
        at = interpolated(self._truth, before, after, time_ns[instant])
        course = np.column_stack([np.cos(at.direction), np.sin(at.direction)])
        return TruthRows(frame[instant], self._vehicle[before], at.position, course, at.speed)

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
        best = best_pairs(one, other, gate_m**2 - distance**2)
        return Pairs(one[best], other[best])

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


def _leaps(truth: Tracks) -> BoolArray:
    """(n,) rows of the truth near a step that no vehicle makes."""
    is_near = np.zeros(len(truth), np.bool_)
    for rows in rows_of_each(truth.vehicle):
        if rows.size < 3:
            continue
        time_s = (truth.time_ns[rows] - truth.time_ns[rows[0]]) * 1e-9
        pace = np.hypot(*np.diff(truth.position[rows], axis=0).T) / np.maximum(np.diff(time_s), 1e-3)
        leap_s = time_s[1:][np.abs(pace - median_filter(pace, ABOUT, mode="nearest")) > LEAP]
        is_near[rows] = (np.abs(time_s[:, None] - leap_s) <= LEAP_S).any(axis=1)
    return is_near


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
