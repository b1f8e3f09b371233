"""`dirprim doctor`: is this installation sound? What it prints belongs into a report of a fault."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Annotated, Any

import typer

from dirprim_filter.cli.compiling import cache_folders, warm_up

PACKAGES = ("dirprim-filter", "numpy", "scipy", "numba", "mcap", "rerun-sdk", "pyarrow", "protobuf", "matplotlib")
LEARN_NS, TRACK_NS, RAW_M = 120 * 10**9, 15 * 10**9, 0.71
"""Of the self test: so much of two recordings, and how far detections are off in them."""


def doctor(
    compiles: Annotated[bool, typer.Option("--compile", help="Compile what learning and tracking need.")] = False,
) -> int:
    """Check the installation: versions, cache, viewer, a self test.

    Exit code 1 where something does not work. Nothing is sent anywhere. With --compile first uses start at once, as in
    an image of a container.

    Example: dirprim doctor --compile
    """
    typer.echo(
        f"python {platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    )
    checks: dict[str, Callable[[], str]] = {
        "packages": _packages, "cache of compiled kernels": _cache, "viewer": _viewer,
        "learn, track, write and read back": partial(_self_test, compiles=compiles),
    }  # fmt: skip
    well = True
    for name, check in checks.items():
        try:
            typer.echo(f"ok: {name}: {check()}")
        except Exception as error:  # noqa: BLE001 - whatever it is, it is printed, and the others are checked
            well = False
            typer.echo(f"FAILED: {name}: {type(error).__name__}: {error}")
    return 0 if well else 1


def _packages() -> str:
    from importlib.metadata import version

    return ", ".join(f"{name} {version(name)}" for name in PACKAGES)


def _cache() -> str:
    folder = cache_folders()[0]
    with TemporaryDirectory(dir=folder):
        pass
    return f"{folder} can be written, {sum(1 for _ in folder.rglob('*.nbi'))} kernels are compiled"


def _viewer() -> str:
    from dirprim_filter.viewer.process import viewer_program

    if viewer_program() is None:
        return "rerun's program is not installed; --save still writes files for it"
    has_screen = sys.platform in ("darwin", "win32") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    if has_screen:
        return "it is there"
    return "it is there, but no screen: use --save, and `rerun --serve-web --bind 127.0.0.1 FILE.rrd`"


def _self_test(*, compiles: bool) -> str:
    """Learn from a recording that ships, write the map and read it back, track another recording with it.

    Where it `compiles` it learns with all that `learn` does by default, and forecasts too: each kernel on the way is
    kept.

    Raises:
        RuntimeError: estimates are not nearer than detections.
    """
    import numpy as np

    from dirprim_filter import Estimates, Tracker, learn_primitives, load_map, read_tracks, save_map
    from dirprim_filter.cli.demo import recordings_folder
    from dirprim_filter.evaluation.tracked_rows import TrackedRows
    from dirprim_filter.evaluation.tracking_report import report_of
    from dirprim_filter.recording.reader import stream_detections

    since, folder = perf_counter(), recordings_folder()
    log, rng = folder / "roundabout_track.mcap", np.random.default_rng(0)
    known = read_tracks(folder / "roundabout_learn.mcap", end_ns=LEARN_NS)
    how: dict[str, Any] = {} if compiles else {"tessellation": "grid", "cell_size": 8.0}
    if compiles:
        warm_up()
    with TemporaryDirectory() as work:
        save_map(learn_primitives(known, rng=rng, **how), Path(work) / "map.mcap")
        tracker = Tracker(load_map(Path(work) / "map.mcap"), rng=rng)
    found = Estimates.concatenate([tracker.step(frame) for frame in stream_detections(log, end_ns=TRACK_NS)])
    truth = read_tracks(log, topics="/objects", end_ns=TRACK_NS)
    report = report_of(TrackedRows.of(found), truth, with_ids=True).report
    if not report.rmse < RAW_M:
        raise RuntimeError(f"expected estimates nearer than {RAW_M:.2f} m, got {report.rmse:.2f} m")
    return f"{report.rmse:.2f} m where detections err by {RAW_M:.2f} m, in {perf_counter() - since:.0f} s"
