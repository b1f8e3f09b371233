"""A part of a map: some of its cells by numbers of their own, and what is known of all the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dirprim_filter.arrays import IntArray

if TYPE_CHECKING:
    from dirprim_filter.primitives.traffic import Traffic


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What a part of a map knows of the whole: vehicles of all places together tell how many there are at each.

    Attributes:
        cell: (n_cells,) which of the map's cells the part's are, ascending.
        manoeuvre: (n_placed,) which of the map's manoeuvres, ascending.
        traffic: of the map; None where it counted no transitions.
    """

    cell: IntArray
    manoeuvre: IntArray
    traffic: Traffic | None


def renumbered(former: IntArray, now: IntArray) -> IntArray:
    """Where each of some numbers (n,) stands among others (m,), both ascending; -1 where it does not. -> (n,)."""
    if not now.size:
        return np.full(former.size, -1)
    at = np.minimum(np.searchsorted(now, former), now.size - 1)
    return np.where(now[at] == former, at, -1)
