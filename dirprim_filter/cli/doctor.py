"""`dirprim doctor`: what is installed, for a report of a fault; and compiling before the first use."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from typing import Annotated

import typer

import dirprim_filter as dp
from dirprim_filter.cli.compiling import cache_folders, warm_up

PACKAGES = ("dirprim-filter", "numpy", "scipy", "numba", "mcap", "rerun-sdk", "pyarrow", "protobuf", "matplotlib")


def doctor(
    compiles: Annotated[bool, typer.Option("--compile", help="Compile what learning and tracking need.")] = False,
) -> None:
    """Print versions and where compiled kernels are.

    Nothing is sent anywhere. With --compile first uses start at once, as in an image of a container.

    Example: dirprim doctor --compile
    """
    if compiles:  # learns and tracks as commands do by default: each kernel on the way is kept
        import numpy as np

        from dirprim_filter.cli.demo import recordings_folder
        from dirprim_filter.recording.reader import stream_detections

        warm_up()
        rng, recordings = np.random.default_rng(0), recordings_folder()
        learned = dp.learn_primitives(dp.read_tracks(recordings / "roundabout_learn.mcap", end_ns=120 * 10**9), rng=rng)
        tracker = dp.Tracker(learned, rng=rng)
        for frame in stream_detections(recordings / "roundabout_track.mcap", end_ns=15 * 10**9):
            tracker.step(frame)
    folder = cache_folders()[0]
    typer.echo(
        f"python {platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores\n"
        f"{', '.join(f'{name} {version(name)}' for name in PACKAGES)}\n"
        f"{folder}: {sum(1 for _ in folder.rglob('*.nbi'))} kernels are compiled"
    )
