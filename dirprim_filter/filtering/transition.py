"""How particles move: one protocol, of which the map's motion is one.

Whoever has another law of motion writes a class with these two functions. A `ParticleFilter` takes it in place of the
map's, and with it trackers, smoothers and experiments do; `forecast` takes it too. And the map's motion may move the
particles of another library.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.filtering import _kernels
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering.belief import empty_cloud
from dirprim_filter.primitives._leader import ALONE
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.motion_table import motion_table, under
from dirprim_filter.primitives.primitive_map import PrimitiveMap


@dataclass(slots=True, kw_only=True)
class Moving:
    """Particles of one vehicle, which a transition changes in place.

    Attributes:
        position: (n, 2) metres.
        direction: (n,) course over ground, radians in (-pi, pi].
        speed: (n,) m/s, not negative.
        own: (n, n_own) what the transition knows of each beside that, such as a turn rate.
    """

    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    own: FloatArray


class Transition(Protocol):
    """A law of motion. It draws all that is random from the generator given.

    Attributes:
        n_own: number of the columns that are its own.
    """

    n_own: int

    def begin(self, particles: Moving, rng: np.random.Generator) -> None:
        """Fill the own columns of particles whose place, direction and speed were just drawn."""
        ...

    def advance(self, particles: Moving, dt_s: float, rng: np.random.Generator) -> None:
        """Move particles by so many seconds."""
        ...


class MapTransition:
    """The motion of a map: Algorithm 1 of Senanayake et al. 2020 by manoeuvres, section 4 of `docs/method.md`.

    Its own columns are cell, manoeuvre, and the vehicle's own acceleration in its manoeuvre's standard deviations.

    Args:
        primitive_map: how vehicles move at each place.
        step_s: seconds, the longest step.
        cue: that the vehicle gives: it draws its next manoeuvre by Eq. 4.
    """

    n_own = 3

    def __init__(self, primitive_map: PrimitiveMap, *, step_s: float = 0.1, cue: Cue | None = None) -> None:
        self._table = under(motion_table(primitive_map, step_s=step_s), cue)

    def begin(self, particles: Moving, rng: np.random.Generator) -> None:
        """Look up cells, and draw manoeuvres that fit place, direction and speed."""
        cloud = _cloud(particles, rng)
        _kernels.initialise_motion(self._table, cloud, np.zeros(1, np.int64))
        _take(particles, cloud)

    def advance(self, particles: Moving, dt_s: float, rng: np.random.Generator) -> None:
        """Move by the manoeuvres, in steps of at most `step_s`."""
        cloud = _cloud(particles, rng)
        one = np.zeros(1, np.int64)
        _kernels.advance(self._table, ALONE, cloud, _kernels.NO_SCENE, one, np.array([dt_s], np.float64))
        _take(particles, cloud)


def _cloud(particles: Moving, rng: np.random.Generator) -> Cloud:
    """The particles as kernels take them, a copy."""
    cell, manoeuvre, push = particles.own.T.copy()
    return empty_cloud(1, push.size)._replace(
        position=particles.position[None].copy(), direction=particles.direction[None].copy(),
        speed=particles.speed[None].copy(), cell=cell.astype(np.int64)[None], push=push[None],
        manoeuvre=manoeuvre.astype(np.int64)[None], state=rng.integers(2**64, size=(1, 4), dtype=np.uint64),
    )  # fmt: skip


def _take(particles: Moving, cloud: Cloud) -> None:
    """Give particles what a step made of them."""
    particles.position[:], particles.direction[:], particles.speed[:] = (
        cloud.position[0], cloud.direction[0], cloud.speed[0],
    )  # fmt: skip
    particles.own[:] = np.column_stack([cloud.cell[0], cloud.manoeuvre[0], cloud.push[0]])
