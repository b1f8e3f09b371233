"""Pieces of what a sensor reports of moving vehicles, short enough for a likelihood of their whole covariance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.course import motion_of
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.track_ids import vehicle_numbers

LONGEST = 100
"""Detections of a window."""
FEWEST = 12
LONGEST_S = 10.0
LEAST_STEP_S = 0.09
"""Detections nearer in time are passed over: windows would be too short to tell errors that last from white ones."""
LONGEST_PAUSE_S = 1.0
MOVING_FROM = 1.0
"""m/s: of slower vehicles the way has no direction that is worth to be known."""
STRAYS = 6.0
"""Robust standard deviations of second differences from which on a detection is an outlier."""
MAD = 1.4826


class Windows(NamedTuple):
    """Detections of vehicles in motion. (w, n) windows, padded where they are shorter.

    Attributes:
        time_s: (w, n) seconds from the first.
        position: (w, n, 2) metres from the mean of the window; 0 where padded.
        along: (w, n, 2) unit vector of the course; 0 where padded.
        known: (w, n) false where padded.
    """

    time_s: FloatArray
    position: FloatArray
    along: FloatArray
    known: BoolArray


def windows_of(detections: Detections, *, n_most: int, rng: np.random.Generator) -> Windows:
    """At most so many windows, drawn from all that there are.

    Args:
        detections: with ids.
        n_most: how many.
        rng: which.
    """
    named = detections[detections.track_id != NO_ID]
    vehicle = vehicle_numbers(named.track_id, named.group)
    motion = motion_of(vehicle, named.time_ns, named.position)
    time_s = np.asarray(named.time_ns * 1e-9, np.float64)
    found = [
        rows
        for of_vehicle in by_vehicle(vehicle, named.time_ns)
        for rows in _pieces(of_vehicle, time_s)
        if np.nan_to_num(motion.speed[rows]).min() >= MOVING_FROM
    ]
    chosen = [found[i] for i in rng.permutation(len(found))[:n_most]]
    shape = (len(chosen), LONGEST)
    windows = Windows(np.zeros(shape), np.zeros((*shape, 2)), np.zeros((*shape, 2)), np.zeros(shape, np.bool_))
    for i, rows in enumerate(chosen):
        n = rows.size
        windows.time_s[i, :n] = (named.time_ns[rows] - named.time_ns[rows[0]]) * 1e-9
        windows.position[i, :n] = named.position[rows] - named.position[rows].mean(axis=0)
        windows.along[i, :n] = np.column_stack([np.cos(motion.direction[rows]), np.sin(motion.direction[rows])])
        windows.known[i, :n] = True
    return windows


def without_strays(detections: Detections) -> tuple[Detections, int, int]:
    """Detections without those far from where their neighbours in time put them; how many these are, and of how many.

    Only detections between two others of their vehicle are judged.
    """
    vehicle = vehicle_numbers(detections.track_id, detections.group)
    order = np.lexsort((detections.time_ns, vehicle))
    time_s, of = detections.time_ns[order] * 1e-9, vehicle[order]
    inner = np.flatnonzero((of[2:] == of[:-2]) & (time_s[2:] - time_s[:-2] <= LONGEST_PAUSE_S)) + 1
    before, after = time_s[inner] - time_s[inner - 1], time_s[inner + 1] - time_s[inner]
    share = (after / (before + after))[:, None]
    place = detections.position[order]
    off = np.hypot(*(place[inner] - share * place[inner - 1] - (1.0 - share) * place[inner + 1]).T)
    usual = MAD * float(np.median(off)) if off.size else 0.0
    # a stray one moves its neighbours' expected places by half as much: only the worst of three is one
    worst = np.zeros(len(order))
    worst[inner] = off
    around = np.maximum(np.r_[worst[1:], 0.0], np.r_[0.0, worst[:-1]])
    stray = inner[(off > STRAYS * max(usual, 1e-3)) & (off >= around[inner])]
    kept = np.ones(len(detections), np.bool_)
    kept[order[stray]] = False
    return detections[kept], int(stray.size), int(inner.size)


def by_vehicle(vehicle: IntArray, time_ns: IntArray) -> list[IntArray]:
    """Rows of each vehicle, ascending in time."""
    order = np.lexsort((time_ns, vehicle))
    return np.split(order, np.flatnonzero(np.diff(vehicle[order])) + 1)


def _pieces(rows: IntArray, time_s: FloatArray) -> Iterator[IntArray]:
    """One vehicle's rows, cut where a window is full or the vehicle was out of sight."""
    piece: list[int] = []
    for row in rows.tolist():
        if piece and (
            len(piece) == LONGEST
            or time_s[row] - time_s[piece[0]] > LONGEST_S
            or time_s[row] - time_s[piece[-1]] > LONGEST_PAUSE_S
        ):
            if len(piece) >= FEWEST:
                yield np.array(piece)
            piece = []
        if not piece or time_s[row] - time_s[piece[-1]] >= LEAST_STEP_S:
            piece.append(row)
    if len(piece) >= FEWEST:
        yield np.array(piece)
