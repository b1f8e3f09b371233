"""The Kalman filters that every result is printed beside: constant velocity, and interacting models with constant turn.

All share one state, x, y, their rates and the rate of turn, so that the interacting multiple model can mix them. The
numbers of all vehicles stand in arrays, which filterpy's filters of one vehicle do not take: its process noise and
sigma points serve here, and its filters are the oracle of the tests. Measurements are linear in the state, so that an
unscented filter differs from a linear one in its prediction alone.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, ch. 6 and 11;
Wan and van der Merwe, The Unscented Kalman Filter for Nonlinear Estimation, 2000.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering.measurements import OUTLIER_EXTENT_M, measured_covariance
from dirprim_filter.filtering.protocols import Evidence
from dirprim_filter.filtering.smoothing._kernels import log_gaussian
from dirprim_filter.tracks import Tracks

N_STATES = 5
PLACE = np.eye(2, N_STATES)
FIRST_SPEED_STD, FIRST_TURN_STD = 10.0, 0.2
"""m/s and rad/s, prior standard deviations of velocity and turn at initiation."""
MAX_INTERVAL_S, LEAST_DENSITY = 2.0, 1e-6
"""Seconds between rows of which the change of velocity counts; and m^2/s^3, of vehicles that never accelerate."""
SMALLEST_TURN = 1e-6
"""rad/s; slower than this is straight on."""

GaussianMotion = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""A motion model: beliefs (v, 5), (v, 5, 5) moved on by (v,) seconds."""


@dataclass(frozen=True)
class ConstantVelocity:
    """Straight on at the same speed, but for white acceleration of a density in m^2/s^3 per axis."""

    acceleration_density: float

    def transition(self, dt_s: FloatArray) -> FloatArray:
        """(v,) -> (v, 5, 5); whoever drives straight on does not turn."""
        moved = np.tile(np.diag([1.0, 1.0, 1.0, 1.0, 0.0]), (dt_s.size, 1, 1))
        moved[:, 0, 2] = moved[:, 1, 3] = dt_s
        return moved

    def __call__(self, mean: FloatArray, covariance: FloatArray, dt_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Beliefs (v, 5), (v, 5, 5) moved on by (v,) seconds."""
        moved, noise = self.transition(dt_s), _white_acceleration(self.acceleration_density, dt_s)
        noise[:, 4, 4] = FIRST_TURN_STD**2  # for the turn that may begin next
        return (moved @ mean[..., None])[..., 0], moved @ covariance @ moved.swapaxes(1, 2) + noise


@dataclass(frozen=True)
class ConstantTurn:
    """Along a circle, by sigma points: noise in m^2/s^3 per axis, and of the rate of turn in rad^2/s^3."""

    acceleration_density: float
    turn_density: float

    def __call__(self, mean: FloatArray, covariance: FloatArray, dt_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Beliefs (v, 5), (v, 5, 5) moved on by (v,) seconds."""
        root = np.linalg.cholesky(_sigma_points().alpha ** 2 * N_STATES * covariance).swapaxes(1, 2)
        points = turned(np.concatenate([0.0 * root[:, :1], root, -root], axis=1) + mean[:, None], dt_s[:, None])
        later = _sigma_points().Wm @ points
        off = points - later[:, None]
        noise = _white_acceleration(self.acceleration_density, dt_s)
        noise[:, 4, 4] = self.turn_density * dt_s
        return later, (off * _sigma_points().Wc[:, None]).swapaxes(1, 2) @ off + noise


class KalmanBank:
    """A `BayesFilter` of Gaussians, or of mixtures of one Gaussian for each motion model: interacting multiple models.

    Positions alone are measured: reported courses and speeds are not used.

    Args:
        models: how vehicles move.
        config: the noise of the measurements, and how many of them are outliers.
        switching_rate: 1/s, how often a vehicle goes over from one model to another.
    """

    def __init__(self, models: Sequence[GaussianMotion], config: FilterConfig, *, switching_rate: float = 0.0) -> None:
        self.config = config
        self._models, self._rate = models, switching_rate
        m = len(models)
        self.mean: FloatArray = np.empty((0, m, N_STATES))
        self.covariance: FloatArray = np.empty((0, m, N_STATES, N_STATES))
        self.probability: FloatArray = np.empty((0, m))
        with np.errstate(divide="ignore"):  # what is off has no probability
            self._log_outlier = float(np.log(config.outlier_probability / OUTLIER_EXTENT_M**2))
        self._log_kept = float(np.log1p(-config.outlier_probability))

    def reserve(self, n_slots: int) -> None:
        """Make room for so many slots."""
        more = n_slots - len(self.mean)
        if more > 0:
            for name in ("mean", "covariance", "probability"):
                column = getattr(self, name)
                setattr(self, name, np.concatenate([column, np.zeros((more, *column.shape[1:]))]))

    def begin(self, slot: IntArray, key: AnyArray, measured: Detections) -> None:
        """Start beliefs from one measurement each; nothing here is random, so `key` is not used."""
        unknown = np.diag([0.0, 0.0, FIRST_SPEED_STD**2, FIRST_SPEED_STD**2, FIRST_TURN_STD**2])
        mean, covariance = np.zeros((slot.size, N_STATES)), np.tile(unknown, (slot.size, 1, 1))
        mean[:, :2], covariance[:, :2, :2] = measured.position, measured_covariance(measured, self.config)
        self.mean[slot], self.covariance[slot] = mean[:, None], covariance[:, None]
        self.probability[slot] = 1.0 / len(self._models)

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the beliefs of `target` those of `source`. (v,), (v,)."""
        for column in (self.mean, self.covariance, self.probability):
            column[target] = column[source]

    def predict(self, slot: IntArray, dt_s: FloatArray) -> None:
        """Mix the models, then move each. (v,), (v,) seconds."""
        mean, covariance = self.mean[slot], self.covariance[slot]
        m = len(self._models)
        if m > 1:
            kept = np.exp(-m * self._rate * dt_s)[:, None, None]
            before = np.maximum(self.probability[slot], 1e-12)[..., None] * (kept * np.eye(m) + (1.0 - kept) / m)
            after = before.sum(axis=1)
            share = (before / after[:, None]).swapaxes(1, 2)[..., None]  # (v, m, m, 1) of the former in each model
            mixed = (share * mean[:, None]).sum(axis=2)
            off = mean[:, None] - mixed[:, :, None]
            spread = covariance[:, None] + off[..., :, None] * off[..., None, :]
            mean, covariance = mixed, (share[..., None] * spread).sum(axis=2)
            self.probability[slot] = after
        for i, model in enumerate(self._models):
            self.mean[slot, i], moved = model(mean[:, i], covariance[:, i], dt_s)
            self.covariance[slot, i] = _symmetric(moved)

    def log_likelihood(self, slot: IntArray, measured: Detections) -> FloatArray:
        """Log density of measurements under the beliefs, outliers aside. (v,), v rows -> (v,)."""
        mean, covariance, noise = self.mean[slot], self.covariance[slot], measured_covariance(measured, self.config)
        off, spread = measured.position[:, None] - mean[..., :2], covariance[..., :2, :2] + noise[:, None]
        log_p = log_gaussian(off, spread) + self._log_probability(slot)
        return np.asarray(np.logaddexp.reduce(log_p, axis=1))

    def weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Correct beliefs by measurements; an outlier corrects nothing."""
        fit = self._log_kept + self.log_likelihood(slot, measured)
        evidence = np.logaddexp(fit, self._log_outlier)
        near = fit > self._log_outlier
        self._correct(slot[near], measured[near])
        unexplained = ~(evidence >= np.log(2.0) + self._log_outlier)
        return Evidence(evidence, unexplained, np.ones(slot.size, np.bool_))

    def moments(self, slot: IntArray) -> FloatArray:
        """(v,) -> (v, 10), as `Estimates` names them; the course is the mean velocity's, and certain."""
        share = self.probability[slot][..., None]
        mean = (share * self.mean[slot]).sum(axis=1)
        off = self.mean[slot] - mean[:, None]
        covariance = (share[..., None] * (self.covariance[slot] + off[..., :, None] * off[..., None, :])).sum(axis=1)
        direction = np.arctan2(mean[:, 3], mean[:, 2])
        along, certain = np.column_stack([np.cos(direction), np.sin(direction)]), np.ones(slot.size)
        speed_std = np.sqrt(np.einsum("ni,nij,nj->n", along, covariance[:, 2:4, 2:4], along))
        pace, (xx, xy, _, yy) = np.hypot(mean[:, 2], mean[:, 3]), covariance[:, :2, :2].reshape(-1, 4).T
        return np.column_stack([mean[:, :2], xx, xy, yy, direction, certain, pace, speed_std, certain])

    def resample(self, slot: IntArray) -> None:
        """Nothing to resample."""

    def _correct(self, slot: IntArray, measured: Detections) -> None:
        """Correct beliefs (v,) by v measurements, and models by how well each expected them."""
        mean, covariance = self.mean[slot], self.covariance[slot]
        noise = measured_covariance(measured, self.config)[:, None]
        spread = PLACE @ covariance @ PLACE.T + noise
        off = measured.position[:, None] - mean @ PLACE.T
        fit = log_gaussian(off, spread) + self._log_probability(slot)
        self.probability[slot] = np.exp(fit - np.logaddexp.reduce(fit, axis=1)[:, None])
        gain = np.linalg.solve(spread, PLACE @ covariance).swapaxes(-1, -2)
        kept = np.eye(N_STATES) - gain @ PLACE
        self.mean[slot] = mean + (gain @ off[..., None])[..., 0]
        left = kept @ covariance @ kept.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2)
        self.covariance[slot] = _symmetric(left)

    def _log_probability(self, slot: IntArray) -> FloatArray:
        """(v, m) of each model."""
        return np.log(np.maximum(self.probability[slot], 1e-300))


class ConstantVelocityKalman(KalmanBank):
    """Straight on at the same speed, but for white acceleration; its smoother is Rauch, Tung and Striebel's own.

    Args:
        acceleration_density: m^2/s^3 per axis, see `acceleration_density`.
        config: the noise of the measurements.
    """

    def __init__(self, *, acceleration_density: float, config: FilterConfig | None = None) -> None:
        super().__init__([ConstantVelocity(acceleration_density)], config or FilterConfig())

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

    def states(self, slot: IntArray) -> FloatArray:
        """(v, 5, 6) mean and covariance."""
        return np.concatenate([self.mean[slot, 0, :, None], self.covariance[slot, 0]], axis=2)

    def weights(self, slot: IntArray) -> FloatArray:
        """(v, 1) ones: there are no samples."""
        return np.ones((slot.size, 1))

    def joint(
        self, weight: FloatArray, then: FloatArray, now: FloatArray, *, row: IntArray, vehicle: IntArray,
        dt_s: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """As `Smoothable.joint`: the covariance with what is dt_s later is P F(dt_s)^T."""
        pair = then[row], now[vehicle]
        direction = [np.arctan2(state[:, 3, 0], state[:, 2, 0])[:, None] for state in pair]
        means = [[of[..., 0], np.cos(angle), np.sin(angle)] for of, angle in zip(pair, direction, strict=True)]
        p, later = (state[..., 1:] for state in pair)
        c = p @ ConstantVelocity(0.0).transition(dt_s).swapaxes(1, 2)
        return np.hstack([*means[0], *means[1]]), np.block([[p, c], [c.swapaxes(1, 2), later]])

    def arrivals(self, now: FloatArray, mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Smoothable.arrivals`."""
        d = mean.shape[1]
        return log_gaussian(mean - now[:, :d, 0], now[:, :d, 1 : d + 1] + covariance), np.ones((len(now), 1))


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
        both: list[GaussianMotion] = [ConstantVelocity(straight), ConstantTurn(acceleration_density, turn_density)]
        super().__init__(both, config or FilterConfig(), switching_rate=switching_rate)


def turned(state: FloatArray, dt_s: FloatArray) -> FloatArray:
    """(..., 5) -> (..., 5) along a circle for (...) seconds: Bar-Shalom et al., Eq. 11.7.1-4."""
    x, y, east, north, rate = np.moveaxis(state, -1, 0)
    is_straight = np.abs(rate) < SMALLEST_TURN
    c, s, rates = np.cos(rate * dt_s), np.sin(rate * dt_s), np.where(is_straight, 1.0, rate)
    ahead, aside = np.where(is_straight, dt_s, s / rates), np.where(is_straight, 0.0, (1.0 - c) / rates)
    moved = [x + ahead * east - aside * north, y + aside * east + ahead * north]
    return np.stack([*moved, c * east - s * north, s * east + c * north, rate], axis=-1)


def _white_acceleration(density: float, dt_s: FloatArray) -> FloatArray:
    """(v,) -> (v, 5, 5)."""
    from filterpy.common import Q_continuous_white_noise  # noqa: PLC0415 - it takes a second, also who tracks by a map

    lengths, row = np.unique(dt_s, return_inverse=True)
    noise = np.zeros((lengths.size, N_STATES, N_STATES))
    for own, dt in zip(noise, lengths, strict=True):
        own[:4, :4] = Q_continuous_white_noise(2, dt, density, block_size=2, order_by_dim=False)
    return noise[row]


@cache
def _sigma_points() -> Any:
    from filterpy.kalman import MerweScaledSigmaPoints  # noqa: PLC0415 - likewise

    return MerweScaledSigmaPoints(N_STATES, alpha=0.3, beta=2.0, kappa=0.0)


def _symmetric(matrix: FloatArray) -> FloatArray:
    return 0.5 * (matrix + matrix.swapaxes(-1, -2))


def acceleration_density(tracks: Tracks, *, along: bool = False) -> float:
    """The spectral density of white acceleration that explains the tracks' changes of velocity, m^2/s^3 per axis.

    Args:
        tracks: training vehicles; consecutive rows up to 2 s apart are used.
        along: of changes of speed alone: what is left when the turn is known.

    Raises:
        ValueError: no vehicle has two rows near in time.
    """
    vehicle = tracks.vehicle
    order = np.lexsort((tracks.time_ns, vehicle))
    dt_s = np.diff(tracks.time_ns[order]) * 1e-9
    pair = (np.diff(vehicle[order]) == 0) & (dt_s <= MAX_INTERVAL_S)
    if not pair.any():
        raise ValueError("tracks: expected a vehicle with two rows at most 2 s apart, got none")
    axes = np.ones((len(tracks), 1)) if along else np.column_stack([np.cos(tracks.direction), np.sin(tracks.direction)])
    gained = np.diff((tracks.speed[:, None] * axes)[order], axis=0)[pair]
    return max(float((gained**2).sum() / axes.shape[1] / dt_s[pair].sum()), LEAST_DENSITY)
