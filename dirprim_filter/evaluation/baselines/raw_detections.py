"""Detections as they come, for estimates: what a tracker is worth shows beside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.estimates import EstimateList, Estimates
from dirprim_filter.evaluation.scenes import Scene
from dirprim_filter.evaluation.scoring import TrackedWorld


def as_reported(scenes: Sequence[Scene], *, noise_m: float) -> list[TrackedWorld]:
    """Each group's detections as its estimates; a detection without an id is a track of its own.

    Args:
        scenes: the groups, and what the sensor reports of each.
        noise_m: metres, the sensor's standard deviation in each axis, of which the covariances are made.
    """
    return [TrackedWorld(truth=s.truth, estimates=EstimateList(_estimates(s.seen, noise_m))) for s in scenes]


def _estimates(seen: Detections, noise_m: float) -> Estimates:
    n, unknown = len(seen), np.zeros(len(seen))
    own = np.char.add("detection ", np.arange(n).astype(np.str_))
    return Estimates(
        track_id=np.where(seen.track_id == NO_ID, own, seen.track_id), time_ns=seen.time_ns, position=seen.position,
        covariance=np.tile(noise_m**2 * np.eye(2), (n, 1, 1)), direction=unknown, direction_resultant=unknown,
        speed=unknown, speed_std=unknown, effective_sample_size=unknown, log_evidence=unknown,
    )  # fmt: skip
