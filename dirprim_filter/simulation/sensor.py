"""A sensor that watches the traffic: noisy positions, some vehicles missed, some seen where there are none.

The usual measurement model of multi-target tracking: detection with a fixed probability, Gaussian noise, which may be
late, biased and correlated over time (`Sensor`), and Poisson clutter uniform over the field of view (Bar-Shalom,
Willett, Tian: Tracking and Data Fusion, 2011).
"""

from __future__ import annotations

import math

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.sensor import AxisError, Sensor
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

OUTLIER_EXTENT_M = 100.0
"""Side of the square about a vehicle in which an outlier lies anywhere."""
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
    return _with_false(tracks, seen, position, false_per_frame, rng)


def sense(tracks: Tracks, sensor: Sensor, *, rng: np.random.Generator) -> Detections:
    """What a sensor of such a model reports of vehicles whose true motion is known, in order of time.

    Detections are named as by `detect`. A vehicle is not reported until its first row is a latency old, nor out of
    sight; false ones are in sight. What the model leaves open does not happen: no misses, no false detections, no
    outliers.

    Args:
        tracks: the truth; each of its instants is a frame.
        sensor: the model.
        rng: source of randomness.
    """
    if not len(tracks):
        return Detections.of(tracks)
    missed, astray = 1.0 - (sensor.detection_probability or 1.0), sensor.outlier_share or 0.0
    vehicle = tracks.vehicle
    position, known = np.empty((len(tracks), 2)), np.zeros(len(tracks), np.bool_)
    for rows in np.split(np.argsort(vehicle, kind="stable"), np.cumsum(np.bincount(vehicle))[:-1]):
        position[rows], known[rows] = _late(tracks[rows], sensor, rng)
    strayed = rng.random(len(tracks)) < astray
    half = 0.5 * OUTLIER_EXTENT_M
    position[strayed] = tracks.position[strayed] + rng.uniform(-half, half, (int(strayed.sum()), 2))
    seen = np.flatnonzero(known & (rng.random(len(tracks)) >= missed))
    area = float(np.prod(np.ptp(tracks.position, axis=0)))
    return _with_false(tracks, seen, position[seen], (sensor.clutter_density or 0.0) * area, rng)


def _late(track: Tracks, sensor: Sensor, rng: np.random.Generator) -> tuple[FloatArray, BoolArray]:
    """Of one vehicle (n,) rows: (n, 2) reported positions, and (n,) whether it was there then."""
    time_s = (track.time_ns - track.time_ns[0]) * 1e-9
    at = time_s - sensor.latency_s
    columns = np.column_stack([track.position, np.cos(track.direction), np.sin(track.direction)])
    x, y, cosine, sine = (np.interp(at, time_s, column) for column in columns.T)
    length = np.maximum(np.hypot(cosine, sine), 1e-9)
    cosine, sine = cosine / length, sine / length
    along, across = _errors(sensor.along, time_s, rng), _errors(sensor.across, time_s, rng)
    reported = np.column_stack([x + along * cosine - across * sine, y + along * sine + across * cosine])
    return reported, at >= 0.0


def _errors(axis: AxisError, time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(n,) metres at times (n,): the bias, a first-order Gauss-Markov process, and white noise."""
    kept = np.exp(-np.diff(time_s, prepend=-np.inf) / axis.correlation_s)
    correlated = np.sqrt(1.0 - kept**2) * rng.standard_normal(time_s.size)
    for i in range(1, time_s.size):
        correlated[i] += kept[i] * correlated[i - 1]
    white = rng.standard_normal(time_s.size)
    return np.asarray(
        axis.bias_m + math.sqrt(axis.correlated_variance) * correlated + math.sqrt(axis.white_variance) * white
    )


def _with_false(
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
    )
