"""The maximum likelihood of errors that are a mean, a first-order Gauss-Markov process and white noise.

Of n errors y = X b + c + w at times t the covariance is v (s K + (1 - s) I), K_ij = exp(-|t_i - t_j| / tau) within a
series. K has a tridiagonal inverse, so that all takes time in proportion to n.

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, appendix B, for the process; Aitken's
generalised least squares for b.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize

from dirprim_filter.arrays import BoolArray, FloatArray

SHARES = (0.2, 0.6, 0.95)
TIMES_S = (0.1, 0.3, 1.0, 4.0, 15.0)
"""Where the search begins: at the best of all pairs."""
SHARE_RANGE = (0.01, 0.995)
TIME_RANGE_S = (0.02, 60.0)
SURE = 3.0
"""Log likelihood by which a correlation is known: half of the 95 % point of chi squared, two degrees of freedom."""
STEP = 0.05
"""Of the differences that the curvature is taken from."""


class ErrorFit(NamedTuple):
    """What was found, and the standard errors.

    Attributes:
        coefficients: (k,) of the regressors.
        coefficients_se: (k,).
        spread: standard deviation of the errors around their mean.
        spread_se: of it.
        share: of the variance that is correlated; 0 where no correlation is seen.
        share_se: NaN where there is none.
        correlation_s: seconds; NaN where there is none.
        correlation_se: likewise.
        residual: (n,) what the regressors leave.
    """

    coefficients: FloatArray
    coefficients_se: FloatArray
    spread: float
    spread_se: float
    share: float
    share_se: float
    correlation_s: float
    correlation_se: float
    residual: FloatArray


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

    def profile(share: float, correlation_s: float) -> _Profile:
        return _Profile(y, regressors, gap_s, share, correlation_s)

    def cost(point: FloatArray) -> float:
        return -profile(*_natural(point)).log_likelihood

    white = profile(0.0, 1.0)
    starts = [_point(share, seconds) for share in SHARES for seconds in TIMES_S]
    best = minimize(cost, min(starts, key=cost), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-3})
    if -best.fun < white.log_likelihood + SURE:
        spread_se = white.spread / np.sqrt(2.0 * max(y.size - regressors.shape[1], 1))
        return ErrorFit(white.mean, white.mean_se, white.spread, spread_se, 0.0, np.nan, np.nan, np.nan, white.residual)
    share, correlation_s = _natural(best.x)
    found = profile(share, correlation_s)
    se = _standard_errors(lambda point: -profile(*_natural(point)).log_likelihood, best.x)
    variance_se = _variance_error(time_s, is_first, share, correlation_s)
    return ErrorFit(
        found.mean, found.mean_se, found.spread, found.spread * 0.5 * variance_se, share,
        (1.0 - share) * float(np.hypot(share * se[0], variance_se)), correlation_s,
        correlation_s * float(np.hypot(se[1], variance_se)), found.residual,
    )  # fmt: skip


def _variance_error(time_s: FloatArray, is_first: BoolArray, share: float, correlation_s: float) -> float:
    """Standard error of a mean square, as a share of it: sqrt(2 sum of squared correlations) / n."""
    starts = np.flatnonzero(is_first)
    ends = np.append(starts[1:], time_s.size)
    n = ends - starts
    x = np.maximum(2.0 * (time_s[ends - 1] - time_s[starts]) / correlation_s, 1e-6)
    together = share**2 * n**2 * 2.0 * (x - 1.0 + np.exp(-x)) / x**2
    return float(np.sqrt(2.0 * (together + (1.0 - share**2) * n).sum()) / n.sum())


def autocorrelation(
    residual: FloatArray, time_s: FloatArray, is_first: BoolArray, lag_s: FloatArray, *, within_s: float
) -> FloatArray:
    """(m,) mean product of errors about `lag_s` (m,) apart, over their mean square; NaN of a lag that no pair has."""
    series = np.cumsum(is_first)
    result = np.full(lag_s.size, np.nan)
    for i, lag in enumerate(lag_s):
        shifted = series * 1e6 + time_s - time_s.min()
        other = np.minimum(np.searchsorted(shifted, shifted + lag - within_s), residual.size - 1)
        fits = (series[other] == series) & (np.abs(time_s[other] - time_s - lag) <= within_s)
        if fits.any():
            result[i] = (residual[fits] * residual[other[fits]]).mean() / (residual**2).mean()
    return result


class _Profile:
    """The likelihood at a share and a time, at its maximum over the mean and the variance."""

    def __init__(
        self, y: FloatArray, regressors: FloatArray, gap_s: FloatArray, share: float, correlation_s: float
    ) -> None:
        n, k = regressors.shape
        solve, log_determinant = _inverse(gap_s, share, correlation_s)
        both = solve(np.column_stack([regressors, y]))
        normal = regressors.T @ both[:, :k]
        self.mean = np.linalg.lstsq(normal, regressors.T @ both[:, k], rcond=None)[0]
        self.residual = y - regressors @ self.mean
        # what the mean takes of the errors is put back: of few long series it is not little
        unit_se = np.sqrt(np.maximum(np.diag(np.linalg.pinv(normal)), 0.0))
        taken = float(((regressors @ np.linalg.pinv(normal)) * regressors).sum(axis=1).mean())
        variance = max(float((self.residual**2).mean()) / max(1.0 - taken, 0.1), 1e-12)
        self.spread = float(np.sqrt(variance))
        self.mean_se = self.spread * unit_se
        square = float(self.residual @ (both[:, k] - both[:, :k] @ self.mean))
        self.log_likelihood = -0.5 * float(n * np.log(2.0 * np.pi * variance) + log_determinant + square / variance)


def _inverse(gap_s: FloatArray, share: float, correlation_s: float):  # type: ignore[no-untyped-def]
    """Solves with the covariance of unit variance, and the log of its determinant."""
    if share == 0.0:
        return (lambda columns: columns), 0.0
    kept = np.minimum(np.exp(-gap_s / correlation_s), 1.0 - 1e-9)
    own, white = 1.0 / (1.0 - kept**2), 1.0 - share
    precision = np.zeros((2, gap_s.size))  # of the correlated part: tridiagonal, as `cholesky_banded` takes it
    precision[1] = (own + np.append(kept[1:] ** 2 * own[1:], 0.0)) / share
    precision[0, 1:] = -(kept * own)[1:] / share
    precision[1] += 1.0 / white
    factor = cholesky_banded(precision)
    log_determinant = (
        gap_s.size * np.log(white) + 2.0 * np.log(factor[1]).sum() + gap_s.size * np.log(share) - np.log(own).sum()
    )

    def solve(columns: FloatArray) -> FloatArray:
        return np.asarray((columns - cho_solve_banded((factor, False), columns) / white) / white)

    return solve, float(log_determinant)


def _standard_errors(cost: Callable[[FloatArray], float], at: FloatArray) -> FloatArray:
    """(2,) of the logit of the share and the log time, by the curvature of the likelihood."""
    step = STEP * np.eye(2)
    curvature = np.empty((2, 2))
    for a in range(2):
        for b in range(2):
            signs = ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
            curvature[a, b] = sum(s * cost(at + i * step[a] + j * step[b]) for i, j, s in signs) / (4.0 * STEP**2)
    return np.sqrt(np.maximum(np.diag(np.linalg.pinv(curvature)), 0.0))


def _natural(point: FloatArray) -> tuple[float, float]:
    """The share and the time of a point; far out both stay in their ranges."""
    share = 1.0 / (1.0 + np.exp(-np.clip(point[0], -10.0, 10.0)))
    return float(np.clip(share, *SHARE_RANGE)), float(np.clip(np.exp(np.clip(point[1], -10.0, 10.0)), *TIME_RANGE_S))


def _point(share: float, correlation_s: float) -> FloatArray:
    return np.array([np.log(share / (1.0 - share)), np.log(correlation_s)])
