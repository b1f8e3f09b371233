"""A cue of where a vehicle will turn, as the kernel that weighs particles takes it."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import von_mises
from dirprim_filter.primitives.cues import Cue


def cue_columns(cue: Cue) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Turns, logs of weight over normaliser, and concentrations, (M,) each."""
    turn, concentration = np.asarray(cue.turn, np.float64), np.asarray(cue.concentration, np.float64)
    return turn, -np.log(turn.size) - von_mises.log_normaliser(concentration), concentration
