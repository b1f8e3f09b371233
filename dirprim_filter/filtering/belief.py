"""The belief about each vehicle: weighted particles over position, direction and speed."""

from __future__ import annotations

import hashlib

import numpy as np

from dirprim_filter.arrays import BoolArray, IntArray
from dirprim_filter.estimates import Particles
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.filtering._measuring import Carried

FIRST_CAPACITY = 16


class ParticleBelief:
    """Particles of many vehicles in one block of memory, a slot for each vehicle.

    Attributes:
        cloud: arrays of (slots, particles, ...).
        carried: the lasting errors of measurements.
        mode_of: (z,) the mode of each manoeuvre.
        step: how often it was changed; whoever changes it counts.
    """

    def __init__(self, *, n_particles: int, mode_of: IntArray) -> None:
        if n_particles < 1:
            raise ValueError(f"n_particles: expected at least 1, got {n_particles}")
        self.cloud, self.carried = _empty(FIRST_CAPACITY, n_particles)
        self.mode_of = mode_of
        self.step = 0

    @property
    def n_slots(self) -> int:
        """How many vehicles there is room for."""
        return int(self.cloud.speed.shape[0])

    def reserve(self, n_slots: int) -> None:
        """Make room for so many vehicles; what the present slots hold stays."""
        old = self.n_slots
        if n_slots <= old:
            return
        larger = _empty(n_slots, self.cloud.speed.shape[1])
        for new, column in zip((*larger[0], *larger[1]), (*self.cloud, *self.carried), strict=True):
            new[:old] = column
        self.cloud, self.carried = larger

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the particles of `target` those of `source`, random numbers to come included."""
        self.step += 1
        for column in (*self.cloud, *self.carried):
            column[target] = column[source]


class BelievedParticles:
    """The `Samples` of some beliefs as they are now: copied when, and as far as, they are asked for.

    Args:
        belief: moves on.
        slot: (v,) of which there are samples, one vehicle after the other.
    """

    def __init__(self, belief: ParticleBelief, slot: IntArray) -> None:
        self._belief, self._slot, self._step = belief, slot, belief.step

    def __len__(self) -> int:
        return int(self._slot.size * self._belief.cloud.speed.shape[1])

    def of(self, row: int) -> Particles:
        """The samples of one vehicle, by its row.

        Raises:
            RuntimeError: the belief has moved on.
        """
        n = self._belief.cloud.speed.shape[1]
        return self._copied(np.full(n, row), np.arange(n))

    def thinned(self, stride: int, *, rows: BoolArray | None = None) -> Particles:
        """Every `stride`-th sample; of some vehicles, where `rows` are given.

        Raises:
            RuntimeError: the beliefs have moved on.
        """
        vehicle, number = np.divmod(np.arange(0, len(self), stride), self._belief.cloud.speed.shape[1])
        if rows is not None:
            vehicle, number = vehicle[rows[vehicle]], number[rows[vehicle]]
        return self._copied(vehicle, number)

    def _copied(self, vehicle: IntArray, number: IntArray) -> Particles:
        if self._belief.step != self._step:
            raise RuntimeError(
                "these particles have moved on: copy what is wanted of them while their frame is written"
            )
        cloud = self._belief.cloud
        at = self._slot[vehicle] * cloud.speed.shape[1] + number  # in the whole block: one index is quicker than two
        manoeuvre = cloud.manoeuvre.take(at)
        return Particles(
            position=cloud.position.reshape(-1, 2).take(at, axis=0),
            direction=cloud.direction.take(at),
            speed=cloud.speed.take(at),
            weight=cloud.weight.take(at),
            vehicle=vehicle,
            mode=self._belief.mode_of[manoeuvre],
            manoeuvre=manoeuvre,
            push=cloud.push.take(at),
        )


def _empty(n_slots: int, n_particles: int) -> tuple[Cloud, Carried]:
    shape = (n_slots, n_particles)
    cloud = Cloud(
        position=np.zeros((*shape, 2)),
        direction=np.zeros(shape),
        speed=np.zeros(shape),
        cell=np.full(shape, -1, np.int64),
        manoeuvre=np.zeros(shape, np.int64),
        push=np.zeros(shape),
        weight=np.full(shape, 1.0 / n_particles),
        state=np.zeros((n_slots, 4), np.uint64),
    )
    carried = Carried(np.zeros((*shape, 2)), np.zeros((n_slots, 2)), np.zeros(n_slots), np.zeros(n_slots, np.bool_))
    return cloud, carried


def birth_key(seed: int, track_id: str, time_ns: int) -> np.uint64:
    """The 64 bits that all random numbers of one belief follow from: no other vehicle has a part in them."""
    text = f"{seed}/{time_ns}/{track_id}".encode()
    return np.uint64(int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little"))
