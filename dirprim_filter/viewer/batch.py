"""Frames that wait to be sent to the viewer together: a message costs more than what one frame puts in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import rerun as rr

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.drawing.names import short_name
from dirprim_filter.drawing.sight import may_be_anywhere
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.focus import Look, polar_curves, speed_rows
from dirprim_filter.viewer.lifelines import Lifelines
from dirprim_filter.viewer.timeline import time_column

Columns = tuple[str, rr.TimeColumn, rr.ComponentColumnList]
"""An entity, its instants, and what it shows at each."""
POLAR = ("prior", "cue", "posterior", "belief")
SOUTHWARDS = np.array([1.0, -1.0])
"""Two-dimensional views count y downwards."""


class FrameBatch:
    """Gathers frames and turns them into columns, one set for each entity.

    Args:
        primitives: the map, for what the prior says of the vehicle to look at.
        depth: metres of ground in view: labels and rings keep their size on the screen.
    """

    def __init__(self, *, primitives: PrimitiveMap | None = None, depth: float = 100.0) -> None:
        self._depth, self._primitives = depth, primitives
        self._time_ns: list[int] = []
        self._believed: list[Estimates] = []
        self._detected: list[FloatArray] = []
        self._in_full: list[BoolArray] = []
        self._particles: list[marks.Dots] = []
        self._steps: list[tuple[IntArray, FloatArray]] = []
        self._looks: list[Look | None] = []
        self._metrics: dict[str, list[tuple[int, tuple[float, ...]]]] = {}

    def __len__(self) -> int:
        return len(self._time_ns)

    def add(
        self,
        frame: TrackedFrame,
        *,
        particles: Particles,
        in_full: BoolArray,
        steps: tuple[IntArray, FloatArray],
        look: Look | None,
        metrics: Mapping[str, tuple[float, ...]],
    ) -> None:
        """Take a frame and what is drawn of it.

        Args:
            frame: of vehicles.
            particles: of them.
            in_full: (n_vehicles,) which of them are drawn with all that is known of them.
            steps: which of them were seen before, (n,), and their steps since, (n, 2, 2) metres.
            look: at one of them.
            metrics: of the frame.
        """
        self._time_ns.append(frame.time_ns)
        self._believed.append(frame.estimates)
        self._detected.append(frame.detections.position)
        self._particles.append(marks.Dots.of(particles))
        self._in_full.append(in_full)
        self._steps.append(steps)
        self._looks.append(look)
        for entity, row in metrics.items():
            self._metrics.setdefault(entity, []).append((frame.time_ns, row))

    def columns(self) -> Iterator[Columns]:
        """What the frames show; a vehicle that a frame does not name vanishes in it."""
        if not self._time_ns:
            return
        times = time_column(self._time_ns)
        believed = Estimates.concatenate(self._believed)
        n_believed = [len(part) for part in self._believed]
        frame = np.repeat(np.arange(len(n_believed)), n_believed)
        in_full = np.concatenate(self._in_full)
        prominence = np.where(in_full, 1.0, marks.in_crowd(np.array(n_believed))[frame])
        for entity, draw in (
            ("/tracks/estimates", marks.estimates),
            ("/tracks/motion", marks.motion),
        ):
            yield entity, times, draw(believed, prominence).partition(n_believed)
        unseen = believed.is_coasting
        named = marks.ids(believed[in_full], depth=self._depth)
        yield "/tracks/ids", times, named.partition(np.bincount(frame[in_full], minlength=len(n_believed)))
        for entity, chosen in (
            ("/tracks/covariance", in_full & ~unseen),
            ("/tracks/unseen", in_full & unseen & ~may_be_anywhere(believed)),
        ):
            counts = np.bincount(frame[chosen], minlength=len(n_believed))
            yield entity, times, marks.covariance(believed[chosen]).partition(counts)
        n_detected = [len(part) for part in self._detected]
        detected = np.concatenate(self._detected)
        yield "/detections", times, marks.detections(detected, n_detected)
        n_particles = [len(dots.color) for dots in self._particles]
        yield "/tracks/particles", times, marks.particles(self._particles).partition(n_particles)
        first = np.cumsum([0, *n_believed[:-1]])
        stepped = np.concatenate([start + rows for start, (rows, _) in zip(first, self._steps, strict=True)])
        way = np.concatenate([part for _, part in self._steps])
        steps = marks.trails(believed.track_id[stepped], way, prominence[stepped])
        yield "/tracks/trails", times, steps.partition([len(rows) for rows, _ in self._steps])
        yield from self._of_focus(times)
        for entity, rows in self._metrics.items():
            when = time_column([time_ns for time_ns, _ in rows])
            yield entity, when, _curves(np.array([values for _, values in rows]))

    def _of_focus(self, times: rr.TimeColumn) -> Iterator[Columns]:
        looks = self._looks
        n_shown = [int(look is not None) for look in looks]
        shown = [look for look in looks if look is not None]
        places = np.array([look.position for look in shown]).reshape(-1, 2)
        yield "/focus/ring", times, marks.ring(places, depth=self._depth).partition(n_shown)
        yield "/focus/speed", times, _curves(speed_rows(looks, self._primitives))
        if shown:
            curves = polar_curves(shown, self._primitives)
            for name in POLAR:
                strips = (SOUTHWARDS * getattr(curves, name)).astype(np.float32)
                yield f"/polar/{name}", times, rr.LineStrips2D.columns(strips=strips).partition(n_shown)
            names = rr.Points2D.columns(positions=np.tile([-1.2, 1.2], (len(shown), 1)),
                                        labels=[short_name(look.track_id) for look in shown])  # fmt: skip
            yield "/polar/vehicle", times, names.partition(n_shown)


def _curves(rows: FloatArray) -> rr.ComponentColumnList:
    """(n, k) values of k curves."""
    return rr.Scalars.columns(scalars=rows.ravel()).partition([rows.shape[1]] * len(rows))


def lane_columns(lines: Lifelines) -> Iterator[Columns]:
    """What has changed in the lanes and in the diary since the last time."""
    for lane, changes in lines.changes.items():
        times = time_column([change.time_ns for change in changes])
        states = [change.state for change in changes if change.state]
        n_states = [int(bool(change.state)) for change in changes]
        yield lane_path(lane), times, rr.StateChange.columns(state=states).partition(n_states)
    if lines.entries:
        entries = lines.entries
        columns = rr.TextLog.columns(text=[e.text for e in entries], level=[e.level for e in entries])
        yield "/events", time_column([e.time_ns for e in entries]), columns


def lane_path(lane: int) -> str:
    """The entity of a lane."""
    return f"/vehicles/{lane + 1:02d}"


def lane_styles(lines: Lifelines) -> Iterator[tuple[str, rr.StateConfiguration]]:
    """The colours of the states of lanes that have changed."""
    for lane in lines.changes:
        states = lines.states[lane]
        yield (
            lane_path(lane),
            rr.StateConfiguration(values=list(states), labels=list(states), colors=list(states.values())),
        )
