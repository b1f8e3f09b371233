"""What a tracker asks of a filter: beliefs in numbered slots, which it predicts and corrects.

One tracker serves the particle filter on the map and the Kalman filters, so that a comparison is one of motion models
alone.
"""

from typing import NamedTuple, Protocol, runtime_checkable

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Samples
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.traffic import Traffic


class Evidence(NamedTuple):
    """How well beliefs explain their measurements.

    Attributes:
        log_density: (v,) natural log of the density of each measurement given those before it: per square metre of
            position; that of course and speed is a ratio to a false detection's, see `measurements`.
        is_unexplained: (v,) where an outlier explains it better, or nothing does.
        is_moved: (v,) of whom samples were moved, not only weighed.
    """

    log_density: FloatArray
    is_unexplained: BoolArray
    is_moved: BoolArray


@runtime_checkable
class WeighsCues(Protocol):
    """A filter whose beliefs hold what vehicles will do next, which cues report."""

    def weigh_by_cue(self, slot: IntArray, cue: Cue) -> FloatArray:
        """Weigh beliefs by a cue, Eq. 4. (v,) -> (v,) natural log of the cue's density under each, per radian."""
        ...


class BayesFilter(Protocol):
    """Beliefs of many vehicles; every step takes the slots (v,) it is about.

    No belief depends on another.
    """

    @property
    def traffic(self) -> Traffic | None:
        """Of the map; None for models without places."""
        ...

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

    def probability_outside(self, slot: IntArray) -> FloatArray:
        """(v,) probability that a vehicle is outside of the map's cells; 0 for models without places."""
        ...

    def rate_of_ends(self, slot: IntArray) -> FloatArray:
        """(v,) 1/s, rate at which journeys end where vehicles are; 0 for models without places."""
        ...

    def resample(self, slot: IntArray) -> None:
        """Resample beliefs whose samples have degenerated."""
        ...

    def particles(self, slot: IntArray) -> Samples:
        """The samples behind the beliefs, if there are any, until the next step; `vehicle` counts the slots given."""
        ...
