"""The belief about each vehicle: weighted particles over position, direction and speed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.estimates import Particles, Samples
from dirprim_filter.filtering._kernels import Cloud
from dirprim_filter.primitives._manoeuvres import MotionTable
from dirprim_filter.primitives.cues import Cue

FIRST_CAPACITY = 16


class ParticleBelief:
    """Particles of many vehicles in one block of memory, a slot for each vehicle.

    Attributes:
        cloud: arrays of (slots, particles, ...).
        step: how often it was changed; whoever changes it counts.
    """

    def __init__(self, *, n_particles: int) -> None:
        if n_particles < 1:
            raise ValueError(f"n_particles: expected at least 1, got {n_particles}")
        self.cloud = empty_cloud(FIRST_CAPACITY, n_particles)
        self.step = 0

    @property
    def n_particles(self) -> int:
        """Of each vehicle."""
        return int(self.cloud.speed.shape[1])

    def reserve(self, n_slots: int) -> None:
        """Make room for so many vehicles; what the present slots hold stays."""
        old = len(self.cloud.speed)
        if n_slots <= old:
            return
        larger = empty_cloud(n_slots, self.n_particles)
        for new, column in zip(larger, self.cloud, strict=True):
            new[:old] = column
        self.cloud = larger

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the particles of `target` those of `source`, random numbers to come included."""
        self.step += 1
        for column in self.cloud:
            column[target] = column[source]

    def samples(self, at: IntArray, vehicle: IntArray) -> Particles:
        """Copies of samples (n,) by their places in the whole block, of vehicles (n,)."""
        cloud = self.cloud
        return Particles(
            position=cloud.position.reshape(-1, 2).take(at, axis=0), direction=cloud.direction.take(at),
            speed=cloud.speed.take(at), weight=cloud.weight.take(at), vehicle=vehicle,
            manoeuvre=cloud.manoeuvre.take(at), push=cloud.push.take(at),
        )  # fmt: skip


class BeliefSamples:
    """The `Samples` of beliefs as they are now: copied when, and as far as, they are asked for.

    Args:
        parts: beliefs, which move on, and slots (v,) of each: there are samples of one vehicle after the other.
    """

    def __init__(self, *parts: tuple[ParticleBelief, IntArray]) -> None:
        self._parts = [(belief, slot, belief.step) for belief, slot in parts]

    @classmethod
    def concatenate(cls, samples: Iterable[Samples]) -> BeliefSamples:
        """Those of all, in their order; of filters without samples none."""
        return cls(*((of, slot) for one in samples if isinstance(one, cls) for of, slot, _ in one._parts))

    def __len__(self) -> int:
        return sum(slot.size * belief.n_particles for belief, slot, _ in self._parts)

    def thinned(self, stride: int) -> Particles:
        """Every `stride`-th sample.

        Raises:
            RuntimeError: the beliefs have moved on.
        """
        found, first = [Particles.none()], 0
        for belief, slot, step in self._parts:
            if belief.step != step:
                raise RuntimeError(
                    "these particles have moved on: copy what is wanted of them while their frame is written"
                )
            at = np.arange(0, slot.size * belief.n_particles, stride)  # all samples are counted through
            vehicle, further = at // belief.n_particles, (slot - np.arange(slot.size)) * belief.n_particles
            found.append(belief.samples(at + further[vehicle], first + vehicle))
            first += slot.size
        return Particles.concatenate(found[1:] or found)


class States(NamedTuple):
    """Beliefs as mixtures of Gaussians about samples, a copy; of a filter without samples of one each.

    Attributes:
        sample: (v, 9, P) x, y, their rates and one number more that lasts; then cosine and sine of the direction; then
            what the samples follow, as `ParticleFilter.resumed` takes it. Of a filter without samples (v, 7, 1).
        weight: (v, P) of the samples, sums to 1.
        covariance: (v, 4, 4) of place and rates about each sample.
    """

    sample: FloatArray
    weight: FloatArray
    covariance: FloatArray


def weigh_by_cue(table: MotionTable, cloud: Cloud, vehicle: IntArray, cue: Cue) -> FloatArray:
    """Multiply the weights of vehicles (v,) by a cue's density, and normalise (Senanayake et al. 2020, Eq. 4).

    p_t is the cue: a mixture of von Mises over the direction some seconds later, relative to the current one. p_0 is
    given by the particles: how far vehicles on their manoeuvre have turned by then.

    Returns:
        (v,) natural log of the density of the cue under each belief, per radian.
    """
    log_fit = cue.belief(0.0).log_density(table.ahead[cloud.manoeuvre[vehicle]])
    with np.errstate(divide="ignore"):  # a particle without weight
        log_weight = np.log(cloud.weight[vehicle]) + log_fit
    top = log_weight.max(axis=1)
    weight = np.exp(log_weight - top[:, None])
    total = weight.sum(axis=1)
    cloud.weight[vehicle] = weight / total[:, None]
    return np.asarray(top + np.log(total))


def empty_cloud(n_slots: int, n_particles: int) -> Cloud:
    """Particles of equal weight, of no place and no motion yet."""
    shape = (n_slots, n_particles)
    return Cloud(
        position=np.zeros((*shape, 2)), direction=np.zeros(shape), speed=np.zeros(shape),
        cell=np.full(shape, -1, np.int64), manoeuvre=np.zeros(shape, np.int64), push=np.zeros(shape),
        weight=np.full(shape, 1.0 / n_particles), state=np.zeros((n_slots, 4), np.uint64), since_s=np.zeros(n_slots),
    )  # fmt: skip


def birth_key(seed: int, track_id: str, time_ns: int) -> np.uint64:
    """The 64 bits that all random numbers of one belief follow from: no other vehicle has a part in them."""
    text = f"{seed}/{time_ns}/{track_id}".encode()
    return np.uint64(int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little"))
