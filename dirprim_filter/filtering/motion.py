"""The map as the direction-speed transition model of vehicles."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.special import gammaln

from dirprim_filter.config import FilterConfig
from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions.von_mises_mixture import log_weights
from dirprim_filter.filtering._relaxing import MotionTable
from dirprim_filter.primitives import PrimitiveMap
from tessellation._kernels import Locator

STANDING_BELOW = 0.3
"""m/s, mean speed of a mode; vehicles that stand do not relax to those that drive."""
FINE_PIXEL_M = 1.5
MAX_REFINEMENT = 10
MAX_PIXELS = 20_000_000


def motion_table(primitive_map: PrimitiveMap, config: FilterConfig) -> MotionTable:
    """A map's parameters as the compiled motion model takes them.

    Modes that belong to the place-free primitive, and those without a direction, draw no vehicle towards them: its
    direction diffuses, and its speed relaxes to the speeds of all places, not to those of one place-free mode.

    Where the map remembers journeys, vehicles follow these, and modes only tell what a vehicle may do at first sight.

    Args:
        primitive_map: the map.
        config: the motion model's knobs.
    """
    direction, speed = primitive_map.direction, primitive_map.speed
    n, m = direction.weight.shape
    draws = direction.concentration > 0
    draws[n - 1] = False
    draws[:, m - primitive_map.n_place_free_modes :] = False
    concentration = 1.0 / (1.0 / np.maximum(direction.concentration, 1e-12) + config.direction_spread**2)
    concentration = np.where(direction.concentration > 0, concentration, 0.0)
    shape = 1.0 / (1.0 / speed.shape + np.where(speed.shape > 1.0, config.speed_spread**2, 0.0))
    rate = shape / speed.mean
    anywhere = ~draws & (speed.mean >= STANDING_BELOW)
    shape[anywhere], rate[anywhere] = speeds_of_all_places(primitive_map)
    relaxation = primitive_map.relaxation
    return MotionTable(
        locator=reaching(primitive_map.tessellation.locator, config.reach_m),
        weight=direction.weight,
        mean=direction.mean_direction,
        concentration=concentration,
        shape=shape,
        rate=rate,
        log_fit=log_weights(direction.weight) - von_mises.log_normaliser(concentration),
        log_speed_fit=np.asarray(shape * np.log(rate) - gammaln(shape)),
        draws=draws,
        bend=primitive_map.bend,
        gain=primitive_map.gain,
        center=primitive_map.centers,
        extent=np.append(0.5 * np.sqrt(primitive_map.tessellation.area), 0.0),
        direction_rate=relaxation.direction_rate,
        speed_rate=relaxation.speed_rate,
        mode_rate=relaxation.mode_rate,
        turning=relaxation.place_free_turning,
        place_free_speed_rate=relaxation.place_free_speed_rate,
        drift=relaxation.drift,
        place_free_share=config.place_free_share,
        step_s=config.step_s,
        journeys=primitive_map.journeys.table(
            direction_spread=config.direction_spread, speed_spread=config.speed_spread, drift=config.drift,
            forget_rate=config.forget_rate, agility=config.place_free_agility,
        ),
        remembers=len(primitive_map.journeys) > 0,
    )  # fmt: skip


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

    A vehicle beside the cells, where nobody happened to be seen, still follows the road beside it. The raster is made
    as fine as `reach_m` asks for, so the reach is right to half of `FINE_PIXEL_M`. Where several generators share the
    nearest pixel, the nearest of them has the vehicle.
    """
    finer = int(np.clip(np.ceil(1.0 / (locator.pixels_per_metre * FINE_PIXEL_M)), 1, MAX_REFINEMENT))
    while finer > 1 and locator.pixel.size * finer**2 > MAX_PIXELS:
        finer -= 1
    per_metre = locator.pixels_per_metre * finer
    margin = int(np.ceil(reach_m * per_metre))
    pixel = np.pad(np.kron(locator.pixel, np.ones((finer, finer), np.int32)), margin, constant_values=-1)
    beyond = pixel == -1
    if beyond.all():
        return locator
    distance, nearest = distance_transform_edt(beyond, return_indices=True)
    reached = np.where(distance <= reach_m * per_metre, pixel[tuple(nearest)], np.int32(-1))
    origin_x, origin_y = locator.origin_x - margin / per_metre, locator.origin_y - margin / per_metre
    return Locator(origin_x, origin_y, per_metre, np.ascontiguousarray(reached), locator.entry)
