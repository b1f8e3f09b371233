"""Disk: MCAP logs in and out, maps, and tables of other formats.

Names are looked up when they are first used: a command that needs but the index of a log answers at once.
"""

from typing import TYPE_CHECKING

from tessellation._late import late as _late

if TYPE_CHECKING:
    from dirprim_filter.recording.map_file import load_map as load_map
    from dirprim_filter.recording.map_file import save_map as save_map
    from dirprim_filter.recording.reader import read_assigned as read_assigned
    from dirprim_filter.recording.reader import read_estimates as read_estimates
    from dirprim_filter.recording.reader import read_tracks as read_tracks
    from dirprim_filter.recording.writer import write_tracks as write_tracks

_HOME = {
    "load_map": "map_file", "read_assigned": "reader", "read_estimates": "reader", "read_tracks": "reader",
    "save_map": "map_file", "write_tracks": "writer",
}  # fmt: skip

__all__ = list(_HOME)
__getattr__ = _late(__name__, _HOME)
