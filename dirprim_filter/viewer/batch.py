"""Frames that wait to be sent to the viewer together: a message costs more than what one frame puts in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import rerun as rr

from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.viewer import marks
from dirprim_filter.viewer.blueprint import TIMELINE
from tessellation.arrays import FloatArray

Columns = tuple[str, rr.TimeColumn, rr.ComponentColumnList]
"""An entity, its instants, and what it shows at each."""


class FrameBatch:
    """Gathers frames and turns them into columns, one set for each entity.

    Args:
        particle_stride: one particle in so many is kept.
    """

    def __init__(self, *, particle_stride: int) -> None:
        self._stride = particle_stride
        self._time_ns: list[int] = []
        self._believed: list[Estimates] = []
        self._detected: list[FloatArray] = []
        self._particles: list[tuple[FloatArray, FloatArray]] = []
        self._steps: list[tuple[list[str], FloatArray]] = []

    def __len__(self) -> int:
        return len(self._time_ns)

    def add(self, frame: TrackedFrame, stepped: list[str], steps: FloatArray) -> None:
        """Take a frame, and the steps (n, 2, 2) of the vehicles of it that were seen before."""
        self._time_ns.append(frame.time_ns)
        self._believed.append(frame.estimates)
        self._detected.append(frame.detections.position)
        kept = slice(None, None, self._stride)
        # Copies, so that the other particles need not be kept until the batch is sent.
        self._particles.append((frame.particles.position[kept].copy(), frame.particles.direction[kept].copy()))
        self._steps.append((stepped, steps))

    def columns(self) -> Iterator[Columns]:
        """What the frames show; a vehicle that a frame does not name vanishes in it."""
        if not self._time_ns:
            return
        times = time_column(self._time_ns)
        believed = Estimates.concatenate(self._believed)
        n_believed = [len(part) for part in self._believed]
        for entity, draw in (
            ("/tracks/estimates", marks.estimates),
            ("/tracks/ids", marks.ids),
            ("/tracks/motion", marks.motion),
            ("/tracks/covariance", marks.covariance),
        ):
            yield entity, times, draw(believed).partition(n_believed)
        n_detected = [len(part) for part in self._detected]
        yield "/detections", times, marks.detections(np.concatenate(self._detected)).partition(n_detected)
        position, direction = (np.concatenate(parts) for parts in zip(*self._particles, strict=True))
        n_particles = [len(part) for part, _ in self._particles]
        yield "/tracks/particles", times, marks.particles(position, direction).partition(n_particles)
        stepped = [name for names, _ in self._steps for name in names]
        steps = marks.trails(stepped, np.concatenate([part for _, part in self._steps]))
        yield "/tracks/trails", times, steps.partition([len(names) for names, _ in self._steps])
        yield from self._metrics(times, n_believed)

    def _metrics(self, times: rr.TimeColumn, n_believed: Sequence[int]) -> Iterator[Columns]:
        yield "/metrics/vehicles", times, rr.Scalars.columns(scalars=n_believed)
        known = [(time_ns, part) for time_ns, part in zip(self._time_ns, self._believed, strict=True) if len(part)]
        if known:
            when = time_column([time_ns for time_ns, _ in known])
            ess = [part.effective_sample_size.mean() for _, part in known]
            evidence = [part.log_evidence.mean() for _, part in known]
            yield "/metrics/ess", when, rr.Scalars.columns(scalars=ess)
            yield "/metrics/log_evidence", when, rr.Scalars.columns(scalars=evidence)


def time_column(time_ns: Sequence[int]) -> rr.TimeColumn:
    """Instants of the log, exact to the nanosecond."""
    return rr.TimeColumn(TIMELINE, timestamp=np.array(time_ns, dtype=np.int64).astype("datetime64[ns]"))
