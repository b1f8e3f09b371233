"""The map as the direction-speed transition model of vehicles."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.special import gammaln

from dirprim_filter.config import FilterConfig
from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions.von_mises_mixture import log_weights
from dirprim_filter.filtering._kernels import MotionTable
from dirprim_filter.primitives import PrimitiveMap
from tessellation._kernels import Locator

STANDING_BELOW = 0.3
"""m/s, mean speed of a mode; vehicles that stand do not relax to those that drive."""


def motion_table(primitive_map: PrimitiveMap, config: FilterConfig) -> MotionTable:
    """A map's parameters as the compiled motion model takes them.

    Modes that belong to the place-free primitive, and those without a direction, draw no vehicle towards them: its
    direction diffuses, and its speed relaxes to the speeds of all places, not to those of one place-free mode.

    Args:
        primitive_map: the map.
        config: the motion model's knobs.
    """
    direction, speed = primitive_map.direction, primitive_map.speed
    n, m = direction.weight.shape
    draws = direction.concentration > 0
    draws[n - 1] = False
    draws[:, m - primitive_map.n_place_free_modes :] = False
    shape, rate = speed.shape.copy(), speed.rate.copy()
    anywhere = ~draws & (speed.mean >= STANDING_BELOW)
    shape[anywhere], rate[anywhere] = speeds_of_all_places(primitive_map)
    relaxation = primitive_map.relaxation
    return MotionTable(
        locator=reaching(primitive_map.tessellation.locator, config.reach_m),
        weight=direction.weight,
        mean=direction.mean_direction,
        concentration=direction.concentration,
        shape=shape,
        rate=rate,
        log_fit=log_weights(direction.weight) - von_mises.log_normaliser(direction.concentration),
        log_speed_fit=np.asarray(shape * np.log(rate) - gammaln(shape)),
        draws=draws,
        direction_rate=relaxation.direction_rate,
        speed_rate=relaxation.speed_rate,
        mode_rate=relaxation.mode_rate,
        turning=relaxation.place_free_turning,
        place_free_speed_rate=relaxation.place_free_speed_rate,
        drift=relaxation.drift,
        place_free_share=config.place_free_share,
        step_s=config.step_s,
    )


def speeds_of_all_places(primitive_map: PrimitiveMap) -> tuple[float, float]:
    """Shape and rate of the gamma with the moments of the place-free speeds in motion."""
    weight, speed = primitive_map.direction.weight[-1], primitive_map.speed[-1]
    share = np.where(speed.mean >= STANDING_BELOW, weight, 0.0)
    if share.sum() == 0:
        return 1.0, 1.0
    share = share / share.sum()
    mean = float(share @ speed.mean)
    variance = float(share @ (speed.mean / speed.rate + speed.mean**2)) - mean**2
    return max(mean**2 / variance, 1.0), max(mean / variance, 1.0 / mean)


def reaching(locator: Locator, reach_m: float) -> Locator:
    """The locator whose cells also cover what lies within `reach_m` of them, to the nearest.

    A vehicle beside the cells, where nobody happened to be seen, still follows the road beside it.
    """
    pixels = reach_m * locator.pixels_per_metre
    margin = int(np.ceil(pixels))
    cell = np.pad(locator.cell, margin, constant_values=-1)
    if (cell < 0).all():
        return locator
    distance, nearest = distance_transform_edt(cell < 0, return_indices=True)
    near = cell[tuple(nearest)]
    return Locator(
        locator.origin_x - margin / locator.pixels_per_metre,
        locator.origin_y - margin / locator.pixels_per_metre,
        locator.pixels_per_metre,
        np.ascontiguousarray(np.where(distance <= pixels, near, -1)),
    )
