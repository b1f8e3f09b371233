"""Where was it? Beliefs corrected by what was measured later: a backward sweep over what a filter kept."""

from typing import TYPE_CHECKING

from tessellation._late import late as _late

if TYPE_CHECKING:
    from dirprim_filter.filtering.smoothing.smoother import Smoother as Smoother

_HOME = {"Smoother": "smoother"}
__all__ = list(_HOME)
__getattr__ = _late(__name__, _HOME)
