"""Which beliefs a picture shows in full: those of vehicles that do not coast and have a known direction."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import BoolArray
from dirprim_filter.drawing.shapes import reach
from dirprim_filter.estimates import Estimates

SURE_FROM = 0.5
"""Resultant of a belief's direction; below it a forecast spreads in all directions and is not drawn."""
WIDEST_COASTING = 6.0
"""Metres, standard deviation; of a coasting vehicle that may be anywhere, no ellipse is drawn."""


def may_be_anywhere(estimates: Estimates) -> BoolArray:
    """(n,) which vehicles have coasted for so long that their ellipse is not drawn."""
    return np.asarray(estimates.is_coasting & (reach(estimates.covariance) > WIDEST_COASTING))


def has_no_forecast(estimates: Estimates) -> BoolArray:
    """(n,) of which vehicles no forecast is drawn."""
    return np.asarray(estimates.is_coasting | (estimates.direction_resultant < SURE_FROM))
