"""The map as the direction-speed transition model of vehicles."""

from __future__ import annotations

from dirprim_filter.config import FilterConfig
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.primitives._leader import ALONE, LeaderTable
from dirprim_filter.primitives._manoeuvres import MotionTable
from dirprim_filter.primitives.motion_table import MotionKnobs
from dirprim_filter.primitives.motion_table import motion_table as table_of


def tracking_table(primitive_map: PrimitiveMap, config: FilterConfig) -> MotionTable:
    """The motion of a map for a filter: a share of the particles that draw a manoeuvre anew is place-free."""
    return table_of(primitive_map, _knobs(config))


def forecast_table(primitive_map: PrimitiveMap, config: FilterConfig) -> MotionTable:
    """The same for forecasts, which have no measurements to correct particles: none is redrawn."""
    of_map = _knobs(config)._replace(
        place_free_share=0.0, straight_share=0.0, redraw_rate=0.0, direction_spread=0.0, push=0.0, agility=1.0
    )
    return table_of(primitive_map, of_map)


def leader_table(primitive_map: PrimitiveMap, config: FilterConfig) -> LeaderTable:
    """The response to leaders: none without interaction, or where the map knows of none."""
    response = primitive_map.motion.leader
    if response is None or config.interaction == "none":
        return ALONE
    return LeaderTable(response.gain, response.push, response.trust, response.start_rate)


def _knobs(config: FilterConfig) -> MotionKnobs:
    return MotionKnobs(
        place_free_share=config.place_free_share, redraw_rate=config.redraw_rate, drift=config.drift,
        step_s=config.step_s, reach_m=config.reach_m, direction_spread=config.direction_spread, push=config.push,
        agility=config.place_free_agility, straight_share=config.straight_share,
    )  # fmt: skip
