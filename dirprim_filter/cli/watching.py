"""The rerun viewer of a command: opened where its options say, and served until Ctrl-C."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

if TYPE_CHECKING:
    from dirprim_filter.viewer.sink import RerunSink


def open_viewer(
    place: str,
    *,
    save: Path | None = None,
    spawn: bool = False,
    connect: str | None = None,
    serve: str | None = None,
    force: bool = False,
    particle_stride: int = 1,
    particle_color: Literal["direction", "mode", "weight"] = "direction",
    focus: str | None = None,
    most_in_full: int | None = None,
    truth: Path | None = None,
    group: int | None = None,
) -> RerunSink:
    """A stream to all of these, with the true tracks of a log or group; prints the address of a served one.

    What is shown of one `place` shares the layout of a viewer that stays open.
    """
    from dirprim_filter.recording import read_tracks
    from dirprim_filter.track_ids import world_names
    from dirprim_filter.viewer.focus import DRAWN_IN_FULL
    from dirprim_filter.viewer.stream import open_stream

    true_tracks = None if truth is None else read_tracks(truth, group=group)
    if true_tracks is not None and group is None:  # as the vehicles of several groups are called
        true_tracks = replace(true_tracks, track_id=world_names(true_tracks.track_id, true_tracks.group))
    viewer = open_stream(
        f"dirprim {place}",
        save=save, spawn=spawn, connect=connect, serve=serve, force=force, particle_stride=particle_stride,
        particle_color=particle_color, focus=focus,
        most_in_full=DRAWN_IN_FULL if most_in_full is None else most_in_full,
    )  # fmt: skip
    if true_tracks is not None:
        viewer.log_truth(true_tracks)
    if viewer.outlet.server is not None:
        typer.echo(f"serving at {viewer.outlet.server.page_url}", err=True)
    return viewer


def keep_serving(viewer: RerunSink) -> None:
    """If it serves, send what is left and stay until Ctrl-C."""
    server = viewer.outlet.server
    if server is not None:
        viewer.flush()
        typer.echo("all is sent; Ctrl-C ends the server", err=True)
        server.wait()
