"""The particle filter whose transition model is the map: predict, weigh, resample.

Source: Gordon, Salmond and Smith 1993 for the filter; section 4 of `docs/method.md` for the transition.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.course import MOVING_FROM
from dirprim_filter.detections import Detections
from dirprim_filter.distributions import von_mises
from dirprim_filter.filtering import _conditioning, _kernels, _measuring, _resampling
from dirprim_filter.filtering.belief import BeliefSamples, ParticleBelief, States, weigh_by_cue
from dirprim_filter.filtering.kalman import ConstantVelocityKalman, WanderingKalman
from dirprim_filter.filtering.measurements import FASTEST, LOST, Evidence
from dirprim_filter.primitives._leader import ALONE
from dirprim_filter.primitives._manoeuvres import OWN_WAY
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.motion import CREEP
from dirprim_filter.primitives.motion_table import motion_table, under
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.primitives.traffic import Traffic
from dirprim_filter.sensor import Sensor

PACE_CHANGES = 0.5
"""m/s^2, by how much a velocity differs from the mean of the way before: half of what vehicles accelerate."""
OWN_WAY_SHARE = 0.5
"""Of vehicles out of sight: the evidence of where they come back says which (`smoothing.bridge`)."""
QUICK, CELL_SHARE, LONGEST_STEP_S = 0.05, 0.4, 0.5
"""Of the ways through cells, the share of the quickest; of a cell, what these pass in the longest step; and seconds:
in one a deviation from a course is forgotten, and regions would be up to a tenth wider."""
PARALLEL_FROM_NS = 1_000_000.0
"""Work below which handing a part of it to a second thread, some 0.1 ms of both, costs more than it saves."""
PARTS_PER_THREAD = 4
"""Vehicles differ in work: a thread that is done early takes another part."""


class Places(NamedTuple):
    """Where vehicles are on a map, by their beliefs.

    Attributes:
        outside: (v,) probability that a vehicle is outside of the map's cells; 0 without cells.
        follows_map: (v,) probability that it follows a manoeuvre of the map and does not go its own way.
        ends: (v,) 1/s, rate at which trajectories end there; 0 without cells.
    """

    outside: FloatArray
    follows_map: FloatArray
    ends: FloatArray


class ParticleFilter(ParticleBelief):
    """A `Smoothable` of particles that move by a map, which hold what vehicles will do next.

    Vehicles are split among threads, and a vehicle's numbers come from its own random state: results depend neither on
    the threads nor on other vehicles.

    Args:
        primitive_map: how vehicles move at each place.
        config: the filter's parameters.
        sensor: how measured positions err, latency aside, which is the tracker's; it replaces the configured noise
            and the covariances that detections report.

    Attributes:
        traffic: of the map; None for one without cells.
        longest_step_s: seconds of the longest step of motion that the map allows.
    """

    def __init__(
        self, primitive_map: PrimitiveMap, config: FilterConfig | None = None, sensor: Sensor | None = None
    ) -> None:
        self.config = config = config or FilterConfig()
        super().__init__(n_particles=config.n_particles)
        self._table = motion_table(primitive_map, step_s=config.step_s, own_way_rate=config.own_way_rate)
        self._primitives = primitive_map.compiled()
        self._has_cells = primitive_map.tessellation.n_cells > 0
        self._cell_of, self._wander = primitive_map.tessellation.cell_of, primitive_map.motion.wander()
        self.traffic = Traffic.of(primitive_map.tessellation, primitive_map.motion)
        self._of_manoeuvre = np.zeros((len(self._table.row), 2))  # whether it is a cell's, and rate of ends
        self._of_manoeuvre[: len(primitive_map.motion), 0] = primitive_map.motion.cell >= 0
        if self.traffic is not None:
            self._of_manoeuvre[: self.traffic.ends.size, 1] = self.traffic.ends
        self.longest_step_s = max(longest_step_s(primitive_map), config.step_s)
        self._noise, self._sensor = _noise(config, free=len(self._table.row) + OWN_WAY), sensor
        self._n_threads = os.cpu_count() or 1
        self._threads = ThreadPoolExecutor(self._n_threads - 1, "dirprim") if self._n_threads > 1 else None

    def begin(self, slot: IntArray, key: AnyArray, measured: Detections) -> None:
        """Initialise beliefs from one measurement each and the primitive at its place. (v,), (v,) uint64, v rows."""
        self.step += 1
        self.cloud.since_s[slot] = np.inf
        per_vehicle = slot, np.asarray(key), self._columns(slot, measured)
        self._split(_measuring.begin, (self._primitives, self._noise, self.cloud), per_vehicle, each_ns=200.0)
        self._split(_kernels.initialise_motion, (self._table, self.cloud), (slot,), each_ns=100.0)

    def steer(self, slot: IntArray, key: AnyArray, way: FloatArray, took_s: FloatArray) -> None:
        """After `begin`, with its keys: half of the particles move as vehicles came, by ways (v, 2) in (v,) seconds.

        By the map alone who drives against all traffic would be sent back, row after row. Two-point initiation:
        Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 5.5.3.
        """
        self.step += 1
        m, half = self.moments(slot), self.cloud.speed[0, ::2].size
        spread = np.sqrt((m[:, 2] + m[:, 4]) / took_s**2 + (PACE_CHANGES * took_s) ** 2)
        for i, (s, seed) in enumerate(zip(slot.tolist(), key.tolist(), strict=True)):
            drawn = way[i] / took_s[i] + spread[i] * np.random.default_rng(seed).standard_normal((half, 2))
            self.cloud.direction[s, ::2] = np.arctan2(drawn[:, 1], drawn[:, 0])
            self.cloud.speed[s, ::2] = np.hypot(*drawn.T)
        self._split(_kernels.initialise_motion, (self._table, self.cloud), (slot,), each_ns=100.0)

    def straight(self) -> ConstantVelocityKalman:
        """Straight on, by the acceleration of the map's background."""
        return WanderingKalman(*self._wander, config=self.config).straight()

    @property
    def own_way_share(self) -> float:
        """Share of vehicles out of sight that go straight on, not by the map; 1 of a map that knows no places."""
        if not self._has_cells:
            return 1.0
        return OWN_WAY_SHARE if self.config.own_way_rate > 0.0 else 0.0

    def resumed(self, key: int, sample: FloatArray) -> Self:
        """One of the same map with one belief: samples (9, P) as of `states`, of equal weight; seeded by a uint64."""
        other, rng = copy(self), np.random.default_rng(key)
        ParticleBelief.__init__(other, n_particles=sample.shape[1])
        cloud, (east, north, *rates, _, cosine, sine, manoeuvre, push) = other.cloud, sample
        cloud.position[0], cloud.direction[0] = np.column_stack([east, north]), np.arctan2(sine, cosine)
        cloud.speed[0], cloud.manoeuvre[0], cloud.push[0] = np.hypot(*rates), manoeuvre, push
        cloud.cell[0] = self._cell_of(cloud.position[0])
        cloud.state[0] = rng.integers(2**64, size=4, dtype=np.uint64)
        return other

    def choose(self, rows: IntArray) -> None:
        """Of the one belief take these samples (P,)."""
        self.step += 1
        for name in ("position", "direction", "speed", "cell", "manoeuvre", "push"):
            column = getattr(self.cloud, name)
            column[0] = column[0, rows]

    def states(self, slot: IntArray) -> States:
        """The particles; the number that lasts is their acceleration."""
        sample = np.empty((slot.size, _kernels.N_SAMPLE, self.n_particles))
        self._split(_kernels.columns_of, (self.cloud, self._table.row), (slot, sample), each_ns=12.0)
        return States(sample, self.cloud.weight[slot], np.zeros((slot.size, 4, 4)))

    def joint(self, then: States, now: States, *, vehicle: IntArray, dt_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As `Smoothable.joint`: those of one belief at two times are the same ones, moved on, whatever the time."""
        mean = np.empty((vehicle.size, 2 * _kernels.N_MEANS))
        covariance = np.empty((vehicle.size, 2 * _kernels.N_STATES, 2 * _kernels.N_STATES))
        pairs = vehicle, then.sample, mean, covariance
        self._split(_kernels.joint_moments, (now.weight, now.sample), pairs, each_ns=40.0)
        return mean, covariance

    def predict(
        self, slot: IntArray, dt_s: FloatArray, cue: Cue | None = None, step_s: FloatArray | None = None
    ) -> None:  # fmt: skip
        """Move the particles by the map's motion model, under a cue by Eq. 4. (v,), (v,) seconds.

        In steps of at most (v,) `step_s`, left out the configured.
        """
        self.step += 1
        table, steps = under(self._table, cue), np.full(slot.size, self.config.step_s) if step_s is None else step_s
        for longest in set(steps.tolist()):
            own, shared = steps == longest, (table._replace(step_s=longest), ALONE, self.cloud, _kernels.NO_SCENE)
            self._split(_kernels.advance, shared, (slot[own], dt_s[own]), each_ns=60.0)
        self.cloud.since_s[slot] += dt_s

    def log_likelihood(self, slot: IntArray, measured: Detections) -> FloatArray:
        """Log density of measurements under the beliefs, outliers aside. (v,), v rows -> (v,)."""
        result = np.empty(slot.size)
        per_vehicle = slot, self._columns(slot, measured), result
        self._split(_measuring.log_likelihood, (self._noise, self.cloud), per_vehicle, each_ns=20.0)
        return result

    def weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Weigh the particles by measurements; a belief none of whose particles is near is left as it was."""
        self.step += 1
        evidence = np.empty((slot.size, 3))
        per_vehicle = slot, self._columns(slot, measured), evidence
        self._split(_measuring.weigh, (self._noise, self.cloud), per_vehicle, each_ns=8.0)
        return Evidence(evidence[:, 0], evidence[:, 1] == 0.0, evidence[:, 2] > 0.0)

    def weigh_by_cue(self, slot: IntArray, cue: Cue) -> FloatArray:
        """Weigh particles by a cue of the turn some seconds later, Eq. 4. (v,) -> (v,) as `belief.weigh_by_cue`."""
        self.step += 1
        return weigh_by_cue(self._table, self.cloud, slot, cue)

    def resample(self, slot: IntArray) -> None:
        """Systematic resampling of the beliefs whose effective sample size has fallen. (v,)."""
        self.step += 1
        below = self.config.resample_below * self.config.n_particles
        self._split(_resampling.resample, (below, self.cloud), (slot,), each_ns=25.0)

    def moments(self, slot: IntArray) -> FloatArray:
        """(v,) -> (v, 10): x, y, xx, xy, yy, direction, resultant, speed, deviation, effective sample size."""
        result = np.empty((slot.size, 10))
        self._split(_kernels.moments, (self.cloud,), (slot, result), each_ns=8.0)
        return result

    def places(self, slot: IntArray) -> Places:
        """Where the particles are; a map without cells has no outside. (v,) -> columns (v,)."""
        result = np.empty((slot.size, 3))
        self._split(_kernels.places, (self.cloud, self._of_manoeuvre), (slot, result), each_ns=2.0)
        return Places(result[:, 0] * self._has_cells, result[:, 1], result[:, 2])

    def particles(self, slot: IntArray) -> BeliefSamples:
        """The beliefs' samples until the next step, one vehicle after the other; `vehicle` counts the slots given."""
        return BeliefSamples((self, slot))

    def _columns(self, slot: IntArray, measured: Detections) -> FloatArray:
        """(v, 9) measurements as the kernels take them."""
        columns = np.zeros((len(measured), 9))
        place, course, axis, errors = columns[:, :2], columns[:, 2], columns[:, 4], columns[:, 5:]
        place[:], columns[:, 3] = measured.position, measured.speed
        course[:] = np.where(measured.speed < MOVING_FROM, np.nan, measured.direction)  # counts where no speed is known
        if self._sensor is not None:
            for k, one in enumerate((self._sensor.along, self._sensor.across)):
                errors[:, k], errors[:, 2 + k] = one.new_variance(self.cloud.since_s[slot]), one.bias_m
            axis[(errors[:, 0] != errors[:, 1]) | errors[:, 2:].any(axis=1)] = np.nan  # none where errors are round
        else:
            errors[:, :2] = self.config.noise_m**2
            own = np.flatnonzero(~np.isnan(measured.covariance[:, 0, 0]))
            if own.size:
                errors[own, :2], axes = np.linalg.eigh(measured.covariance[own])
                axis[own] = np.arctan2(axes[:, 1, 0], axes[:, 0, 0])
        return columns

    def _split(
        self, kernel: Callable[..., None], shared: tuple[Any, ...], per_vehicle: tuple[AnyArray, ...], *, each_ns: float
    ) -> None:  # fmt: skip
        """Run a kernel that takes about `each_ns` a particle on all vehicles, on several threads where that pays."""
        n = per_vehicle[0].size
        if n == 0:
            return
        if self._threads is None or n < 2 or n * self.config.n_particles * each_ns < PARALLEL_FROM_NS:
            kernel(*shared, *per_vehicle)
            return
        n_parts = min(PARTS_PER_THREAD * self._n_threads, n)
        ends = [n * i // n_parts for i in range(n_parts + 1)]
        parts = iter([tuple(a[i:j] for a in per_vehicle) for i, j in pairwise(ends)])

        def work() -> None:
            for part in parts:
                kernel(*shared, *part)

        running = [self._threads.submit(work) for _ in range(self._n_threads - 1)]
        work()
        for other in running:
            other.result()


def _noise(config: FilterConfig, *, free: int) -> _measuring.Noise:
    outlier, astray = config.outlier_probability, config.motion_outlier_probability
    concentration = np.array(1.0 / config.direction_noise**2)
    return _measuring.Noise(
        few=min(_conditioning.FEWEST, config.resample_below), outlier=outlier, lost=outlier or LOST,
        leaves=config.innovation_outlier_rate, free=free, direction_concentration=float(concentration),
        direction_scale=(1.0 - astray) * 2.0 * np.pi * float(np.exp(-von_mises.log_normaliser(concentration))),
        direction_outlier=astray, speed_precision=1.0 / config.speed_noise**2,
        speed_scale=(1.0 - astray) * FASTEST / (config.speed_noise * float(np.sqrt(2.0 * np.pi))),
        speed_outlier=astray,
    )  # fmt: skip


def longest_step_s(primitive_map: PrimitiveMap) -> float:
    """Seconds of the longest step in which particles neither pass most of a cell nor forget their deviation."""
    motion, drives = primitive_map.motion, np.flatnonzero(primitive_map.motion.start_rate == 0.0)
    drives = drives[motion.cell[drives] >= 0]
    side, pace = np.sqrt(primitive_map.tessellation.area)[motion.cell[drives]], np.exp(motion.log_pace[drives]) - CREEP
    passed_s = np.append(side / np.maximum(pace, CREEP), np.inf)
    return float(min(CELL_SHARE * np.quantile(passed_s, QUICK, method="lower"), LONGEST_STEP_S))
