"""Cues: a vehicle's signal of where it will turn, as a density over its direction.

A cue is p_t of Eq. 4 in Senanayake et al. 2020. With what is usual at the place, p_0, it gives what the vehicle will do
there: `multiply_mixtures(map.primitive_at(position).direction, cue.belief(heading)).mixture`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import BoolArray, FloatArray, as_floats
from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.angles import wrap

SIGNAL_CONCENTRATION = 2.5
"""Of a turn signal (the paper's): it says which way, not how far."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cue:
    """Where a vehicle will turn, relative to its heading: one direction, or several that are equally likely.

    Attributes:
        turn: () or (M,) radians from the heading to the mean direction, counter-clockwise.
        concentration: () or (M,) of the von Mises around it, at least 0; 0 is no information.

    Raises:
        ValueError: shapes that do not fit, or a negative concentration.
    """

    turn: npt.ArrayLike
    concentration: npt.ArrayLike

    def __post_init__(self) -> None:
        turn, concentration = np.broadcast_arrays(np.atleast_1d(self.turn), np.atleast_1d(self.concentration))
        object.__setattr__(self, "turn", wrap(as_floats("turn", turn, "M")))
        object.__setattr__(self, "concentration", as_floats("concentration", concentration, "M"))
        if turn.size == 0 or np.min(self.concentration) < 0:
            raise ValueError("turn, concentration: expected at least one direction and no negative concentration")

    def belief(self, heading: npt.ArrayLike) -> VonMisesMixture:
        """The cue of vehicles that head so, in map directions. (...) radians -> mixtures (..., M)."""
        mean: FloatArray = np.asarray(heading, dtype=np.float64)[..., None] + np.asarray(self.turn)
        return VonMisesMixture(
            weight=np.full(mean.shape, 1.0 / mean.shape[-1]),
            mean_direction=mean,
            concentration=np.broadcast_to(np.asarray(self.concentration), mean.shape),
        )


def signalled(is_left: BoolArray, is_right: BoolArray) -> FloatArray:
    """Turn signals as `Detections.cue`: (n,), (n,) -> (n, 2); those that are neither, or both, say nothing."""
    turn = 0.5 * np.pi * (is_left.astype(np.float64) - is_right)
    return np.where(
        (is_left ^ is_right)[:, None], np.column_stack([turn, np.full_like(turn, SIGNAL_CONCENTRATION)]), np.nan
    )


TURN_RIGHT = Cue(turn=-np.pi / 2, concentration=SIGNAL_CONCENTRATION)
TURN_LEFT = Cue(turn=np.pi / 2, concentration=SIGNAL_CONCENTRATION)
