"""What a tracker asks of a filter: beliefs in numbered slots, which it predicts and corrects.

One tracker serves the particle filter on the map and the Kalman filter, so that a comparison is one of motion models
alone. What some filters can do beside that are protocols of their own.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, Self, runtime_checkable

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Samples
from dirprim_filter.filtering.belief import States
from dirprim_filter.filtering.kalman import ConstantVelocityKalman
from dirprim_filter.filtering.measurements import Evidence
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.traffic import Traffic


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
    """A filter of samples on a map, which hold what vehicles will do next.

    Attributes:
        traffic: of the map; None for one without cells.
        longest_step_s: seconds of the longest step of motion that the map allows.
    """

    traffic: Traffic | None
    longest_step_s: float

    def places(self, slot: IntArray) -> Places:
        """Where vehicles are on the map."""
        ...

    def particles(self, slot: IntArray) -> Samples:
        """The samples behind the beliefs, until the next step; `vehicle` counts the slots given."""
        ...

    def predict(
        self, slot: IntArray, dt_s: FloatArray, cue: Cue | None = None, step_s: FloatArray | None = None
    ) -> None:  # fmt: skip
        """As a `BayesFilter`'s, of vehicles that give a cue: what they do next is drawn from the product of Eq. 4.

        In steps of at most (v,) `step_s`, left out the configured.
        """
        ...

    def steer(self, slot: IntArray, key: AnyArray, way: FloatArray, took_s: FloatArray) -> None:
        """After `begin`, with its keys, of vehicles that came there by ways (v, 2) metres in seconds (v,)."""
        ...

    def weigh_by_cue(self, slot: IntArray, cue: Cue) -> FloatArray:
        """Weigh beliefs by a cue, Eq. 4. (v,) -> (v,) natural log of the cue's density under each, per radian."""
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
