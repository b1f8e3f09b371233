"""Estimates of a filter, frame by frame, and the sinks that take them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from dirprim_filter.arrays import AnyArray, ArrayValue, BoolArray, FloatArray, IntArray
from dirprim_filter.columns import ArrayTable, ids, optional, required, whole
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.origin import Origin
from dirprim_filter.track_ids import as_texts, as_track_ids

COASTING_FROM_S = 0.5
"""A vehicle that was not measured for longer is coasting: one detection that fails to come says little."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimates(ArrayTable):
    """The filter's belief about confirmed vehicles, seen or coasting, a row for each vehicle and instant.

    Attributes:
        track_id: (n,) int64 or str.
        time_ns: (n,) int64, nanoseconds since the log's epoch.
        position: (n, 2) mean, metres.
        covariance: (n, 2, 2) of the position, square metres.
        direction: (n,) circular mean, radians in (-pi, pi].
        direction_resultant: (n,) length of the mean direction vector: 1 certain, 0 unknown.
        speed: (n,) mean, m/s.
        speed_std: (n,) standard deviation, m/s.
        effective_sample_size: (n,) of the particle weights before resampling.
        log_evidence: (n,) natural log of the density of this measurement given those before it, per square metre; that
            of a measured course and speed is a ratio to a false detection's. 0 at birth and where there is none.
        existence: (n,) probability of existence: that there is such a vehicle. Left out: 1.
        unseen_s: (n,) seconds since it was last measured: 0 where it is now. Left out: 0.
        follows_map: (n,) probability that it follows a manoeuvre of the map and does not go its own way. Left out: 0.
        origin: latitude and longitude of the plane's origin, degrees; None where positions have none.

    Raises:
        ValueError: shapes that do not fit.
    """

    track_id: AnyArray = ids(as_track_ids)
    time_ns: IntArray = whole()
    position: FloatArray = required(2)
    covariance: FloatArray = required(2, 2)
    direction: FloatArray = required()
    direction_resultant: FloatArray = required()
    speed: FloatArray = required()
    speed_std: FloatArray = required()
    effective_sample_size: FloatArray = required()
    log_evidence: FloatArray = required()
    existence: FloatArray = optional(missing=1.0)
    unseen_s: FloatArray = optional(missing=0.0)
    follows_map: FloatArray = optional(missing=0.0)
    origin: Origin | None = None

    @property
    def is_coasting(self) -> BoolArray:
        """(n,) predicted by the motion model alone for some time, because nothing was measured."""
        return np.asarray(self.unseen_s > COASTING_FROM_S)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assignments(ArrayTable):
    """Which track each detection was assigned to, a row for each detection, frame by frame.

    Attributes:
        track_id: (n,) str, of the detection as in `Detections`, and not of the track.
        time_ns: (n,) int64, nanoseconds since the log's epoch.
        position: (n, 2) of the detection, metres.
        assigned: (n,) str, the track as in `TrackedFrame.assigned`.
        group: (n,) int64, of the detection. Left out: all 0.
        origin: latitude and longitude of the plane's origin, degrees; None where positions have none.

    Raises:
        ValueError: shapes that do not fit.
    """

    track_id: AnyArray = ids(as_texts)
    time_ns: IntArray = whole()
    position: FloatArray = required(2)
    assigned: AnyArray = ids(as_texts)
    group: IntArray = whole(missing=0)
    origin: Origin | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Particles(ArrayTable):
    """The weighted samples behind the estimates of one instant, all vehicles one after the other.

    Attributes:
        position: (n, 2) metres.
        direction: (n,) radians.
        speed: (n,) m/s.
        weight: (n,) sums to one for each vehicle.
        vehicle: (n,) int64, the row of the vehicle in the frame's estimates, ascending.
        manoeuvre: (n,) int64, the manoeuvre of the map's motion. Left out: -1, none.
        push: (n,) the vehicle's own acceleration, in standard deviations of its manoeuvre's. Left out: 0.
    """

    position: FloatArray = required(2)
    direction: FloatArray = required()
    speed: FloatArray = required()
    weight: FloatArray = required()
    vehicle: IntArray = whole()
    manoeuvre: IntArray = whole(missing=-1)
    push: FloatArray = optional(missing=0.0)

    def of(self, row: int) -> Particles:
        """The samples of one vehicle, by its row in the frame's estimates."""
        first, end = np.searchsorted(self.vehicle, [row, row + 1])
        return self[slice(first, end)]

    def thinned(self, stride: int) -> Particles:
        """A copy of every `stride`-th sample."""
        return self[np.arange(0, len(self), stride)]


class Samples(Protocol):
    """The samples behind the estimates of one instant, of which a sink takes what it wants, as copies.

    Those of a tracker are where its next step will move them: they are there while a frame is written, not later.
    """

    def __len__(self) -> int: ...

    def thinned(self, stride: int) -> Particles:
        """Every `stride`-th sample, 1 for all."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackedFrame(ArrayValue):
    """All that is known at one instant: the detections, the estimates, and the particles.

    Attributes:
        time_ns: nanoseconds since the log's epoch.
        detections: what was reported.
        estimates: of the vehicles that are reported.
        particles: the samples behind it; who keeps a frame keeps a copy of them.
        innovations: (n,) squared distance of each measurement from where it was expected, normalised by its
            covariance; NaN of vehicles that were not measured or are new. Its mean is 2, of chi-squared, where the
            filter is as sure as it should be. None where the tracker was not asked for them.
        expected: (n, 2) metres, where the measurements were expected; NaN and None likewise.
        reinitialised: ids of the vehicles whose belief no longer explained them, and was reinitialised.
        group: (n,) of the log, each estimate's; left out: all of one.
        assigned: (d,) str, the track that each detection was assigned to; empty for none that has a name yet: an
            unlabelled track gets its name when it is confirmed. Left out: none.
    """

    time_ns: int
    detections: Detections
    estimates: Estimates
    particles: Samples
    innovations: FloatArray | None = None
    expected: FloatArray | None = None
    reinitialised: tuple[str, ...] = ()
    group: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    assigned: AnyArray = field(default_factory=lambda: np.empty(0, np.str_))

    def __post_init__(self) -> None:
        if self.group.size == 0:
            object.__setattr__(self, "group", np.zeros(len(self.estimates), np.int64))
        if self.assigned.size == 0:
            object.__setattr__(self, "assigned", np.full(len(self.detections), NO_ID))

    @property
    def assignments(self) -> Assignments:
        """The detections and what they were assigned to, as a table."""
        seen = self.detections
        return Assignments(
            track_id=seen.track_id, time_ns=seen.time_ns, position=seen.position, assigned=self.assigned,
            group=seen.group, origin=seen.origin,
        )  # fmt: skip

    @cached_property
    def names(self) -> list[str]:
        """The ids of the estimates as texts; whoever shows a frame asks for them again and again."""
        return list(as_texts(self.estimates.track_id).tolist())


class EstimateSink(Protocol):
    """Takes the tracked frames as they come: a log, a viewer, a list."""

    def write(self, frame: TrackedFrame) -> None:
        """Take one frame; frames come in order of time."""
        ...


class EstimateList:
    """An `EstimateSink` that keeps all estimates in memory."""

    def __init__(self) -> None:
        self._parts: list[Estimates] = []

    def write(self, frame: TrackedFrame) -> None:
        """Keep the frame's estimates."""
        self._parts.append(frame.estimates)

    def all(self) -> Estimates:
        """All that were written, in their order."""
        return Estimates.concatenate(self._parts)
