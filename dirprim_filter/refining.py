"""Tracking by tracking: what another tracker reported is taken for measurements, and smoothed with the map.

A tracker's estimates differ from a sensor's detections in two ways. Where it lost its vehicle from sight it coasts:
such rows measure nothing, and are left out. And its errors last, for each estimate follows from the one before. Tracks
that it broke are joined first, where the map leads from the end of one to the beginning of another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from dirprim_filter.arrays import BoolArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.filtering import BayesFilter, GroupTracker
from dirprim_filter.filtering.smoother import Smoother
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.replay import Look, follow
from dirprim_filter.sensor import AxisError, Sensor
from dirprim_filter.track_ids import qualified_names

EVEN = 0.01
"""Change of velocity between rows, as a share of the usual one of all rows, below which it is none."""
MOST_ALONE = 0.1
"""Of changes of velocity, the share that vanishes along one axis alone: by noise 2 % do, of rounded positions many."""
CORRELATED_SHARE, CORRELATION_S = 0.8, 0.5
"""Of a tracker's error, and seconds: a Kalman filter's, of cars at 10 Hz."""


def is_measured(rows: Detections) -> BoolArray:
    """(n,) whether a tracker measured its vehicle, or coasted: moved it on at an even velocity, to the last digit.

    Vehicles that stand, that drive evenly in a log without noise, or whose positions were rounded move evenly too. So
    rows count as coasted only of vehicles in motion, in a log whose changes of velocity are noise, each as different
    from the one before as they are large, and hardly ever vanish along one axis alone.

    Args:
        rows: of named vehicles, in any order.
    """
    order = np.lexsort((rows.time_ns, rows.track_id, rows.group))
    vehicle = np.unique(qualified_names(rows.track_id, rows.group), return_inverse=True)[1][order]
    dt_s = np.maximum(np.diff(rows.time_ns[order]) * 1e-9, 1e-9)
    velocity = np.diff(rows.position[order], axis=0) / dt_s[:, None]
    moves = (vehicle[2:] == vehicle[:-2]) & velocity[1:].any(axis=1)
    change, measured = np.diff(velocity, axis=0), np.ones(len(rows), np.bool_)
    usual = np.median(np.hypot(*change[moves].T)) if moves.any() else 0.0
    is_even = np.abs(change) < EVEN * usual
    even, alone = moves & is_even.all(axis=1), moves & (is_even[:, 0] != is_even[:, 1])
    uneven = moves & ~even
    apart = np.hypot(*np.diff(change, axis=0)[uneven[1:] & uneven[:-1]].T)
    if alone.sum() <= MOST_ALONE * uneven.sum() and apart.size and np.median(apart) > usual:
        measured[order[2:][even]] = False
        measured[order[1:-1][even]] = False  # it is the first that shows no change of its own
    return measured


def refine(
    rows: Detections, model: PrimitiveMap | Callable[[], PrimitiveMap | BayesFilter], *,
    config: FilterConfig, tracking: TrackingConfig,
    rate_hz: float | None = None, rng: Callable[[], np.random.Generator],
) -> list[TrackedFrame]:  # fmt: skip
    """Smooth what another tracker reported, at each of its instants, from a vehicle's first measured row to its last.

    Args:
        rows: what it reported, of named vehicles. Covariances and velocities are not used.
        model: how vehicles move there: a map, or what makes a filter for each group that is tracked.
        config: of the filter; its noise is the spread of the tracker's errors.
        tracking: of the tracker.
        rate_hz: where instants of a group are farther apart, there are estimates so often.
        rng: makes the generator of each group.

    Returns:
        The smoothed frames.

    Raises:
        ValueError: two rows of a vehicle at one instant.
    """
    bare = replace(rows[is_measured(rows)], covariance=np.empty(0), direction=np.empty(0), speed=np.empty(0))
    axis = AxisError(spread_m=config.noise_m, correlated_share=CORRELATED_SHARE, correlation_s=CORRELATION_S)
    sensor = Sensor(along=axis, across=axis)
    instants = [(int(frame.time_ns[0]), np.unique(frame.group).tolist()) for frame in rows.frames()]

    def smooth(seen: Detections, *, joins_labelled: bool) -> tuple[list[TrackedFrame], list[tuple[str, str]]]:
        frames: list[TrackedFrame] = []
        smoother = Smoother(sinks=[frames.append], joins_labelled=joins_labelled)
        tracker = GroupTracker(lambda group: smoother.tracker(
            group, model() if callable(model) else model, config=config, tracking=tracking, sensor=sensor, rng=rng()
        ))  # fmt: skip
        frame_at = {int(frame.time_ns[0]): frame for frame in seen.frames()}
        with smoother:
            looks = (Look(time_ns, frame_at.get(time_ns, Detections.none()), groups) for time_ns, groups in instants)
            follow(looks, tracker, [smoother], rate_hz=rate_hz)
        return frames, smoother.joined

    frames, joined = smooth(bare, joins_labelled=True)
    if joined:  # under one id a vehicle keeps its belief across the break
        frames, _ = smooth(_renamed(bare, joined), joins_labelled=False)
    return frames


def _renamed(rows: Detections, joined: Iterable[tuple[str, str]]) -> Detections:
    """The rows under the ids of the pieces that theirs continue; ids that overlap in time stay apart."""
    names = qualified_names(rows.track_id, rows.group).astype(np.str_)
    ids = rows.track_id.copy()
    for former, later in joined:
        one, other = names == former, names == later
        if former != later and one.any() and other.any() and rows.time_ns[one].max() < rows.time_ns[other].min():
            ids[other], names[other] = ids[one][0], former
    return replace(rows, track_id=ids)
