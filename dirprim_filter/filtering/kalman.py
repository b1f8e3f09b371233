"""The Kalman filters of filterpy that every result is printed beside: constant velocity, constant turn, and both.

All share one state, x, y, their rates and the rate of turn, so that the interacting multiple model can mix them.
filterpy holds one vehicle; here the numbers of all vehicles stand in arrays, and its filters are lent to each in turn.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, ch. 6 and 11.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace
from functools import lru_cache
from typing import Self

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import IMMEstimator, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering.measurements import FASTEST, OUTLIER_EXTENT_M, measured_covariance, measured_motion
from dirprim_filter.filtering.protocols import Evidence
from dirprim_filter.filtering.smoothing._kernels import log_gaussian

N_STATES = 5
PLACE, VELOCITY = np.eye(2, N_STATES), np.eye(2, N_STATES, 2)
FIRST_SPEED_STD = 10.0
"""m/s, prior standard deviation of the velocity at initiation."""
FIRST_TURN_STD = 0.2
"""rad/s, likewise."""
SMALLEST_TURN = 1e-6
"""rad/s; slower than this is straight on."""


class KalmanBank:
    """A `BayesFilter` of Gaussians, or of mixtures of one Gaussian for each motion model.

    Args:
        models: filterpy's filters, one for each motion model; `predict` is called with their `dt_s` set.
        config: the noise of the measurements, and how many of them are outliers.
    """

    def __init__(self, models: list[ConstantVelocity | ConstantTurn], config: FilterConfig) -> None:
        self.config = config
        self._models = models
        m = len(models)
        self.mean: FloatArray = np.empty((0, m, N_STATES))
        self.covariance: FloatArray = np.empty((0, m, N_STATES, N_STATES))
        self.probability: FloatArray = np.empty((0, m))
        self._log_outlier = _log(config.outlier_probability / OUTLIER_EXTENT_M**2)
        self._log_kept = float(np.log1p(-config.outlier_probability))
        self._log_astray = _log(config.motion_outlier_probability)
        self._log_steady = float(np.log1p(-config.motion_outlier_probability))

    def reserve(self, n_slots: int) -> None:
        """Make room for so many slots."""
        more = n_slots - len(self.mean)
        if more > 0:
            for name in ("mean", "covariance", "probability"):
                column = getattr(self, name)
                setattr(self, name, np.concatenate([column, np.zeros((more, *column.shape[1:]))]))

    def begin(self, slot: IntArray, key: AnyArray, measured: Detections) -> None:
        """Start beliefs from one measurement each; nothing here is random, so `key` is not used."""
        place = measured_covariance(measured, self.config)
        direction, speed = measured_motion(measured)
        for i, s in enumerate(slot):
            first = np.diag([0.0, 0.0, FIRST_SPEED_STD**2, FIRST_SPEED_STD**2, FIRST_TURN_STD**2])
            first[:2, :2] = place[i]
            state = np.array([*measured.position[i], 0.0, 0.0, 0.0])
            if np.isfinite(direction[i]) and np.isfinite(speed[i]):
                state[2:4], first[2:4, 2:4] = self._velocity(direction[i], speed[i])
            self.mean[s], self.covariance[s] = state, first
            self.probability[s] = 1.0 / len(self._models)

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the beliefs of `target` those of `source`. (v,), (v,)."""
        for column in (self.mean, self.covariance, self.probability):
            column[target] = column[source]

    def predict(self, slot: IntArray, dt_s: FloatArray) -> None:
        """Move beliefs on. (v,), (v,) seconds."""
        for s, dt in zip(slot, dt_s, strict=True):
            self._lend(s, float(dt))
            self._models[0].predict()
            self._take_back(s)

    def log_likelihood(self, slot: IntArray, measured: Detections) -> FloatArray:
        """Log density of measurements under the beliefs, outlying positions aside. (v,), v rows -> (v,)."""
        mean, covariance = self.mean[slot], self.covariance[slot]
        spread = covariance[..., :2, :2] + measured_covariance(measured, self.config)[:, None]
        off = measured.position[:, None] - mean[..., :2]
        log_p = _log_gaussian(off, spread) + np.log(np.maximum(self.probability[slot], 1e-300))
        direction, speed = measured_motion(measured)
        for i in np.flatnonzero(np.isfinite(direction) & np.isfinite(speed)):
            gain = np.linalg.solve(spread[i], covariance[i, :, :2, 2:4]).swapaxes(-1, -2)
            moves = mean[i, :, 2:4] + (gain @ off[i, ..., None])[..., 0]
            p = covariance[i, :, 2:4, 2:4] - gain @ covariance[i, :, :2, 2:4]
            log_p[i] += np.logaddexp(self._log_velocity(moves, p, direction[i], speed[i]), self._log_astray)
        return np.asarray(np.logaddexp.reduce(log_p, axis=1)) if slot.size else np.empty(0)

    def weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Correct beliefs by measurements; an outlier corrects nothing."""
        unmoving = replace(measured, direction=np.empty(0), speed=np.empty(0))
        fit = self._log_kept + self.log_likelihood(slot, unmoving)
        evidence = np.logaddexp(fit, self._log_outlier)
        place = measured_covariance(measured, self.config)
        direction, speed = measured_motion(measured)
        for i, s in enumerate(slot):
            if fit[i] > self._log_outlier:
                self._update(int(s), measured.position[i], PLACE, place[i])
            if np.isfinite(direction[i]) and np.isfinite(speed[i]):
                evidence[i] += self._weigh_velocity(int(s), direction[i], speed[i])
        unexplained = ~(np.logaddexp(fit, self._log_outlier) >= np.log(2.0) + self._log_outlier)
        return Evidence(evidence, unexplained, np.ones(slot.size, np.bool_))

    def moments(self, slot: IntArray) -> FloatArray:
        """(v,) -> (v, 10), as `Estimates` names them; the course is the mean velocity's, and certain."""
        share = self.probability[slot][..., None]
        mean = (share * self.mean[slot]).sum(axis=1)
        off = self.mean[slot] - mean[:, None]
        covariance = (share[..., None] * (self.covariance[slot] + off[..., :, None] * off[..., None, :])).sum(axis=1)
        direction = np.arctan2(mean[:, 3], mean[:, 2])
        along = np.column_stack([np.cos(direction), np.sin(direction)])
        speed_std = np.sqrt(np.einsum("ni,nij,nj->n", along, covariance[:, 2:4, 2:4], along))
        return np.column_stack(
            [
                mean[:, :2], covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1],
                direction, np.ones(slot.size), np.hypot(mean[:, 2], mean[:, 3]), speed_std, np.ones(slot.size),
            ]
        )  # fmt: skip

    def resample(self, slot: IntArray) -> None:
        """Nothing to resample."""

    def _update(self, s: int, z: FloatArray, of_state: FloatArray, noise: FloatArray) -> None:
        self._lend(s, 0.0)
        self._models[0].measure(of_state, noise)
        self._models[0].update(z)
        self._take_back(s)

    def _lend(self, s: int, dt_s: float) -> None:
        for i, model in enumerate(self._models):
            model.lend(self.mean[s, i], self.covariance[s, i], dt_s)

    def _take_back(self, s: int) -> None:
        for i, model in enumerate(self._models):
            self.mean[s, i], self.covariance[s, i] = model.x, _symmetric(model.P)

    def _velocity(self, direction: float, speed: float) -> tuple[FloatArray, FloatArray]:
        """A measured course and speed as a velocity (2,) and its covariance (2, 2)."""
        along = np.array([np.cos(direction), np.sin(direction)])
        across = np.array([-along[1], along[0]])
        sideways = max(speed * self.config.direction_noise, self.config.speed_noise)
        spread = self.config.speed_noise**2 * np.outer(along, along) + sideways**2 * np.outer(across, across)
        return speed * along, spread

    def _log_velocity(self, mean: FloatArray, covariance: FloatArray, direction: float, speed: float) -> FloatArray:
        """(m, 2), (m, 2, 2) of velocities -> (m,) log ratio of a measured one, no outlier, to a false detection's."""
        z, noise = self._velocity(direction, speed)
        per_course_and_speed = speed * 2.0 * np.pi * FASTEST
        return np.asarray(_log_gaussian(z - mean, covariance + noise) + np.log(per_course_and_speed) + self._log_steady)

    def _weigh_velocity(self, s: int, direction: float, speed: float) -> float:
        """Correct a belief by a measured velocity unless it is an outlier; -> its log ratio."""
        log_p = self._log_velocity(self.mean[s, :, 2:4], self.covariance[s, :, 2:4, 2:4], direction, speed)
        fit = float(np.logaddexp.reduce(log_p + np.log(np.maximum(self.probability[s], 1e-300))))
        if fit > self._log_astray:
            z, noise = self._velocity(direction, speed)
            self._update(s, z, VELOCITY, noise)
        return float(np.logaddexp(fit, self._log_astray))


class ConstantVelocityKalman(KalmanBank):
    """Straight on at the same speed, but for white acceleration.

    Args:
        acceleration_density: m^2/s^3 per axis, see `manoeuvre.acceleration_density`.
        config: the noise of the measurements.
    """

    def __init__(self, *, acceleration_density: float, config: FilterConfig | None = None) -> None:
        super().__init__([ConstantVelocity(acceleration_density)], config or FilterConfig())

    @property
    def paths(self) -> KalmanPaths:
        """What a smoother asks for: then its sweep is Rauch, Tung and Striebel's own."""
        return KalmanPaths(self)

    def sibling(self) -> Self:
        """One of the same models, without beliefs."""
        other = copy(self)
        other.mean, other.covariance, other.probability = self.mean[:0], self.covariance[:0], self.probability[:0]
        return other

    def place(self, slot: IntArray, key: AnyArray, mean: FloatArray, covariance: FloatArray) -> None:
        """Start beliefs from Gaussians of x, y and their rates. (v,), (v,) not looked at, (v, 4), (v, 4, 4)."""
        self.mean[slot], self.covariance[slot] = 0.0, np.diag([0.0] * 4 + [FIRST_TURN_STD**2])
        self.mean[slot, 0, :4], self.covariance[slot, 0, :4, :4] = mean, covariance
        self.probability[slot] = 1.0


class KalmanPaths:
    """`Paths` of constant velocity: the joint Gaussians of two times.

    Args:
        of: whose Gaussians are looked at.
    """

    def __init__(self, of: KalmanBank) -> None:
        self._of = of

    def states(self, slot: IntArray) -> FloatArray:
        """(v, 5, 6) mean and covariance."""
        return np.concatenate([self._of.mean[slot, 0, :, None], self._of.covariance[slot, 0]], axis=2)

    def weights(self, slot: IntArray) -> FloatArray:
        """(v, 1) ones: there are no samples."""
        return np.ones((slot.size, 1))

    def joint(
        self, weight: FloatArray, then: FloatArray, now: FloatArray, *, row: IntArray, vehicle: IntArray,
        dt_s: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """As `Paths.joint`: the covariance with what is dt_s later is P F(dt_s)^T."""
        pair = then[row], now[vehicle]
        direction = [np.arctan2(state[:, 3, 0], state[:, 2, 0])[:, None] for state in pair]
        means = [[of[..., 0], np.cos(angle), np.sin(angle)] for of, angle in zip(pair, direction, strict=True)]
        p, later = (state[..., 1:] for state in pair)
        moved = np.tile(np.diag([1.0, 1.0, 1.0, 1.0, 0.0]), (row.size, 1, 1))
        moved[:, 0, 2] = moved[:, 1, 3] = dt_s
        c = p @ moved.swapaxes(1, 2)
        return np.hstack([*means[0], *means[1]]), np.block([[p, c], [c.swapaxes(1, 2), later]])

    def arrivals(self, now: FloatArray, mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Paths.arrivals`."""
        d = mean.shape[1]
        spread = now[:, :d, 1 : d + 1] + covariance
        density = [float(log_gaussian(*pair)) for pair in zip(mean - now[:, :d, 0], spread, strict=True)]
        return np.array(density), np.ones((len(now), 1))


class ConstantTurnUKF(KalmanBank):
    """Along a circle whose rate of turn drifts: an unscented Kalman filter.

    Args:
        acceleration_density: m^2/s^3 per axis, what the turn leaves unexplained.
        turn_density: rad^2/s^3, of the white noise that changes the rate of turn.
        config: the noise of the measurements.
    """

    def __init__(self, *, acceleration_density: float, turn_density: float, config: FilterConfig | None = None) -> None:
        super().__init__([ConstantTurn(acceleration_density, turn_density)], config or FilterConfig())


class InteractingModels(KalmanBank):
    """Now straight on, now along a circle: the interacting multiple model of both.

    Args:
        straight: m^2/s^3, acceleration density of the constant velocity.
        acceleration_density: m^2/s^3, of the constant turn.
        turn_density: rad^2/s^3, of the constant turn.
        switching_rate: 1/s, how often a vehicle goes over from one to the other.
        config: the noise of the measurements.
    """

    def __init__(
        self, *, straight: float, acceleration_density: float, turn_density: float, switching_rate: float = 0.5,
        config: FilterConfig | None = None,
    ) -> None:  # fmt: skip
        turning = ConstantTurn(acceleration_density, turn_density)
        super().__init__([ConstantVelocity(straight), turning], config or FilterConfig())
        self._rate = switching_rate
        self._imm = IMMEstimator(self._models, [0.5, 0.5], np.full((2, 2), 0.5))

    def predict(self, slot: IntArray, dt_s: FloatArray) -> None:
        """Mix the models, then move each."""
        for s, dt in zip(slot, dt_s, strict=True):
            stays = 0.5 + 0.5 * np.exp(-2.0 * self._rate * dt)
            self._lend(s, float(dt))
            self._imm.M = np.array([[stays, 1.0 - stays], [1.0 - stays, stays]])
            self._imm._compute_mixing_probabilities()  # filterpy mixes after updates only; here beliefs also coast
            self._imm.predict()
            self._take_back(s)
            self.probability[s] = self._imm.cbar

    def _update(self, s: int, z: FloatArray, of_state: FloatArray, noise: FloatArray) -> None:
        self._lend(s, 0.0)
        for model in self._models:
            model.measure(of_state, noise)
        self._imm.cbar = self.probability[s].copy()
        self._imm.update(z)
        self._take_back(s)
        self.probability[s] = self._imm.mu

    def _lend(self, s: int, dt_s: float) -> None:
        super()._lend(s, dt_s)
        self._imm.mu = np.maximum(self.probability[s], 1e-12)


class ConstantVelocity(KalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """filterpy's filter, lent to one vehicle after the other."""

    def __init__(self, acceleration_density: float) -> None:
        super().__init__(dim_x=N_STATES, dim_z=2)  # kinematic_kf builds a wrong H in filterpy 2.0
        self._density = acceleration_density
        self.x = np.zeros(N_STATES)
        self.F = np.diag([1.0, 1.0, 1.0, 1.0, 0.0])  # whoever drives straight on does not turn

    def lend(self, mean: FloatArray, covariance: FloatArray, dt_s: float) -> None:
        """Take a vehicle's belief, to move it by `dt_s`."""
        self.x, self.P = mean.copy(), covariance.copy()
        self.F[0, 2] = self.F[1, 3] = dt_s
        self.Q = _white_acceleration(self._density, dt_s).copy()
        self.Q[4, 4] = FIRST_TURN_STD**2  # for the turn that may begin next

    def measure(self, of_state: FloatArray, noise: FloatArray) -> None:
        """What the next update is of, (2, 5), and its covariance (2, 2)."""
        self.H, self.R = of_state, noise


class ConstantTurn(UnscentedKalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """filterpy's filter, lent to one vehicle after the other."""

    def __init__(self, acceleration_density: float, turn_density: float) -> None:
        points = MerweScaledSigmaPoints(N_STATES, alpha=0.3, beta=2.0, kappa=0.0)
        super().__init__(dim_x=N_STATES, dim_z=2, dt=0.0, hx=self._measured, fx=turned, points=points)
        self._density, self._turn_density = acceleration_density, turn_density
        self._of_state = PLACE

    def lend(self, mean: FloatArray, covariance: FloatArray, dt_s: float) -> None:
        """Take a vehicle's belief, to move it by `dt_s`."""
        self.x, self.P, self._dt = mean.copy(), covariance.copy(), dt_s
        self.Q = _white_acceleration(self._density, dt_s).copy()
        self.Q[4, 4] = self._turn_density * dt_s

    def measure(self, of_state: FloatArray, noise: FloatArray) -> None:
        """What the next update is of, (2, 5), and its covariance (2, 2)."""
        self._of_state, self.R = of_state, noise
        self.sigmas_f = self.points_fn.sigma_points(self.x, self.P)

    def _measured(self, state: FloatArray) -> FloatArray:
        return self._of_state @ state


def turned(state: FloatArray, dt_s: float) -> FloatArray:
    """(5,) -> (5,) along a circle for `dt_s`: the coordinated turn of Bar-Shalom et al., Eq. 11.7.1-4."""
    x, y, east, north, rate = state
    if abs(rate) < SMALLEST_TURN:
        return np.array([x + east * dt_s, y + north * dt_s, east, north, rate])
    c, s = np.cos(rate * dt_s), np.sin(rate * dt_s)
    return np.array(
        [
            x + (s * east - (1.0 - c) * north) / rate, y + ((1.0 - c) * east + s * north) / rate,
            c * east - s * north, s * east + c * north, rate,
        ]
    )  # fmt: skip


@lru_cache
def _white_acceleration(density: float, dt_s: float) -> FloatArray:
    """(5, 5), of which users take a copy."""
    noise = np.zeros((N_STATES, N_STATES))
    noise[:4, :4] = np.kron(Q_continuous_white_noise(dim=2, dt=dt_s, spectral_density=density), np.eye(2))
    return noise


def _log_gaussian(off: FloatArray, covariance: FloatArray) -> FloatArray:
    """(..., 2), (..., 2, 2) -> (...); filterpy asks scipy.stats, at ten times the cost."""
    a, b, d = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    determinant = a * d - b * b
    x, y = off[..., 0], off[..., 1]
    distance = (d * x * x - 2.0 * b * x * y + a * y * y) / determinant
    return np.asarray(-0.5 * (distance + np.log(determinant)) - np.log(2.0 * np.pi))


def _log(probability: float) -> float:
    return math.log(probability) if probability > 0.0 else -math.inf


def _symmetric(matrix: FloatArray) -> FloatArray:
    return 0.5 * (matrix + matrix.T)
