"""Makes the pictures of README and the site from the recordings that ship: `python docs/make_pictures.py`, in the root.

The animation of the blind scene is made by `make_animation.py`.

`recordings/viewer.png` is the rerun viewer, without a screen, in the middle of a tracked intersection; it needs a
Vulkan driver (Debian: mesa-vulkan-drivers). `recordings/gap.png` compares filter and smoother on vehicles that are out
of sight for three seconds. `recordings/experiment.png` is the figure of the experiment in `docs/guides/rival.md`.

`recordings/foxglove.png` is the demo in Lichtblick, the open fork of Foxglove. The environment variable
FOXGLOVE_PICTURE names a program that opens a log there and writes its window to a PNG of 1600 x 1000, called as
`PROGRAM LOG PNG --layout LAYOUT --at SECONDS`. Without it that picture stays as it is.
"""

from __future__ import annotations

import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection
from PIL import Image

from dirprim_filter import PrimitiveMap, load_map, read_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.drawing.shapes import covariance_axes
from dirprim_filter.evaluation.scenes import Scene, followed
from dirprim_filter.evaluation.tracking_experiment import TrackingExperiment
from dirprim_filter.filtering import ParticleFilter
from dirprim_filter.viewer.process import screenshot

RECORDINGS = Path("recordings")
SECOND_NS = 1_000_000_000
SHOWN_S = 55.0
"""Vehicles turn, wait, and go straight on."""
MENU = 36
"""Rows of the window's own bar, which says nothing."""
WIDTH = 1600
FOXGLOVE_AT_S = 45.0
FOXGLOVE_PANELS = (320, 44, 1600, 920)
"""Left, top, right and bottom of the panels in the window, pixels."""


def demo(folder: Path) -> None:
    """The panels of the demo in Foxglove's window, where a program draws them."""
    program = shlex.split(os.environ.get("FOXGLOVE_PICTURE", ""))
    if not program:
        return
    succeed("demo", "-o", folder / "demo")
    layout, window = Path(__file__).with_name("guides") / "foxglove_layout.json", folder / "demo.png"
    options = ["--layout", str(layout), "--at", str(FOXGLOVE_AT_S)]
    subprocess.run([*program, str(folder / "demo/tracks.mcap"), str(window), *options], check=True)  # noqa: S603 (the caller's own program)
    panels = Image.open(window).convert("RGB").crop(FOXGLOVE_PANELS)
    panels.quantize(colors=256).save(RECORDINGS / "foxglove.png", optimize=True)


def experiment(folder: Path) -> None:
    """The figure of the guide's experiment, by its own files and command."""
    guide = Path(__file__).with_name("guides") / "rival.md"
    for name, body in re.findall(r"^```\w+ ([\w.]+)\n(.*?)^```$", guide.read_text(), flags=re.MULTILINE | re.DOTALL):
        (folder / name).write_text(body)
    tracker = shlex.join([sys.executable, str(folder / "my_tracker.py")])
    succeed(
        "evaluate", "tracking", RECORDINGS / "intersection_track.mcap", "--config", folder / "experiment.toml",
        "--method", f"filterpy={tracker} {{detections}} {{instants}} {{estimates}} 5",
        "--plot", folder / "experiment.png",
    )  # fmt: skip
    shutil.copy(folder / "experiment.png", RECORDINGS)


def viewer(folder: Path, learned: Path) -> None:
    """The viewer's window."""
    log = RECORDINGS / "intersection_track.mcap"
    succeed(
        "track", log, "--map", learned, "-o", folder / "tracks.mcap", "--save", folder / "tracks.rrd",
        "--set", f"truth={log}", "--no-ids", "--forecast", 4,
    )  # fmt: skip
    window = Image.open(io.BytesIO(screenshot(folder / "tracks.rrd", SHOWN_S))).convert("RGB")
    shown = window.crop((0, MENU, *window.size))
    small = shown.resize((WIDTH, round(shown.height * WIDTH / shown.width)), Image.Resampling.LANCZOS)
    small.save(RECORDINGS / "viewer.png", optimize=True)


def gap(primitives: PrimitiveMap, *, n_shown: int = 4) -> None:
    """Paths of filter and smoother beside the truth, of the vehicles that turn most unseen; ellipses hold 90 %."""
    experiment = TrackingExperiment()
    scene = Scene.of(read_tracks(RECORDINGS / "intersection_track.mcap"), experiment, seed=1)
    ways = followed([scene], lambda: ParticleFilter(primitives, experiment.filter), experiment, smooth=True, seed=1)
    truth, hidden = scene.truth, scene.is_hidden
    speed = np.where(hidden, truth.speed, 0.0)
    east, north = (np.bincount(truth.vehicle, speed * of(truth.direction)) for of in (np.cos, np.sin))
    chosen = np.argsort(np.hypot(east, north) - np.bincount(truth.vehicle, speed))[:n_shown]
    figure, panels = plt.subplots(1, n_shown, figsize=(4.0 * n_shown, 4.2), layout="constrained")
    for axes, vehicle in zip(panels, chosen.tolist(), strict=True):
        rows = truth.vehicle == vehicle
        unseen_ns = truth.time_ns[rows & hidden]
        from_ns, to_ns = unseen_ns.min() - SECOND_NS, unseen_ns.max() + SECOND_NS
        rows &= (truth.time_ns >= from_ns) & (truth.time_ns <= to_ns)
        axes.plot(*truth.position[rows].T, color="0.75", linewidth=7, solid_capstyle="round", label="truth")
        for found, color, width, name in (
            (ways.filtered[0].rows, "#d55e00", 1.0, "filter"), (ways.smoothed[0].rows, "#0072b2", 2.5, "smoother"),
        ):  # fmt: skip
            own = (found.track_id == truth.track_id[rows][0]) & (found.time_ns >= from_ns) & (found.time_ns <= to_ns)
            of = found[own]
            axes.plot(*of.position.T, color=color, linewidth=width, label=name)
            coasting = of[np.isin(of.time_ns, unseen_ns[4::5])]
            half, angle = covariance_axes(coasting.covariance, probability=0.9)
            axes.add_collection(
                EllipseCollection(
                    2.0 * half[:, 0], 2.0 * half[:, 1], np.degrees(angle), units="xy", offsets=coasting.position,
                    offset_transform=axes.transData, facecolors="none", edgecolors=color, linewidths=0.5,
                )
            )  # fmt: skip
        seen = scene.seen[(scene.seen.track_id == str(truth.track_id[rows][0])) & (scene.seen.time_ns >= from_ns)]
        axes.plot(*seen[seen.time_ns <= to_ns].position.T, "kx", markersize=4, label="detections")
        middle, half = truth.position[rows].mean(axis=0), 0.6 * np.ptp(truth.position[rows], axis=0).max() + 3.0
        axes.set(xlim=middle[0] + [-half, half], ylim=middle[1] + [-half, half], aspect="equal", xlabel="east, m")
    panels[0].set_ylabel("north, m")
    panels[0].legend(frameon=False)
    figure.savefig(RECORDINGS / "gap.png", dpi=110)


def succeed(*arguments: object) -> None:
    """Run a command of `dirprim`, well."""
    if run([str(argument) for argument in arguments]) != 0:
        raise SystemExit(1)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        experiment(Path(made))
        demo(Path(made))
        succeed("learn", RECORDINGS / "intersection_learn.mcap", "-o", learned := Path(made) / "map.mcap")
        viewer(Path(made), learned)
        gap(load_map(learned))
