"""How cells are fitted."""

from __future__ import annotations

from typing import Literal, NamedTuple

from dirprim_filter.config import LearningConfig
from dirprim_filter.primitives._modes import Bounds
from dirprim_filter.primitives.fitting import bounds_of

ModesRule = Literal["bic", "dbscan"]
CellsRule = Literal["joint", "voronoi", "grid"]


class Usual(NamedTuple):
    """A usual mode's spreads: what modes lean on that few vehicles drive."""

    resultant: float  # mean resultant length of its directions; 0: uniform
    speed_spread: float  # log(mean) - mean(log) of its speeds


class Recipe(NamedTuple):
    """How cells are fitted."""

    modes: ModesRule
    curved: bool
    prior_strength: float
    usual: Usual
    config: LearningConfig
    parameter_cost: float = 1.0
    thorough: bool = True  # or roughly, while cells are looked for: such fits are compared, not kept

    @property
    def bounds(self) -> Bounds:
        """The priors and bounds of a fit, as the kernels take them."""
        return bounds_of(
            self.config,
            prior_strength=self.prior_strength,
            usual_resultant=self.usual.resultant,
            speed_spread=self.usual.speed_spread,
            curved=self.curved,
            parameter_cost=self.parameter_cost,
            thorough=self.thorough,
        )
