"""The maximum likelihood of errors that are a mean, a first-order Gauss-Markov process and white noise.

Of n errors y = X b + c + w at times t the covariance is v (s K + (1 - s) I), K_ij = exp(-|t_i - t_j| / tau) within a
series. K has a tridiagonal inverse, so that all takes time in proportion to n.

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, appendix B, for the process; Aitken's
generalised least squares for b.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize
from scipy.special import expit, logit

from dirprim_filter.arrays import BoolArray, FloatArray

STARTS = [np.array(of) for of in product(logit([0.2, 0.6, 0.95]), np.log([0.1, 0.3, 1.0, 4.0, 15.0]))]
"""Logits of the share and logs of the seconds: the search begins at the best of them."""
BOUNDS: list[tuple[float, float]] = [(float(logit(0.01)), float(logit(0.995))), (math.log(0.02), math.log(60.0))]
SURE = 3.0
"""Log likelihood by which a correlation is known: half of the 95 % point of chi squared, two degrees of freedom."""
STEP = 0.05
"""Of the differences that the curvature is taken from."""


class ErrorFit(NamedTuple):
    """What was found, and the standard errors.

    Attributes:
        mean: (k,) coefficients of the regressors.
        mean_se: (k,).
        spread: standard deviation of the errors around their mean.
        spread_se: of it.
        share: of the variance that is correlated; 0 where no correlation is seen.
        share_se: NaN where there is none.
        lasts_s: seconds; NaN where there is none.
        lasts_se: likewise.
    """

    mean: FloatArray
    mean_se: FloatArray
    spread: float
    spread_se: float
    share: float
    share_se: float
    lasts_s: float
    lasts_se: float


def fit_errors(y: FloatArray, regressors: FloatArray, time_s: FloatArray, is_first: BoolArray) -> ErrorFit:
    """Fit a mean, a variance, the correlated share of it and its time.

    The variance is the mean square itself, and share and time the likeliest with it: where errors are smoother than a
    first-order process, as those of a sensor that filters are, the likelihood alone would believe their small steps
    and not how far they stray.

    Args:
        y: (n,) errors, series after series, ascending in time.
        regressors: (n, k) of the mean.
        time_s: (n,) seconds.
        is_first: (n,) where a series begins.
    """
    gap_s = np.where(is_first, np.inf, np.maximum(np.diff(time_s, prepend=time_s[0]), 1e-6))

    def cost(point: FloatArray) -> float:
        return -Profile(y, regressors, gap_s, float(expit(point[0])), float(np.exp(point[1]))).log_likelihood

    found, share, lasts_s, se = Profile(y, regressors, gap_s, 0.0, 1.0), 0.0, np.nan, np.full(2, np.nan)
    best = minimize(
        cost, min(STARTS, key=cost), method="Nelder-Mead", bounds=BOUNDS, options={"xatol": 1e-3, "fatol": 1e-3}
    )
    if -best.fun >= found.log_likelihood + SURE:
        share, lasts_s = float(expit(best.x[0])), float(np.exp(best.x[1]))
        found, se = Profile(y, regressors, gap_s, share, lasts_s), _standard_errors(cost, best.x)
    square_se = _mean_square_error(time_s, is_first, share, lasts_s)
    return ErrorFit(
        found.mean, found.mean_se, found.spread, found.spread * 0.5 * square_se, share,
        (1.0 - share) * float(np.hypot(share * se[0], square_se)), lasts_s,
        lasts_s * float(np.hypot(se[1], square_se)),
    )  # fmt: skip


class Profile:
    """The likelihood at a share and a time, at its maximum over the mean and the variance."""

    def __init__(self, y: FloatArray, regressors: FloatArray, gap_s: FloatArray, share: float, lasts_s: float) -> None:
        n, k = regressors.shape
        solve, log_determinant = _inverse(gap_s, share, lasts_s)
        both = solve(np.column_stack([regressors, y]))
        inverse = np.linalg.pinv(regressors.T @ both[:, :k])
        self.mean = inverse @ regressors.T @ both[:, k]
        residual = y - regressors @ self.mean
        # what the mean takes of the errors is put back: of few long series it is not little
        taken = float(((regressors @ inverse) * regressors).sum(axis=1).mean())
        variance = max(float((residual**2).mean()) / max(1.0 - taken, 0.1), 1e-12)
        self.spread = float(np.sqrt(variance))
        self.mean_se = self.spread * np.sqrt(np.maximum(np.diag(inverse), 0.0))
        square = float(residual @ (both[:, k] - both[:, :k] @ self.mean))
        self.log_likelihood = -0.5 * float(n * np.log(2.0 * np.pi * variance) + log_determinant + square / variance)


def _inverse(gap_s: FloatArray, share: float, lasts_s: float) -> tuple[Callable[[FloatArray], FloatArray], float]:
    """Solves with the covariance of unit variance, and the log of its determinant."""
    if share == 0.0:
        return (lambda columns: columns), 0.0
    kept = np.minimum(np.exp(-gap_s / lasts_s), 1.0 - 1e-9)
    own, white = 1.0 / (1.0 - kept**2), 1.0 - share
    precision = np.zeros((2, gap_s.size))  # of the correlated part: tridiagonal, as `cholesky_banded` takes it
    precision[1] = (own + np.append(kept[1:] ** 2 * own[1:], 0.0)) / share + 1.0 / white
    precision[0, 1:] = -(kept * own)[1:] / share
    factor = cholesky_banded(precision)
    log_determinant = gap_s.size * np.log(white * share) + 2.0 * np.log(factor[1]).sum() - np.log(own).sum()

    def solve(columns: FloatArray) -> FloatArray:
        return np.asarray((columns - cho_solve_banded((factor, False), columns) / white) / white)

    return solve, float(log_determinant)


def _mean_square_error(time_s: FloatArray, is_first: BoolArray, share: float, lasts_s: float) -> float:
    """Standard error of a mean square, as a share of it: sqrt(2 sum of squared correlations) / n."""
    starts = np.flatnonzero(is_first)
    ends = np.append(starts[1:], time_s.size)
    n, together = ends - starts, 0.0
    if share:
        x = np.maximum(2.0 * (time_s[ends - 1] - time_s[starts]) / lasts_s, 1e-6)
        together = share**2 * n**2 * 2.0 * (x - 1.0 + np.exp(-x)) / x**2
    return float(np.sqrt(2.0 * (together + (1.0 - share**2) * n).sum()) / n.sum())


def _standard_errors(cost: Callable[[FloatArray], float], at: FloatArray) -> FloatArray:
    """(2,) of the logit of the share and the log time, by the curvature of the likelihood."""
    steps, signs = STEP * np.eye(2), tuple(product((1.0, -1.0), repeat=2))
    curvature = [[sum(i * j * cost(at + i * a + j * b) for i, j in signs) for b in steps] for a in steps]
    return np.sqrt(np.maximum(np.diag(np.linalg.pinv(np.array(curvature) / (4.0 * STEP**2))), 0.0))
