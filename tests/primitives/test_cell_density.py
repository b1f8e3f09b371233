"""Densities of rows in cells that need not be their own, far away from them too."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dirprim_filter.primitives._cell_density import log_densities

STANDING_RATE, PLACE_FREE = 10.0, -3.0


def log_density_at(east_m: float, share: float) -> float:
    """Of 10 m/s eastward, in a cell of one mode whose log speed grows by .05 for each metre to the east."""
    shape, rate, concentration = 4.0, 0.4, 2.0
    constant = (
        shape * math.log(rate) - math.lgamma(shape) - math.log(2.0 * math.pi * np.i0(concentration)) + concentration
    )
    mode = [constant, 1.0, 0.0, concentration, shape, rate, 0.0, 0.0, 0.05, 0.0]
    out = np.empty(1)
    log_densities(
        np.array([[mode]]), np.zeros(1), STANDING_RATE, np.zeros((1, 2)), np.array([share]), np.array([PLACE_FREE]),
        np.array([[east_m, 0.0]]), np.zeros(1), np.array([10.0]), np.zeros(1, np.int64), np.zeros(1, np.int64), out,
    )  # fmt: skip
    return float(out[0])


@pytest.mark.parametrize("east_m", [-1e3, -2e4, -1e6, 1e3])
def test_far_from_a_cell_the_background_is_left(east_m: float) -> None:
    """Where no mode explains a row, since its rate e^(-gain east) is beyond all numbers, the density is the rest's."""
    assert log_density_at(east_m, share=0.2) == pytest.approx(math.log(0.2) + PLACE_FREE, abs=1e-6)


def test_in_the_cell_the_mode_counts() -> None:
    """The negative control: by the formulas of von Mises and gamma."""
    shape, rate, concentration = 4.0, 0.4, 2.0
    gamma = rate**shape / math.gamma(shape) * 10.0 ** (shape - 1.0) * math.exp(-rate * 10.0)
    von_mises = math.exp(concentration) / (2.0 * math.pi * float(np.i0(concentration)))
    expected = math.log(0.8 * gamma * von_mises + 0.2 * math.exp(PLACE_FREE))
    assert log_density_at(0.0, share=0.2) == pytest.approx(expected, abs=1e-9)
