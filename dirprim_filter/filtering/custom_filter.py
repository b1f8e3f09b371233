"""A particle filter with a motion or a sensor model of one's own, in numpy, in place of the compiled ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import logsumexp

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.filtering import _measuring
from dirprim_filter.filtering.measurements import TAIL, Evidence
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.filtering.radar import Measurement
from dirprim_filter.filtering.transition import Moving, Transition
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.primitive_map import PrimitiveMap


class CustomFilter(ParticleFilter):
    """A `ParticleFilter` that moves particles, or weighs them, as its user says.

    Beliefs begin as they do on the map; existence, association and the smoother are the same. Across gaps a smoother
    goes straight on, as it does not know where such particles may lead. With a measurement of one's own there are wrong
    positions, but no innovation outliers, nor draws given measurements.

    Args:
        primitive_map: how vehicles that are first seen move at each place.
        transition: moves particles; left out, the map.
        measurement: weighs them; left out, Gaussians of the detections' covariances.
        config: the filter's parameters.
    """

    def __init__(
        self, primitive_map: PrimitiveMap, *, transition: Transition | None = None,
        measurement: Measurement | None = None, config: FilterConfig | None = None,
    ) -> None:  # fmt: skip
        super().__init__(primitive_map, config)
        self.transition, self.measurement = transition, measurement
        self.longest_step_s = self.longest_step_s if transition is None else self.config.step_s
        self.own = np.zeros((*self.cloud.speed.shape, 0 if transition is None else transition.n_own))

    @property
    def own_way_share(self) -> float:
        """As of a `ParticleFilter`; of an own transition 1."""
        return super().own_way_share if self.transition is None else 1.0

    def reserve(self, n_slots: int) -> None:
        """Make room for so many vehicles."""
        super().reserve(n_slots)
        more = len(self.cloud.speed) - len(self.own)
        self.own = np.pad(self.own, ((0, more), (0, 0), (0, 0)))

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the particles of `target` those of `source`, own columns included."""
        super().copy(source, target)
        self.own[target] = self.own[source]

    def begin(self, slot: IntArray, key: AnyArray, measured: Detections) -> None:
        """Initialise beliefs as on the map, then the own columns."""
        super().begin(slot, key, measured)
        self._begin_own(slot)

    def steer(self, slot: IntArray, key: AnyArray, way: FloatArray, took_s: FloatArray) -> None:
        """As on the map, then the own columns anew."""
        super().steer(slot, key, way, took_s)
        self._begin_own(slot)

    def _begin_own(self, slot: IntArray) -> None:
        if self.transition is not None:
            for _, particles, rng in self._each(slot):
                self.transition.begin(particles, rng)

    def predict(
        self, slot: IntArray, dt_s: FloatArray, cue: Cue | None = None, step_s: FloatArray | None = None
    ) -> None:  # fmt: skip
        """Move the particles. (v,), (v,) seconds."""
        if self.transition is None:
            super().predict(slot, dt_s, cue, step_s)
            return
        self.step += 1
        for i, particles, rng in self._each(slot):
            self.transition.advance(particles, float(dt_s[i]), rng)
        self.cloud.cell[slot] = self._cell_of(self.cloud.position[slot])
        self.cloud.since_s[slot] += dt_s

    def resample(self, slot: IntArray) -> None:
        """As of a `ParticleFilter`; survivors keep their own columns."""
        if self.transition is None:
            super().resample(slot)
            return
        self.cloud.manoeuvre[slot] = np.arange(self.n_particles)  # which survivors keep, so that it says whose they are
        super().resample(slot)
        self.own[slot] = np.take_along_axis(self.own[slot], self.cloud.manoeuvre[slot][..., None], axis=1)
        self.cloud.manoeuvre[slot] = self._noise.free

    def log_likelihood(self, slot: IntArray, measured: Detections) -> FloatArray:
        """Log density of measurements under the beliefs, wrong positions aside. (v,), v rows -> (v,)."""
        if self.measurement is None:
            return super().log_likelihood(slot, measured)
        log_fit, _ = _log_fits(self.measurement, self.cloud.position[slot], measured)
        with np.errstate(divide="ignore"):  # a particle without weight
            return np.asarray(logsumexp(log_fit + np.log(self.cloud.weight[slot]), axis=1))

    def weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Weigh the particles by measurements."""
        if self.measurement is None or not slot.size:
            return super().weigh(slot, measured)
        self.step += 1
        log_fit, log_tail = _log_fits(self.measurement, self.cloud.position[slot], measured)
        with np.errstate(divide="ignore"):  # a particle without weight, an outlier without probability
            log_weight, e = np.log(self.cloud.weight[slot]), self._noise.outlier
            both = np.logaddexp(np.log1p(-e) + log_fit, np.log(e) + log_tail)
            own, wrong = (logsumexp(log_weight + of, axis=1) for of in (log_fit, log_tail + np.log(self._noise.lost)))
        top = both.max(axis=1)
        fit, evidence = np.exp(both - top[:, None]), np.empty(slot.size)
        for i, (v, z) in enumerate(zip(slot, self._columns(slot, measured), strict=True)):
            _measuring.fit_motion(self.cloud, v, z, self._noise, fit[i])
            evidence[i] = self.cloud.weight[v] @ fit[i]
            _measuring.normalise(self.cloud.weight[v], fit[i])
        self.cloud.since_s[slot] = 0.0
        with np.errstate(divide="ignore"):  # no particle has a weight
            return Evidence(np.log(evidence) + top, ~(own >= wrong), np.zeros(slot.size, np.bool_))

    def _each(self, slot: IntArray) -> Iterator[tuple[int, Moving, np.random.Generator]]:
        """The particles of vehicles (v,), to be changed in place, each with random numbers of its own."""
        cloud = self.cloud
        for i, v in enumerate(slot):
            rng = np.random.default_rng(cloud.state[v])
            cloud.state[v] = rng.integers(2**64, size=4, dtype=np.uint64)
            cloud.manoeuvre[v] = self._noise.free
            yield i, Moving(
                position=cloud.position[v], direction=cloud.direction[v], speed=cloud.speed[v], own=self.own[v]
            ), rng  # fmt: skip


def _log_fits(measurement: Measurement, position: FloatArray, measured: Detections) -> tuple[FloatArray, FloatArray]:
    """(v, P) log densities of the measurements at particles (v, P, 2), and those of wrong ones, see `_measuring`."""
    log_fit = np.array([
        measurement.log_likelihood(np.vstack([place, measured.position[i]]), measured[i : i + 1])
        for i, place in enumerate(position)
    ]).reshape(len(position), -1)  # fmt: skip
    densest, log_fit = log_fit[:, -1:], log_fit[:, :-1]
    return log_fit, densest - 2.0 * np.log(TAIL + (densest - log_fit) / TAIL)
