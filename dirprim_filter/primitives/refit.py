"""What it takes to fit some cells of a map anew: what was chosen when it was learned, and from what."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dirprim_filter.arrays import ArrayValue, FloatArray, IntArray
from dirprim_filter.primitives.recipe import Recipe
from dirprim_filter.primitives.schedule import N_SLOTS

N_SPREADS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counted(ArrayValue):
    """What a map was learned from: the recordings of a store, by tiles, so that its size is that of the map.

    Attributes:
        by: how the store counts, and in which frame.
        min_vehicles: of what fewer did the map says nothing.
        most_rows: around a tile, of as many ways of vehicles as leave no more.
        usual_square: (4,) of a manoeuvre's deviations, see `motion_learning.usual_squares`.
        tile: (t, 2) east and north, in order: those that recordings have steps in.
        digest: (t,) of the recordings of each.
        half_life_s: seconds, by which older vehicles count less; 0 where nothing fades.
        now_ns: nanoseconds since 1970-01-01, from when age is counted at the latest.
        slot_strength: (2,) vehicles with which all day counts in a slot of the schedule, of flow and of pace; (0,)
            where there is no schedule.
        slot_share: (n_slots,) of the vehicles of the whole map, those of each slot.

    Raises:
        ValueError: columns of different lengths, or a number out of range.
    """

    by: str
    min_vehicles: int
    most_rows: int
    usual_square: FloatArray
    tile: IntArray
    digest: IntArray
    half_life_s: float = 0.0
    now_ns: int = 0
    slot_strength: FloatArray = field(default_factory=lambda: np.empty(0))
    slot_share: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if self.tile.shape != (self.digest.size, 2):
            raise ValueError(f"tile, digest: expected (t, 2) and (t,), got {self.tile.shape} and {self.digest.shape}")
        if min(self.min_vehicles, self.most_rows) < 1:
            raise ValueError(
                f"min_vehicles, most_rows: expected at least 1, got {self.min_vehicles} and {self.most_rows}"
            )
        square = self.usual_square
        if square.shape != (N_SPREADS,) or not (np.isfinite(square).all() and (square >= 0).all()):
            raise ValueError(f"usual_square: expected {N_SPREADS} numbers, none negative, got {square}")
        if not (np.isfinite(self.half_life_s) and self.half_life_s >= 0.0):
            raise ValueError(f"half_life_s: expected seconds, not negative, got {self.half_life_s}")
        strength, share = self.slot_strength, self.slot_share
        if (strength.size, share.size) != (0, 0) and (strength.size != 2 or share.size not in N_SLOTS.values()):
            raise ValueError(
                f"slot_strength, slot_share: expected 2 numbers and {sorted(N_SLOTS.values())}, got {strength.size} "
                f"and {share.size}"
            )
        if not ((strength > 0.0).all() and np.isfinite(share).all() and (share >= 0.0).all()):
            raise ValueError(
                f"slot_strength, slot_share: expected numbers above 0, and shares, got {strength}, {share}"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refit:
    """How a map's cells were fitted.

    Attributes:
        recipe: of the modes.
        softness: how much cells learn from beside them, see `tessellation.gates`.
        place_free: vehicles with which the place-free primitive enters a cell.
        borrowed: share of a cell's weight that it borrows.
        lenders: generators (k, 2) of the cells that it borrows from.
        counted: what the map was learned from; None where that is no store.

    Raises:
        ValueError: a number that is out of range.
    """

    recipe: Recipe
    softness: float
    place_free: float
    borrowed: float
    lenders: tuple[FloatArray, ...] = ()
    counted: Counted | None = None

    def __post_init__(self) -> None:
        numbers = (self.softness, self.place_free, self.borrowed, *self.recipe.usual)
        if not (np.isfinite(numbers).all() and min(numbers) >= 0.0 and self.borrowed < 1.0):
            raise ValueError(
                f"softness, place_free, borrowed, usual: expected numbers that are not negative, got {numbers}"
            )
        if not (self.recipe.prior_strength > 0.0 and self.recipe.parameter_cost > 0.0 and self.place_free > 0.0):
            raise ValueError("prior_strength, parameter_cost, place_free: expected positive numbers")
