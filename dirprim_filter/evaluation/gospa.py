"""How far is a set of estimates from the set of vehicles? The GOSPA metric and its parts, and identity switches.

Source: Rahmathullah, Garcia-Fernandez and Svensson, Generalized Optimal Sub-Pattern Assignment Metric, 2017, with
alpha = 2, where a missed vehicle and a false track cost half of the cut-off each; Bernardin and Stiefelhagen,
Evaluating Multiple Object Tracking Performance, 2008, for the switches.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from tessellation.arrays import FloatArray, IntArray

ORDER = 2


class Gospa(NamedTuple):
    """The metric of one instant; `localisation + missed + false` is its square.

    Attributes:
        distance: metres.
        localisation: square metres, from estimates to the vehicles they are given to.
        missed: square metres, half the squared cut-off for each vehicle without an estimate.
        false: square metres, the same for each estimate without a vehicle.
        vehicle: rows of the vehicles that are given an estimate.
        estimate: rows of those estimates.
    """

    distance: float
    localisation: float
    missed: float
    false: float
    vehicle: IntArray
    estimate: IntArray


def gospa(truth: FloatArray, estimated: FloatArray, *, cutoff_m: float) -> Gospa:
    """The metric between positions (n, 2) of vehicles and (m, 2) of estimates, metres, of order 2.

    Raises:
        ValueError: the cut-off is not positive.
    """
    if not cutoff_m > 0:
        raise ValueError(f"cutoff_m: expected a positive distance in metres, got {cutoff_m}")
    squared = ((truth[:, None, :] - estimated[None, :, :]) ** 2).sum(axis=-1)
    half = 0.5 * cutoff_m**ORDER
    vehicle, estimate = linear_sum_assignment(np.minimum(squared, 2.0 * half))
    near = squared[vehicle, estimate] < 2.0 * half
    vehicle, estimate = vehicle[near], estimate[near]
    localisation = float(squared[vehicle, estimate].sum())
    missed, false = half * (len(truth) - vehicle.size), half * (len(estimated) - vehicle.size)
    return Gospa(float(np.sqrt(localisation + missed + false)), localisation, missed, false, vehicle, estimate)


class SwitchCount:
    """Counts how often a vehicle is given to another track than the last one it was given to.

    Attributes:
        n_switches: so far.
    """

    def __init__(self) -> None:
        self.n_switches = 0
        self._last: dict[str, str] = {}

    def add(self, vehicles: list[str], tracks: list[str]) -> None:
        """Take the vehicles of one instant and the tracks that they are given to."""
        for vehicle, track in zip(vehicles, tracks, strict=True):
            self.n_switches += self._last.get(vehicle, track) != track
            self._last[vehicle] = track
