"""What a picture shows of a vehicle: a short name, a trail; in full no belief that coasts or has no known direction."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dirprim_filter.arrays import BoolArray
from dirprim_filter.estimates import Estimates
from dirprim_filter.track_ids import numbered
from dirprim_filter.tracks import Tracks

LONGEST = 12
"""Characters of a name that is shown in full."""
KEPT = 4
"""Characters of a longer one's start and of its end: some ids differ in the one, some in the other."""
SURE_FROM = 0.5
"""Resultant of a belief's direction; below it a forecast spreads in all directions and is not drawn."""

TRAIL_NS, TRAIL_POINTS = 5_000_000_000, 16
"""How far back a trail goes, and by how many points it leads to the vehicle."""

CLASS_SIZES: Mapping[str, tuple[float, float, float]] = {
    "pedestrian|person|people|walker|human": (0.5, 0.6, 1.7), "bicycl|cyclist|biker|bike|scooter": (1.8, 0.6, 1.7),
    "motor": (2.2, 0.8, 1.5), "bus|tram": (12.0, 2.5, 3.2), "truck|lorry|trailer": (9.0, 2.5, 3.5),
    "van": (5.5, 2.0, 2.3), "ship|boat|vessel|ferry|tanker": (25.0, 7.0, 6.0), "aircraft|plane": (35.0, 34.0, 11.0),
}  # fmt: skip
"""Length, width and height, metres, by words of which a label holds one; the first that fits counts."""


def may_be_anywhere(estimates: Estimates) -> BoolArray:
    """(n,) which vehicles have coasted for so long that their ellipse is not drawn: 6 m of standard deviation."""
    longest = np.linalg.eigvalsh(estimates.covariance)[:, 1]
    return np.asarray(estimates.is_coasting & (longest > 6.0**2))


def has_no_forecast(estimates: Estimates) -> BoolArray:
    """(n,) of which vehicles no forecast is drawn."""
    return np.asarray(estimates.is_coasting | (estimates.direction_resultant < SURE_FROM))


def drawn_sizes(tracks: Tracks, labels: Mapping[str, str]) -> Tracks:
    """The same with the usual size of their class, to be drawn, of vehicles of unknown size; `labels` are by id."""
    known: dict[str, tuple[float, float, float]] = {}
    for name, label in labels.items():
        fits = [size for words, size in CLASS_SIZES.items() if re.search(words, label.lower())]
        known |= {name: fits[0]} if fits else {}
    if not known:
        return tracks
    names, number = numbered(tracks.track_id)
    usual = np.array([known.get(name, (np.nan,) * 3) for name in names])[number]
    return replace(tracks, size=np.where(np.isnan(tracks.size), usual, tracks.size))


def short_name(name: str) -> str:
    """A name of at most `LONGEST` characters as it is, of a longer one its start and end, after its group.

    The same id has the same short name in every frame and picture. It is for the eye: two ids may share one.
    """
    group, slash, own = name.rpartition("/")
    return name if len(own) <= LONGEST else f"{group}{slash}{own[:KEPT]}…{own[-KEPT:]}"


class Trails:
    """Where vehicles came by in the last seconds."""

    def __init__(self) -> None:
        self._of: dict[str, list[tuple[int, Any]]] = {}

    def lead_on(self, names: Sequence[str], places: Iterable[Any], time_ns: int) -> list[list[Any]]:
        """For each vehicle of an instant where it was at even times, oldest first, and is; others are forgotten."""
        before, self._of = self._of, {}
        for name, place in zip(names, places, strict=True):
            self._of[name] = trail = before.get(name) or [(time_ns, place)]
            if len(trail) > 1 and trail[-1][0] - trail[-2][0] < TRAIL_NS // TRAIL_POINTS:
                trail.pop()
            while trail and time_ns - trail[0][0] > TRAIL_NS:
                trail.pop(0)
            trail.append((time_ns, place))
        return [[place for _, place in self._of[name]] for name in names]
