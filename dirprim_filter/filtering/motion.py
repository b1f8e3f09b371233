"""The map as the direction-speed transition model of vehicles."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions.von_mises_mixture import log_weights
from dirprim_filter.filtering._kernels import MotionTable
from dirprim_filter.primitives import PrimitiveMap


def motion_table(primitive_map: PrimitiveMap, *, step_s: float, place_free_share: float) -> MotionTable:
    """A map's parameters as the compiled motion model takes them.

    Modes that belong to the place-free primitive, and those without a direction, draw no vehicle towards them: its
    direction diffuses.

    Args:
        primitive_map: the map.
        step_s: seconds, the longest step of the motion model.
        place_free_share: of the particles that take up a mode, those that take up a place-free one.

    Raises:
        ValueError: `step_s` is not positive.
    """
    if not step_s > 0:
        raise ValueError(f"step_s: expected a positive time in seconds, got {step_s}")
    direction, speed = primitive_map.direction, primitive_map.speed
    n, m = direction.weight.shape
    draws = direction.concentration > 0
    draws[n - 1] = False
    draws[:, m - primitive_map.n_place_free_modes :] = False
    relaxation = primitive_map.relaxation
    return MotionTable(
        locator=primitive_map.tessellation.locator,
        weight=direction.weight,
        mean=direction.mean_direction,
        concentration=direction.concentration,
        shape=speed.shape,
        rate=speed.rate,
        log_fit=log_weights(direction.weight) - von_mises.log_normaliser(direction.concentration),
        log_speed_fit=np.asarray(speed.shape * np.log(speed.rate) - gammaln(speed.shape)),
        draws=draws,
        direction_rate=relaxation.direction_rate,
        speed_rate=relaxation.speed_rate,
        mode_rate=relaxation.mode_rate,
        turning=relaxation.place_free_turning,
        place_free_speed_rate=relaxation.place_free_speed_rate,
        drift=relaxation.drift,
        place_free_share=place_free_share,
        step_s=step_s,
    )
