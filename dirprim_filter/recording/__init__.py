"""Disk: MCAP logs in and out, maps, and tables of other formats."""

from dirprim_filter.recording.map_file import load_map as load_map
from dirprim_filter.recording.map_file import save_map as save_map
from dirprim_filter.recording.reader import read_estimates as read_estimates
from dirprim_filter.recording.reader import read_tracks as read_tracks
from dirprim_filter.recording.writer import write_tracks as write_tracks
