"""One belief for each track id: the filter's steps for the vehicles of a frame."""

from __future__ import annotations

import logging

import numpy as np

from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import NO_TIME, Detections
from dirprim_filter.estimates import Estimates, Particles
from dirprim_filter.filtering.belief import birth_key
from dirprim_filter.filtering.particle_filter import ParticleFilter
from dirprim_filter.primitives import PrimitiveMap
from tessellation.arrays import FloatArray, IntArray

logger = logging.getLogger(__name__)


class Tracker:
    """Tracks vehicles whose detections carry ids.

    A belief moves from its own measurement to its next, never by the times of others, so a vehicle's estimates are the
    same whichever other vehicles the log holds.

    Args:
        primitive_map: the map that says how vehicles move.
        config: the filter's knobs.
        rng: one number drawn from it seeds every vehicle, together with its id.
    """

    def __init__(
        self, primitive_map: PrimitiveMap, *, config: FilterConfig | None = None, rng: np.random.Generator
    ) -> None:
        self.config = config or FilterConfig()
        self.recoveries = 0
        self._filter = ParticleFilter(primitive_map, self.config)
        self._seed = int(rng.integers(2**63))
        self._time_ns = NO_TIME
        self._frame = Detections.none()
        self._slot: IntArray = np.empty(0, np.int64)
        self._measured: IntArray = np.empty(0, np.int64)
        self._effective_sample_size: FloatArray = np.empty(0)
        self._log_evidence: FloatArray = np.empty(0)

    def predict(self, detections: Detections) -> None:
        """Move the belief of every vehicle in the frame to the frame's time; begin those that are new.

        Args:
            detections: one instant, each id once.

        Raises:
            ValueError: several instants, a repeated id, or time going backwards; the beliefs are as before.
        """
        belief = self._filter.belief
        self._time_ns = time_ns = detections.instant(after_ns=self._time_ns)
        ids = [str(name) for name in detections.track_id]
        belief.forget(before_ns=time_ns - int(self.config.max_gap_s * 1e9))
        is_new = np.array([name not in belief for name in ids], dtype=np.bool_)
        slot = np.array([belief.slot_of(name) for name in ids], dtype=np.int64)
        dt_ns = time_ns - belief.time_ns[slot[~is_new]]
        self._filter.predict(slot[~is_new], np.asarray(dt_ns * 1e-9, dtype=np.float64))
        belief.time_ns[slot] = time_ns
        self._frame, self._slot = detections, slot
        self._log_evidence = np.zeros(slot.size)
        self._begin(np.flatnonzero(is_new))
        self._measured = np.flatnonzero(~is_new)

    def weigh(self) -> None:
        """Weigh the moved beliefs by the frame's positions; begin anew those that no particle explains."""
        rows = self._measured
        evidence = self._filter.weigh(self._slot[rows], self._frame.position[rows])
        self._log_evidence[rows] = evidence
        lost = rows[self._filter.is_lost(evidence)]
        if lost.size:
            self.recoveries += int(lost.size)
            logger.info(
                "at %d ns no particle explains the positions of %s: begun anew",
                self._time_ns, ", ".join(str(name) for name in self._frame.track_id[lost]),
            )  # fmt: skip
            self._begin(lost)

    def estimate(self) -> Estimates:
        """What is believed of the frame's vehicles."""
        m = self._filter.moments(self._slot)
        self._effective_sample_size = self._filter.effective_sample_size(self._slot)
        return Estimates(
            track_id=self._frame.track_id,
            time_ns=self._frame.time_ns,
            position=m[:, :2],
            covariance=m[:, [2, 3, 3, 4]].reshape(-1, 2, 2),
            direction=m[:, 5],
            direction_resultant=m[:, 6],
            speed=m[:, 7],
            speed_std=m[:, 8],
            effective_sample_size=self._effective_sample_size,
            log_evidence=self._log_evidence,
        )

    def particles(self) -> Particles:
        """Copies of the samples behind the frame's estimates."""
        cloud, slot = self._filter.belief.cloud, self._slot
        n = self.config.n_particles
        return Particles(
            position=cloud.position[slot].reshape(-1, 2),
            direction=cloud.direction[slot].ravel(),
            speed=cloud.speed[slot].ravel(),
            weight=np.exp(cloud.log_weight[slot]).ravel(),
            vehicle=np.repeat(np.arange(slot.size), n),
        )

    def resample(self) -> None:
        """Resample the beliefs whose effective sample size has fallen."""
        self._filter.resample(self._slot, self._effective_sample_size)

    def _begin(self, rows: IntArray) -> None:
        key = [birth_key(self._seed, str(name), self._time_ns) for name in self._frame.track_id[rows]]
        self._filter.be_born(self._slot[rows], np.array(key, dtype=np.uint64), self._frame.position[rows])
