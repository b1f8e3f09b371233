"""How often a sensor reports a vehicle, and how often where there is none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.evaluation.calibration.blindness import Passages, Surveyed, clearly_seen, learn_sight
from dirprim_filter.evaluation.calibration.pairing import APART_M, Scene, TruthRows
from dirprim_filter.filtering.association import Pairs
from dirprim_filter.track_ids import as_texts

FEWEST_FRAMES = 30
"""Fewest frames in which a vehicle may be seen or missed, of all vehicles together."""
FASTEST = 20.0
"""m/s: a stray detection continues in the next frame if one is within the distance of this speed."""
GOING_ON = 0.3
"""Share of stray detections that continue in the next frame beyond chance, above which they are of vehicles."""


class Measured(NamedTuple):
    """A number and its standard error."""

    value: float
    error: float


class Reported:
    """Which rows of the truth were detected, and which detections are stray.

    Args:
        scene: detections beside the truth.
        rows: positions of vehicles at the frames.
        pairs: rows, each with its detection.

    Attributes:
        scene: as given.
        rows: as given.
        pairs: as given.
        sight: where the sensor sees, by where vehicles were detected; None for everywhere, for all that is known.
        hits: of each vehicle, whether it was detected in each frame from its first detection to its last, while in
            sight.
        are_named: whether the ids of detections are those of the truth.
        stray: detections that belong to no vehicle of the truth.
    """

    def __init__(self, scene: Scene, rows: TruthRows, pairs: Pairs) -> None:
        self.scene, self.rows, self.pairs = scene, rows, pairs
        is_hit = np.zeros(rows.frame.size, np.bool_)
        is_hit[pairs.one] = True
        order = np.lexsort((rows.frame, rows.vehicle))
        was_seen = np.bincount(rows.vehicle, weights=is_hit) > 0  # of others, a sensor may not report their kind
        passages = Passages(rows.vehicle, rows.position, is_hit)[order[was_seen[rows.vehicle[order]]]]
        self.sight = learn_sight(passages)
        in_sight = clearly_seen(self.sight, passages.position)
        self.hits: list[BoolArray] = []
        of_vehicles = np.split(np.arange(in_sight.size), np.flatnonzero(np.diff(passages.vehicle)) + 1)
        for of_vehicle in of_vehicles:
            seen = of_vehicle[passages.is_hit[of_vehicle]]
            between = np.arange(seen[0] + 1, seen[-1])  # the ends are where they are because they were seen
            self.hits.append(passages.is_hit[between[in_sight[between]]])
        self.are_named = scene.are_named(rows)
        is_stray = np.ones(len(scene.detections), np.bool_)
        is_stray[pairs.other] = False
        if self.are_named:  # at the ends of the truth as well
            is_stray &= ~np.isin(as_texts(scene.detections.track_id), scene.names)
        self.stray = np.flatnonzero(is_stray)


def share(n: int, of: int) -> Measured:
    """A share by its count, with half a count to either side so that none is certain."""
    value = (n + 0.5) / (of + 1.0)
    return Measured(value, float(np.sqrt(value * (1.0 - value) / (of + 1.0))))


def detection_probability(reported: Reported) -> Measured | None:
    """Of a vehicle between its first and its last detection; misses in a row count as fewer. None of too few frames."""
    hits = reported.hits
    n = sum(of.size for of in hits)
    if n < FEWEST_FRAMES:
        return None
    found = share(sum(int(of.sum()) for of in hits), n)
    off = [of - found.value for of in hits]
    variance = sum(float((of**2).sum()) for of in off) / n
    product = sum(float((of[1:] * of[:-1]).sum()) for of in off) / max(n - len(off), 1)
    correlation = float(np.clip(product / variance, 0.0, 0.95)) if variance > 0 else 0.0
    return Measured(found.value, found.error * float(np.sqrt((1.0 + correlation) / (1.0 - correlation))))


def clutter(reported: Reported) -> tuple[Measured | None, str]:
    """Stray detections per square metre of the truth's bounding box in sight, and frame; or why that is not known."""
    scene, position = reported.scene, reported.rows.position
    low, high = position.min(axis=0), position.max(axis=0)
    surveyed = Surveyed(reported.sight, position, low, high)
    covered = np.unique(reported.rows.frame)
    where = scene.detections.position[reported.stray]
    counted = surveyed.contains(where) & np.isin(scene.frame_of[reported.stray], covered)
    stray = reported.stray[counted]
    if _go_on(scene, scene.detections.position[stray], scene.frame_of[stray], surveyed.area):
        return None, "stray detections continue from frame to frame: the truth does not contain all vehicles"
    exposure = surveyed.area * covered.size
    return Measured((stray.size + 0.5) / exposure, float(np.sqrt(stray.size + 1.0)) / exposure), ""


def _go_on(scene: Scene, position: FloatArray, frame: IntArray, area: float) -> bool:
    """Whether more of the detections than by chance have another near them in the next frame."""
    if position.shape[0] < FEWEST_FRAMES:
        return False
    step_s = float(np.median(np.diff(scene.frame_s))) if scene.frame_s.size > 1 else 0.0
    reach = 0.5 + FASTEST * max(step_s, 0.0)
    tree = KDTree(np.column_stack([position, frame * APART_M]))
    ahead = np.column_stack([position, (frame + 1) * APART_M])
    distance, _ = tree.query(ahead, distance_upper_bound=reach)
    per_frame = position.shape[0] / max(np.unique(frame).size, 1)
    by_chance = 1.0 - np.exp(-per_frame * np.pi * reach**2 / area)
    return bool(np.isfinite(distance).mean() > by_chance + GOING_ON)
