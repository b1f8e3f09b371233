"""Learn from MCAP logs how vehicles move at each place, and track vehicles with what was learned.

In the order of use; `help(dirprim_filter.NAME)` says more, docs/guides shows each at work:

    read_tracks, write_tracks          the vehicles of logs and tables, as Tracks
    learn_primitives, LearningConfig   how they move at each place, as a PrimitiveMap
    save_map, load_map                 the map as a file
    forecast                           where a vehicle may go next
    Detections, Tracker, FilterConfig  what a sensor reports, tracked frame by frame
    read_estimates                     what `dirprim track` wrote, as Estimates

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

    __version__: str

_HOME = {
    "read_tracks": "recording",
    "Tracks": "tracks",
    "write_tracks": "recording",
    "learn_primitives": "primitives.learning",
    "LearningConfig": "config",
    "PrimitiveMap": "primitives.primitive_map",
    "save_map": "recording",
    "load_map": "recording",
    "forecast": "forecasting",
    "Detections": "detections",
    "Tracker": "filtering",
    "FilterConfig": "config",
    "read_estimates": "recording",
    "Estimates": "estimates",
}

__all__ = list(_HOME)
_find = _late(__name__, _HOME)


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - of those who ask

        return version("dirprim-filter")
    return _find(name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
