"""Gaussians of few dimensions, of which there are many."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray


def squared_distance(off: FloatArray, covariance: FloatArray) -> FloatArray:
    """(...) squared Mahalanobis distance of deviations (..., d) from the mean, by covariances (..., d, d)."""
    return np.asarray(np.einsum("...i,...i->...", off, np.linalg.solve(covariance, off[..., None])[..., 0]))


def log_density(off: FloatArray, covariance: FloatArray) -> FloatArray:
    """(...) natural log density of deviations (..., d) from the mean, by covariances (..., d, d)."""
    return np.asarray(-0.5 * (squared_distance(off, covariance) + np.linalg.slogdet(2.0 * np.pi * covariance)[1]))
