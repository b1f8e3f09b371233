"""Whether the rows of a log or a table can be: one check of units, times and ids, of all that is read as tracks."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.faults import find_faults, wrong_scale
from dirprim_filter.jumps import ACCELERATION, FASTEST, MOST_JUMPS, Jumps, Scale
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.losses import OFF_WAY, REPEATED, Losses
from dirprim_filter.recording.rows import LEFT_OUT, Rows
from dirprim_filter.track_ids import in_order, repeated_in


class ImplausibleError(RecordingError):
    """What was read is no log of tracks."""


class DetectionsAloneError(ImplausibleError):
    """Tracks are asked for, and there are detections without ids alone."""


OFTEN = 0.1
"""So many of the steps are jumps, where ids number the objects of each message anew."""
SAMPLED, NEARER = 200, 4.0
"""Steps that are looked at; and by how many times another id was nearer than the own one, where they are exchanged."""
AT_ZERO_M = 0.5
"""Where what counts from its own start begins."""
TWIN_M, TWIN_NOISES, TOGETHER, LEAST_TIMES, MOST_BESIDE = 0.4, 5.0, 0.9, 10, 8
"""Two are one within so many metres, or times the log's noise, in such a share of the times at which both are there,
and so many at least; and with how many that are next on an axis each is compared."""
GAPS = 3.0
"""So many usual intervals between two rows are a gap, in which nobody knows where a vehicle was."""
COMPARED = 100_000
"""About so many rows have stated motion compared with their way."""


def plausible(rows: Rows, losses: Losses, path: Path) -> Rows:
    """The rows that can be, of `names`.

    Rows that repeat a vehicle and a time, and those that no body reaches from the ones before and after, are left out
    and counted; an id of several vehicles becomes several. Speeds and courses in other units are unknown from here on.
    All this is among the `faults` of the losses.

    Raises:
        ImplausibleError: no log of vehicles looks so; with the likely cause.
    """
    n_rows = len(rows)
    order = in_order(rows.track_id, rows.time_ns)
    if (repeated := repeated_in(order, rows.track_id, rows.time_ns)).any():
        losses.drop(REPEATED, repeated)
        rows = rows[~repeated]
        order = in_order(rows.track_id, rows.time_ns)
    losses.doubt_ids(n_rows)
    vehicle, time_ns, position = rows.track_id[order], rows.time_ns[order], rows.position[order]
    scale = Scale.of(vehicle, time_ns, position)
    if wrong := wrong_scale(scale):
        raise ImplausibleError(f"{path}: {wrong}")
    if (rows.group == rows.group[:1]).all():  # groups are worlds of their own
        losses.faults += _in_own_frames(vehicle, time_ns, position)
        losses.faults += _twins(vehicle, time_ns, position, rows.names, scale)
    if (absurd := rows.speed > FASTEST).any():
        if 2 * np.count_nonzero(absurd) > np.count_nonzero(np.isfinite(rows.speed)):
            raise ImplausibleError(
                f"{path}: expected speeds in m/s, got {float(rows.speed[absurd][0]):g}; mend them (column speed_mps of "
                "a table), or leave them out: speeds are then derived from positions"
            )
        losses.faults.append(f"{np.count_nonzero(absurd)} speeds above {FASTEST:g} m/s are not used")
        rows = replace(rows, speed=np.where(absurd, np.nan, rows.speed))
    jumps, steps = Jumps.of(vehicle, time_ns, position, scale), np.flatnonzero(np.diff(vehicle) == 0)
    line = _jumping(rows, order, jumps) if jumps.at.size else "most go"
    at = jumps.at if jumps.at.size > OFTEN * steps.size else steps[: steps.size * (scale.acceleration > ACCELERATION)]
    if jumps.at.size > MOST_JUMPS or (at.size and _exchange_bodies(rows, order, at, scale.least_m)):
        raise ImplausibleError(
            f"{path}: expected ids that name vehicles, but {line} to where another id was just before; `dirprim track "
            "--no-ids` tracks detections without them, and a `group` for each keeps sessions apart"
        )
    some = np.flatnonzero(~jumps.left_out & (vehicle % (1 + len(rows) // COMPARED) == 0))
    speed, course = rows.speed[order[some]], rows.direction[order[some]]
    faults = find_faults(vehicle[some], time_ns[some], position[some], direction=course, speed=speed, scale=scale)
    losses.faults += faults.values()
    rows = replace(rows, **dict.fromkeys(faults.keys() & {"direction", "speed"}, LEFT_OUT))
    if not jumps.at.size:
        return rows
    if jumps.part.any():
        rows, made = _apart(rows, order, jumps)
        line += (
            "; are ids given again, or to two at once (`dirprim track --no-ids` does without), or are two sessions in "
            "one (give each a `group`)? Parts of "
            f"{made[0].rpartition('~')[0]} and others are vehicles of their own, as {made[0]}, {len(made)} in all"
        )
    elif not jumps.left_out.any():  # corrections of the position, but for those that lead to another vehicle
        if _exchange_bodies(rows, order, jumps.at, scale.least_m):
            losses.faults.append(f"{line} to where another id was just before; `dirprim track --no-ids` does without")
        return rows
    else:
        line += ": is that a place that stands for none, such as 0 0, or an outlier?"
    losses.faults.append(line)
    losses.drop(OFF_WAY, jumps.left_out)
    kept = np.ones(len(rows), np.bool_)
    kept[order[jumps.left_out]] = False
    return rows[kept]


def _in_own_frames(vehicle: IntArray, time_ns: IntArray, position: FloatArray) -> list[str]:
    """A line where most vehicles begin at 0 0 though another is on its way from there: rows in their order."""
    first = np.flatnonzero(np.diff(vehicle, prepend=-1))
    last = np.append(first[1:], vehicle.size) - 1
    begins = np.flatnonzero(np.hypot(*position[first].T) < AT_ZERO_M)
    if len(begins) < 2 or 2 * len(begins) <= len(first):
        return []
    begins = begins[np.argsort(time_ns[first[begins]], kind="stable")]
    if not (time_ns[first[begins[1:]]] < np.maximum.accumulate(time_ns[last[begins]])[:-1]).all():
        return []
    return [
        f"{len(begins)} of {len(first)} vehicles begin at 0 0, while others go on from there: does each count from "
        "where it began, as odometry does? Then they are not of one frame; learn from each alone"
    ]


def _twins(
    vehicle: IntArray, time_ns: IntArray, position: FloatArray, names: AnyArray, scale: Scale
) -> list[str]:  # fmt: skip
    """A line where vehicles are in one place whenever both are there: rows in their order.

    Places are compared at some of the times, between a vehicle's rows on the straight line, if these are near in time.
    """
    by_time, longest_ns = np.argsort(time_ns, kind="stable"), GAPS * 1e9 * scale.interval_s
    near_m = max(TWIN_M, TWIN_NOISES * scale.noise)
    of, at_ns, there, met = vehicle[by_time], time_ns[by_time], list[IntArray](), Counter[tuple[int, ...]]()
    for t in np.unique(at_ns[:: 1 + at_ns.size // SAMPLED]).tolist():
        begin, now, end = np.searchsorted(at_ns, [t - longest_ns, t + 1, t + longest_ns])
        before, last = np.unique(of[begin:now][::-1], return_index=True)
        after, first = np.unique(of[now:end], return_index=True)
        present, i, j = np.intersect1d(before, after, assume_unique=True, return_indices=True)
        one, then = by_time[now - 1 - last[i]], by_time[now + first[j]]
        share = ((t - time_ns[one]) / (time_ns[then] - time_ns[one]))[:, None]
        place = position[one] * (1.0 - share) + position[then] * share
        east = np.argsort(place[:, 0])
        for k in range(1, min(MOST_BESIDE, east.size)):
            close = np.hypot(*(place[east[k:]] - place[east[:-k]]).T) < near_m
            pairs = np.sort(present[np.column_stack([east[:-k], east[k:]])[close]], axis=1)
            met.update(map(tuple, pairs.tolist()))
        there.append(present)
    twins = [
        pair for pair, n in met.most_common()
        if n >= LEAST_TIMES and n >= TOGETHER * sum(np.isin(pair, present).all() for present in there)
    ]  # fmt: skip
    if not twins or np.unique(twins).size < OFTEN * np.count_nonzero(np.diff(vehicle, prepend=-1)):
        return []  # two of a crowd may stand side by side
    more = f", and so are {len(twins) - 1} other pairs" if twins[1:] else ""
    return [
        f"{' and '.join(names[list(twins[0])].tolist())} are in one place whenever both are there{more}: is it one "
        "vehicle under several names, or on several topics? --topics chooses"
    ]


def _jumping(rows: Rows, order: IntArray, jumps: Jumps) -> str:
    """The first jump in words."""
    first, then = order[jumps.at[0] : jumps.at[0] + 2].tolist()
    way_m = float(np.hypot(*(rows.position[then] - rows.position[first])))
    dt_s = (int(rows.time_ns[then]) - int(rows.time_ns[first])) * 1e-9
    name = rows.names[rows.track_id[first]]
    return f"vehicle {name} jumps {way_m:.4g} m in {dt_s:.3g} s ({way_m / dt_s:.4g} m/s)"


def _exchange_bodies(rows: Rows, order: IntArray, at: IntArray, least_m: float) -> bool:
    """Whether most steps from some rows lead to where another id was just before, far from their own."""
    by_time, n = np.argsort(rows.time_ns, kind="stable"), 0
    seen_ns = rows.time_ns[by_time]
    some = at[:: 1 + at.size // SAMPLED]
    for first, then in zip(order[some].tolist(), order[some + 1].tolist(), strict=True):
        at_ns = rows.time_ns[first]
        there = by_time[np.searchsorted(seen_ns, at_ns) : np.searchsorted(seen_ns, at_ns, side="right")]
        nearest_m = np.hypot(*(rows.position[there] - rows.position[then]).T).min()
        own_m = np.hypot(*(rows.position[first] - rows.position[then]))
        n += bool(nearest_m < min(least_m, own_m / NEARER))
    return 2 * n > some.size


def _apart(rows: Rows, order: IntArray, jumps: Jumps) -> tuple[Rows, list[str]]:
    """The same with a vehicle of its own for each part of an id but the first; and their names."""
    n_parts, of = int(jumps.part.max()) + 1, np.flatnonzero(jumps.part)
    keys, place = np.unique(rows.track_id[order[of]] * n_parts + jumps.part[of], return_inverse=True)
    made = [f"{rows.names[key // n_parts]}~{key % n_parts}" for key in keys.tolist()]
    taken, number = {*rows.names.tolist()}, rows.track_id.copy()
    while taken & {*made}:
        made = [f"{one}~" for one in made]
    number[order[of]] = rows.names.size + place
    return replace(rows, track_id=number, names=np.array([*rows.names.tolist(), *made], np.str_)), made
