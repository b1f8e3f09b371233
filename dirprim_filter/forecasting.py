"""What next? Hallucinated trajectories of a vehicle, cell by cell.

Source: Senanayake et al. 2020, Algorithm 1: sample a mode of the cell, an angle and a speed; project the vehicle by one
step; look up the cell it has come to; repeat.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from dirprim_filter.config import FilterConfig
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.filtering.belief import birth_key
from dirprim_filter.filtering.futures import Start, Steps, forecast_table, sample_paths, sample_paths_of_belief
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.primitives.cues import Cue
from tessellation.arrays import FloatArray, as_floats


def forecast(
    primitive_map: PrimitiveMap,
    *,
    position: npt.ArrayLike,
    direction: float,
    speed: float,
    horizon_s: float = 5.0,
    dt_s: float = 0.5,
    n_samples: int = 100,
    cue: Cue | None = None,
    config: FilterConfig | None = None,
    rng: np.random.Generator,
) -> FloatArray:
    """Sample where a vehicle goes from here.

    Args:
        primitive_map: how vehicles move at each place.
        position: (2,) metres.
        direction: course over ground, radians.
        speed: m/s, not negative.
        horizon_s: seconds to look ahead.
        dt_s: seconds between the positions returned; the motion itself is sampled at `config.step_s`.
        n_samples: number of futures.
        cue: what the vehicle tells of where it will turn: its turn signal.
        config: the motion model's knobs.
        rng: what the futures are drawn from.

    Returns:
        (n_samples, n_steps, 2) positions at dt_s, 2 dt_s, ... up to the horizon, metres.

    Raises:
        ValueError: a number that is not finite, a negative speed, or times and counts that are not positive.
    """
    start = Start.of(as_floats("position", position, "2")[None], [direction], [speed])
    steps = Steps.of(horizon_s, dt_s, n_samples)
    table = forecast_table(primitive_map, config or FilterConfig())
    return np.asarray(sample_paths(table, start, steps, cue=cue, rng=rng)[0])


class ForecastSink(Protocol):
    """Takes forecasts as they are made: a log, a viewer."""

    def write_forecast(self, time_ns: int, track_id: Sequence[str], paths: FloatArray) -> None:
        """Take the futures of vehicles, (n, n_samples, n_steps, 2) metres, after the frame of that time."""
        ...


class Forecaster:
    """An `EstimateSink` that forecasts every vehicle of a frame, now and then.

    A vehicle's futures follow from the seed, its id and the time: no other vehicle has a part in them.

    Args:
        primitive_map: how vehicles move at each place.
        sinks: take the forecasts.
        every_s: seconds of log time between forecasts.
        horizon_s: seconds to look ahead.
        dt_s: seconds between positions.
        n_samples: futures of each vehicle.
        config: the motion model's knobs.
        rng: one number drawn from it seeds every forecast.
    """

    def __init__(
        self,
        primitive_map: PrimitiveMap,
        sinks: Sequence[ForecastSink],
        *,
        every_s: float = 1.0,
        horizon_s: float = 5.0,
        dt_s: float = 0.25,
        n_samples: int = 30,
        config: FilterConfig | None = None,
        rng: np.random.Generator,
    ) -> None:
        self._table = forecast_table(primitive_map, config or FilterConfig())
        self._sinks = sinks
        self._every_ns = int(every_s * 1e9)
        self._steps = Steps.of(horizon_s, dt_s, n_samples)
        self._seed = int(rng.integers(2**63))
        self._next_ns: int | None = None

    def write(self, frame: TrackedFrame) -> None:
        """Forecast the frame's vehicles if it is time."""
        if (self._next_ns is not None and frame.time_ns < self._next_ns) or len(frame.estimates) == 0:
            return
        self._next_ns = frame.time_ns + self._every_ns
        names = [str(name) for name in frame.estimates.track_id]
        paths = self.paths(frame)
        for sink in self._sinks:
            sink.write_forecast(frame.time_ns, names, paths)

    def paths(self, frame: TrackedFrame) -> FloatArray:
        """Futures of the frame's vehicles, (n, n_samples, n_steps, 2) metres: from their particles if it has them."""
        return np.stack([self._of_vehicle(frame, row) for row in range(len(frame.estimates))])

    def _of_vehicle(self, frame: TrackedFrame, row: int) -> FloatArray:
        believed, particles = frame.estimates, frame.particles
        key = birth_key(self._seed, str(believed.track_id[row]), frame.time_ns)
        rng = np.random.default_rng(int(key))
        if len(particles):
            own = particles.of(row)
            belief = Start(own.position, own.direction, own.speed)
            return sample_paths_of_belief(self._table, belief, own.weight, self._steps, rng=rng)
        mean = Start(believed.position[[row]], believed.direction[[row]], believed.speed[[row]])
        return np.asarray(sample_paths(self._table, mean, self._steps, rng=rng)[0])
