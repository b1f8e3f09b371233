"""How likely is what a sensor reports, whatever way the vehicles went? The likelihood of its errors without a truth.

Along the way, and across it, the error is a first-order Gauss-Markov process and white noise, as in `Sensor`. The
vehicle's acceleration is another such process. How hard a driver accelerates differs from piece to piece of the tracks:
the likelihood is the mean over that, for if each piece took the size that suits it best, motion would explain a part of
the errors. All is Gaussian otherwise, and a Kalman filter of place, speed, acceleration and lasting error computes it.

Source: Singer, Estimating Optimal Tracking Filter Performance for Manned Maneuvering Targets, 1970, for the
acceleration; Schweppe, Evaluation of likelihood functions for Gaussian signals, 1965.
"""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from dirprim_filter.arrays import FloatArray, IntArray

SPREAD, SHARE, LASTS, SIZE, HOLDS, DIFFER = range(6)
"""Parameters: of the error log standard deviation, logit of the share that lasts, log seconds that it lasts; of the
acceleration log standard deviation, log seconds, and standard deviation of the log between pieces."""
ANYWHERE, ANY_SPEED = 1e4, 1e3
"""Variances, m^2 and (m/s)^2, of a place and a speed that are not known."""
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)


def log_evidence(step_s: FloatArray, position: FloatArray, length: IntArray, parameters: FloatArray) -> float:
    """Natural log of the density of all pieces, along one axis.

    Args:
        step_s: (w, n) seconds since the row before.
        position: (w, n) metres.
        length: (w,) rows of each piece, descending.
        parameters: (6,) as named above.
    """
    variance, share = np.exp(2.0 * parameters[SPREAD]), 1.0 / (1.0 + np.exp(-parameters[SHARE]))
    lasting, white = variance * share, variance * (1.0 - share)
    moving = np.exp(2.0 * (parameters[SIZE] + parameters[DIFFER] * NODES))[:, None]
    held, kept = (np.exp(-step_s / np.exp(parameters[of]))[:, None] for of in (HOLDS, LASTS))
    mean, p = np.zeros((4, NODES.size, length.size)), np.zeros((4, 4, NODES.size, length.size))
    p[0, 0], p[1, 1], p[2, 2], p[3, 3] = ANYWHERE, ANY_SPEED, moving, lasting
    log_p = np.zeros((NODES.size, length.size))
    for i in range(position.shape[1]):
        n = int(np.count_nonzero(length > i))
        x, c = mean[..., :n], p[..., :n]
        if i:
            decay = held[:n, :, i].T, kept[:n, :, i].T
            for of in (x, c, c.swapaxes(0, 1)):
                _advance(of, step_s[:n, i], *decay)
            c[2, 2] += moving * (1.0 - decay[0] ** 2)
            c[3, 3] += lasting * (1.0 - decay[1] ** 2)
        shared = c[0] + c[3]  # with the measurement: the place and the lasting error
        spread, off = shared[0] + shared[3] + white, position[:n, i] - x[0] - x[3]
        gain = shared / spread
        x += gain * off
        c -= gain[:, None] * shared
        log_p[:, :n] -= 0.5 * (off**2 / spread + np.log(2.0 * np.pi * spread))
    return float(logsumexp(log_p, axis=0, b=(WEIGHTS / WEIGHTS.sum())[:, None]).sum())


def _advance(state: FloatArray, step_s: FloatArray, held: FloatArray, kept: FloatArray) -> None:
    """Move place, speed, acceleration and lasting error, in rows, on; the acceleration is held during a step."""
    state[0] += step_s * state[1] + 0.5 * step_s**2 * state[2]
    state[1] += step_s * state[2]
    state[2] *= held
    state[3] *= kept
