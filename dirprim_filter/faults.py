"""Faults of observed motion: columns in other units than the positions.

Learning and scoring take a log of tracks for the truth, so its faults enter both.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dirprim_filter.distributions.angles import wrap

if TYPE_CHECKING:
    from dirprim_filter.tracks import Tracks

MAX_STEP_S = 2.0
"""Across a longer pause nothing is known of the path between."""
MOVING_FROM = 1.0
"""m/s: the distance that standing vehicles drive says nothing of units."""
COMPARED_S, LONGEST_S = 2.0, 4.0
"""Stated speeds and courses are compared with the way between rows so far apart: noise is small beside it."""
LEAST_COMPARED = 20
UNLIKE_RATIO, UNLIKE_ANGLE = 1.6, np.pi / 6
"""Of the distance by speeds to that by positions, or its inverse; and radians between courses, in the median."""
UNITS = {3.6: "km/h", 2.237: "mph", 3.281: "ft/s", 1.944: "knots"}
"""By how much larger their numbers are than those of m/s."""
UNIT_SHARE = 0.06
DEGREES_PER_M = 1e-4
"""Positions by which all go so much less than by their speeds are degrees: of latitude 1e-5 are 1.1 m."""
SMALL_M = 0.5
"""Three vehicles have no room in so small a square."""


def find_faults(tracks: Tracks) -> list[str]:
    """A line for each column that does not fit to where vehicles go; what was derived from positions always fits."""
    order = np.lexsort((tracks.time_ns, tracks.vehicle))
    vehicle, time_ns, position = tracks.vehicle[order], tracks.time_ns[order], tracks.position[order]
    speed, course = tracks.speed[order], tracks.direction[order]
    if not vehicle.size:
        return []
    if vehicle[-1] >= 2 and (np.ptp(position, axis=0) < SMALL_M).all():
        return [f"all positions lie within {SMALL_M:g} m: are they degrees? Say latitude and longitude"]
    dt_s = np.diff(time_ns) * 1e-9
    soon = (np.diff(vehicle) == 0) & (dt_s <= MAX_STEP_S)
    driven = np.append(0.0, np.cumsum(np.where(soon, dt_s * 0.5 * (speed[1:] + speed[:-1]), 0.0)))
    breaks = np.append(0, np.cumsum(~soon))
    since_s = (time_ns - time_ns.min()) * 1e-9
    key = since_s + vehicle * (since_s.max() + 2.0 * LONGEST_S)  # ascending, vehicles apart
    later = np.minimum(np.searchsorted(key, key + COMPARED_S), key.size - 1)
    distance = driven[later] - driven
    moves = (breaks[later] == breaks) & (key[later] - key <= LONGEST_S) & (distance >= MOVING_FROM * COMPARED_S)
    if np.count_nonzero(moves) < LEAST_COMPARED:
        return []
    way_m = (position[later] - position)[moves]
    ratio = float(distance[moves].sum()) / max(float(np.linalg.norm(way_m, axis=1).sum()), 1e-9)
    if ratio > 1.0 / DEGREES_PER_M:
        return ["speeds lead thousands of times as far as positions: are these degrees? Say latitude and longitude"]
    found = []
    if not 1.0 / UNLIKE_RATIO < ratio < UNLIKE_RATIO:
        unit = next((unit for factor, unit in UNITS.items() if abs(ratio / factor - 1.0) < UNIT_SHARE), "another unit")
        found.append(f"speeds lead {ratio:.3g} times as far as positions: are they in {unit} in place of m/s?")
    apart = float(np.median(np.abs(wrap(course[moves] - np.arctan2(way_m[:, 1], way_m[:, 0])))))
    if apart > UNLIKE_ANGLE:
        found.append(
            f"courses and positions are {np.rad2deg(apart):.0f} deg apart in the median: are courses in degrees, or "
            "from north?"
        )
    return found
