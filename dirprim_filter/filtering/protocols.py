"""What a tracker asks of a filter: beliefs in numbered slots, which it predicts and corrects.

One tracker serves the particle filter on the map and the Kalman filter, so that a comparison is one of motion models
alone. What some filters can do beside that are protocols of their own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol, Self, runtime_checkable

from dirprim_filter.arrays import AnyArray, BoolArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Samples
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.traffic import Traffic

if TYPE_CHECKING:
    from dirprim_filter.filtering.kalman import ConstantVelocityKalman


class Evidence(NamedTuple):
    """How well beliefs explain their measurements.

    Attributes:
        log_density: (v,) natural log of the density of each measurement given those before it: per square metre of
            position; that of course and speed is a ratio to a false detection's, see `measurements`.
        is_unexplained: (v,) where an outlier explains it better, or nothing does.
        is_moved: (v,) whose belief was moved: samples were, not only weighed, or there are none.
    """

    log_density: FloatArray
    is_unexplained: BoolArray
    is_moved: BoolArray


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
class OnMap(Protocol):
    """A filter of samples on a map, which hold what vehicles will do next."""

    @property
    def traffic(self) -> Traffic | None:
        """Of the map; None for one without cells."""
        ...

    def places(self, slot: IntArray) -> Places:
        """Where vehicles are on the map."""
        ...

    def particles(self, slot: IntArray) -> Samples:
        """The samples behind the beliefs, until the next step; `vehicle` counts the slots given."""
        ...

    def predict(self, slot: IntArray, dt_s: FloatArray, cue: Cue | None = None) -> None:
        """As a `BayesFilter`'s, of vehicles that give a cue: what they do next is drawn from the product of Eq. 4."""
        ...

    def weigh_by_cue(self, slot: IntArray, cue: Cue) -> FloatArray:
        """Weigh beliefs by a cue, Eq. 4. (v,) -> (v,) natural log of the cue's density under each, per radian."""
        ...


class States(NamedTuple):
    """Beliefs as mixtures of Gaussians about samples, a copy; of a filter without samples of one each.

    Attributes:
        sample: (v, 9, P) x, y, their rates and one number more that lasts; then cosine and sine of the direction; then
            what the samples follow, as `Guided.resumed` takes it. Of a filter without samples (v, 7, 1).
        weight: (v, P) of the samples, sums to 1.
        covariance: (v, 4, 4) of place and rates about each sample.
    """

    sample: FloatArray
    weight: FloatArray
    covariance: FloatArray


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


@runtime_checkable
class Guided(Smoothable, Protocol):
    """A filter of samples that can be led to where a vehicle came back."""

    @property
    def own_way_share(self) -> float:
        """Share of vehicles out of sight that go straight on, not as the filter expects; 1 if it knows no places."""
        ...

    def resumed(self, key: int, sample: FloatArray) -> Self:
        """One of the same motion, with one belief: samples (9, P) of equal weight as of `States`; of a uint64 key."""
        ...

    def choose(self, rows: IntArray) -> None:
        """Of the one belief take these samples (P,)."""
        ...
