"""Mixtures of von Mises distributions (Eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray, as_floats
from dirprim_filter.distributions import von_mises
from dirprim_filter.distributions.angles import wrap


def log_weights(weight: FloatArray) -> FloatArray:
    """Natural log of weights; -inf where a mode is padding."""
    with np.errstate(divide="ignore"):
        return np.log(weight)


@dataclass(frozen=True, slots=True, kw_only=True)
class VonMisesMixture:
    """sum_m weight_m VM(mean_direction_m, concentration_m), for any number of mixtures at once.

    Attributes:
        weight: (..., M) sums to one over the last axis; 0 pads.
        mean_direction: (..., M) radians in (-pi, pi].
        concentration: (..., M) at least 0.

    Raises:
        ValueError: shapes differ, a weight or concentration is negative, or weights do not sum to one.
    """

    weight: FloatArray
    mean_direction: FloatArray
    concentration: FloatArray

    def __post_init__(self) -> None:
        weight = as_floats("weight", self.weight, "... M")
        mean = as_floats("mean_direction", self.mean_direction, "... M")
        concentration = as_floats("concentration", self.concentration, "... M")
        if not weight.shape == mean.shape == concentration.shape:
            raise ValueError(
                "weight, mean_direction, concentration: expected one shape (..., M), "
                f"got {weight.shape}, {mean.shape}, {concentration.shape}"
            )
        if (weight < 0).any() or (concentration < 0).any():
            raise ValueError("weight, concentration: expected no negative number")
        if not np.allclose(weight.sum(axis=-1), 1.0, atol=1e-9):
            raise ValueError("weight: expected to sum to one over the last axis")
        object.__setattr__(self, "weight", weight)
        object.__setattr__(self, "mean_direction", wrap(mean))
        object.__setattr__(self, "concentration", concentration)

    def __getitem__(self, index: AnyArray | int | None) -> VonMisesMixture:
        """The mixtures at `index` of the leading axes."""
        return VonMisesMixture(
            weight=self.weight[index],
            mean_direction=self.mean_direction[index],
            concentration=self.concentration[index],
        )

    def mode_log_density(self, direction: FloatArray) -> FloatArray:
        """log(weight_m VM_m(direction)) of every mode. (...) -> (..., M)."""
        d = np.asarray(direction, dtype=np.float64)[..., None]
        return log_weights(self.weight) + von_mises.log_density(d, self.mean_direction, self.concentration)

    def log_density(self, direction: FloatArray) -> FloatArray:
        """Natural log of the mixture's density, per radian (Eq. 1). (...) -> (...)."""
        return np.asarray(logsumexp(self.mode_log_density(direction), axis=-1))

    def sample(self, *, n_samples: int | None = None, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """Directions from each mixture and the modes that they came from. -> (n_samples, ...), (n_samples, ...).

        Args:
            n_samples: how many from each mixture; left out, one, and the results have shape (...).
            rng: what is drawn from.

        Raises:
            ValueError: `n_samples` is negative.
        """
        if n_samples is not None and n_samples < 0:
            raise ValueError(f"n_samples: expected no negative number, got {n_samples}")
        shape = self.weight.shape[:-1] if n_samples is None else (n_samples, *self.weight.shape[:-1])
        last = np.array(self.weight.shape[-1] - 1 - (self.weight[..., ::-1] > 0).argmax(axis=-1))  # that has weight
        drawn = rng.random(shape)[..., None]
        mode = np.minimum((np.cumsum(self.weight, axis=-1) <= drawn).sum(axis=-1), last)
        pick = np.broadcast_to(mode[..., None], (*shape, 1))
        mean, concentration = (
            np.take_along_axis(np.broadcast_to(column, (*shape, column.shape[-1])), pick, axis=-1)[..., 0]
            for column in (self.mean_direction, self.concentration)
        )
        return wrap(rng.vonmises(mean, concentration)), mode
