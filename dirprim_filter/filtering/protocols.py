"""The steps of every filter that can be replayed."""

from typing import Protocol

from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles


class BayesFilter(Protocol):
    """One belief for each track id, moved and corrected frame by frame; the steps are called in this order."""

    def predict(self, detections: Detections) -> None:
        """Move the belief of every vehicle in the frame to the frame's time; begin those that are new."""
        ...

    def weigh(self) -> None:
        """Correct the moved beliefs by the frame's positions."""
        ...

    def estimate(self) -> Estimates:
        """What is believed of the frame's vehicles."""
        ...

    def particles(self) -> Particles:
        """The samples behind the estimates, if there are any."""
        ...

    def resample(self) -> None:
        """Renew samples that have lost their weight."""
        ...
