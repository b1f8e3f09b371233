"""The constant-velocity Kalman filter of filterpy, the baseline that every result is printed beside."""

from __future__ import annotations

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter

from dirprim_filter.detections import NO_TIME, Detections
from dirprim_filter.estimates import Estimates, Particles
from dirprim_filter.tracks import Tracks
from tessellation.arrays import BoolArray, FloatArray

FIRST_SPEED_STD = 10.0
"""m/s, how little the first position of a vehicle tells of its velocity."""


def acceleration_density(tracks: Tracks) -> float:
    """The spectral density of white acceleration that explains the tracks' changes of velocity, m^2/s^3 per axis.

    Args:
        tracks: training vehicles; consecutive rows up to 2 s apart are used.

    Raises:
        ValueError: no vehicle has two rows near in time.
    """
    _, vehicle = np.unique(tracks.track_id, return_inverse=True)
    order = np.lexsort((tracks.time_ns, vehicle))
    dt_s = np.diff(tracks.time_ns[order]) * 1e-9
    pair = (np.diff(vehicle[order]) == 0) & (dt_s <= 2.0)
    if not pair.any():
        raise ValueError("tracks: expected a vehicle with two rows at most 2 s apart, got none")
    heading = np.column_stack([np.cos(tracks.direction[order]), np.sin(tracks.direction[order])])
    gained = np.diff(tracks.speed[order][:, None] * heading, axis=0)[pair]
    return max(float((gained**2).sum() / 2.0 / dt_s[pair].sum()), 1e-6)


class ConstantVelocityTracker:
    """One constant-velocity Kalman filter for each track id.

    Args:
        noise_m: metres, standard deviation of a measured position in each axis.
        acceleration_density: m^2/s^3, see `acceleration_density`.
        max_gap_s: seconds without a measurement after which a filter begins anew.
    """

    def __init__(self, *, noise_m: float, acceleration_density: float, max_gap_s: float = 5.0) -> None:
        self._noise_m = noise_m
        self._density = acceleration_density
        self._max_gap_ns = int(max_gap_s * 1e9)
        self._filters: dict[str, tuple[KalmanFilter, int]] = {}
        self._time_ns = NO_TIME
        self._frame = Detections.none()
        self._log_evidence: FloatArray = np.empty(0)
        self._is_new: BoolArray = np.empty(0, np.bool_)

    def predict(self, detections: Detections) -> None:
        """Move the filter of every vehicle in the frame to the frame's time; begin those that are new.

        Raises:
            ValueError: several instants, a repeated id, or time going backwards; the filters are as before.
        """
        self._time_ns = time_ns = detections.instant(after_ns=self._time_ns)
        self._frame = detections
        self._log_evidence = np.zeros(len(detections))
        self._is_new = np.zeros(len(detections), np.bool_)
        gone = [name for name, (_, last_ns) in self._filters.items() if time_ns - last_ns > self._max_gap_ns]
        for name in gone:
            del self._filters[name]
        for row, name in enumerate(detections.track_id):
            kalman, last_ns = self._filters.get(str(name), (None, 0))
            if kalman is None:
                kalman = _begin(detections.position[row], self._noise_m)
                self._is_new[row] = True
            else:
                _move(kalman, (time_ns - last_ns) * 1e-9, self._density)
            self._filters[str(name)] = kalman, time_ns

    def weigh(self) -> None:
        """Update the moved filters by the frame's positions."""
        for row, name in enumerate(self._frame.track_id):
            if not self._is_new[row]:
                kalman, _ = self._filters[str(name)]
                kalman.update(self._frame.position[row])
                self._log_evidence[row] = _log_density(kalman.y, kalman.S)

    def estimate(self) -> Estimates:
        """What is believed of the frame's vehicles; a Gaussian has all of its samples' worth."""
        filters = [self._filters[str(name)][0] for name in self._frame.track_id]
        n = len(filters)
        state = np.array([kalman.x for kalman in filters]).reshape(n, 4)
        covariance = np.array([kalman.P for kalman in filters]).reshape(n, 4, 4)
        direction = np.arctan2(state[:, 3], state[:, 2])
        along = np.column_stack([np.cos(direction), np.sin(direction)])
        return Estimates(
            track_id=self._frame.track_id,
            time_ns=self._frame.time_ns,
            position=state[:, :2],
            covariance=covariance[:, :2, :2],
            direction=direction,
            direction_resultant=np.ones(n),
            speed=np.hypot(state[:, 2], state[:, 3]),
            speed_std=np.sqrt(np.einsum("ni,nij,nj->n", along, covariance[:, 2:, 2:], along)),
            effective_sample_size=np.ones(n),
            log_evidence=self._log_evidence,
        )

    def particles(self) -> Particles:
        """None: a Kalman filter has no samples."""
        none = np.empty(0)
        return Particles(
            position=np.empty((0, 2)), direction=none, speed=none, weight=none, vehicle=np.empty(0, np.int64)
        )

    def resample(self) -> None:
        """Nothing to resample."""


def _move(kalman: KalmanFilter, dt_s: float, density: float) -> None:
    kalman.F[0, 2] = kalman.F[1, 3] = dt_s
    noise = Q_continuous_white_noise(dim=2, dt=dt_s, spectral_density=density)
    kalman.Q = np.kron(noise, np.eye(2))
    kalman.predict()


def _log_density(innovation: FloatArray, covariance: FloatArray) -> float:
    """Natural log of the Gaussian density of an innovation (2,); filterpy asks scipy.stats, at ten times the cost."""
    (a, b), (_, d) = covariance
    determinant = a * d - b * b
    x, y = innovation
    distance = (d * x * x - 2.0 * b * x * y + a * y * y) / determinant
    return float(-0.5 * (distance + np.log(determinant)) - np.log(2.0 * np.pi))


def _begin(position: FloatArray, noise_m: float) -> KalmanFilter:
    kalman = KalmanFilter(dim_x=4, dim_z=2)  # x, y, and their rates; kinematic_kf builds a wrong H in filterpy 2.0
    kalman.x = np.array([position[0], position[1], 0.0, 0.0])
    kalman.P = np.diag([noise_m**2, noise_m**2, FIRST_SPEED_STD**2, FIRST_SPEED_STD**2])
    kalman.F = np.eye(4)
    kalman.H = np.eye(2, 4)
    kalman.R = noise_m**2 * np.eye(2)
    return kalman
