"""Knots of ways: few steps, between which splines give all others back nearly as they were.

Of a vehicle that stands, or drives on evenly, one step tells what many do. Between knots a vehicle is where learning
has it between the rows of a log (see `primitives._filling`).
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray, IntArray
from dirprim_filter.primitives._filling import at_steps
from dirprim_filter.store._knots import knots_of
from dirprim_filter.store.lattice import PARTS, Lattice
from dirprim_filter.store.pseudo_tracks import pseudo_tracks
from dirprim_filter.store.steps import TICK_NS, WHEN, tally_in_order, unpacked_when
from dirprim_filter.store.tallies import Tally

WITHIN = (0.25, np.radians(0.4), 0.2)
"""Metres, radians and m/s, by which a step that is left out may be off."""
MOST_STEPS = 256
"""From a knot to the next."""


class Knots(NamedTuple):
    """Steps of ways, one way after the other."""

    begins: BoolArray  # (n,) the first of a way
    when: IntArray  # (n,) the same for all of a way, see `Summary.steps`
    state: IntArray  # (n,) of the lattice
    parts: IntArray  # (n, 4) where in its bins
    apart: IntArray  # (n,) how many steps on the next knot is; 1 of the last of a way

    @classmethod
    def of(cls, steps: Tally, lattice: Lattice) -> Self:
        """Of the ways that steps chain into, see `pseudo_tracks`.

        Raises:
            ValueError: the steps do not chain.
        """
        tracks, kind = pseudo_tracks(steps, lattice)
        begins = np.diff(tracks.track_id, prepend=-1) != 0
        state, of = lattice.states(tracks.position, tracks.direction, tracks.speed)
        parts, when = np.column_stack(of), steps.key[kind, WHEN]
        position, direction, speed = _motion(state, parts, lattice)
        step_ns = unpacked_when(when, lattice)[2] * TICK_NS
        at = np.flatnonzero(
            knots_of(_ends(begins), step_ns, position, direction, speed, np.array(WITHIN), MOST_STEPS)
        )  # fmt: skip
        return cls(begins[at], when[at], state[at], parts[at], np.diff(at, append=begins.size))

    def check(self, lattice: Lattice, most_steps: int) -> None:
        """Whether they can be of ways, of no more than so many steps in all.

        Raises:
            ValueError: they cannot.
        """
        apart, same = self.apart, self.when[1:] == self.when[:-1]
        in_order = self.begins[:1].all() and (same | self.begins[1:]).all() and (apart[_ends(self.begins)] == 1).all()
        if not in_order or (apart < 1).any() or (apart > MOST_STEPS).any() or apart.sum() > most_steps:
            raise ValueError(f"steps that are not those of ways, or more than {most_steps}")
        if (unpacked_when(self.when, lattice)[2] < 1).any() or (self.parts < 0).any() or (self.parts >= PARTS).any():
            raise ValueError("steps without length, or beyond their bins")

    def steps(self, lattice: Lattice) -> Tally:
        """All steps, as of `Summary`."""
        position, direction, speed = _motion(self.state, self.parts, lattice)
        ticks, parts = unpacked_when(self.when, lattice)[2], []
        for length in np.unique(ticks).tolist():
            step_ns, own = length * TICK_NS, np.flatnonzero(ticks == length)
            apart_ns = np.where(_ends(self.begins), -1, self.apart * step_ns)[own]
            row, first, state = at_steps(own, apart_ns, position, direction, speed, step_ns)
            here, of = lattice.states(state[:, :2], state[:, 2], state[:, 3])
            parts.append((self.when[row], here, np.diff(first, prepend=-1) != 0, np.column_stack(of)))
        if not parts:
            return Tally.none(4, 9)
        when, here, begins, part = (np.concatenate(column) for column in zip(*parts, strict=True))
        return tally_in_order(when, here, begins, np.column_stack([np.ones_like(when), part, part * part]))


def _motion(state: IntArray, parts: IntArray, lattice: Lattice) -> tuple[FloatArray, FloatArray, FloatArray]:
    return lattice.motion(state, parts.astype(np.float64) + 0.5)


def _ends(begins: BoolArray) -> BoolArray:
    """(n,) the last step of each way."""
    return np.append(begins[1:], True)[: begins.size]
