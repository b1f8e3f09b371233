"""Which density? Distributions on the circle and of speed.

Names are looked up when they are first used: who needs but angles does without scipy.
"""

from typing import TYPE_CHECKING

from tessellation._late import late as _late

if TYPE_CHECKING:
    from dirprim_filter.distributions.gamma import Gamma as Gamma
    from dirprim_filter.distributions.von_mises_mixture import VonMisesMixture as VonMisesMixture

_HOME = {"Gamma": "gamma", "VonMisesMixture": "von_mises_mixture"}

__all__ = list(_HOME)
__getattr__ = _late(__name__, _HOME)
