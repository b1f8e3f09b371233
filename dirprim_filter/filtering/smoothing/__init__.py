"""Where was it? Beliefs corrected by what was measured later: a backward sweep over what a filter kept."""

from dirprim_filter.filtering.smoothing.smoother import Smoother as Smoother
