"""A summary of recordings: statistics of how their vehicles moved that add up, and from which maps are learned."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from dirprim_filter.arrays import ArrayValue, FloatArray
from dirprim_filter.primitives.leader import N_FEATURES, N_PACES
from dirprim_filter.primitives.leader_learning import N_FOLDS, LeaderSums, folds_of
from dirprim_filter.primitives.motion_sums import Regression
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.steps import WHEN, tally_steps
from dirprim_filter.store.tallies import Tally
from dirprim_filter.tracks import Tracks

LEADER_UNIT = 2.0**-12
"""Sums of responses to leaders are whole multiples of it."""
LEADER_SHAPES = (
    (N_FOLDS, N_FEATURES, N_FEATURES), (N_FOLDS, N_FEATURES), (N_FOLDS,), (N_FOLDS,), (N_PACES + 1,), (N_PACES + 1,),
)  # fmt: skip
N_LEADER_SUMS = sum(int(np.prod(shape)) for shape in LEADER_SHAPES)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Summary(ArrayValue):
    """Sums of whole numbers: two summaries of the same recordings are the same, however they came together.

    Attributes:
        lattice: what is counted on.
        frame: name of the frame of the positions; empty where logs name none.
        steps: (when, before, here, after): steps of vehicles. When: the hour since 1970-01-01 in which the vehicle came
            into sight, times the number of folds, plus the vehicle's fold; the others are states of the lattice. How
            many, sums of where in its bins `here` was: east, north, direction and speed; and sums of the squares.
        passed: (place and way): how many vehicles.
        leader: (sum): of `LeaderSums`, in `LEADER_UNIT`.
    """

    lattice: Lattice
    frame: str
    steps: Tally
    passed: Tally
    leader: Tally

    @classmethod
    def of(cls, tracks: Tracks, *, lattice: Lattice | None = None, frame: str = "") -> Self:
        """The summary of a recording. Recordings share no vehicle: an id in two of them is two vehicles."""
        lattice = lattice or Lattice()
        fold = folds_of(tracks, lattice.n_folds)
        steps, passed = tally_steps(tracks, lattice, fold)
        leader = LeaderSums.of(tracks, fold if lattice.n_folds == N_FOLDS else None)
        return cls(lattice=lattice, frame=frame, steps=steps, passed=passed, leader=_as_tally(leader))

    @classmethod
    def none(cls, *, lattice: Lattice | None = None, frame: str = "") -> Self:
        """The summary of nothing: added to another it changes nothing."""
        return cls(
            lattice=lattice or Lattice(), frame=frame, steps=Tally.none(4, 9), passed=Tally.none(1, 1),
            leader=Tally.none(1, 2),
        )  # fmt: skip

    @classmethod
    def total(cls, parts: Iterable[Self]) -> Self:
        """The sum of all parts, of which there is at least one.

        Raises:
            ValueError: two parts are of different lattices or frames.
        """
        parts = list(parts)
        for part in parts[1:]:
            parts[0]._check_alike(part)
        sums = {name: Tally.total([getattr(part, name) for part in parts]) for name in ("steps", "passed", "leader")}
        return cls(lattice=parts[0].lattice, frame=parts[0].frame, **sums)

    def __add__(self, other: Self) -> Self:
        return self.total([self, other])

    def __sub__(self, other: Self) -> Self:
        """What is left without a part.

        Raises:
            ValueError: it is no part of this, or of another lattice or frame.
        """
        self._check_alike(other)
        return type(self)(
            lattice=self.lattice, frame=self.frame, steps=self.steps - other.steps, passed=self.passed - other.passed,
            leader=self.leader - other.leader,
        )  # fmt: skip

    @property
    def digest(self) -> str:
        """SHA-256 of all of it, in hexadecimal: equal for equal summaries."""
        digest = hashlib.sha256(repr((self.lattice, self.frame)).encode())
        for tally in (self.steps, self.passed, self.leader):
            digest.update(f"{len(tally)};".encode())
            digest.update(np.ascontiguousarray(tally.key, "<i8").tobytes())
            digest.update(np.ascontiguousarray(tally.value, "<i8").tobytes())
        return digest.hexdigest()

    @property
    def leader_sums(self) -> LeaderSums:
        """What the response to leaders is learned from."""
        return as_leader_sums(self.leader)

    @property
    def whens(self) -> Tally:
        """(when): how many steps."""
        return Tally.of(self.steps.key[:, WHEN : WHEN + 1], self.steps.value[:, :1])

    def steps_of(self, first: int, last: int) -> Tally:
        """The steps of some `when`s, both included."""
        return self.steps[slice(*np.searchsorted(self.steps.key[:, WHEN], [first, last + 1]).tolist())]

    def _check_alike(self, other: Summary) -> None:
        for field in fields(Lattice):
            ours, theirs = getattr(self.lattice, field.name), getattr(other.lattice, field.name)
            if ours != theirs:
                raise ValueError(f"lattice: expected {field.name} {ours}, got {theirs}; count both alike")
        if self.frame != other.frame:
            raise ValueError(f"frame: expected positions in frame {self.frame!r}, got {other.frame!r}")


def _as_tally(sums: LeaderSums) -> Tally:
    """A count of one recording, and the sum, for each number."""
    flat = np.concatenate([np.ravel(part) for part in (*sums.acceleration, sums.stood, sums.started)])
    whole = np.round(flat / LEADER_UNIT).astype(np.int64)
    return Tally(key=np.arange(whole.size)[:, None], value=np.column_stack([np.ones(whole.size, np.int64), whole]))


def as_leader_sums(leader: Tally) -> LeaderSums:
    """The sums of `Summary.leader`."""
    flat = np.zeros(N_LEADER_SUMS)
    flat[leader.key[:, 0]] = leader.value[:, 1] * LEADER_UNIT
    parts: list[FloatArray] = []
    for shape in LEADER_SHAPES:
        parts.append(flat[: int(np.prod(shape))].reshape(shape))
        flat = flat[int(np.prod(shape)) :]
    return LeaderSums(Regression(*parts[:4]), *parts[4:])
