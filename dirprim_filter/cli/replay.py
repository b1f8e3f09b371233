"""`dirprim replay`: a log's tracks in rerun, at the speed at which they were recorded or another."""

from __future__ import annotations

from typing import Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.counts import counted
from dirprim_filter.cli.options import Connect, Force, Log, Save, Spawn
from dirprim_filter.cli.reading import Reading, reads_logs


@reads_logs
def replay(
    log: Log,
    rate: Annotated[float, typer.Option("--rate", help="Speed: 2 is twice as fast; inf does not wait.")] = 1.0,
    save: Save = None,
    spawn: Spawn = False,
    connect: Connect = None,
    reading: Reading = Reading(),
    force: Force = False,
) -> int:
    """Play the tracks of a log into rerun: the estimates that `dirprim track` wrote, else the objects.

    Example: dirprim replay tracks.mcap --rate 2 --spawn
    """
    from dirprim_filter.cli.progress import with_progress
    from dirprim_filter.recording.playback import paced
    from dirprim_filter.viewer.stream import open_stream

    playback = reading.playback(log)
    frames = paced(playback, rate)
    n_frames = 0
    with open_stream(save=save, spawn=spawn, connect=connect, force=force) as viewer:
        for frame in with_progress(frames, what=f"playing {log.name}", end_ns=playback.end_ns):
            viewer.write(frame)
            n_frames += 1
    typer.echo(f"{log}: {counted(n_frames, 'frame')} of {', '.join(sorted(playback.topics))}")
    return losses.exit_code(playback.losses)
