"""The belief about each vehicle: weighted particles over position, direction and speed."""

from __future__ import annotations

import hashlib

import numpy as np

from dirprim_filter.filtering._kernels import Cloud
from tessellation.arrays import IntArray

FIRST_CAPACITY = 16


class ParticleBelief:
    """Particles of many vehicles in one block of memory, a slot for each vehicle.

    Slots are given to vehicles as they come and taken back when they go; the block doubles when it is full.

    Attributes:
        cloud: arrays of (slots, particles, ...).
        time_ns: (slots,) the time each belief holds for.
    """

    def __init__(self, *, n_particles: int) -> None:
        if n_particles < 1:
            raise ValueError(f"n_particles: expected at least 1, got {n_particles}")
        self.cloud = _empty_cloud(FIRST_CAPACITY, n_particles)
        self.time_ns: IntArray = np.zeros(FIRST_CAPACITY, np.int64)
        self._slot: dict[str, int] = {}
        self._free = list(range(FIRST_CAPACITY - 1, -1, -1))

    def __len__(self) -> int:
        return len(self._slot)

    def __contains__(self, track_id: str) -> bool:
        return track_id in self._slot

    def slot_of(self, track_id: str) -> int:
        """The slot of a vehicle, a free one if it has none yet."""
        if track_id not in self._slot:
            if not self._free:
                self._grow()
            self._slot[track_id] = self._free.pop()
        return self._slot[track_id]

    def forget(self, *, before_ns: int) -> list[str]:
        """End the beliefs that hold for a time before `before_ns`; returns whose they were."""
        gone = [track_id for track_id, slot in self._slot.items() if self.time_ns[slot] < before_ns]
        for track_id in gone:
            self._free.append(self._slot.pop(track_id))
        return gone

    def _grow(self) -> None:
        old = self.time_ns.size
        larger = _empty_cloud(2 * old, self.cloud.speed.shape[1])
        for new, column in zip(larger, self.cloud, strict=True):
            new[:old] = column
        self.cloud = larger
        self.time_ns = np.concatenate([self.time_ns, np.zeros(old, np.int64)])
        self._free.extend(range(2 * old - 1, old - 1, -1))


def _empty_cloud(n_slots: int, n_particles: int) -> Cloud:
    shape = (n_slots, n_particles)
    return Cloud(
        position=np.zeros((*shape, 2)),
        direction=np.zeros(shape),
        speed=np.zeros(shape),
        cell=np.full(shape, -1, np.int64),
        mode=np.zeros(shape, np.int64),
        log_weight=np.full(shape, -np.log(n_particles)),
        state=np.zeros((n_slots, 4), np.uint64),
    )


def birth_key(seed: int, track_id: str, time_ns: int) -> np.uint64:
    """The 64 bits that all random numbers of one belief follow from: no other vehicle has a part in them."""
    text = f"{seed}/{time_ns}/{track_id}".encode()
    return np.uint64(int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little"))
