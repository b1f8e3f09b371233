"""Learn from MCAP logs how vehicles move at each place, and track vehicles with what was learned.

Names are looked up when they are first used: importing the package costs nothing, so the command line answers at once.
"""

from typing import TYPE_CHECKING

from tessellation._late import late as _late

if TYPE_CHECKING:
    from dirprim_filter.config import FilterConfig as FilterConfig
    from dirprim_filter.config import LearningConfig as LearningConfig
    from dirprim_filter.detections import Detections as Detections
    from dirprim_filter.estimates import Estimates as Estimates
    from dirprim_filter.filtering import Tracker as Tracker
    from dirprim_filter.forecasting import forecast as forecast
    from dirprim_filter.primitives.learning import learn_primitives as learn_primitives
    from dirprim_filter.primitives.primitive_map import PrimitiveMap as PrimitiveMap
    from dirprim_filter.recording import load_map as load_map
    from dirprim_filter.recording import read_estimates as read_estimates
    from dirprim_filter.recording import read_tracks as read_tracks
    from dirprim_filter.recording import save_map as save_map
    from dirprim_filter.recording import write_tracks as write_tracks
    from dirprim_filter.tracks import Tracks as Tracks

_HOME = {
    "Detections": "detections",
    "Estimates": "estimates",
    "FilterConfig": "config",
    "LearningConfig": "config",
    "PrimitiveMap": "primitives.primitive_map",
    "Tracker": "filtering",
    "Tracks": "tracks",
    "forecast": "forecasting",
    "learn_primitives": "primitives.learning",
    "load_map": "recording",
    "read_estimates": "recording",
    "read_tracks": "recording",
    "save_map": "recording",
    "write_tracks": "recording",
}

__all__ = list(_HOME)
__getattr__ = _late(__name__, _HOME)
