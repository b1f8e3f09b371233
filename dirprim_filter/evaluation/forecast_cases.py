"""Instants of held-out tracks from which forecasts are made, and what came after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.instants import Instants
from dirprim_filter.track_ids import world_names
from dirprim_filter.tracks import Tracks

HORIZONS_S = tuple(0.5 * i for i in range(1, 17))
START_EVERY_S = 1.0
MAX_STARTS = 8
"""Of a vehicle: that one which waits for minutes does not outweigh all others."""
MAX_MATCH_S = 0.25
"""Between rows further from an instant than this, where the vehicle was is not known."""


class Cases(NamedTuple):
    """Instants from which forecasts are made, and what came after.

    Attributes:
        vehicle: (n,) number of the vehicle, (group, id), among those forecast.
        name: (n,) str, the vehicle's id, with its group's: the same whichever vehicles it is forecast with.
        group: (n,) the vehicle's.
        position: (n, 2) metres.
        direction: (n,) radians.
        speed: (n,) m/s.
        later: (n, n_horizons, 2) metres, where the vehicle was that much later; NaN where the log does not say.
        around: all vehicles that were there at the instants, those that are not forecast too.
        at: (n,) which row of these each case is.
    """

    vehicle: IntArray
    name: AnyArray
    group: IntArray
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    later: FloatArray
    around: Instants
    at: IntArray

    @classmethod
    def of(
        cls, tracks: Tracks, *, horizons_s: Sequence[float] = HORIZONS_S, among: Tracks | None = None
    ) -> Cases:  # fmt: skip
        """Up to `MAX_STARTS` instants of each vehicle, `START_EVERY_S` apart, spread over its track.

        `among` are all vehicles of the log, of which `tracks` are some; left out, there are no others.
        """
        vehicle = tracks.vehicle
        order = np.lexsort((tracks.time_ns, vehicle))
        first = np.searchsorted(vehicle[order], np.arange(tracks.n_tracks + 1))
        starts: list[IntArray] = []
        later: list[FloatArray] = []
        for v in range(first.size - 1):
            rows = order[first[v] : first[v + 1]]
            time_s = (tracks.time_ns[rows] - tracks.time_ns[rows[0]]) * 1e-9
            at = _spread(time_s, horizon_s=min(horizons_s))
            starts.append(rows[at])
            wanted = time_s[at][:, None] + np.asarray(horizons_s)
            later.append(_position_at(wanted, time_s, tracks.position[rows]))
        row = np.concatenate(starts)
        around, at = _around(tracks, row, tracks if among is None else among)
        return cls(
            vehicle=np.asarray(vehicle[row], np.int64),
            name=world_names(tracks.track_id[row], tracks.group[row]),
            group=tracks.group[row],
            position=tracks.position[row],
            direction=tracks.direction[row],
            speed=tracks.speed[row],
            later=np.concatenate(later),
            around=around,
            at=at,
        )


def _around(tracks: Tracks, row: IntArray, among: Tracks) -> tuple[Instants, IntArray]:
    """Who is there at the instants of some rows of `tracks`, and which of these each row is."""
    when = np.column_stack([tracks.group[row], tracks.time_ns[row]])
    instant, which = np.unique(when, axis=0, return_inverse=True)
    around = Instants.of(among, instant[:, 0], instant[:, 1])
    vehicle, first = np.unique(among.vehicle, return_index=True)
    names = world_names(among.track_id[first], among.group[first])
    by_name = np.argsort(names)
    own = np.searchsorted(names, world_names(tracks.track_id[row], tracks.group[row]), sorter=by_name)
    return around, around.rows_of(which.ravel(), vehicle[by_name[own]])


def _spread(time_s: FloatArray, *, horizon_s: float) -> IntArray:
    """Rows at which to start, so that at least the nearest horizon is seen."""
    last = time_s[-1] - horizon_s
    if last < 0:
        return np.empty(0, np.int64)
    instants = np.arange(0.0, last + 1e-6, START_EVERY_S)
    chosen = np.unique(np.linspace(0, instants.size - 1, min(instants.size, MAX_STARTS)).round().astype(np.int64))
    return np.unique(np.searchsorted(time_s, instants[chosen] - 1e-6)).astype(np.int64)


def _position_at(wanted: FloatArray, time_s: FloatArray, position: FloatArray) -> FloatArray:
    """(...) seconds -> (..., 2), linear between rows at most `MAX_MATCH_S` away; NaN elsewhere."""
    found = np.stack([np.interp(wanted, time_s, position[:, axis]) for axis in (0, 1)], axis=-1)
    after = np.clip(np.searchsorted(time_s, wanted - 1e-6), 0, time_s.size - 1)
    before = np.maximum(after - 1, 0)
    near = np.abs(time_s[after] - wanted) <= 1e-6
    between = (time_s[before] <= wanted) & (wanted <= time_s[after])
    near |= between & (wanted - time_s[before] <= MAX_MATCH_S) & (time_s[after] - wanted <= MAX_MATCH_S)
    return np.where(near[..., None], found, np.nan)
