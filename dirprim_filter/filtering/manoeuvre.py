"""How much vehicles manoeuvre: the noise that the Kalman baselines need, from the training vehicles."""

from __future__ import annotations

import numpy as np

from dirprim_filter.distributions.angles import difference
from dirprim_filter.tracks import Tracks
from tessellation.arrays import BoolArray, FloatArray, IntArray

MAX_INTERVAL_S = 2.0
MOVING_FROM = 0.5
"""m/s; what is slower has no rate of turn."""
LEAST = 1e-6
CHI_SQUARED_MEDIAN = 0.455
"""Of one degree of freedom."""


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


def turn_density(tracks: Tracks) -> float:
    """The spectral density of the white noise that explains changes of the rate of turn, rad^2/s^3.

    Args:
        tracks: training vehicles; three consecutive rows in motion, at most 2 s apart, are used; none gives 0.01.

    Raises:
        ValueError: no vehicle has two rows near in time.
    """
    order, dt_s, pair = _pairs(tracks)
    moving = tracks.speed[order] >= MOVING_FROM
    usable = pair & moving[:-1] & moving[1:]
    rate = difference(tracks.direction[order][1:], tracks.direction[order][:-1]) / np.where(usable, dt_s, 1.0)
    both = usable[1:] & usable[:-1]
    if not both.any():
        return 0.01
    changed, lasted = np.diff(rate)[both], (0.5 * (dt_s[1:] + dt_s[:-1]))[both]
    return max(float(np.median(changed**2 / lasted)) / CHI_SQUARED_MEDIAN, LEAST)  # a jump of the log's is no manoeuvre


def _pairs(tracks: Tracks) -> tuple[IntArray, FloatArray, BoolArray]:
    """The rows by vehicle and time, the seconds from each to the next, and whether that is the same vehicle soon."""
    _, vehicle = np.unique(tracks.track_id, return_inverse=True)
    order = np.lexsort((tracks.time_ns, vehicle))
    dt_s = np.diff(tracks.time_ns[order]) * 1e-9
    pair = (np.diff(vehicle[order]) == 0) & (dt_s <= MAX_INTERVAL_S)
    if not pair.any():
        raise ValueError("tracks: expected a vehicle with two rows at most 2 s apart, got none")
    return order, dt_s, pair
