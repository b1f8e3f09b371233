"""Rollouts: sampled trajectories of vehicles under the motion model of a map.

Source: Senanayake et al. 2020, Algorithm 1: sample the motion at a vehicle's place, project it by one step, and
repeat at its new place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from dirprim_filter.arrays import FloatArray, as_floats
from dirprim_filter.config import FilterConfig
from dirprim_filter.estimates import Particles
from dirprim_filter.filtering import _kernels
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering.belief import weigh_by_cue
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.primitives._leader import ALONE, LeaderTable
from dirprim_filter.primitives._manoeuvres import MotionTable
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.motion_table import motion_table

States = tuple[FloatArray, FloatArray, FloatArray]
"""(n, 2), (n,), (n,) metres, radians and m/s of vehicles."""
PER_SAMPLE = 16
"""Rollouts drawn for each one that is kept, where a cue weighs them: rare manoeuvres must be among them."""


def forecast_states(
    primitive_map: PrimitiveMap,
    *,
    position: npt.ArrayLike,
    direction: npt.ArrayLike,
    speed: npt.ArrayLike,
    time_s: npt.ArrayLike,
    n_samples: int = 100,
    cue: Cue | None = None,
    config: FilterConfig | None = None,
    rng: np.random.Generator,
) -> FloatArray:
    """Sample rollouts of many vehicles.

    Each as if it were alone, unless a `config` says that vehicles respond to leaders: then all are in one scene, and
    sample p of every vehicle belongs together.

    Args:
        primitive_map: how vehicles move at each place.
        position: (n, 2) metres.
        direction: (n,) course over ground, radians.
        speed: (n,) m/s, not negative.
        time_s: (n_times,) ascending, seconds ahead.
        n_samples: number of rollouts of each.
        cue: of where each of them will turn, such as a turn signal.
        config: the parameters of the motion model, and whether vehicles interact; by default they do not.
        rng: draws the rollouts.

    Returns:
        (n, n_samples, n_times, 2) metres.

    Raises:
        ValueError: columns of different lengths, a number that is not finite, a negative speed, or times that do not
            ascend from above zero.
    """
    start = checked(position, direction, speed)
    dt_s = np.diff(as_floats("time_s", time_s, "n"), prepend=0.0)
    if dt_s.size < 1 or (dt_s <= 0).any() or n_samples < 1:
        raise ValueError(f"time_s, n_samples: expected ascending times and a sample, got {time_s!r}, {n_samples}")
    config = config or FilterConfig(interaction="none")
    response = leader_table(primitive_map, config)
    table = motion_table(primitive_map, step_s=config.step_s)
    return sample_paths(table, start, dt_s, n_samples, cue=cue, response=response, rng=rng)


def checked(position: npt.ArrayLike, direction: npt.ArrayLike, speed: npt.ArrayLike) -> States:
    """Where vehicles are, which way they go and how fast.

    Raises:
        ValueError: of different lengths, not finite, or a negative speed.
    """
    place = as_floats("position", position, "n 2")
    n = len(place)
    states = place, as_floats("direction", direction, f"{n}"), as_floats("speed", speed, f"{n}")
    if (states[2] < 0).any():
        raise ValueError(f"speed: expected at least 0 m/s, got {states[2].min()}")
    return states


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
    return LeaderTable(response.gain, response.push, response.trust, response.start_rate)


def sample_paths(
    table: MotionTable, start: States, dt_s: FloatArray, n_samples: int, *, cue: Cue | None = None,
    response: LeaderTable = ALONE, rng: np.random.Generator,
) -> FloatArray:  # fmt: skip
    """Rollouts of vehicles, each from one state. (n, n_samples, n_steps, 2) metres."""
    cloud = sampled(table, start, n_samples * (1 if cue is None else PER_SAMPLE), rng=rng)
    if cue is not None:
        cloud = _weighted_by_cue(table, cloud, cue, rng=rng)
    return projected(table, cloud, dt_s, response)


def sampled(table: MotionTable, start: States, n_samples: int, *, rng: np.random.Generator) -> Cloud:
    """Samples of vehicles that all begin at one state each."""
    position, direction, speed = (np.repeat(column[:, None], n_samples, axis=1) for column in start)
    return _cloud(table, position, direction, speed, rng=rng)


def sampled_belief(table: MotionTable, belief: Particles, n_samples: int, *, rng: np.random.Generator) -> Cloud:
    """Samples of one vehicle's belief.

    Samples go on by the manoeuvre and the push that the filter found for them; those of no place look at the map anew.
    """
    chosen = belief[rng.choice(len(belief), n_samples, p=belief.weight / belief.weight.sum())]
    cloud = _cloud(table, chosen.position[None], chosen.direction[None], chosen.speed[None], rng=rng)
    placed = (chosen.manoeuvre >= 0) & (chosen.manoeuvre < table.begin[-1])
    cloud.manoeuvre[0, placed], cloud.push[0, placed] = chosen.manoeuvre[placed], chosen.push[placed]
    return cloud


def side_by_side(clouds: Sequence[Cloud]) -> Cloud:
    """The samples of several vehicles as one cloud."""
    columns: list[Any] = [np.concatenate(column) for column in zip(*clouds, strict=True)]
    return Cloud(*columns)


def _cloud(
    table: MotionTable, position: FloatArray, direction: FloatArray, speed: FloatArray, *, rng: np.random.Generator
) -> Cloud:  # fmt: skip
    """Particles of each vehicle, (v, n, ...), that follow manoeuvres which fit them."""
    v, n = speed.shape
    unknown = np.empty((v, n), np.int64)
    cloud = Cloud(
        position, direction, speed, cell=unknown, manoeuvre=unknown.copy(), push=np.empty((v, n)),
        weight=np.full((v, n), 1.0 / n), state=rng.integers(2**64, size=(v, 4), dtype=np.uint64),
    )  # fmt: skip
    _kernels.initialise_motion(table, cloud, np.arange(v))
    return cloud


def _weighted_by_cue(table: MotionTable, cloud: Cloud, cue: Cue, *, rng: np.random.Generator) -> Cloud:
    """One in `PER_SAMPLE` of the particles, drawn by how well they fit a cue (Eq. 4)."""
    v, n = cloud.speed.shape
    vehicle = np.arange(v)
    weigh_by_cue(table, cloud, vehicle, cue)
    kept = np.stack([rng.choice(n, n // PER_SAMPLE, p=weight) for weight in cloud.weight])
    of_particles = {name: column[vehicle[:, None], kept] for name, column in cloud._asdict().items() if name != "state"}
    return cloud._replace(**of_particles)


def projected(table: MotionTable, cloud: Cloud, dt_s: FloatArray, response: LeaderTable = ALONE) -> FloatArray:
    """The particles moved on: (v, n, n_steps, 2) metres. Behind leaders sample p of all vehicles is one scene."""
    v, n = cloud.speed.shape
    path, is_alone, scene = np.empty((v, n, dt_s.size, 2)), response.trust == 0.0 or v == 1, _kernels.NOBODY
    for t, dt in enumerate(dt_s.tolist()):
        n_looks = 1 if is_alone else max(1, math.ceil(dt / _kernels.LOOK_S - 1e-9))
        for _ in range(n_looks):
            if not is_alone:
                columns = [*np.moveaxis(cloud.position, 2, 0), cloud.direction, cloud.speed]
                scene = np.ascontiguousarray(np.stack(columns, axis=-1).transpose(1, 0, 2))
            _kernels.advance(table, response, cloud, scene, np.arange(v), np.full(v, dt / n_looks))
        path[:, :, t] = cloud.position
    return path
