"""The vehicle ahead: how drivers go on behind a leader.

Car-following models (Gipps 1981; Treiber, Hennecke and Helbing 2000) state how a driver accelerates by its speed, the
gap to its leader and the leader's speed. Here that law is learned, see `leader_learning`. One of its features is the
speed that is safe at a gap g behind a leader of speed l, by Gipps with equal braking b, after a reaction time t, and
with 7 m from centre to centre in a queue: -b t + sqrt((b t)^2 + l^2 + 2 b max(g - 7 m, 0)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dirprim_filter.arrays import FloatArray, as_floats

N_FEATURES = 10
N_PACES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class LeaderResponse:
    """How vehicles accelerate, and start, behind others.

    Attributes:
        gain: (10,) of the acceleration, m/s^2, by each of the features of `_leader.describe`.
        push: m/s^2, standard deviation of a driver's own acceleration beside that.
        trust: share of that acceleration; the rest is the primitive's.
        start_rate: (3,) 1/s, how often a vehicle that stands starts behind one that stands, that has just started, and
            that drives.

    Raises:
        ValueError: columns of other lengths, numbers that are not finite, negative amounts, or a share above 1.
    """

    gain: FloatArray
    push: float
    trust: float
    start_rate: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "gain", as_floats("gain", self.gain, f"{N_FEATURES}"))
        object.__setattr__(self, "start_rate", as_floats("start_rate", self.start_rate, f"{N_PACES}"))
        if not (0.0 <= self.push < np.inf and 0.0 <= self.trust <= 1.0 and (self.start_rate >= 0.0).all()):
            raise ValueError(
                "push, trust, start_rate: expected no negative numbers, and a share, "
                f"got {self.push}, {self.trust} and {self.start_rate}"
            )
