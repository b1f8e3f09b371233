"""What a tracker asks of a filter: beliefs in numbered slots, moved, measured against and corrected.

The same tracker holds the particle filter on the map and the Kalman filters it is compared with, so that a comparison
is one of motion models and of nothing else.
"""

from typing import NamedTuple, Protocol

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Samples


class Evidence(NamedTuple):
    """What measurements say of the beliefs they were weighed against.

    Attributes:
        log_density: (v,) natural log of the density of each measurement given those before it.
        is_unexplained: (v,) where it is better explained as an outlier, or by nothing at all.
    """

    log_density: FloatArray
    is_unexplained: BoolArray


class BayesFilter(Protocol):
    """Beliefs of many vehicles; every step takes the slots (v,) of those it concerns.

    No belief sees another, unless the filter's configuration says that vehicles interact.
    """

    def reserve(self, n_slots: int) -> None:
        """Make room for so many slots; what the present ones hold stays."""
        ...

    def begin(self, slot: IntArray, key: AnyArray, measured: Detections) -> None:
        """Start beliefs from one measurement each; `key` (v,) uint64 is what their random numbers follow from."""
        ...

    def copy(self, source: IntArray, target: IntArray) -> None:
        """Make the beliefs of `target` those of `source`, random numbers to come included."""
        ...

    def look_around(self, slot: IntArray, home: IntArray) -> None:
        """Note where vehicles are, for filters whose vehicles interact: others of these do nothing.

        Args:
            slot: (v,) what holds their beliefs, all of one instant.
            home: (v,) the slots in which those go on.
        """
        ...

    def predict(self, slot: IntArray, dt_s: FloatArray) -> None:
        """Move beliefs on by times of their own, seconds."""
        ...

    def log_likelihood(self, slot: IntArray, measured: Detections) -> FloatArray:
        """(v,) natural log of the density of each measurement under the belief, outliers aside; changes nothing."""
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
        """(v,) that a vehicle is where by the motion model nobody goes; 0 where the model knows no places."""
        ...

    def resample(self, slot: IntArray) -> None:
        """Renew the samples that have lost their weight."""
        ...

    def particles(self, slot: IntArray) -> Samples:
        """The samples behind the beliefs, if there are any, until the next step; `vehicle` counts the slots given."""
        ...
