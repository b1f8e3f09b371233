"""What next? Hallucinated trajectories of vehicles, cell by cell, and the regions that hold them.

Source: Senanayake et al. 2020, Algorithm 1: sample a mode of the cell, an angle and a speed; project the vehicle by one
step; look up the cell it has come to; repeat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import FloatArray, IntArray, as_floats, read_only, require
from dirprim_filter.columns import check
from dirprim_filter.config import FilterConfig
from dirprim_filter.distributions.highest_density import Region, highest_density_regions
from dirprim_filter.estimates import Particles, TrackedFrame
from dirprim_filter.filtering import _kernels
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering.belief import birth_key, empty_cloud, weigh_by_cue
from dirprim_filter.filtering.transition import Moving, Transition
from dirprim_filter.primitives._leader import ALONE, LeaderTable
from dirprim_filter.primitives._manoeuvres import MotionTable
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.motion_table import motion_table, under
from dirprim_filter.primitives.primitive_map import PrimitiveMap

REGION_SHARES = (0.9, 0.5)
"""The shares of a vehicle's rollouts that its regions contain."""
MOST_INSTANTS = 24
"""Of a region: more could not be distinguished."""
PER_SAMPLE = 16
"""Rollouts drawn for each one that is kept, where a cue weighs them: rare manoeuvres must be among them."""


def forecast(
    primitive_map: PrimitiveMap, *, position: npt.ArrayLike, direction: float, speed: float, horizon_s: float = 5.0,
    dt_s: float = 0.5, n_samples: int = 100, cue: Cue | None = None, config: FilterConfig | None = None,
    transition: Transition | None = None, rng: np.random.Generator,
) -> FloatArray:  # fmt: skip
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
        transition: moves the vehicle in place of the map, whatever the cue.
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
    dt = steps(horizon_s, dt_s, n_samples)
    course, pace = as_floats("direction", [direction], "1"), as_floats("speed", [speed], "1")
    check("direction", course)
    check("speed", pace)
    place, one = as_floats("position", position, "2")[None], np.ones(1)
    state = Particles(position=place, direction=course, speed=pace, weight=one, vehicle=one.astype(np.int64))
    if transition is not None:
        return rolled(transition, state, n_samples, dt, rng=rng)
    table, n = motion_table(primitive_map, step_s=config.step_s), n_samples * (1 if cue is None else PER_SAMPLE)
    cloud = sampled(table, state, n, rng=rng)
    if cue is not None:  # Eq. 4: of the particles those are drawn that fit it
        weigh_by_cue(table, cloud, np.zeros(1, np.int64), cue)
        kept = rng.choice(n, n_samples, p=cloud.weight[0])
        columns = {name: column for name, column in cloud._asdict().items() if name not in ("state", "since_s")}
        cloud = cloud._replace(**{name: column.take(kept, axis=1) for name, column in columns.items()})
    return np.asarray(projected(under(table, cue), [cloud], dt, leader_table(primitive_map, config))[0])


def steps(horizon_s: float, dt_s: float, n_samples: int) -> FloatArray:
    """(n_steps,) seconds: every `dt_s` up to the horizon.

    Raises:
        ValueError: not a step or not a sample.
    """
    horizon_s, dt_s = float(as_floats("horizon_s", horizon_s, "")), float(as_floats("dt_s", dt_s, ""))
    n_steps = int(np.floor(horizon_s / dt_s + 1e-9)) if dt_s > 0 else 0
    if n_steps < 1 or n_samples < 1:
        raise ValueError(
            "horizon_s, dt_s, n_samples: expected at least one step and one sample, "
            f"got {horizon_s}, {dt_s} and {n_samples}"
        )
    return np.full(n_steps, dt_s)


def leader_table(primitive_map: PrimitiveMap, config: FilterConfig) -> LeaderTable:
    """The response to leaders: none without interaction, or where the map knows of none."""
    response = primitive_map.motion.leader
    if response is None or config.interaction == "none":
        return ALONE
    return LeaderTable(read_only(response.gain), response.push, response.trust, read_only(response.start_rate))


def sampled(table: MotionTable, belief: Particles, n_samples: int, *, rng: np.random.Generator) -> Cloud:
    """Samples (1, n_samples) of one vehicle's belief, that follow manoeuvres which fit them.

    They go on by the manoeuvre and the push that the filter found for them; those of no place look at the map anew.
    """
    share = belief.weight / belief.weight.sum()
    row = rng.choice(len(belief), n_samples, p=share) if len(belief) > 1 else np.zeros(n_samples, np.int64)
    drawn = belief[row]
    cloud = empty_cloud(1, n_samples)._replace(
        position=drawn.position[None], direction=drawn.direction[None], speed=drawn.speed[None],
        state=rng.integers(2**64, size=(1, 4), dtype=np.uint64),
    )  # fmt: skip
    _kernels.initialise_motion(table, cloud, np.arange(1))
    placed = (drawn.manoeuvre >= 0) & (drawn.manoeuvre < table.begin[-1])
    cloud.manoeuvre[0, placed], cloud.push[0, placed] = drawn.manoeuvre[placed], drawn.push[placed]
    return cloud


def rolled(
    transition: Transition, belief: Particles, n_samples: int, dt_s: FloatArray, *, rng: np.random.Generator
) -> FloatArray:  # fmt: skip
    """(n, n_steps, 2) metres: samples of one vehicle's belief, moved by a law of motion whose own columns begin."""
    drawn = belief[rng.choice(len(belief), n_samples, p=belief.weight / belief.weight.sum())]
    particles = Moving(
        position=drawn.position.copy(), direction=drawn.direction.copy(), speed=drawn.speed.copy(),
        own=np.zeros((n_samples, transition.n_own)),
    )  # fmt: skip
    transition.begin(particles, rng)
    path = np.empty((n_samples, dt_s.size, 2))
    for t, dt in enumerate(dt_s.tolist()):
        transition.advance(particles, dt, rng)
        path[:, t] = particles.position
    return path


def projected(
    table: MotionTable, clouds: Sequence[Cloud], dt_s: FloatArray, response: LeaderTable = ALONE
) -> FloatArray:
    """Particles of v vehicles moved on: (v, n, n_steps, 2) metres. Behind leaders sample p of all is one scene."""
    columns: list[Any] = [np.concatenate(column) for column in zip(*clouds, strict=True)]
    cloud = Cloud(*columns)
    v, n = cloud.speed.shape
    path, is_alone, scene = np.empty((v, n, dt_s.size, 2)), response.trust == 0.0 or v == 1, _kernels.NO_SCENE
    for t, dt in enumerate(dt_s.tolist()):
        n_looks = 1 if is_alone else max(1, math.ceil(dt / _kernels.LOOK_S - 1e-9))
        for _ in range(n_looks):
            if not is_alone:
                state = [*np.moveaxis(cloud.position, 2, 0), cloud.direction, cloud.speed]
                scene = np.ascontiguousarray(np.stack(state, axis=-1).transpose(1, 0, 2))
            _kernels.advance(table, response, cloud, scene, np.arange(v), np.full(v, dt / n_looks))
        path[:, :, t] = cloud.position
    return path


@dataclass(frozen=True, slots=True)
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
    regions: Sequence[Sequence[Region]] = field(init=False)

    def __post_init__(self) -> None:
        regions = [highest_density_regions(few, REGION_SHARES) for few in self.coarse_paths()]
        object.__setattr__(self, "regions", regions)

    def coarse_paths(self) -> FloatArray:
        """The paths from the start on, at `MOST_INSTANTS` at most. -> (n, n_samples, n_instants, 2) metres."""
        first = np.broadcast_to(self.start[:, None, None], (*self.paths.shape[:2], 1, 2))
        stride = math.ceil((self.paths.shape[2] + 1) / MOST_INSTANTS)
        return np.concatenate([first, self.paths[:, :, ::-stride][:, :, ::-1]], axis=2)  # the last is among them


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
        self, primitive_map: PrimitiveMap, sinks: Sequence[Callable[[Forecasts], None]], *, every_s: float = 1.0,
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
        made = Forecasts(frame.time_ns, frame.names, frame.estimates.position, self.paths(frame))
        for sink in self._sinks:
            sink(made)

    def paths(self, frame: TrackedFrame, rows: IntArray | None = None) -> FloatArray:
        """Rollouts from the particles of the frame's vehicles, or of some rows: (n, n_samples, n_steps, 2) metres."""
        rows, particles = np.arange(len(frame.estimates)) if rows is None else rows, frame.particles.thinned(1)
        seeds = [int(birth_key(self._seed, frame.names[row], frame.time_ns)) for row in rows]
        clouds = [
            sampled(self._table, particles.of(row), self._n_samples, rng=np.random.default_rng(seed))
            for row, seed in zip(rows, seeds, strict=True)
        ]
        path = np.empty((rows.size, self._n_samples, self._dt_s.size, 2))
        for group in np.unique(frame.group[rows]):
            own = np.flatnonzero(frame.group[rows] == group)
            path[own] = projected(self._table, [clouds[i] for i in own], self._dt_s, self._response)
        return path
