"""Motion models of who has no map, learned from what a log itself reports of vehicles with ids.

Of constant velocity the evidence is maximised: the density of each measured position of a vehicle, given those before
it, with the gaps and misses that the filter will meet.
"""

from __future__ import annotations

import numpy as np

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.filtering import BayesFilter, ConstantVelocityKalman
from dirprim_filter.filtering.kalman import acceleration_density
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


def fitted_acceleration(seen: Detections, train: Tracks, config: FilterConfig) -> Choice:
    """The acceleration density of greatest evidence, and between which others it was chosen.

    Args:
        seen: labelled detections of training vehicles.
        train: their motion, which says where the search begins.
        config: noise of the measurements.

    Raises:
        ValueError: no training vehicle has two rows near in time, or no noise is best.
    """

    def evidence(values: tuple[float, ...]) -> float:
        return log_evidence(ConstantVelocityKalman(acceleration_density=values[0], config=config), seen) / len(seen)

    return choose([Axis("acceleration_density", acceleration_density(train))], evidence)[0]


def log_evidence(model: BayesFilter, seen: Detections) -> float:
    """Natural log of the density of all vehicles' measured positions; the first of each is given.

    Args:
        model: a filter without beliefs.
        seen: labelled, of one group; every row is of its vehicle.
    """
    vehicle = np.unique(seen.track_id, return_inverse=True)[1]
    order = np.lexsort((seen.time_ns, vehicle))
    n_rows = np.bincount(vehicle)
    first = np.cumsum(n_rows) - n_rows
    slot = np.arange(n_rows.size)
    model.reserve(slot.size)
    model.begin(slot, slot.astype(np.uint64), seen[order[first]])
    total = 0.0
    for k in range(1, int(n_rows.max(initial=0))):  # the next row of every vehicle that has one
        going = np.flatnonzero(n_rows > k)
        row, before = order[first[going] + k], order[first[going] + k - 1]
        model.predict(going, (seen.time_ns[row] - seen.time_ns[before]) * 1e-9)
        total += float(model.weigh(going, seen[row]).log_density.sum())
    return total


def _tracks(seen: Detections) -> Tracks:
    named = seen[seen.track_id != NO_ID]
    of = Tracks.from_positions(
        track_id=named.track_id, time_ns=named.time_ns, position=named.position, group=named.group
    )  # fmt: skip
    return of.on_plane(named.origin)
