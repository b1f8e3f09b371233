"""A model of cells with a known optimum: numbers that are normal around a level of their cell."""

from typing import NamedTuple

import numpy as np


class Levels(NamedTuple):
    mean: np.ndarray
    spread: np.ndarray


class GaussianCells:
    """One normal distribution in each cell, leaning on (0, 3) as on one datum."""

    def fit(self, position, data, members):
        cell = np.repeat(np.arange(len(members.center)), np.diff(members.start))
        n = len(members.center)
        value = data[members.row]
        mass = np.bincount(cell, members.weight, minlength=n) + 1.0
        mean = np.bincount(cell, members.weight * value, minlength=n) / mass
        square = (np.bincount(cell, members.weight * value**2, minlength=n) + 9.0) / mass
        return Levels(mean, np.sqrt(np.maximum(square - mean**2, 1e-4)))

    def log_density(self, cells, position, data, row, cell):
        z = (data[row] - cells.mean[cell]) / cells.spread[cell]
        return -0.5 * z**2 - np.log(cells.spread[cell]) - 0.5 * np.log(2 * np.pi)
