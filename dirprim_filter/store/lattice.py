"""The lattice that motion is counted on: squares of the map frame, bins of direction, and bins of speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray

NONE = -1
"""In the place of a state: there is none."""
SQUARE_BITS, BIN_BITS = 24, 7
N_SQUARES, N_BINS = 1 << SQUARE_BITS, 1 << BIN_BITS
"""In each axis; and at most, of direction and of speed. Powers of two: division would take most of the time."""
STANDING_BELOW = 0.3
"""m/s: bin 0 of speed is for vehicles that stand."""
PART_BITS = 5
PARTS = 1 << PART_BITS
"""A bin's width in the units of the moments: sums of whole numbers are the same in any order."""


class Parts(NamedTuple):
    """Where in their bins states lie, in `PARTS` of a bin from its lower edge: integers."""

    east: IntArray
    north: IntArray
    direction: IntArray
    speed: IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Lattice:
    """How motion is counted; only what was counted alike can be added.

    Attributes:
        square_m: metres, side of the squares; (0, 0) is a corner.
        n_directions: bins of direction, the first from east on.
        speed_mps: m/s, width of the bins of speed in motion.
        n_folds: parts that vehicles are dealt to by their names.

    Raises:
        ValueError: a number that is out of range.
    """

    square_m: float = 1.0
    n_directions: int = 36
    speed_mps: float = 2.0
    n_folds: int = 5

    def __post_init__(self) -> None:
        for name in ("square_m", "speed_mps"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name}: expected a positive number, got {getattr(self, name)}")
        for name, most in (("n_directions", N_BINS), ("n_folds", N_BINS)):
            if not 1 <= getattr(self, name) <= most:
                raise ValueError(f"{name}: expected 1 to {most}, got {getattr(self, name)}")

    def states(self, position: FloatArray, direction: FloatArray, speed: FloatArray) -> tuple[IntArray, Parts]:
        """The state that each row is in, and where in its bins. (n, 2), (n,), (n,) -> (n,).

        Raises:
            ValueError: a position beyond the lattice.
        """
        east, of_east = _binned(position[:, 0] / self.square_m)
        north, of_north = _binned(position[:, 1] / self.square_m)
        half = N_SQUARES // 2
        if position.size and max(np.abs(east).max(), np.abs(north).max()) >= half:
            raise ValueError(
                f"position: expected coordinates within {half * self.square_m:g} m of the origin, got "
                f"{np.abs(position).max():g}"
            )
        turned = np.where(direction < 0.0, direction + 2.0 * np.pi, direction)
        turn, of_turn = _binned(turned * (self.n_directions / (2.0 * np.pi)))
        pace, of_pace = _binned((speed - STANDING_BELOW) / self.speed_mps)
        stands = speed < STANDING_BELOW
        of_pace = np.where(stands, np.floor(speed * (PARTS / STANDING_BELOW)).astype(np.int64), of_pace)
        pace = np.where(stands, 0, np.minimum(pace + 1, N_BINS - 1))
        state = packed(east, north, np.where(turn < self.n_directions, turn, 0), pace)
        return state, Parts(of_east, of_north, of_turn, of_pace)

    def motion(self, state: IntArray, parts: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, directions and speeds of states, (n, 4) `PARTS` from the lower edges. -> (n, 2), (n,), (n,)."""
        east, north, turn, pace = unpacked(state)
        share = parts / PARTS
        position = (np.column_stack([east, north]) + share[:, :2]) * self.square_m
        direction = (turn + share[:, 2]) * (2.0 * np.pi / self.n_directions)
        speed = np.where(
            pace == 0, share[:, 3] * STANDING_BELOW, STANDING_BELOW + (pace - 1 + share[:, 3]) * self.speed_mps
        )
        return position, direction, speed


def packed(east: IntArray, north: IntArray, turn: IntArray, pace: IntArray) -> IntArray:
    """States of squares, bins of direction and bins of speed. (n,) each."""
    square = (east + N_SQUARES // 2) * N_SQUARES + (north + N_SQUARES // 2)
    return np.asarray((square * N_BINS + turn) * N_BINS + pace)


def unpacked(state: IntArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Squares east and north, bins of direction and bins of speed of states. (n,) each."""
    square = square_of(state)
    return (
        (square >> SQUARE_BITS) - N_SQUARES // 2, (square & (N_SQUARES - 1)) - N_SQUARES // 2,
        (state >> BIN_BITS) & (N_BINS - 1), state & (N_BINS - 1),
    )  # fmt: skip


def square_of(state: IntArray) -> IntArray:
    """(n,) a number for the square of each state."""
    return np.asarray(state >> 2 * BIN_BITS)


def _binned(value: FloatArray) -> tuple[IntArray, IntArray]:
    """The bin of each value in units of bins, and where in it."""
    part = np.floor(value * PARTS).astype(np.int64)
    return part >> PART_BITS, part & (PARTS - 1)
