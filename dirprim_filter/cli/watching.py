"""The rerun viewer of a command: opened where its options say, and served until Ctrl-C."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from dirprim_filter.cli.losses import FAILED

if TYPE_CHECKING:
    from dirprim_filter.viewer.sink import RerunSink


def open_viewer(place: str, *, truth: Path | None = None, group: int | None = None, **options: Any) -> RerunSink:
    """A stream as of `open_stream`, with the true tracks of a log or group; prints the address of a served one.

    What is shown of one `place` shares the layout of a viewer that stays open.
    """
    from dirprim_filter.recording import read_tracks
    from dirprim_filter.track_ids import world_names
    from dirprim_filter.viewer.sink import open_stream

    true_tracks = None if truth is None else read_tracks(truth, group=group)
    if true_tracks is not None and group is None:  # as the vehicles of several groups are called
        true_tracks = replace(true_tracks, track_id=world_names(true_tracks.track_id, true_tracks.group))
    viewer = open_stream(f"dirprim {place}", **options)
    if true_tracks is not None:
        viewer.log_truth(true_tracks)
    if viewer.stream.server is not None:
        typer.echo(f"serving at {viewer.stream.server.page_url}", err=True)
    return viewer


def keep_serving(viewer: RerunSink) -> None:
    """If it serves, send what is left and stay until Ctrl-C."""
    server = viewer.stream.server
    if server is not None:
        viewer.flush()
        typer.echo("all is sent; Ctrl-C ends the server", err=True)
        server.wait()


def exit_code(viewer: RerunSink | None, otherwise: int) -> int:
    """1 where a viewer or its file was left, of which the log has said why; once it is closed."""
    return FAILED if viewer is not None and viewer.stream.failures else otherwise
