"""Frames that wait to be sent to the viewer together: a message costs more than what one frame puts in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import repeat

import numpy as np
import rerun as rr

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.drawing.names import short_name
from dirprim_filter.drawing.sight import may_be_anywhere
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.blueprint import TRAIL_S
from dirprim_filter.viewer.focus import Look, polar_curves, speed_rows
from dirprim_filter.viewer.stream import time_column

Columns = tuple[str, rr.TimeColumn, rr.ComponentColumnList]
"""An entity, its instants, and what it shows at each."""
POLAR = ("prior", "cue", "posterior", "belief")
BOLD = 2.5
"""By how much a smoothed path is wider than the filter's."""
SOUTHWARDS = np.array([1.0, -1.0])
"""Two-dimensional views count y downwards."""


class Steps:
    """Where vehicles were seen last, so that a line leads from there to where they are.

    Attributes:
        last: by name the time, ns, and metres east and north.
    """

    def __init__(self) -> None:
        self.last: dict[str, tuple[int, float, float]] = {}

    def of(self, frame: TrackedFrame) -> tuple[IntArray, FloatArray]:
        """Rows of the frame's vehicles that were seen in the last seconds, (n,), and their steps, (n, 2, 2) metres."""
        seen = [self.last.get(name) for name in frame.names]
        known = np.array([row for row, before in enumerate(seen) if before is not None], np.int64)
        start = np.array([before[1:] for before in seen if before is not None]).reshape(-1, 2)
        east, north = frame.estimates.position.T.tolist()
        oldest_ns = frame.time_ns - int(TRAIL_S * 1e9)
        self.last = {name: before for name, before in self.last.items() if before[0] >= oldest_ns}
        self.last |= dict(zip(frame.names, zip(repeat(frame.time_ns), east, north), strict=True))
        return known, np.stack([start, frame.estimates.position[known]], axis=1)


class SmoothedBatch:
    """Smoothed frames, in order of time, beside those of the filter: bold paths and thin ellipses."""

    def __init__(self) -> None:
        self._frames: list[TrackedFrame] = []
        self._steps, self._trails = Steps(), list[tuple[IntArray, FloatArray]]()

    def __len__(self) -> int:
        return len(self._frames)

    def add(self, frame: TrackedFrame) -> None:
        """Take a frame."""
        self._frames.append(frame)
        self._trails.append(self._steps.of(frame))

    def columns(self) -> Iterator[Columns]:
        """What the frames gathered since the last time show."""
        if not self._frames:
            return
        times = time_column([frame.time_ns for frame in self._frames])
        n_each = [len(frame.estimates) for frame in self._frames]
        believed = Estimates.concatenate([frame.estimates for frame in self._frames])
        drawn = _trails(believed, n_each, self._trails, np.ones(len(believed)), width=BOLD)
        yield "/smoothed/trails", times, drawn
        yield "/smoothed/covariance", times, marks.covariance(believed).partition(n_each)
        self._frames, self._trails = [], []


def _trails(
    believed: Estimates, n_each: list[int], steps: list[tuple[IntArray, FloatArray]], prominence: FloatArray, *,
    width: float = 1.0,
) -> rr.ComponentColumnList:  # fmt: skip
    """The steps of each frame's vehicles; its rows count from its own first."""
    first = np.cumsum([0, *n_each[:-1]])
    rows = np.concatenate([start + own for start, (own, _) in zip(first, steps, strict=True)])
    path = np.concatenate([part for _, part in steps])
    return marks.trails(believed.track_id[rows], path, prominence[rows], width=width).partition(
        [len(own) for own, _ in steps]
    )


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
        yield "/tracks/trails", times, _trails(believed, n_believed, self._steps, prominence)
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
