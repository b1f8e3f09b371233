"""How often a sensor reports a vehicle, and how often where there is none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.evaluation.calibration.pairing import APART_M, Scene, TruthRows
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


def share(n: int, of: int) -> Measured:
    """A share by its count, with half a count to either side so that none is certain."""
    value = (n + 0.5) / (of + 1.0)
    return Measured(value, float(np.sqrt(value * (1.0 - value) / (of + 1.0))))


def detection_probability(rows: TruthRows, is_hit: BoolArray) -> Measured | None:
    """Of a vehicle between its first and its last detection; misses in a row count as fewer. None of too few frames.

    Args:
        rows: (n,) vehicles at the frames.
        is_hit: (n,) whether each was detected.
    """
    order = np.lexsort((rows.frame, rows.vehicle))
    of_vehicles = np.split(is_hit[order], np.flatnonzero(np.diff(rows.vehicle[order])) + 1)
    # the ends are where they are because they were seen; of vehicles never seen, a sensor may not report their kind
    hits = [hit[np.argmax(hit) + 1 : hit.size - 1 - np.argmax(hit[::-1])] for hit in of_vehicles if hit.any()]
    n = sum(of.size for of in hits)
    if n < FEWEST_FRAMES:
        return None
    found = share(sum(int(of.sum()) for of in hits), n)
    off = [of - found.value for of in hits]
    variance = sum(float((of**2).sum()) for of in off) / n
    product = sum(float((of[1:] * of[:-1]).sum()) for of in off) / max(n - len(off), 1)
    correlation = float(np.clip(product / variance, 0.0, 0.95)) if variance > 0 else 0.0
    return Measured(found.value, found.error * float(np.sqrt((1.0 + correlation) / (1.0 - correlation))))


def clutter(scene: Scene, rows: TruthRows, detected: IntArray) -> Measured | None:
    """Stray detections per square metre of the truth's bounding box, and frame.

    Args:
        scene: detections beside the truth.
        rows: vehicles at the frames.
        detected: detections that are of vehicles.

    Returns:
        None where stray detections continue from frame to frame: the truth does not contain all vehicles.
    """
    low, high = rows.position.min(axis=0), rows.position.max(axis=0)
    area = float(np.prod(np.maximum(high - low, 1.0)))
    covered = np.unique(rows.frame)
    position = scene.detections.position
    stray = np.isin(scene.frame_of, covered) & ((position >= low) & (position <= high)).all(axis=1)
    stray[detected] = False
    if scene.are_named(rows):  # at the ends of the truth as well
        stray &= ~np.isin(as_texts(scene.detections.track_id), scene.names)
    if _go_on(scene, position[stray], scene.frame_of[stray], area):
        return None
    n, exposure = int(stray.sum()), area * covered.size
    return Measured((n + 0.5) / exposure, float(np.sqrt(n + 1.0)) / exposure)


def _go_on(scene: Scene, position: FloatArray, frame: IntArray, area: float) -> bool:
    """Whether more of the detections than by chance have another near them in the next frame."""
    if position.shape[0] < FEWEST_FRAMES:
        return False
    step_s = float(np.median(np.diff(scene.frame_s))) if scene.frame_s.size > 1 else 0.0
    reach = 0.5 + FASTEST * max(step_s, 0.0)
    tree = KDTree(np.column_stack([position, frame * APART_M]))
    distance, _ = tree.query(np.column_stack([position, (frame + 1) * APART_M]), distance_upper_bound=reach)
    per_frame = position.shape[0] / max(np.unique(frame).size, 1)
    by_chance = 1.0 - np.exp(-per_frame * np.pi * reach**2 / area)
    return bool(np.isfinite(distance).mean() > by_chance + GOING_ON)
