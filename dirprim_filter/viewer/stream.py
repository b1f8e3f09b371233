"""Where what is shown goes: an .rrd file, a viewer started for it, a running viewer, a server for browsers."""

from __future__ import annotations

import re
import uuid
from contextlib import ExitStack
from pathlib import Path

import rerun as rr

from dirprim_filter.partial_file import PartialFile
from dirprim_filter.viewer.focus import DRAWN_IN_FULL
from dirprim_filter.viewer.marks import ParticleColor
from dirprim_filter.viewer.outlet import Outlet
from dirprim_filter.viewer.program import WebServer, require_listener, spawn_viewer
from dirprim_filter.viewer.sink import RerunSink


def open_stream(
    application_id: str = "dirprim",
    *,
    save: Path | None = None,
    spawn: bool = False,
    connect: str | None = None,
    serve: str | None = None,
    force: bool = False,
    particle_stride: int = 1,
    particle_color: ParticleColor = "direction",
    focus: str | None = None,
    most_in_full: int = DRAWN_IN_FULL,
) -> RerunSink:
    """A stream to a file, to a viewer started for it, to a running viewer, to browsers, or to several of them.

    Args:
        application_id: recordings with the same one share the layout of a viewer that is open, the place it looks at
            included: so it names the place. Characters other than ASCII letters, digits, _ and - become spaces.
        save: an .rrd file. It grows under a temporary name, see `PartialFile`.
        spawn: start a viewer on this machine and leave it open.
        connect: the address of a running viewer, such as `program.VIEWER_URL`.
        serve: an address of this machine, such as 127.0.0.1, at which browsers find the stream until it is closed.
        force: overwrite `save`.
        particle_stride: show one particle in so many.
        particle_color: what the colour of particles encodes.
        focus: id of the vehicle to follow. Default: the one with the largest innovations.
        most_in_full: vehicles of a crowd that are drawn with particles, ellipse, name and forecast.

    Raises:
        ValueError: nowhere to stream to, or a stride below 1.
        OutputExistsError: `save` exists and `force` is not given.
        ConnectionError: no viewer answers at `connect`, or none could be started.
        OSError: `save` cannot be written.
    """
    if save is None and not spawn and connect is None and serve is None:
        raise ValueError(
            "expected at least one place to stream to, got none; "
            "--spawn shows it on a screen, --save FILE.rrd keeps it for `dirprim view`"
        )
    if particle_stride < 1:
        raise ValueError(f"particle_stride: expected at least 1, got {particle_stride}")
    file = None
    if save is not None:
        save.parent.mkdir(parents=True, exist_ok=True)
        file = PartialFile(save, force=force, keep=True)
    live = spawn or connect is not None or serve is not None
    application = re.sub(r"[^A-Za-z0-9_-]+", " ", application_id).strip()
    stream = rr.RecordingStream(application, recording_id=_identity(save, live=live))
    stream.set_log_time_enabled(False)
    sinks: list[rr.GrpcSink | rr.FileSink] = []
    server = None
    with ExitStack() as if_failed:
        if serve is not None:
            server = if_failed.enter_context(WebServer(serve))
            sinks.append(rr.GrpcSink(server.stream_url))
        if spawn:
            sinks.append(rr.GrpcSink(spawn_viewer()))
        if connect is not None:
            require_listener(connect, "start one with `rerun`")
            sinks.append(rr.GrpcSink(connect))
        if file is not None:
            file.__enter__()
            sinks.append(rr.FileSink(file.partial))
        stream.set_sinks(*sinks)
        if_failed.pop_all()
    outlet = Outlet(stream, file=file, live=live, server=server)
    return RerunSink(
        outlet, particle_stride=particle_stride, particle_color=particle_color, focus=focus, most_in_full=most_in_full
    )


def _identity(save: Path | None, *, live: bool) -> uuid.UUID:
    """The same for a file in every run; but a viewer that is still open must not mix two runs into one."""
    if live or save is None:
        return uuid.uuid4()
    return uuid.uuid5(uuid.NAMESPACE_URL, save.resolve().as_uri())
