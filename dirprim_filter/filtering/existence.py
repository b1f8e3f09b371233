"""Is there such a vehicle, in sight or out of it, or is it gone? A Markov chain of three states for each track.

Source: Musicki, Evans and Stankovic, Integrated Probabilistic Data Association, 1994: their "Markov chain two".
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.config import TrackingConfig
from tessellation.arrays import FloatArray

VISIBLE, OCCLUDED, GONE = range(3)


def at_birth(n: int, config: TrackingConfig) -> FloatArray:
    """(n, 3) of detections that nobody expected: a new vehicle's, or false."""
    exists = config.birth_density / (config.birth_density + config.clutter_density)
    return np.tile(np.array([exists, 0.0, 1.0 - exists]), (n, 1))


def later(existence: FloatArray, dt_s: float, config: TrackingConfig) -> FloatArray:
    """(n, 3) -> (n, 3) after `dt_s` seconds in which nobody looked."""
    out, back = config.occlusion_rate, config.reappearance_rate
    stays = np.exp(-config.departure_rate * dt_s)
    mixes = np.exp(-(out + back) * dt_s)
    exists = existence[:, VISIBLE] + existence[:, OCCLUDED]
    settled = exists * back / (out + back)
    visible = stays * (settled + (existence[:, VISIBLE] - settled) * mixes)
    return np.column_stack([visible, stays * exists - visible, 1.0 - stays * exists])


def after_hit(existence: FloatArray, log_density: FloatArray, config: TrackingConfig) -> FloatArray:
    """(n, 3), (n,) -> (n, 3) once a detection was taken for the vehicle's, of this log density under its belief."""
    gain = np.exp(np.clip(log_density - np.log(config.clutter_density), -50.0, 50.0))
    visible = existence[:, VISIBLE] * config.detection_probability * gain
    total = visible + existence[:, GONE] + 1e-300
    return np.column_stack([visible / total, np.zeros_like(visible), existence[:, GONE] / total])


def after_miss(existence: FloatArray, config: TrackingConfig) -> FloatArray:
    """(n, 3) -> (n, 3) once a frame held no detection of the vehicle."""
    seen = existence * np.array([1.0 - config.detection_probability, 1.0, 1.0])
    return np.asarray(seen / seen.sum(axis=1, keepdims=True))


def unseen_for(seconds: FloatArray, config: TrackingConfig) -> FloatArray:
    """(n,) -> (n,) existence of vehicles that would be seen for certain where they in sight, by how long they were not.

    What of the chain is left when the first frame without the vehicle has ruled the visible state out: it is out of
    sight or gone, and one that came back would have been seen.
    """
    hidden = config.occlusion_rate * np.exp(-config.reappearance_rate * np.asarray(seconds))
    return np.where(seconds > 0, hidden / (hidden + config.departure_rate), 1.0)
