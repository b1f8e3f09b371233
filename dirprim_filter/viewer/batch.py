"""Frames that wait to be sent to the viewer together: a message costs more than what one frame puts in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.drawing.names import short_name
from dirprim_filter.drawing.sight import may_be_anywhere
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.blueprint import TRAIL_S
from dirprim_filter.viewer.direction_panel import SOUTHWARDS, polar_curves, speed_rows
from dirprim_filter.viewer.focus import Look
from dirprim_filter.viewer.stream import time_column

Columns = tuple[str, rr.TimeColumn, rr.ComponentColumnList]
"""An entity, its instants, and what it shows at each."""
Step = tuple[IntArray, FloatArray]
"""Rows of a frame's vehicles that were seen in the last seconds, (n,), and their steps since, (n, 2, 2) metres."""
BOLD = 2.5
"""By how much a smoothed path is wider than the filter's."""


class Steps:
    """Where vehicles were seen last, so that a line leads from there to where they are."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, float, float]] = {}

    def of(self, frame: TrackedFrame) -> Step:
        """The steps of a frame's vehicles."""
        seen = [self._last.get(name) for name in frame.names]
        known = np.array([row for row, before in enumerate(seen) if before is not None], np.int64)
        start = np.array([before[1:] for before in seen if before is not None]).reshape(-1, 2)
        oldest_ns = frame.time_ns - int(TRAIL_S * 1e9)
        self._last = {name: before for name, before in self._last.items() if before[0] >= oldest_ns}
        for name, (east, north) in zip(frame.names, frame.estimates.position.tolist(), strict=True):
            self._last[name] = (frame.time_ns, east, north)
        return known, np.stack([start, frame.estimates.position[known]], axis=1)


class Drawn(NamedTuple):
    """A frame, and what is drawn of it.

    Attributes:
        frame: of vehicles.
        steps: of its vehicles.
        particles: some of its own, a copy.
        in_full: (n_vehicles,) which of them are drawn with all that is known of them.
        look: at one of them.
        metrics: of the frame, by entity.
    """

    frame: TrackedFrame
    steps: Step
    particles: Particles
    in_full: BoolArray
    look: Look | None
    metrics: Mapping[str, tuple[float, ...]]


def columns(drawn: Sequence[Drawn], *, primitives: PrimitiveMap | None, depth: float) -> Iterator[Columns]:
    """What frames show; a vehicle that a frame does not name vanishes in it.

    Args:
        drawn: the frames, at least one.
        primitives: the map, for what the prior says of the vehicle to look at.
        depth: metres of ground in view: labels and rings keep their size on the screen.
    """
    times = time_column([one.frame.time_ns for one in drawn])
    estimates = Estimates.concatenate([one.frame.estimates for one in drawn])
    n_each = [len(one.frame.estimates) for one in drawn]
    frame = np.repeat(np.arange(len(drawn)), n_each)
    in_full = np.concatenate([one.in_full for one in drawn])
    prominence = np.where(in_full, 1.0, marks.in_crowd(np.array(n_each))[frame])
    yield "/tracks/estimates", times, marks.estimates(estimates, prominence).partition(n_each)
    yield "/tracks/motion", times, marks.motion(estimates, prominence).partition(n_each)
    unseen = estimates.is_coasting
    for entity, chosen, shown in (
        ("/tracks/ids", in_full, marks.ids(estimates[in_full], depth=depth)),
        ("/tracks/covariance", mask := in_full & ~unseen, marks.covariance(estimates[mask])),
        ("/tracks/unseen", mask := in_full & unseen & ~may_be_anywhere(estimates), marks.covariance(estimates[mask])),
    ):
        yield entity, times, shown.partition(np.bincount(frame[chosen], minlength=len(drawn)))
    detected = [one.frame.detections.position for one in drawn]
    yield "/detections", times, marks.detections(np.concatenate(detected), [len(part) for part in detected])
    particles = [one.particles for one in drawn]
    yield "/tracks/particles", times, marks.particles(particles).partition([len(part) for part in particles])
    yield "/tracks/trails", times, _trails(estimates, n_each, [one.steps for one in drawn], prominence)
    yield from _of_focus(times, [one.look for one in drawn], primitives, depth)
    for entity in sorted({entity for one in drawn for entity in one.metrics}):
        rows = [(one.frame.time_ns, one.metrics[entity]) for one in drawn if entity in one.metrics]
        yield entity, time_column([time_ns for time_ns, _ in rows]), _curves(np.array([row for _, row in rows]))


def smoothed_columns(frames: Sequence[tuple[TrackedFrame, Step]]) -> Iterator[Columns]:
    """What smoothed frames show beside those of the filter: bold paths and thin ellipses."""
    times = time_column([frame.time_ns for frame, _ in frames])
    n_each = [len(frame.estimates) for frame, _ in frames]
    estimates = Estimates.concatenate([frame.estimates for frame, _ in frames])
    of_each = [steps for _, steps in frames]
    yield "/smoothed/trails", times, _trails(estimates, n_each, of_each, np.ones(len(estimates)), width=BOLD)
    yield "/smoothed/covariance", times, marks.covariance(estimates).partition(n_each)


def _trails(
    estimates: Estimates, n_each: list[int], steps: list[Step], prominence: FloatArray, *, width: float = 1.0
) -> rr.ComponentColumnList:
    """The steps of each frame's vehicles; its rows count from its own first."""
    first = np.cumsum([0, *n_each[:-1]])
    rows = np.concatenate([start + own for start, (own, _) in zip(first, steps, strict=True)])
    path = np.concatenate([part for _, part in steps])
    drawn = marks.trails(estimates.track_id[rows], path, prominence[rows], width=width)
    return drawn.partition([len(own) for own, _ in steps])


def _of_focus(
    times: rr.TimeColumn, looks: list[Look | None], primitives: PrimitiveMap | None, depth: float
) -> Iterator[Columns]:
    n_shown = [int(look is not None) for look in looks]
    shown = [look for look in looks if look is not None]
    places = np.array([look.position for look in shown]).reshape(-1, 2)
    yield "/focus/ring", times, marks.ring(places, depth=depth).partition(n_shown)
    yield "/focus/speed", times, _curves(speed_rows(looks, primitives))
    if not shown:
        return
    for name, lines in polar_curves(shown, primitives).items():
        strips = rr.LineStrips2D.columns(strips=(SOUTHWARDS * lines).astype(np.float32))
        yield f"/polar/{name}", times, strips.partition(n_shown)
    names = [short_name(look.track_id) for look in shown]
    titles = rr.Points2D.columns(positions=np.tile([-1.2, 1.2], (len(shown), 1)), labels=names)
    yield "/polar/vehicle", times, titles.partition(n_shown)


def _curves(rows: FloatArray) -> rr.ComponentColumnList:
    """(n, k) values of k curves."""
    return rr.Scalars.columns(scalars=rows.ravel()).partition([rows.shape[1]] * len(rows))
