"""How much vehicles manoeuvre: the noise that the Kalman baselines need, from the training vehicles."""

from __future__ import annotations

import numpy as np

from dirprim_filter.tracks import Tracks

MAX_INTERVAL_S = 2.0
LEAST = 1e-6


def acceleration_density(tracks: Tracks, *, along: bool = False) -> float:
    """The spectral density of white acceleration that explains the tracks' changes of velocity, m^2/s^3 per axis.

    Args:
        tracks: training vehicles; consecutive rows up to 2 s apart are used.
        along: of changes of speed alone: what is left when the turn is known.

    Raises:
        ValueError: no vehicle has two rows near in time.
    """
    vehicle = tracks.vehicle
    order = np.lexsort((tracks.time_ns, vehicle))
    dt_s = np.diff(tracks.time_ns[order]) * 1e-9
    pair = (np.diff(vehicle[order]) == 0) & (dt_s <= MAX_INTERVAL_S)
    if not pair.any():
        raise ValueError("tracks: expected a vehicle with two rows at most 2 s apart, got none")
    axes = np.ones((len(tracks), 1)) if along else np.column_stack([np.cos(tracks.direction), np.sin(tracks.direction)])
    gained = np.diff((tracks.speed[:, None] * axes)[order], axis=0)[pair]
    return max(float((gained**2).sum() / axes.shape[1] / dt_s[pair].sum()), LEAST)
