"""A sensor by its model: detections that are late, biased, and err for a while. Slow and obvious, for tests."""

import math

import numpy as np

from dirprim_filter.detections import Detections
from dirprim_filter.simulation.sensor import with_false

OUTLIER_EXTENT_M = 100.0
"""Side of the square about a vehicle in which an outlier lies anywhere."""


def sense(tracks, sensor, *, rng):
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
    return with_false(tracks, seen, position[seen], (sensor.clutter_density or 0.0) * area, rng)


def _late(track, sensor, rng):
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


def _errors(axis, time_s, rng):
    """(n,) metres at times (n,): the bias, a first-order Gauss-Markov process, and white noise."""
    kept = np.exp(-np.diff(time_s, prepend=-np.inf) / axis.correlation_s)
    correlated = np.sqrt(1.0 - kept**2) * rng.standard_normal(time_s.size)
    for i in range(1, time_s.size):
        correlated[i] += kept[i] * correlated[i - 1]
    white = rng.standard_normal(time_s.size)
    share = math.sqrt(axis.correlated_share) * correlated + math.sqrt(1.0 - axis.correlated_share) * white
    return np.asarray(axis.bias_m + axis.spread_m * share)
