"""How much vehicles manoeuvre: the noise that the Kalman baselines need, from the training vehicles."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.tracks import Tracks

MAX_INTERVAL_S = 2.0
LEAST = 1e-6


def acceleration_density(tracks: Tracks) -> float:
    """The spectral density of white acceleration that explains the tracks' changes of velocity, m^2/s^3 per axis.

    Args:
        tracks: training vehicles; consecutive rows up to 2 s apart are used.

    Raises:
        ValueError: no vehicle has two rows near in time.
    """
    order, dt_s, pair = _pairs(tracks)
    heading = np.column_stack([np.cos(tracks.direction[order]), np.sin(tracks.direction[order])])
    gained = np.diff(tracks.speed[order][:, None] * heading, axis=0)[pair]
    return max(float((gained**2).sum() / 2.0 / dt_s[pair].sum()), LEAST)


def pace_density(tracks: Tracks) -> float:
    """The same along the way alone, m^2/s^3: what is left of the acceleration when the turn is known.

    Raises:
        ValueError: no vehicle has two rows near in time.
    """
    order, dt_s, pair = _pairs(tracks)
    gained = np.diff(tracks.speed[order])[pair]
    return max(float((gained**2).sum() / dt_s[pair].sum()), LEAST)


def _pairs(tracks: Tracks) -> tuple[IntArray, FloatArray, BoolArray]:
    """The rows by vehicle and time, the seconds from each to the next, and whether that is the same vehicle soon."""
    vehicle = tracks.vehicle
    order = np.lexsort((tracks.time_ns, vehicle))
    dt_s = np.diff(tracks.time_ns[order]) * 1e-9
    pair = (np.diff(vehicle[order]) == 0) & (dt_s <= MAX_INTERVAL_S)
    if not pair.any():
        raise ValueError("tracks: expected a vehicle with two rows at most 2 s apart, got none")
    return order, dt_s, pair
