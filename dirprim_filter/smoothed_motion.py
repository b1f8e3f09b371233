"""Velocities of positions that are noisy, or too seldom for differences: a smoother whose numbers the rows choose.

Velocity is a random walk: acceleration is white, of density q, and positions have white noise of variance r. Mean
positions and velocities of all rows solve one system of equations; rows couple with their neighbours alone, so it is a
band, and a million rows take a second. Of q and r the evidence chooses: r follows from the residuals, q / r from a
search.

Source: Rauch, Tung and Striebel, Maximum likelihood estimates of linear dynamic systems, 1965; as one system: Barfoot,
Tong and Särkkä, Batch Continuous-Time Trajectory Estimation as Exactly Sparse Gaussian Process Regression, 2014.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray

LEAST_ROWS = 30
"""Fewer do not show their noise."""
SEARCHED, BLOCK = 10_000, 200
"""Rows that the ratio is searched by, and how many follow each other there."""
LEAST_RATIO, MOST_RATIO = math.log(1e-7), math.log(1e7)
"""Of q T^3 / r, T the mean interval: rows are averaged over some fifty intervals, or positions are exact."""
LEAST_STEP = 0.05
"""Mean intervals: rows still nearer in time count as so far apart, or rounding would decide."""
_SPREAD = 2.0**-1.5
"""Integral of w^2 / (1 + w^4) over w / (2 pi): what a smoother of rows without end leaves open of a velocity."""


class SmoothedMotion(NamedTuple):
    """What positions show of velocities.

    Attributes:
        velocity: (n, 2) m/s.
        noise: metres, standard deviation of each coordinate's white noise.
        spread: m/s, standard deviation of a velocity's component, rows being as far apart as in the mean.
    """

    velocity: FloatArray
    noise: float
    spread: float

    @classmethod
    def of(
        cls, time_s: FloatArray, position: FloatArray, follows: BoolArray, moves: BoolArray
    ) -> SmoothedMotion | None:
        """The motion of rows in order of vehicle and time; None of rows too few to show their noise.

        Args:
            time_s: (n,) ascending from row to row that follows.
            position: (n, 2) metres.
            follows: (n - 1,) whether the next row is the vehicle's, without a gap.
            moves: (n,) rows that noise is searched by: who stands shows none, and is surer of its velocity.
        """
        block = np.arange(time_s.size) // BLOCK
        used = moves & (block % (1 + time_s.size // SEARCHED) == 0)
        near = follows & used[1:] & used[:-1] & (block[1:] == block[:-1])
        if np.count_nonzero(near) < LEAST_ROWS:
            return None
        usual_s = float(np.diff(time_s)[near].mean())
        rows = _Rows.of(time_s / usual_s, position, follows)
        few = _Rows.of(time_s[used] / usual_s, position[used], near[np.flatnonzero(used)[:-1]])
        ratio = _greatest(lambda log_ratio: few.solved(log_ratio).evidence)
        noise = math.sqrt(few.solved(ratio).variance)
        density = math.exp(ratio) * noise**2  # m^2 per interval^3
        spread = math.sqrt(_SPREAD * density**0.75 * noise**0.5) / usual_s
        return cls(rows.solved(ratio).velocity / usual_s, noise, spread)


class _Solved(NamedTuple):
    """Velocities (n, 2), metres per unit of time; the variance of a position; the log evidence but for a constant."""

    velocity: FloatArray
    variance: float
    evidence: float


class _Rows(NamedTuple):
    """Steps of time in mean intervals, 1 from piece to piece, and positions from where each piece begins."""

    step: FloatArray  # (n - 1,)
    follows: BoolArray  # (n - 1,)
    offset: FloatArray  # (n, 2)

    @classmethod
    def of(cls, time: FloatArray, position: FloatArray, follows: BoolArray) -> _Rows:
        piece = np.append(0, np.cumsum(~follows))
        step = np.where(follows, np.maximum(np.diff(time), LEAST_STEP), 1.0)
        return cls(step, follows, position - position[np.searchsorted(piece, piece)])

    def solved(self, log_ratio: float) -> _Solved:
        """Means under a ratio q / r, in units of the positions' variance."""
        from scipy.linalg import cho_solve_banded, cholesky_banded  # noqa: PLC0415 - logs that state motion, and precise ones, do without

        root = cholesky_banded(self._information(math.exp(log_ratio)), lower=True, check_finite=False)
        right = np.zeros((root.shape[1], 2))
        right[::2] = self.offset
        mean = cho_solve_banded((root, True), right, check_finite=False)
        squares = max(float((self.offset**2).sum() - (right * mean).sum()), 1e-300)
        n_free = 2 * int(np.count_nonzero(self.follows[1:] & self.follows[:-1]))  # two rows fit any line
        prior = np.log(self.step[self.follows] ** 4 / 12.0).sum() + 2.0 * log_ratio * np.count_nonzero(self.follows)
        evidence = -2.0 * np.log(root[0]).sum() - prior - 0.5 * n_free * math.log(squares)
        return _Solved(mean[1::2], squares / max(n_free, 1), float(evidence))

    def _information(self, ratio: float) -> FloatArray:
        """(4, 2 n) the lower band of the information matrix: position and velocity of each row in turn.

        A step of time h contributes e' Q^-1 e, e = (p' - p - h v, v' - v) and Q = q [h^3 / 3, h^2 / 2; h^2 / 2, h];
        a position contributes 1.
        """
        h, weight = self.step, self.follows / ratio
        place, both, speed = 12.0 * weight / h**3, 6.0 * weight / h**2, weight / h
        band = np.zeros((4, 2 * len(self.offset)))
        band[0, ::2] = 1.0
        band[0, 1::2] = 1e-9  # who is alone has any velocity
        for now in (0, 1):
            end = band.shape[1] - 2 * (1 - now)
            band[0, 2 * now : end : 2] += place
            band[0, 2 * now + 1 : end : 2] += 4.0 * speed
            band[1, 2 * now : end : 2] += -both if now else both
        band[2, :-2:2] = -place
        band[3, :-2:2] = both
        band[1, 1:-2:2] = -both
        band[2, 1:-2:2] = 2.0 * speed
        return band


def _greatest(evidence: Callable[[float], float]) -> float:
    """The log ratio of the greatest evidence."""
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - logs that state motion, and precise ones, do without

    grid = np.linspace(LEAST_RATIO, MOST_RATIO, 9)
    best = int(np.argmax([evidence(x) for x in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    found = minimize_scalar(lambda x: -evidence(x), bounds=around, method="bounded", options={"xatol": 0.05})
    return float(found.x)
