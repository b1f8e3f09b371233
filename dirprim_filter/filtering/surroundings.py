"""Where the other vehicles were in the frame before: what drivers respond to until the next."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.primitives import PrimitiveMap
from dirprim_filter.primitives._leader import ALONE, LeaderTable


def leader_table(primitive_map: PrimitiveMap, config: FilterConfig) -> LeaderTable:
    """The response to leaders: none without interaction, or where the map knows of none."""
    response = primitive_map.motion.leader
    if response is None or config.interaction == "none":
        return ALONE
    return LeaderTable(response.gain, response.push, response.trust, response.start_rate)


class Surroundings:
    """The vehicles of a frame, and which of them the belief in each slot is of.

    Attributes:
        state: (1, m, 4) place, direction and speed.
        own: (slots,) the row of the vehicle whose belief a slot holds, -1 for none of them.
        since_s: (slots,) by how much each belief has moved on since.
    """

    def __init__(self) -> None:
        self.state: FloatArray = np.empty((1, 0, 4))
        self.own: IntArray = np.empty(0, np.int64)
        self.since_s: FloatArray = np.empty(0)

    def reserve(self, n_slots: int) -> None:
        """Make room for so many slots."""
        more = n_slots - self.own.size
        if more > 0:
            self.own = np.append(self.own, np.full(more, -1))
            self.since_s = np.append(self.since_s, np.zeros(more))

    def see(self, moments: FloatArray, home: IntArray) -> None:
        """Vehicles, as `BayesFilter.moments` gives them, and the slots of their beliefs. (m, 10), (m,)."""
        self.state = np.ascontiguousarray(moments[None][..., [0, 1, 5, 7]])
        self.own[:], self.since_s[:] = -1, 0.0
        self.own[home] = np.arange(home.size)

    def copy(self, source: IntArray, target: IntArray) -> None:
        """The beliefs of `target` are those of `source`."""
        self.own[target], self.since_s[target] = self.own[source], self.since_s[source]
