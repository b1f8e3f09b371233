"""How likely is what a sensor reports, whatever way the vehicles went? The likelihood of its errors without a truth.

In the vehicle's axes the error is a first-order Gauss-Markov process and white noise, as in `Sensor`. The vehicle's
acceleration is another such process along the way and across it. How hard a driver accelerates differs from window to
window: the likelihood is the mean over that, for if each window took the size that suits it best, motion would explain
a part of the errors. All is Gaussian otherwise: a Kalman filter tells it, from any place and velocity.

Source: Singer, Estimating Optimal Tracking Filter Performance for Manned Maneuvering Targets, 1970, for the
acceleration; Schweppe, Evaluation of likelihood functions for Gaussian signals, 1965.
"""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from dirprim_filter.arrays import FloatArray
from dirprim_filter.evaluation.calibration._evidence import log_likelihoods
from dirprim_filter.evaluation.calibration.windows import Windows

SPREAD, SHARE, TIME = range(3)
"""The parameters of an error: log standard deviation, logit of the correlated share, log time."""
N_PARAMETERS = 11
"""Three of each axis' errors, log size and log time of the acceleration along and across, and how windows differ."""
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)


def log_evidence(windows: Windows, parameters: FloatArray) -> float:
    """Natural log of the density of all windows. The last parameter is the standard deviation of log sizes."""
    model = np.empty((2, 5))
    for axis, of_error, of_motion in zip(
        model, parameters[:6].reshape(2, 3), parameters[6:10].reshape(2, 2), strict=True
    ):
        variance, share = np.exp(2.0 * of_error[SPREAD]), 1.0 / (1.0 + np.exp(-of_error[SHARE]))
        axis[:3] = variance * share, variance * (1.0 - share), np.exp(-of_error[TIME])
        axis[3:] = np.exp(2.0 * of_motion[0]), np.exp(-of_motion[1])
    by_node = np.empty((NODES.size, windows.known.shape[0]))
    for node, out in zip(NODES, by_node, strict=True):
        log_likelihoods(*windows, model, float(np.exp(2.0 * parameters[10] * node)), out)
    return float(logsumexp(by_node, axis=0, b=(WEIGHTS / WEIGHTS.sum())[:, None]).sum())
