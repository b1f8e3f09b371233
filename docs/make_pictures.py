"""Makes README's pictures from the recordings that ship: `python docs/make_pictures.py`, in the repository's root.

`recordings/roundabout.png` is what `dirprim demo` draws. `recordings/viewer.png` is the rerun viewer, without a screen,
in the middle of a tracked intersection; it needs a Vulkan driver (Debian: mesa-vulkan-drivers).
"""

from __future__ import annotations

import io
import shutil
import socket
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient

from dirprim_filter.cli.main import run
from dirprim_filter.viewer.program import viewer_program
from dirprim_filter.viewer.timeline import TIMELINE

RECORDINGS = Path("recordings")
SHOWN_NS = 55_000_000_000
"""Vehicles turn, wait, and go straight on."""
MENU = 36
"""Rows of the window's own bar, which says nothing."""
WIDTH = 1600
RESTING_S = 1.5
MOST_LOOKS = 60


def demo(folder: Path) -> None:
    """The picture of the demo."""
    succeed("demo", "-o", folder / "demo")
    shutil.copy(folder / "demo" / "demo.png", RECORDINGS / "roundabout.png")


def viewer(folder: Path) -> None:
    """The viewer's window."""
    log, learned = RECORDINGS / "intersection_track.mcap", folder / "map.mcap"
    succeed("learn", RECORDINGS / "intersection_learn.mcap", "-o", learned)
    succeed(
        "track", log, "--map", learned, "-o", folder / "tracks.mcap", "--save", folder / "tracks.rrd", "--truth", log,
        "--no-ids", "--forecast", 4,
    )  # fmt: skip
    window = Image.open(io.BytesIO(screenshot(folder / "tracks.rrd", SHOWN_NS))).convert("RGB")
    shown = window.crop((0, MENU, *window.size))
    small = shown.resize((WIDTH, round(shown.height * WIDTH / shown.width)), Image.Resampling.LANCZOS)
    small.save(RECORDINGS / "viewer.png", optimize=True)


def screenshot(recording: Path, time_ns: int) -> bytes:
    """The window at an instant, PNG, once two looks at it agree: notes of its own have gone, all data have come."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    client = ViewerClient.spawn(headless=True, port=port, executable_path=viewer_program())
    try:
        client.open(str(recording))
        time.sleep(2 * RESTING_S)
        client.set_time(TIMELINE, timestamp=np.datetime64(time_ns, "ns"), play_state="paused")
        before = b""
        for _ in range(MOST_LOOKS):
            time.sleep(RESTING_S)
            now = client.take_screenshot()
            if now == before:
                return now
            before = now
    finally:
        client.quit()
    raise TimeoutError(f"{recording}: the viewer's picture never came to rest")


def succeed(*arguments: object) -> None:
    """Run a command of `dirprim`, well."""
    if run([str(argument) for argument in arguments]) != 0:
        raise SystemExit(1)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        demo(Path(made))
        viewer(Path(made))
