"""The Kalman filter of constant velocity that every result is printed beside.

The numbers of all vehicles stand in arrays, which filterpy's filters of one vehicle do not take: its process noise
serves here, and its filters are the oracle of the tests.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, ch. 6.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.distributions import gaussian
from dirprim_filter.filtering.belief import States
from dirprim_filter.filtering.measurements import LOST, TAIL, Evidence, measured_covariance
from dirprim_filter.primitives.motion import JUMP_S
from dirprim_filter.tracks import Tracks

FIRST_SPEED_STD = 10.0
"""m/s, prior standard deviation of each component of the velocity at initiation."""
MAX_INTERVAL_S, LEAST_DENSITY = 2.0, 1e-6
"""Seconds between rows of which the change of velocity counts; and m^2/s^3, of vehicles that never accelerate."""


class ConstantVelocityKalman:
    """A `Smoothable` of Gaussians of x, y and their rates: straight on at the same speed, but for white acceleration.

    Positions alone are measured: reported courses and speeds are not used. Its smoother is Rauch, Tung and Striebel's
    own. Another linear motion is another `transition`.

    Args:
        acceleration_density: m^2/s^3 per axis, see `acceleration_density`.
        config: the noise of the measurements, and how many of them are outliers.
    """

    def __init__(self, *, acceleration_density: float, config: FilterConfig | None = None) -> None:
        self.config = config = config or FilterConfig()
        self._density = acceleration_density
        self.mean: FloatArray = np.empty((0, 4))
        self.covariance: FloatArray = np.empty((0, 4, 4))

    def transition(self, dt_s: FloatArray) -> FloatArray:
        """(v, 4, 4) what the state becomes in (v,) seconds."""
        moved = np.tile(np.eye(4), (dt_s.size, 1, 1))
        moved[:, 0, 2] = moved[:, 1, 3] = dt_s
        return moved

    def noise(self, dt_s: FloatArray, *, over_s: FloatArray | float | None = None) -> FloatArray:
        """(v, 4, 4) covariance that motion adds in (v,) seconds of a stretch of `over_s` between measurements."""
        return _white_acceleration(dt_s) * self.density(dt_s if over_s is None else over_s)

    def density(self, over_s: FloatArray | float) -> FloatArray:
        """(v, 1, 1), or (1, 1), m^2/s^3 of the acceleration in stretches of (v,) seconds between measurements."""
        return np.full((*np.shape(over_s), 1, 1), self._density)

    def reserve(self, n_slots: int) -> None:
        """Make room for so many slots."""
        more = max(n_slots - len(self.mean), 0)
        self.mean = np.concatenate([self.mean, np.zeros((more, 4))])
        self.covariance = np.concatenate([self.covariance, np.zeros((more, 4, 4))])

    def begin(self, slot: IntArray, key: AnyArray, measured: Detections) -> None:
        """Start beliefs from one measurement each; nothing here is random, so `key` is not used."""
        self.mean[slot], self.covariance[slot] = 0.0, np.diag([0.0, 0.0, FIRST_SPEED_STD**2, FIRST_SPEED_STD**2])
        self.mean[slot, :2], self.covariance[slot, :2, :2] = (
            measured.position, measured_covariance(measured, self.config),
        )  # fmt: skip

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the beliefs of `target` those of `source`. (v,), (v,)."""
        self.mean[target], self.covariance[target] = self.mean[source], self.covariance[source]

    def predict(self, slot: IntArray, dt_s: FloatArray) -> None:
        """Move beliefs on. (v,), (v,) seconds."""
        moved = self.transition(dt_s)
        self.mean[slot] = (moved @ self.mean[slot, :, None])[..., 0]
        later = moved @ self.covariance[slot] @ moved.swapaxes(1, 2) + self.noise(dt_s)
        self.covariance[slot] = _symmetric(later)

    def log_likelihood(self, slot: IntArray, measured: Detections) -> FloatArray:
        """Log density of measurements under the beliefs, outliers aside. (v,), v rows -> (v,)."""
        spread = self.covariance[slot, :2, :2] + measured_covariance(measured, self.config)
        return gaussian.log_density(measured.position - self.mean[slot, :2], spread)

    def weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Correct beliefs by measurements; an outlier, by `TAIL` wider than expected, corrects nothing."""
        covariance, off = self.covariance[slot], measured.position - self.mean[slot, :2]
        spread, e = covariance[:, :2, :2] + measured_covariance(measured, self.config), self.config.outlier_probability
        fit, squared = gaussian.log_density(off, spread), gaussian.squared_distance(off, spread)
        tail = fit + 0.5 * squared - 2.0 * np.log(TAIL + 0.5 * squared / TAIL)
        with np.errstate(divide="ignore"):  # what is off has no probability
            own, wrong = np.log1p(-e) + fit, np.log(e) + tail
        gain = np.linalg.solve(spread, covariance[:, :2]).swapaxes(1, 2) * (own > wrong)[:, None, None]
        self.mean[slot] += (gain @ off[..., None])[..., 0]
        self.covariance[slot] = _symmetric(covariance - gain @ covariance[:, :2])
        unexplained = ~(fit >= np.log(e or LOST) + tail)
        return Evidence(np.logaddexp(own, wrong), unexplained, np.ones(slot.size, np.bool_))

    def moments(self, slot: IntArray) -> FloatArray:
        """(v,) -> (v, 10), as `Estimates` names them; the course is the mean velocity's, and certain."""
        mean, covariance = self.mean[slot], self.covariance[slot]
        direction = np.arctan2(mean[:, 3], mean[:, 2])
        along, certain = np.column_stack([np.cos(direction), np.sin(direction)]), np.ones(slot.size)
        speed_std = np.sqrt(np.einsum("ni,nij,nj->n", along, covariance[:, 2:4, 2:4], along))
        pace, (xx, xy, _, yy) = np.hypot(mean[:, 2], mean[:, 3]), covariance[:, :2, :2].reshape(-1, 4).T
        return np.column_stack([mean[:, :2], xx, xy, yy, direction, certain, pace, speed_std, certain])

    def resample(self, slot: IntArray) -> None:
        """Nothing to resample."""

    def straight(self) -> ConstantVelocityKalman:
        """One of the same motion, without beliefs, to which every measurement is of its vehicle."""
        other = copy(self)
        other.config = replace(self.config, outlier_probability=0.0)
        other.mean, other.covariance = np.empty((0, 4)), np.empty((0, 4, 4))
        return other

    def states(self, slot: IntArray) -> States:
        """Means and covariances; nothing else lasts."""
        mean = self.mean[slot]
        direction = np.arctan2(mean[:, 3], mean[:, 2])
        sample = np.column_stack([mean, np.zeros(slot.size), np.cos(direction), np.sin(direction)])
        return States(sample[..., None], np.ones((slot.size, 1)), self.covariance[slot])

    def joint(self, then: States, now: States, *, vehicle: IntArray, dt_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Smoothable.joint`: the covariance with what is dt_s later is P F(dt_s)^T."""
        mean = np.hstack([then.sample[..., 0], now.sample[vehicle, :, 0]])
        p, later = then.covariance, now.covariance[vehicle]
        shared = p @ self.transition(dt_s).swapaxes(1, 2)
        p, shared, later = (np.pad(block, ((0, 0), (0, 1), (0, 1))) for block in (p, shared, later))
        return mean, np.block([[p, shared], [shared.swapaxes(1, 2), later]])


def _white_acceleration(dt_s: FloatArray) -> FloatArray:
    """(v,) -> (v, 4, 4) of a density of 1 m^2/s^3."""
    from filterpy.common import Q_continuous_white_noise  # noqa: PLC0415 - it takes a second of whoever does not smooth

    lengths, row = np.unique(dt_s, return_inverse=True)
    noise = [Q_continuous_white_noise(2, dt, 1.0, block_size=2, order_by_dim=False) for dt in lengths]
    return np.reshape(noise, (-1, 4, 4))[row]


def _symmetric(matrix: FloatArray) -> FloatArray:
    return 0.5 * (matrix + matrix.swapaxes(-1, -2))


def acceleration_density(tracks: Tracks) -> float:
    """The spectral density of white acceleration that explains the tracks' changes of velocity, m^2/s^3 per axis.

    Args:
        tracks: training vehicles; consecutive rows up to 2 s apart are used.

    Raises:
        ValueError: no vehicle has two rows near in time.
    """
    vehicle = tracks.vehicle
    order = np.lexsort((tracks.time_ns, vehicle))
    dt_s = np.diff(tracks.time_ns[order]) * 1e-9
    pair = (np.diff(vehicle[order]) == 0) & (dt_s <= MAX_INTERVAL_S)
    if not pair.any():
        raise ValueError("tracks: expected a vehicle with two rows at most 2 s apart, got none")
    course = np.column_stack([np.cos(tracks.direction), np.sin(tracks.direction)])
    gained = np.diff((tracks.speed[:, None] * course)[order], axis=0)[pair]
    return max(float((gained**2).sum() / 2.0 / dt_s[pair].sum()), LEAST_DENSITY)


class WanderingKalman(ConstantVelocityKalman):
    """Whose acceleration lasts: white noise, and manoeuvres that go on for seconds, as those of a map's background do.

    Over a stretch between two measurements it counts as white, of the density that gives the same change of velocity;
    over less than `JUMP_S` as over that: what acts now acts in the next stretch too.

    Args:
        white: (2,) m^2/s^3, as `Motion.wander`: it counts as round.
        lasting: (k, 2) m^2/s^4, likewise.
        config: as of a `ConstantVelocityKalman`.
    """

    def __init__(self, white: FloatArray, lasting: FloatArray, config: FilterConfig | None = None) -> None:
        super().__init__(acceleration_density=max(float(white.mean()), LEAST_DENSITY), config=config)
        self._lasting = lasting.mean(axis=1)

    def density(self, over_s: FloatArray | float) -> FloatArray:
        """As of a `ConstantVelocityKalman`."""
        over = np.fmax(np.asarray(over_s, np.float64), JUMP_S)[..., None] / JUMP_S
        lag = np.arange(1, self._lasting.size)
        later = np.maximum(1.0 - lag / over, 0.0) @ self._lasting[1:]
        lasts = JUMP_S * (self._lasting[0] + 2.0 * later)
        return np.asarray(super().density(over_s) + np.maximum(lasts, 0.0)[..., None, None])
