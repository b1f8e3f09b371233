"""Faults of observed motion: times, positions, speeds and courses in other units than they are said to be.

Learning and scoring take a log of tracks for the truth, so its faults enter both.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.course import later_rows
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.jumps import ACCELERATION, FASTEST, NOISES, Scale

MAX_STEP_S, INTERVALS_IN_STEP = 2.0, 3.0
"""Across a longer pause nothing is known of the path between; of rows that come seldom, across so many intervals."""
DRIVES_FROM = 1.0
"""m/s: the distance that standing vehicles drive says nothing of units."""
LEAST_STEPS, LEAST_COMPARED = 8, 20
UNLIKE_RATIO, UNLIKE_ANGLE = 1.6, np.pi / 6
"""Of the distance by speeds to that by positions, or its inverse; and radians between courses, in the median."""
UNITS = {3.6: "km/h", 2.237: "mph", 3.281: "ft/s", 1.944: "knots"}
"""By how much larger their numbers are than those of m/s."""
OF_POSITIONS = {0.3048: "feet", 0.01: "centimetres", 0.001: "millimetres"}
"""How long they are in metres."""
UNIT_SHARE = 0.06
DEGREES_PER_M = 1e-4
"""Positions by which all go so much less than by their speeds are degrees: of latitude 1e-5 are 1.1 m."""
SMALL_M = 0.5
"""Three vehicles have no room in so small a square."""
CREEPING, STRAIGHT = 0.05, 0.8
"""m/s, of what does not tremble in place: nothing that is logged is so slow."""
SELDOM_S, OFTEN_S, QUICK = 20.0, 5e-4, 300.0
"""Seconds between rows, with which such slow ones count ms, and such as are faster than so many m/s count ns for us."""


def wrong_scale(scale: Scale) -> str:
    """Why no log of vehicles looks so, and the likely cause; empty where it may."""
    if scale.n_steps < LEAST_STEPS:
        return ""
    moves = f"vehicles move at {scale.speed:.3g} m/s, in rows {scale.interval_s:.3g} s apart"
    if scale.interval_s < OFTEN_S and scale.speed > QUICK:
        unit = next((u for f, u in ((1e3, "us"), (1e6, "ms")) if scale.speed < QUICK * f), "s")
        return f"{moves}: are times in {unit} in place of ns?"
    if scale.speed > FASTEST:
        return f"{moves}: are positions in centimetres, or are ids given to several vehicles?"
    if 0 < scale.speed < CREEPING and scale.straightness > STRAIGHT:
        cause = "times in ms in place of s" if scale.interval_s > SELDOM_S else "positions degrees, so latitudes"
        return f"{moves}: are {cause}?"
    return ""


def _quick(scale: Scale) -> str:
    """A question about what is as fast as a jet, and turns as no jet can; empty where nothing is."""
    if scale.speed > QUICK and scale.acceleration > ACCELERATION and scale.straightness > STRAIGHT:
        return (
            f"vehicles move at {scale.speed:.3g} m/s, with {scale.acceleration:.3g} m/s2: are positions in centimetres?"
        )
    return ""


def find_faults(
    vehicle: IntArray,
    time_ns: IntArray,
    position: FloatArray,
    *,
    direction: FloatArray,
    speed: FloatArray,
    scale: Scale,
) -> dict[str, str]:
    """A line for each column that does not fit to where vehicles go, of these rows.

    Args:
        vehicle: (n,) numbers, ascending.
        time_ns: (n,) ascending for each vehicle.
        position: (n, 2) metres.
        direction: (n,) stated, radians; NaN where it is not.
        speed: (n,) stated, m/s; NaN where it is not.
        scale: of these rows.

    Returns:
        By `direction` or `speed` where it is known what is wrong with these, so that they are better derived; else by
        `position` or another word.
    """
    found: dict[str, str] = {"scale": line} if (line := _quick(scale)) else {}
    if vehicle.size and vehicle[-1] - vehicle[0] >= 2 and (np.ptp(position, axis=0) < SMALL_M).all():
        return {"position": f"all positions lie within {SMALL_M:g} m: are they degrees? Say latitude and longitude"}
    is_stated = np.isfinite(speed)
    vehicle, time_ns = vehicle[is_stated], time_ns[is_stated]
    position, direction, speed = position[is_stated], direction[is_stated], speed[is_stated]
    longest_s = max(MAX_STEP_S, INTERVALS_IN_STEP * scale.interval_s)  # stated motion is compared with the way so long
    later, moves = later_rows(vehicle, time_ns, longest_s, longest_s)
    driven = np.append(0.0, np.cumsum(np.diff(time_ns) * 0.5e-9 * (speed[1:] + speed[:-1])))[: speed.size]
    distance, way_m = driven[later] - driven, position[later] - position
    goes = moves & (np.hypot(*way_m.T) >= max(DRIVES_FROM * longest_s, NOISES * scale.noise))
    if np.count_nonzero(goes) >= LEAST_COMPARED and np.median(distance[goes]) == 0:
        line = "speeds are 0 where positions move: are they not filled in? They are not used, but derived"
        return found | {"speed": line}
    moves &= distance >= DRIVES_FROM * longest_s
    if np.count_nonzero(moves) < LEAST_COMPARED:
        return found
    way_m = way_m[moves]
    ratio = float(distance[moves].sum()) / max(float(np.linalg.norm(way_m, axis=1).sum()), 1e-9)
    if ratio > 1.0 / DEGREES_PER_M:
        line = "speeds lead thousands of times as far as positions: are these degrees? Say latitude and longitude"
        return {"position": line}
    if not 1.0 / UNLIKE_RATIO < ratio < UNLIKE_RATIO:
        far = f"speeds lead {ratio:.3g} times as far as positions: are"
        if unit := _near(ratio, UNITS):
            found["speed"] = f"{far} they in {unit} in place of m/s? They are not used, but derived from positions"
        elif unit := _near(ratio, OF_POSITIONS):
            found["position"] = f"{far} these in {unit} in place of metres?"
        else:
            found["unit"] = f"{far} they in another unit in place of m/s?"
    way = np.arctan2(way_m[:, 1], way_m[:, 0])
    stated = direction[moves]
    apart, if_clockwise, if_north = (
        float(np.nanmedian(np.abs(wrap(stated - seen)))) if np.isfinite(stated).any() else 0.0
        for seen in (way, -way, np.pi / 2 - way)
    )
    if apart > UNLIKE_ANGLE:
        of = "from north, clockwise" if if_north < if_clockwise else "clockwise from east"
        of = of if min(if_clockwise, if_north) < 0.5 * UNLIKE_ANGLE else "in degrees, or from north"
        off = f"courses and positions are {np.rad2deg(apart):.0f} deg apart in the median: are courses {of}?"
        found["direction"] = f"{off} They are not used, but derived from positions"
    return found


def _near(ratio: float, units: dict[float, str]) -> str | None:
    return next((unit for factor, unit in units.items() if abs(ratio / factor - 1.0) < UNIT_SHARE), None)
