"""A sensor that watches the traffic: noisy positions, some vehicles missed, some seen where there are none.

The usual measurement model of multi-target tracking: detection with a fixed probability, white Gaussian noise, and
Poisson clutter uniform over the field of view (Bar-Shalom, Willett, Tian: Tracking and Data Fusion, 2011).
"""

from __future__ import annotations

import math

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

FALSE = "false-"
"""Prefix of the ids of false detections."""


def detect(
    tracks: Tracks,
    *,
    noise_m: float = 0.5,
    miss_rate: float = 0.05,
    false_per_frame: float = 0.2,
    rng: np.random.Generator,
) -> Detections:
    """What a sensor reports of vehicles whose true motion is known, in order of time.

    Args:
        tracks: the truth; each of its instants is a frame.
        noise_m: standard deviation of the noise in x and in y, m.
        miss_rate: probability that a vehicle is not reported in a frame, independent of all else.
        false_per_frame: mean number of false detections in a frame; Poisson, uniform over the bounding box of
            the tracks. Each has an id of its own, `false-<k>`; a true detection has its vehicle's.
        rng: source of randomness.

    Raises:
        ValueError: a parameter out of range.
    """
    if not (math.isfinite(noise_m) and noise_m >= 0):
        raise ValueError(f"noise_m: expected at least 0 m, got {noise_m}")
    if not 0 <= miss_rate <= 1:
        raise ValueError(f"miss_rate: expected a probability in [0, 1], got {miss_rate}")
    if not (math.isfinite(false_per_frame) and false_per_frame >= 0):
        raise ValueError(f"false_per_frame: expected at least 0, got {false_per_frame}")
    if not len(tracks):
        return Detections.of(tracks)
    seen = np.flatnonzero(rng.random(len(tracks)) >= miss_rate)
    position = tracks.position[seen] + noise_m * rng.standard_normal((seen.size, 2))
    return with_false(tracks, seen, position, false_per_frame, rng)


def with_false(
    tracks: Tracks, seen: IntArray, position: FloatArray, false_per_frame: float, rng: np.random.Generator
) -> Detections:
    """Positions of the rows that were seen, and false ones among them, in order of time."""
    frames = np.unique(tracks.time_ns)
    false_time_ns = np.repeat(frames, rng.poisson(false_per_frame, frames.size))
    n_false = false_time_ns.size
    false_position = rng.uniform(tracks.position.min(axis=0), tracks.position.max(axis=0), (n_false, 2))
    false_id = np.char.add(FALSE, np.arange(n_false).astype(np.str_))
    time_ns = np.concatenate([tracks.time_ns[seen], false_time_ns])
    order = np.argsort(time_ns, kind="stable")
    return Detections(
        track_id=np.concatenate([as_texts(tracks.track_id[seen]), false_id])[order],
        time_ns=time_ns[order],
        position=np.concatenate([position, false_position])[order],
        origin=tracks.origin,
    )
