"""The particle filter whose transition model is the map: predict, weigh, resample.

Source: Gordon, Salmond and Smith 1993 for the filter; Senanayake et al. 2020, Eq. 4, for the transition.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from dirprim_filter.config import FilterConfig
from dirprim_filter.filtering import _kernels
from dirprim_filter.filtering.belief import ParticleBelief
from dirprim_filter.filtering.motion import motion_table
from dirprim_filter.primitives import PrimitiveMap
from tessellation.arrays import AnyArray, FloatArray, IntArray

logger = logging.getLogger(__name__)

PARALLEL_FROM = 2000
"""Particles below which handing work to a second thread costs more than it saves."""


class ParticleFilter:
    """Steps of the filter on the beliefs of many vehicles at once.

    Each step takes the slots of the vehicles it concerns. Vehicles are split among threads, and a vehicle's numbers
    come from its own random state: results depend neither on the threads nor on other vehicles.
    """

    def __init__(self, primitive_map: PrimitiveMap, config: FilterConfig) -> None:
        self.config = config
        self.belief = ParticleBelief(n_particles=config.n_particles)
        self._table = motion_table(primitive_map, config)
        self._outlier_density = config.outlier_probability / config.outlier_extent_m**2
        n_threads = os.cpu_count() or 1
        self._threads = ThreadPoolExecutor(n_threads, thread_name_prefix="dirprim") if n_threads > 1 else None
        self._n_threads = n_threads

    def be_born(self, slot: IntArray, key: AnyArray, measured: FloatArray) -> None:
        """Start beliefs from one measurement each, and from the primitive at its place.

        Args:
            slot: (v,) slots of the vehicles.
            key: (v,) uint64, what their random numbers follow from.
            measured: (v, 2) metres.
        """
        self._split(_kernels.be_born, (slot, key, measured), (self.config.noise_m,))

    def predict(self, slot: IntArray, dt_s: FloatArray) -> None:
        """Move the particles by the map's motion model. (v,), (v,) seconds."""
        self._split(_kernels.predict, (slot, dt_s), ())

    def weigh(self, slot: IntArray, measured: FloatArray) -> FloatArray:
        """Weigh the particles by measured positions. (v,), (v, 2) metres -> (v,) log evidence."""
        log_evidence = np.empty(slot.size)
        config = self.config
        _kernels.weigh(
            self.belief.cloud, slot, measured, config.noise_m, config.outlier_probability, config.outlier_extent_m,
            log_evidence,
        )  # fmt: skip
        return log_evidence

    def is_lost(self, log_evidence: FloatArray) -> AnyArray:
        """(v,) where a measurement was better explained as an outlier than by the belief: no particle is near it."""
        return np.asarray(log_evidence < np.log(2.0 * self._outlier_density))

    def effective_sample_size(self, slot: IntArray) -> FloatArray:
        """(v,) -> (v,) 1 / sum of squared weights."""
        result = np.empty(slot.size)
        _kernels.effective_sample_size(self.belief.cloud, slot, result)
        return result

    def resample(self, slot: IntArray, effective_sample_size: FloatArray) -> None:
        """Systematic resampling of the beliefs whose effective sample size has fallen."""
        poor = effective_sample_size < self.config.resample_below * self.config.n_particles
        _kernels.resample(self.belief.cloud, slot[poor])

    def moments(self, slot: IntArray) -> FloatArray:
        """(v,) -> (v, 9), as `Estimates` names them: x, y, xx, xy, yy, direction, resultant, speed, deviation."""
        result = np.empty((slot.size, 9))
        _kernels.moments(self.belief.cloud, slot, result)
        return result

    def _split(self, kernel: Callable[..., None], per_vehicle: tuple[AnyArray, ...], rest: tuple[Any, ...]) -> None:
        """Run a kernel on all vehicles, on several threads where that pays."""
        n = per_vehicle[0].size
        if n == 0:
            return
        cloud = self.belief.cloud
        if self._threads is None or n < 2 or n * self.config.n_particles < PARALLEL_FROM:
            kernel(self._table, cloud, *per_vehicle, *rest)
            return
        parts = zip(*(np.array_split(a, min(self._n_threads, n)) for a in per_vehicle), strict=True)
        running = [self._threads.submit(kernel, self._table, cloud, *part, *rest) for part in parts]
        for part in running:
            part.result()
