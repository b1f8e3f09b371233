"""What a tracker asks of a filter: beliefs in numbered slots, which it predicts and corrects.

One tracker serves the particle filter on the map and the Kalman filter, so that a comparison is one of motion models
alone. What a smoother asks beside that is a protocol of its own.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.filtering.belief import States
from dirprim_filter.filtering.kalman import ConstantVelocityKalman
from dirprim_filter.filtering.measurements import Evidence


class BayesFilter(Protocol):
    """Beliefs of many vehicles; every step takes the slots (v,) it is about.

    No belief depends on another.
    """

    def reserve(self, n_slots: int) -> None:
        """Make room for so many slots; the present beliefs stay."""
        ...

    def begin(self, slot: IntArray, key: AnyArray, measured: Detections) -> None:
        """Initialise beliefs from one measurement each; `key` (v,) uint64 seeds their random numbers."""
        ...

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the beliefs of `target` those of `source`, random numbers to come included."""
        ...

    def predict(self, slot: IntArray, dt_s: FloatArray) -> None:
        """Predict each belief by its own time, seconds."""
        ...

    def log_likelihood(self, slot: IntArray, measured: Detections) -> FloatArray:
        """(v,) as `Evidence.log_density`, outlying positions aside; changes nothing."""
        ...

    def weigh(self, slot: IntArray, measured: Detections) -> Evidence:
        """Correct beliefs by one measurement each."""
        ...

    def moments(self, slot: IntArray) -> FloatArray:
        """(v, 10): x, y, xx, xy, yy, direction, its resultant, speed, its deviation, effective sample size.

        As `Estimates` names them; where there are no samples their size is 1.
        """
        ...

    def resample(self, slot: IntArray) -> None:
        """Resample beliefs whose samples have degenerated."""
        ...


@runtime_checkable
class Smoothable(BayesFilter, Protocol):
    """A filter that knows how beliefs at one time follow from those at another, as a smoother asks."""

    def straight(self) -> ConstantVelocityKalman:
        """The straight motion, without beliefs, that the filter's own is compared with across gaps."""
        ...

    def states(self, slot: IntArray) -> States:
        """Beliefs as they are, to be given back when they have moved on."""
        ...

    def joint(self, then: States, now: States, *, vehicle: IntArray, dt_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k, 14), (k, 10, 10) means of all that samples have, and covariance of states: of earlier beside later ones.

        Args:
            then: k earlier beliefs.
            now: v later ones, whose weights count.
            vehicle: (k,) which of these each became.
            dt_s: (k,) seconds between them.
        """
        ...
