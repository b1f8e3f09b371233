"""Forecasts from what the particle filter believes of vehicles by their positions until then.

This is how `dirprim track --forecast` makes them. From a point, the course and speed of a vehicle's last half second,
90 % regions at 1 s held .66 to .74 of the truth: the start was taken to be known, and was a quarter of a second old.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.forecast_cases import Cases, mean_log_energy
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.evaluation.truth import usual_interval_s
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.roster import GAP_INTERVALS
from dirprim_filter.forecasting import leader_table, projected, sampled
from dirprim_filter.instants import LONGEST_UNSEEN_S
from dirprim_filter.primitives._leader import ALONE
from dirprim_filter.primitives.motion_table import motion_table
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks

NOISE = Axis("noise_m", 0.1)
"""Of a log's rows; they are tracks already, so it is small."""
MOST_VEHICLES, FEWEST_VEHICLES, MOST_SECONDS, N_SAMPLES = 50, 10, 5000.0, 16
"""Of the training vehicles by which the noise is chosen, and rollouts of each case. Ships are seen for an hour each."""
FilterOf = Callable[[PrimitiveMap, FilterConfig], ParticleFilter]
NO_VEHICLE, LOST_AFTER = -1, TrackingConfig().lost_after


def forecast_beliefs(
    primitive_map: PrimitiveMap, cases: Cases, horizons_s: tuple[float, ...], *, noise_m: float = NOISE.start,
    leaders: bool = False, n_samples: int, rng: np.random.Generator, filter_of: FilterOf = ParticleFilter,
) -> FloatArray:  # fmt: skip
    """Rollouts of cases.

    Args:
        primitive_map: how vehicles move at each place.
        cases: n, at rows of their log.
        horizons_s: (n_horizons,) ascending, seconds ahead.
        noise_m: metres, standard deviation of the log's positions in each axis.
        leaders: whether sample p of all vehicles seen in the last quarter of a second is one scene.
        n_samples: of each case.
        rng: draws beliefs and rollouts.
        filter_of: makes the filter.

    Returns:
        (n, n_samples, n_horizons, 2) metres.
    """
    config, log, vehicle = FilterConfig(noise_m=noise_m), cases.log, cases.log.vehicle
    table = motion_table(primitive_map, step_s=config.step_s)
    response, dt_s = leader_table(primitive_map, config) if leaders else ALONE, np.diff(horizons_s, prepend=0.0)
    detections, key = Detections.of(log), rng.integers(2**63, size=len(log)).astype(np.uint64)
    case = np.full(len(log), NO_VEHICLE)
    case[cases.row] = np.arange(cases.row.size)
    path = np.empty((cases.row.size, n_samples, dt_s.size, 2))

    frames = _frames(log, np.arange(len(log)) if leaders else np.flatnonzero(np.isin(vehicle, vehicle[cases.row])))
    slots = _slots(vehicle, frames)
    beliefs = filter_of(primitive_map, config)
    beliefs.reserve(n_slots := 1 + int(slots.max(initial=0)))
    held = np.full(n_slots, NO_VEHICLE)  # the vehicle that a slot's belief is of
    seen_ns, at_ns = np.zeros((2, n_slots), np.int64)  # of its last row, and of the belief
    longest_ns = int(max(config.max_gap_s * 1e9, 1e9 * GAP_INTERVALS * usual_interval_s(log)))
    group, unexplained = None, np.zeros(n_slots, np.int64)
    for rows in frames:
        now_ns, own = int(log.time_ns[rows[0]]), slots[vehicle[rows]]
        if log.group[rows[0]] != group:
            group, held[:] = log.group[rows[0]], NO_VEHICLE
        goes_on = (held[own] == vehicle[rows]) & (now_ns - seen_ns[own] <= longest_ns)
        held[own], seen_ns[own] = vehicle[rows], now_ns
        known = around = own[goes_on]
        if leaders:
            around = np.flatnonzero((held != NO_VEHICLE) & (now_ns - seen_ns <= int(LONGEST_UNSEEN_S * 1e9)))
            around = around[~np.isin(around, own[~goes_on])]
        beliefs.predict(around, (now_ns - at_ns[around]) * 1e-9)
        evidence = beliefs.weigh(known, detections[rows[goes_on]])
        unexplained[known] = (unexplained[known] + 1) * evidence.is_unexplained
        goes_on[goes_on] = unexplained[known] < LOST_AFTER
        begun = own[~goes_on]
        beliefs.begin(begun, key[rows[~goes_on]], detections[rows[~goes_on]])
        unexplained[begun] = 0
        beliefs.resample(known)
        at_ns[around], at_ns[begun] = now_ns, now_ns
        asked = np.flatnonzero(case[rows] != NO_VEHICLE)
        if not asked.size:
            continue
        scene = np.union1d(around, begun) if leaders else own[asked]
        samples = beliefs.particles(scene).thinned(1)
        clouds = [sampled(table, samples.of(i), n_samples, rng=rng) for i in range(scene.size)]
        paths = projected(table, clouds, dt_s, response)
        place = np.zeros(n_slots, np.int64)
        place[scene] = np.arange(scene.size)
        path[case[rows[asked]]] = paths[place[own[asked]]]
    return path


def chosen_noise(
    primitive_map: PrimitiveMap, known: Cases, horizons_s: tuple[float, ...], *, rng: np.random.Generator
) -> tuple[Choice, ...]:
    """The noise with which training vehicles are forecast best, as rivals' settings are chosen; none of few cases."""
    log, vehicle, seed = known.log, known.log.vehicle[known.row], rng.integers(2**63)
    some = rng.permutation(np.unique(vehicle))[:MOST_VEHICLES]
    seconds = np.cumsum([1e-9 * np.ptp(log.time_ns[log.vehicle == v]) for v in some])
    cases = known.some(np.isin(vehicle, some[: max(FEWEST_VEHICLES, np.count_nonzero(seconds < MOST_SECONDS))]))
    if np.isnan(mean_log_energy(np.zeros((cases.row.size, 2, len(horizons_s), 2)), cases.later)):
        return ()

    def score(values: tuple[float, ...]) -> float:
        path = forecast_beliefs(
            primitive_map, cases, horizons_s, noise_m=values[0], n_samples=N_SAMPLES, rng=np.random.default_rng(seed)
        )
        return -mean_log_energy(path, cases.later)

    return choose([NOISE], score)


def _frames(log: Tracks, rows: IntArray) -> list[IntArray]:
    """Rows of a log, those of each instant of a group together, group by group, ascending in time."""
    order = rows[np.lexsort((log.time_ns[rows], log.group[rows]))]
    begins = (np.diff(log.group[order]) != 0) | (np.diff(log.time_ns[order]) != 0)
    return np.split(order, np.flatnonzero(begins) + 1) if rows.size else []


def _slots(vehicle: IntArray, frames: list[IntArray]) -> IntArray:
    """(n_vehicles,) a slot for each vehicle of the frames; those that never meet may have the same."""
    first, last = np.full((2, 1 + int(vehicle.max(initial=-1))), NO_VEHICLE)
    for i, rows in enumerate(frames):
        last[vehicle[rows]] = i
    for i, rows in reversed(list(enumerate(frames))):
        first[vehicle[rows]] = i
    slot, n = np.zeros(first.size, np.int64), 0
    busy: list[tuple[int, int]] = []
    for v in np.argsort(first, kind="stable")[np.count_nonzero(first == NO_VEHICLE) :]:
        if busy and busy[0][0] < first[v]:
            slot[v] = heapq.heappop(busy)[1]
        else:
            slot[v], n = n, n + 1
        heapq.heappush(busy, (int(last[v]), int(slot[v])))
    return slot
