"""Regimes: since when vehicles have shared themselves out between the modes of a cell as they do now.

A half-life says how long a regime lasts: after it, half of all places have changed. So a cell changes in a period of t
seconds with probability 1 - 2^(-t / half-life), and then how many drive which mode says nothing of what comes. Within
a regime shares stay, and are Dirichlet distributed before anything is seen. Since when the present one has held follows
by going through the periods once, with a weight for each period that it may have begun in.

Source: R. P. Adams, D. J. C. MacKay, Bayesian Online Changepoint Detection, 2007, arXiv:0710.3742.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.store import _regimes

N_PERIODS = 64
"""What is older is of the first."""
LEAST_HOURS = 24
"""Of a period: within a day demand turns and turns back."""
PER_HALF_LIFE = 16
"""Periods, where they are longer than that."""
PRIOR = 1.0
"""Vehicles that a regime's shares are worth before it is seen."""
ALIKE = 0.1
"""Correlation of what two vehicles of a period do: days differ by more than chance (Kish 1965, design effect)."""


class Periods(NamedTuple):
    """Stretches of time, counted back from now; the last is the newest."""

    of_vehicle: IntArray  # (n,) the period in which each came into sight
    change: float  # probability that a regime ends from one to the next

    @classmethod
    def of(cls, age: IntArray, half_life_s: float) -> Self:
        """Of ages in hours, (n,)."""
        hours = max(LEAST_HOURS, int(half_life_s / 3600.0 / PER_HALF_LIFE))
        period = N_PERIODS - 1 - np.maximum(age, 0) // hours
        return cls(np.maximum(period, 0), 1.0 - 0.5 ** (hours * 3600.0 / half_life_s))


def still_so(cell: IntArray, mode: IntArray, period: IntArray, *, change: float, n_modes: int) -> FloatArray:
    """How probable it is that what was seen was of the regime that its cell is in now.

    Args:
        cell: (n,) of each vehicle seen.
        mode: (n,) that it drove there.
        period: (n,) in which.
        change: see `Periods`.
        n_modes: of a cell.

    Returns:
        (n,) from 0 to 1; 1 in cells of one mode, where no share can change.
    """
    order = np.argsort(cell, kind="stable")
    _, first = np.unique(cell[order], return_index=True)
    found = np.ones(cell.size)
    found[order] = _regimes.still_so(
        np.append(first, cell.size), mode[order], period[order], n_modes, N_PERIODS, change, PRIOR, ALIKE
    )
    return found
