"""What one message of a log says about objects, whatever its schema."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tessellation.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservedFrame:
    """The objects of one message, in the message's order.

    Attributes:
        track_id: n ids, as text.
        stamp_ns: the time the message itself carries, nanoseconds; None where it carries none.
        position: (n, 2) metres in the log's map frame.
        direction: (n,) course over ground, radians; NaN where the message does not tell.
        speed: (n,) m/s; NaN where the message does not tell.
        group: (n,) int64; 0 where the message knows no groups.
        covariance: (n, 2, 2) of the position's error, square metres; NaN where the message does not tell. Left out:
            nowhere.
    """

    track_id: Sequence[str]
    stamp_ns: int | None
    position: FloatArray
    direction: FloatArray
    speed: FloatArray
    group: IntArray
    covariance: FloatArray = field(default_factory=lambda: np.empty((0, 2, 2)))

    def __post_init__(self) -> None:
        if len(self.covariance) == 0:
            object.__setattr__(self, "covariance", np.full((len(self.track_id), 2, 2), np.nan))

    def __getitem__(self, rows: BoolArray) -> ObservedFrame:
        """The rows of a mask."""
        return ObservedFrame(
            track_id=[name for name, keep in zip(self.track_id, rows.tolist(), strict=True) if keep],
            stamp_ns=self.stamp_ns,
            position=self.position[rows],
            direction=self.direction[rows],
            speed=self.speed[rows],
            group=self.group[rows],
            covariance=self.covariance[rows],
        )

    def without_motion(self) -> ObservedFrame:
        """The same rows, direction and speed unknown."""
        unknown = np.full(len(self.track_id), np.nan)
        return replace(self, direction=unknown, speed=unknown)

    @classmethod
    def of_positions(cls, track_id: Sequence[str], stamp_ns: int | None, position: FloatArray) -> ObservedFrame:
        """Objects of which only the position is known."""
        n = len(track_id)
        unknown = np.full(n, np.nan)
        return cls(
            track_id=track_id,
            stamp_ns=stamp_ns,
            position=position.reshape(n, 2),
            direction=unknown,
            speed=unknown,
            group=np.zeros(n, np.int64),
        )
