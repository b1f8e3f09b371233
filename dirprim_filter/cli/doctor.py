"""`dirprim doctor`: is this installation sound? What it prints belongs into a report of a fault."""

from __future__ import annotations

import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import typer

from dirprim_filter.cli.compiling import cache_folders

PACKAGES = ("dirprim-filter", "numpy", "scipy", "numba", "mcap", "rerun-sdk", "pyarrow", "protobuf", "matplotlib")
SPEED_M_S, RADIUS_M, NOISE_M, STEP_S = 10.0, 20.0, 0.5, 0.1
"""Of the vehicles of the self test, which drive round a ring."""
N_VEHICLES, N_ROWS = 12, 80


def doctor() -> int:
    """Check the installation: versions, cache, viewer, a self test.

    Exit code 1 where something does not work. Nothing is sent anywhere.

    Example: dirprim doctor
    """
    typer.echo(
        f"python {platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    )
    checks = {
        "packages": _packages, "cache of compiled kernels": _cache, "viewer": _viewer,
        "learn, track, write and read back": _self_test,
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
    return "it is there" + ("" if has_screen else ", but no screen: use `dirprim view FILE --serve`, or --save")


def _self_test() -> str:
    """Learn a ring, track other vehicles there, write and read them back.

    Raises:
        RuntimeError: estimates are not nearer than detections, or are read back otherwise.
    """
    import numpy as np

    from dirprim_filter import Tracker, Tracks, learn_primitives, read_tracks, write_tracks
    from dirprim_filter.detections import Detections

    since, rng = perf_counter(), np.random.default_rng(0)
    vehicle, row = (of.ravel() for of in np.indices((2 * N_VEHICLES, N_ROWS)))
    angle = rng.uniform(0.0, 2.0 * np.pi, 2 * N_VEHICLES)[vehicle] + row * STEP_S * SPEED_M_S / RADIUS_M
    ring = Tracks(
        track_id=vehicle, time_ns=row * round(STEP_S * 1e9),
        position=RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)]),
        direction=np.angle(np.exp(1j * (angle + 0.5 * np.pi))), speed=np.full(vehicle.size, SPEED_M_S),
    )  # fmt: skip
    learned = learn_primitives(ring[vehicle < N_VEHICLES], tessellation="grid", cell_size=8.0, rng=rng)
    others = ring[vehicle >= N_VEHICLES]
    seen = Detections(
        track_id=others.track_id, time_ns=others.time_ns,
        position=others.position + rng.normal(0.0, NOISE_M, others.position.shape),
    )  # fmt: skip
    place = {(str(name), t): at for name, t, at in zip(others.track_id, others.time_ns, others.position, strict=True)}
    tracker = Tracker(learned, rng=rng)
    errors = [
        at - place[str(name), frame.time_ns[0]]
        for frame in seen.frames()
        for found in [tracker.step(frame)]
        for name, at in zip(found.track_id, found.position, strict=True)
    ]
    rmse, raw = float(np.sqrt(2.0 * np.mean(np.square(errors)))), float(np.sqrt(2.0) * NOISE_M)
    if not rmse < raw:
        raise RuntimeError(f"expected estimates nearer than {raw:.2f} m, got {rmse:.2f} m")
    with TemporaryDirectory() as folder:
        write_tracks(others, Path(folder) / "tracks.mcap")
        if len(read_tracks(Path(folder) / "tracks.mcap")) != len(others):
            raise RuntimeError("expected a log to be read back whole")
    return f"{rmse:.2f} m where detections err by {raw:.2f} m, in {perf_counter() - since:.0f} s"
