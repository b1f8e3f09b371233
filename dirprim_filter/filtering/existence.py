"""Probability that a track is a vehicle, visible or occluded: one Markov chain of three states for every track.

The same for labelled and unlabelled tracks: a track is initialised by one detection, and each frame, a hit or a miss,
updates the probability by Bayes' rule.

Source: Musicki, Evans and Stankovic, Integrated Probabilistic Data Association, 1994: their "Markov chain two".
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.config import TrackingConfig

VISIBLE, OCCLUDED, GONE = range(3)
"""The states: visible, occluded, or gone: the vehicle left, or the track always was a false detection."""


def at_birth(first: FloatArray, config: TrackingConfig) -> FloatArray:
    """(n, 3) after the detection that initialises a track: the first of a vehicle, or a false one.

    Args:
        first: (n,) density of first detections that was expected there, see `Undetected`.
        config: density of false ones.
    """
    exists = first / (first + config.clutter_density)
    return np.column_stack([exists, np.zeros_like(exists), 1.0 - exists])


def probability(existence: FloatArray, outside: FloatArray) -> FloatArray:
    """(n, 3) -> (n,) probability that there is a vehicle, visible or occluded.

    Args:
        existence: by state.
        outside: (n,) probability that the vehicle is outside of the map's cells: there one that is occluded has left,
            a visible one has not.
    """
    return np.asarray(existence[:, VISIBLE] + existence[:, OCCLUDED] * (1.0 - outside))


def later(
    existence: FloatArray,
    dt_s: FloatArray,
    config: TrackingConfig,
    *,
    ends: FloatArray | float = 0.0,
    pace: FloatArray | float = 1.0,
) -> FloatArray:
    """(n, 3) -> (n, 3) after `dt_s` (n,) seconds without a frame.

    Args:
        existence: by state.
        dt_s: seconds.
        config: rates.
        ends: 1/s, (n,), rate of departure at the place, beside that of the configuration.
        pace: (n,) by which the rates of the configuration are multiplied.
    """
    out, back = pace * config.occlusion_rate, pace * config.reappearance_rate
    stays = np.exp(-(pace * config.departure_rate + ends) * dt_s)
    mixes = np.exp(-(out + back) * dt_s)
    exists = existence[:, VISIBLE] + existence[:, OCCLUDED]
    balance = exists * back / (out + back)
    visible = stays * (balance + (existence[:, VISIBLE] - balance) * mixes)
    return np.column_stack([visible, stays * exists - visible, 1.0 - stays * exists])


def after_hit(
    existence: FloatArray, log_density: FloatArray, by_chance: FloatArray, config: TrackingConfig
) -> FloatArray:
    """(n, 3) -> (n, 3) after a hit: an assigned detection with this log density (n,) under the track's belief.

    The detection is of the vehicle; or it is clutter, or the first of another vehicle, expected there in this density
    together (n,), and then this one was missed or is not there.
    """
    gain = np.exp(np.clip(log_density - np.log(by_chance), -50.0, 50.0))
    p = config.detection_probability
    return _normalised(existence * np.column_stack([1.0 - p + p * gain, np.ones_like(gain), np.ones_like(gain)]))


def after_miss(existence: FloatArray, config: TrackingConfig) -> FloatArray:
    """(n, 3) -> (n, 3) after a miss: a frame without a detection of the vehicle."""
    return _normalised(existence * np.array([1.0 - config.detection_probability, 1.0, 1.0]))


def _normalised(weight: FloatArray) -> FloatArray:
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))
