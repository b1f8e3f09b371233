"""Which density? Distributions on the circle and of speed."""

from dirprim_filter.distributions.gamma import Gamma as Gamma
from dirprim_filter.distributions.von_mises_mixture import VonMisesMixture as VonMisesMixture
