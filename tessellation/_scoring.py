"""Fisher scoring of generators: where the borders of softly gated cells should go.

Between its nearest generator a and a rival b, a datum's gate is logistic in its distance to their border,
s = (|x - g_b|^2 - |x - g_a|^2) / (2 |g_b - g_a|), over a width. Unlike a softmax of -|x - g|^2 / tau, it does not get
sharper as generators move apart, which would pull them where no border is. With gates g and responsibilities r the
score of a generator is sum (r - g) ds / width, its information sum g (1 - g) ds ds^T / width^2, and ds the change of s:
half the way across the border, and a turn of the border for what is beside.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tessellation._arrays import FloatArray, IntArray
from tessellation.gates import border_distance, nearest_generators

N_RIVALS = 4
"""Cells that compete for a datum."""
FARTHEST_RIVAL = 2.0
"""Of half the distance to the nearest rival; farther beyond its border no cell competes."""
FARTHEST_MOVE = 0.3
"""Of the distance to the next generator."""
RIDGE = 0.1
"""Of the mean information: so that a border without data beside it stays."""


def scoring_step(
    position: FloatArray,
    generators: FloatArray,
    *,
    width: float,
    log_density: Callable[[IntArray, IntArray], FloatArray],
) -> FloatArray:
    """One step of Fisher scoring. -> (n_cells, 2) metres.

    Args:
        position: (n, 2) metres.
        generators: (n_cells, 2) metres, at least two.
        width: of the gates, as a share of the distance to the nearest rival's generator.
        log_density: of datum i in cell c, for pairs (p,), (p,).
    """
    distance, cell = nearest_generators(position, generators, k=N_RIVALS)
    beyond, half_apart = border_distance(generators, distance, cell)
    metres = 2.0 * width * half_apart[:, 1:2]
    gate = np.where(beyond <= FARTHEST_RIVAL * half_apart[:, 1:2], -beyond / metres, -np.inf)
    row, column = np.nonzero(np.isfinite(gate))
    log_p = np.full(gate.shape, -np.inf)
    log_p[row, column] = log_density(row, cell[row, column])
    prior, posterior = _shares(gate), _shares(gate + log_p)
    score, information = _score(position, generators, cell, half_apart, metres[:, 0], prior, posterior)
    ridge = RIDGE * np.trace(information, axis1=1, axis2=2) + 1e-9
    information += ridge[:, None, None] * np.eye(2)
    step = np.asarray(np.linalg.solve(information, score[:, :, None])[:, :, 0], np.float64)
    step *= 0.5  # a border moves with both its generators
    spacing = nearest_generators(generators, generators, k=2)[0][:, -1]
    length = np.linalg.norm(step, axis=1)
    return np.asarray(step * np.minimum(1.0, FARTHEST_MOVE * spacing / np.maximum(length, 1e-300))[:, None])


def _shares(log_p: FloatArray) -> FloatArray:
    """exp(log_p), scaled so that each row sums to one. (n, k)."""
    share = np.exp(log_p - log_p.max(axis=1, keepdims=True))
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def _score(
    position: FloatArray,
    generators: FloatArray,
    cell: IntArray,
    half_apart: FloatArray,
    metres: FloatArray,
    prior: FloatArray,
    posterior: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """(n_cells, 2) and (n_cells, 2, 2), summed over each datum's border with each of its rivals."""
    n = len(generators)
    score, information = np.zeros((n, 2)), np.zeros((n, 2, 2))
    home = generators[cell[:, 0]]
    for k in range(1, cell.shape[1]):
        rival, apart = generators[cell[:, k]], 2.0 * half_apart[:, k : k + 1]
        across = (rival - home) / apart
        surprise = (posterior - prior)[:, k]
        doubt = (prior * (1.0 - prior))[:, k]
        for own, sign in ((rival, 1.0), (home, -1.0)):
            aside = position - own
            aside = aside - (aside * across).sum(axis=1, keepdims=True) * across
            slope = (-0.5 * across + sign * aside / apart) / metres[:, None]
            owner = cell[:, k] if sign > 0 else cell[:, 0]
            for i in (0, 1):
                score[:, i] += np.bincount(owner, surprise * slope[:, i], minlength=n)
                for j in (0, 1):
                    information[:, i, j] += np.bincount(owner, doubt * slope[:, i] * slope[:, j], minlength=n)
    return score, information
