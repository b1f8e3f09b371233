"""Motion models of who has no map, learned from what a log itself reports of vehicles with ids."""

from __future__ import annotations

import numpy as np

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.evaluation.rivals import fitted_acceleration
from dirprim_filter.primitives.learning import learn_primitives
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks

MOST_FITTED = 20
"""Vehicles that constant velocity is fitted to; drawn at random."""


def background_motion(tracks: Tracks | Detections, *, rng: np.random.Generator) -> PrimitiveMap:
    """How vehicles move anywhere: a map without a cell.

    Args:
        tracks: observed motion; or detections, of which those with ids count.
        rng: as of `learn_primitives`.

    Raises:
        ValueError: no vehicle has two rows near in time.
    """
    tracks = _tracks(tracks) if isinstance(tracks, Detections) else tracks
    return learn_primitives(tracks, tessellation="grid", n_cells=1, primitive="flat", rng=rng).without_places()


def acceleration_of(seen: Detections, config: FilterConfig, *, rng: np.random.Generator) -> float:
    """The density of white acceleration, m^2/s^3 an axis, under which detections with ids are likeliest.

    Args:
        seen: detections; those with ids count.
        config: their noise.
        rng: draws the vehicles.

    Raises:
        ValueError: no vehicle has two rows near in time, or no density is best.
    """
    tracks, named = _tracks(seen), seen[seen.track_id != NO_ID].in_one_group()
    some = rng.permutation(np.unique(named.track_id))[:MOST_FITTED]
    return fitted_acceleration(named[np.isin(named.track_id, some)], tracks, config).chosen


def _tracks(seen: Detections) -> Tracks:
    named = seen[seen.track_id != NO_ID]
    of = Tracks.from_positions(
        track_id=named.track_id, time_ns=named.time_ns, position=named.position, group=named.group
    )  # fmt: skip
    return of.on_plane(named.origin)
