"""What next? Hallucinated trajectories of a vehicle, cell by cell, and the regions that hold them.

Source: Senanayake et al. 2020, Algorithm 1: sample a mode of the cell, an angle and a speed; project the vehicle by one
step; look up the cell it has come to; repeat.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import FloatArray, as_floats, require
from dirprim_filter.columns import check_angles
from dirprim_filter.config import FilterConfig
from dirprim_filter.distributions.highest_density import Region, highest_density_regions
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering.belief import birth_key
from dirprim_filter.filtering.rollouts import (
    checked,
    leader_table,
    projected,
    sample_paths,
    sampled,
    sampled_belief,
    side_by_side,
    steps,
)
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.motion_table import motion_table

REGION_SHARES = (0.9, 0.5)
"""The shares of a vehicle's rollouts that its regions contain."""
MOST_INSTANTS = 24
"""Of a region: more could not be distinguished."""


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
        n_samples: number of rollouts.
        cue: of where the vehicle will turn, such as its turn signal.
        config: parameters of the motion model.
        rng: draws the rollouts.

    Returns:
        (n_samples, n_steps, 2) positions at dt_s, 2 dt_s, ... up to the horizon, metres.

    Raises:
        ValueError: a number that is not finite, a direction that is not in radians, a negative speed, or times and
            counts that are not positive.
        TypeError: no map, no configuration, or no generator.
    """
    require("primitive_map", primitive_map, PrimitiveMap)
    require("rng", rng, np.random.Generator)
    config = require("config", FilterConfig() if config is None else config, FilterConfig)
    check_angles("direction", np.array([direction]))
    start = checked(as_floats("position", position, "2")[None], [direction], [speed])
    dt = steps(horizon_s, dt_s, n_samples)
    table = motion_table(primitive_map, step_s=config.step_s)
    return np.asarray(sample_paths(table, start, dt, n_samples, cue=cue, rng=rng)[0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecasts:
    """Rollouts of vehicles, and the regions where the vehicles may be.

    Attributes:
        time_ns: when they were made.
        track_id: n ids of the vehicles.
        start: (n, 2) metres, where the vehicles were then.
        paths: (n, n_samples, n_steps, 2) metres.
        regions: of each vehicle one for each of `REGION_SHARES`: it contains that share of rollouts at every instant.
    """

    time_ns: int
    track_id: Sequence[str]
    start: FloatArray
    paths: FloatArray
    regions: Sequence[Sequence[Region]]

    @classmethod
    def of(cls, time_ns: int, track_id: Sequence[str], start: npt.ArrayLike, paths: npt.ArrayLike) -> Self:
        """Check the rollouts, and find their regions.

        Raises:
            ValueError: shapes that do not fit, or a number that is not finite.
        """
        paths = as_floats("paths", paths, "n samples steps 2")
        if len(track_id) != len(paths):
            raise ValueError(f"paths: expected {len(track_id)} vehicles, as there are ids, got {len(paths)}")
        start = as_floats("start", start, f"{len(paths)} 2")
        forecasts = cls(time_ns=time_ns, track_id=track_id, start=start, paths=paths, regions=())
        regions = [highest_density_regions(few, REGION_SHARES) for few in forecasts.coarse_paths()]
        return cls(time_ns=time_ns, track_id=track_id, start=start, paths=paths, regions=regions)

    def coarse_paths(self) -> FloatArray:
        """The paths from the start on, at `MOST_INSTANTS` at most. -> (n, n_samples, n_instants, 2) metres."""
        first = np.broadcast_to(self.start[:, None, None], (*self.paths.shape[:2], 1, 2))
        stride = math.ceil((self.paths.shape[2] + 1) / MOST_INSTANTS)
        return np.concatenate([first, self.paths[:, :, ::-stride][:, :, ::-1]], axis=2)  # the last is among them


class ForecastSink(Protocol):
    """Takes forecasts as they are made: a log, a viewer."""

    def write_forecast(self, forecasts: Forecasts) -> None:
        """Take the rollouts of vehicles, after the frame of their time."""
        ...


class Forecaster:
    """An `EstimateSink` that forecasts every vehicle of a frame, now and then.

    A vehicle's rollouts depend on the seed, its id and the time. Where vehicles respond to leaders, sample p of all
    vehicles of a group is one scene; with `config.interaction` "none" they depend on no other vehicle.

    Args:
        primitive_map: how vehicles move at each place.
        sinks: take the forecasts.
        every_s: seconds of log time between forecasts.
        horizon_s: seconds to look ahead.
        dt_s: seconds between positions.
        n_samples: rollouts of each vehicle.
        config: parameters of the motion model.
        rng: one number drawn from it seeds every forecast.
    """

    def __init__(
        self, primitive_map: PrimitiveMap, sinks: Sequence[ForecastSink], *, every_s: float = 1.0,
        horizon_s: float = 5.0, dt_s: float = 0.25, n_samples: int = 30, config: FilterConfig | None = None,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        config = config or FilterConfig()
        self._table = motion_table(primitive_map, step_s=config.step_s)
        self._response = leader_table(primitive_map, config)
        self._sinks = sinks
        self._every_ns = int(every_s * 1e9)
        self._dt_s, self._n_samples = steps(horizon_s, dt_s, n_samples), n_samples
        self._seed = int(rng.integers(2**63))
        self._next_ns: int | None = None

    def write(self, frame: TrackedFrame) -> None:
        """Forecast the frame's vehicles if it is time."""
        if (self._next_ns is not None and frame.time_ns < self._next_ns) or len(frame.estimates) == 0:
            return
        self._next_ns = frame.time_ns + self._every_ns
        names = [str(name) for name in frame.estimates.track_id]
        made = Forecasts.of(frame.time_ns, names, frame.estimates.position, self.paths(frame))
        for sink in self._sinks:
            sink.write_forecast(made)

    def paths(self, frame: TrackedFrame) -> FloatArray:
        """Rollouts of the frame's vehicles, (n, n_samples, n_steps, 2) metres: from their particles if it has them."""
        clouds = [self._of_vehicle(frame, row) for row in range(len(frame.estimates))]
        path = np.empty((len(clouds), self._n_samples, self._dt_s.size, 2))
        for group in np.unique(frame.group):
            own = np.flatnonzero(frame.group == group)
            scene = side_by_side([clouds[row] for row in own])
            path[own] = projected(self._table, scene, self._dt_s, self._response)
        return path

    def _of_vehicle(self, frame: TrackedFrame, row: int) -> Cloud:
        estimates, particles = frame.estimates, frame.particles
        key = birth_key(self._seed, str(estimates.track_id[row]), frame.time_ns)
        rng = np.random.default_rng(int(key))
        if len(particles):
            return sampled_belief(self._table, particles.of(row), self._n_samples, rng=rng)
        mean = estimates.position[[row]], estimates.direction[[row]], estimates.speed[[row]]
        return sampled(self._table, mean, self._n_samples, rng=rng)
