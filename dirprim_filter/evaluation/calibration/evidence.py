"""How likely is what a sensor reports, whatever way the vehicles went? The likelihood of its errors without a truth.

In the vehicle's axes the error is a first-order Gauss-Markov process c and white noise w, as in `Sensor`. The vehicle's
acceleration a is another such process along the way and across it: z = x_0 + v_0 t + B a + c + w, with B the twofold
integral over time.
All is Gaussian; of x_0 and v_0, which may be anything, the likelihood is free: it is that of the part of z that is
orthogonal to both (restricted maximum likelihood).

Source: Singer, Estimating Optimal Tracking Filter Performance for Manned Maneuvering Targets, 1970, for the
acceleration; Patterson and Thompson, Recovery of inter-block information when block sizes are unequal, 1971, for the
likelihood.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import BoolArray, FloatArray
from dirprim_filter.evaluation.calibration.windows import Windows

SPREAD, SHARE, TIME = range(3)
"""The parameters of an error: log standard deviation, logit of the correlated share, log time."""
DRIVERS_DIFFER = 1.0
"""Standard deviation of the log of a window's acceleration: one drives straight on, another brakes and turns."""
N_SHARED = 10
"""Three of each axis' errors, and log size and log time of the acceleration along and across."""


class _Axis(NamedTuple):
    """Products of the unit vectors (w, n, n) by component: east-east, east-north, north-north."""

    products: tuple[FloatArray, FloatArray, FloatArray]

    @classmethod
    def of(cls, unit: FloatArray) -> _Axis:
        east, north = unit[..., 0], unit[..., 1]
        return cls(tuple(a[:, :, None] * b[:, None] for a, b in ((east, east), (east, north), (north, north))))  # type: ignore[arg-type]

    def contracted(self, blocks: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
        """(w, n, n) what a change of the axis' own covariance changes, given that of each block."""
        return self.products[0] * blocks[0] + 2.0 * self.products[1] * blocks[1] + self.products[2] * blocks[2]


class Evidence:
    """Minus the log likelihood of windows, and its gradient, as a function of the parameters.

    These are `N_SHARED` numbers for all, then the log by which each window's acceleration along the way differs from
    the usual one, then that across. The differences have a Gaussian prior.
    """

    def __init__(self, windows: Windows) -> None:
        time_s, position, along, known = windows
        w, n = time_s.shape
        self._lag_s = np.abs(time_s[:, :, None] - time_s[:, None])
        self._white = np.eye(n)
        self._axes = (_Axis.of(along), _Axis.of(np.stack([-along[..., 1], along[..., 0]], axis=-1)))
        free = np.stack([known * 1.0, known * time_s], axis=-1)
        orthogonal = np.linalg.qr(free, mode="complete")[0][:, :, 2:]
        self._of_errors = _both(orthogonal)
        self._of_motion = _both(_twofold_integral(time_s, known).swapaxes(1, 2) @ orthogonal)
        self._padding = self._of_errors[0] @ (np.where(known, 0.0, 1.0)[:, :, None] * self._white) @ orthogonal
        self._seen = (self._of_errors[0] @ position).swapaxes(1, 2).reshape(w, -1)

    def __call__(self, parameters: FloatArray) -> tuple[float, FloatArray]:
        """At (10 + 2 w,) parameters."""
        w = self._lag_s.shape[0]
        shared, differ = parameters[:N_SHARED], parameters[N_SHARED:].reshape(2, w)
        errors = [_error(self._lag_s, self._white, shared[3 * i : 3 * i + 3]) for i in range(2)]
        motions = [_motion(self._lag_s, shared[6 + 2 * i], shared[7 + 2 * i], differ[i]) for i in range(2)]
        covariance = self._covariance([e[0] for e in errors], [m[0] for m in motions])
        inverse = np.linalg.inv(covariance)
        fit = (inverse @ self._seen[..., None])[..., 0]
        cost = 0.5 * float(np.linalg.slogdet(covariance)[1].sum() + (fit * self._seen).sum())
        change = 0.5 * (inverse - fit[:, :, None] * fit[:, None])
        of_errors, of_motion = self._spread_out(change, self._of_errors), self._spread_out(change, self._of_motion)
        gradient = np.empty_like(parameters)
        for i, axis in enumerate(self._axes):
            by_error, by_motion = axis.contracted(of_errors), axis.contracted(of_motion)
            gradient[3 * i : 3 * i + 3] = [(by_error * slope).sum() for slope in errors[i][1]]
            size, time = ((by_motion * slope).sum(axis=(1, 2)) for slope in motions[i][1])
            gradient[6 + 2 * i], gradient[7 + 2 * i] = size.sum(), time.sum()
            gradient[N_SHARED + i * w : N_SHARED + (i + 1) * w] = size
        gradient[N_SHARED:] += parameters[N_SHARED:] / DRIVERS_DIFFER**2
        return cost + 0.5 * float((differ**2).sum()) / DRIVERS_DIFFER**2, gradient

    def _covariance(self, errors: list[FloatArray], motions: list[FloatArray]) -> FloatArray:
        """(w, 2 k, 2 k) of what is seen."""
        blocks = []
        for component in range(3):
            block = self._padding if component != 1 else 0.0
            for (left, right), parts in ((self._of_errors, errors), (self._of_motion, motions)):
                whole = sum(p * axis.products[component] for p, axis in zip(parts, self._axes, strict=True))
                block = block + left @ (whole @ right)
            blocks.append(np.asarray(block))
        xx, xy, yy = blocks
        return np.concatenate(
            [np.concatenate([xx, xy], axis=2), np.concatenate([xy.swapaxes(1, 2), yy], axis=2)], axis=1
        )

    @staticmethod
    def _spread_out(change: FloatArray, of: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """By component (w, n, n): how the likelihood changes with the covariance at the detections."""
        left, right = of
        k = change.shape[1] // 2
        xx, xy, yy = (right @ (change[:, a : a + k, b : b + k] @ left) for a, b in ((0, 0), (0, k), (k, k)))
        return xx, xy, yy


def _both(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The transpose and the matrix itself, (w, k, n) and (w, n, k)."""
    return np.ascontiguousarray(matrix.swapaxes(1, 2)), matrix


def _error(
    lag_s: FloatArray, white: FloatArray, parameters: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
    """(w, n, n) covariance of an axis' errors, and its slopes."""
    variance, share, time_s = np.exp(2.0 * parameters[0]), 1.0 / (1.0 + np.exp(-parameters[1])), np.exp(parameters[2])
    lasting = np.exp(-lag_s / time_s)
    covariance = variance * (share * lasting + (1.0 - share) * white)
    by_share = variance * share * (1.0 - share) * (lasting - white)
    return covariance, (2.0 * covariance, by_share, variance * share * lasting * lag_s / time_s)


def _motion(
    lag_s: FloatArray, log_size: float, log_time: float, differ: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """(w, n, n) covariance of an axis' acceleration, and its slopes."""
    time_s = np.exp(log_time)
    covariance = np.exp(2.0 * (log_size + differ))[:, None, None] * np.exp(-lag_s / time_s)
    return covariance, (2.0 * covariance, covariance * lag_s / time_s)


def _twofold_integral(time_s: FloatArray, known: BoolArray) -> FloatArray:
    """(w, n, n) from accelerations at times to places: linear in between; 0 where padded."""
    w, n = time_s.shape
    place = np.zeros((w, n, n))
    velocity = np.zeros((w, n))
    unit = np.eye(n)
    for k in range(n - 1):
        h = ((time_s[:, k + 1] - time_s[:, k]) * known[:, k + 1])[:, None]
        place[:, k + 1] = place[:, k] + h * velocity + h**2 / 6.0 * (2.0 * unit[k] + unit[k + 1])
        velocity = velocity + 0.5 * h * (unit[k] + unit[k + 1])
    place *= known[:, :, None]
    return place
