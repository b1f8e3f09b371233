"""Where a search for cells stands, and what one state can take over from another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numpy as np

from tessellation._arrays import BoolArray, FloatArray, IntArray
from tessellation.protocols import Cells, Members


@dataclass(slots=True, kw_only=True, eq=False)
class State(Generic[Cells]):
    """Cells, as fitted without each of the folds, and what they give to the rows held out."""

    generators: FloatArray  # (n_cells, 2)
    members: Members
    cell: IntArray  # (n,) of each row
    signature: FloatArray  # (n_cells,) the same for the same members
    fits: Cells  # cell c without fold f is number c * n_folds + f
    score: FloatArray  # (n,) log density of each row as held out
    objective: float  # minus the mean of the scores
    finished: BoolArray  # (n_cells,) cells that are known not to gain by a split
    refused: FloatArray  # (n,) sums of two signatures, of cells that are known not to gain by being one


def sums(value: FloatArray, start: IntArray) -> FloatArray:
    """The sum of each cell's values."""
    total = np.concatenate([value, [0.0]])
    return np.where(np.diff(start) > 0, np.add.reduceat(total, start[:-1]), 0.0)


def known(generators: FloatArray, signature: FloatArray, before: tuple[State[Cells], ...]) -> tuple[IntArray, IntArray]:
    """Which of the states before has each cell with the same members, and its number there; -1 where none has."""
    numbers = {
        key: (i, c)
        for i, state in enumerate(before)
        for c, key in enumerate(zip(*state.generators.T.tolist(), state.signature.tolist(), strict=True))
    }
    keys = zip(*generators.T.tolist(), signature.tolist(), strict=True)
    found = np.array([numbers.get(key, (-1, -1)) for key in keys], dtype=np.int64).reshape(-1, 2)
    return found[:, 0].copy(), found[:, 1].copy()


def taken(cells: Cells, index: IntArray) -> Cells:
    """The parameters of some cells."""
    return type(cells)(*(column[index] for column in cells))


def joined(parts: list[Cells]) -> Cells:
    """The parameters of the first cells, then of the next."""
    return type(parts[0])(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
