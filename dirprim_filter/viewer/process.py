"""The rerun viewer as a process: the SDK's own `spawn` would listen to whoever reaches this machine."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

ELAPSED = "elapsed"
"""The time line that the viewer opens with."""
VIEWER_PORT = 9876
VIEWER_URL = f"rerun+http://127.0.0.1:{VIEWER_PORT}/proxy"
THIS_MACHINE = "127.0.0.1"
SETTLING_S = 1.0
"""In which a viewer without a screen ends: it listens before it knows whether there is one."""
RESTING_S = 1.5
"""Between two looks at a picture that may still change."""
NO_PICTURE = "the viewer draws no picture without a screen; it needs a Vulkan driver (Debian: mesa-vulkan-drivers)"
WITHOUT_A_SCREEN = "it needs a screen; else use --save FILE.rrd, and `rerun --serve-web --bind 127.0.0.1 FILE.rrd`"


def viewer_program() -> str | None:
    """The viewer that came with the SDK: the search path may lack it, or hold one of another version."""
    package = find_spec("rerun_cli")
    program = Path(package.origin).with_name("rerun") if package and package.origin else None
    return str(program) if program and program.exists() else None


def spawn_viewer(recordings: Sequence[Path] = ()) -> str:
    """Start a viewer on this machine, with recordings or waiting for a stream, and leave it open.

    It is always a new one: a viewer at the default port may belong to another program.

    Returns:
        The address to stream to.

    Raises:
        ConnectionError: none could be started.
    """
    port = free_port()
    shown = [str(path) for path in recordings] or ["--expect-data-soon"]
    try:
        viewer = subprocess.Popen(  # noqa: S603 - the SDK's own program, without a shell
            [viewer_program() or "rerun", "--bind", THIS_MACHINE, "--port", str(port), *shown],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        raise ConnectionError(f"the viewer did not start ({error}); {WITHOUT_A_SCREEN}") from error
    with ExitStack() as left:
        left.callback(viewer.terminate)
        if _answers(viewer, port):
            time.sleep(SETTLING_S)
            if viewer.poll() is None:
                left.pop_all()
                return f"rerun+http://{THIS_MACHINE}:{port}/proxy"
    raise ConnectionError(f"the viewer did not start; {WITHOUT_A_SCREEN}")


def screenshot(recording: Path, elapsed_s: float) -> bytes:
    """The window at an instant, PNG, without a screen: once two looks at it agree, as data come late.

    Raises:
        ConnectionError: there is no viewer, or it cannot draw here.
    """
    from rerun.experimental import ViewerClient  # noqa: PLC0415 - only for pictures

    try:
        client = ViewerClient.spawn(headless=True, port=free_port(), executable_path=viewer_program())
    except (OSError, RuntimeError) as error:
        raise ConnectionError(f"{NO_PICTURE} ({error})") from error
    try:
        client.open(str(recording))
        time.sleep(2 * RESTING_S)
        client.set_time(ELAPSED, duration=elapsed_s, play_state="paused")
        before = b""
        for _ in range(60):
            time.sleep(RESTING_S)
            with suppress(TimeoutError):  # of one look, on a busy machine
                now = client.take_screenshot()
                if now == before:
                    return now
                before = now
    except (OSError, RuntimeError) as error:
        raise ConnectionError(f"{recording}: {NO_PICTURE} ({error})") from error
    finally:
        client.quit()
    raise ConnectionError(f"{recording}: the viewer's picture never came to rest")


def require_listener(url: str) -> None:
    """Make sure that a viewer answers: the SDK would retry for seconds and then lose what was logged.

    Raises:
        ConnectionError: none does, or that is no address.
    """
    try:
        place = urlsplit(url)
        host, port = place.hostname, place.port or VIEWER_PORT
    except ValueError:  # a port that is none
        host = None
    if host is None:
        raise ConnectionError(f"{url}: expected an address such as {VIEWER_URL}")
    try:
        socket.create_connection((host, port), timeout=5.0).close()
    except OSError as error:
        raise ConnectionError(f"{url}: no viewer answers ({error}); start one with `rerun`") from error


def free_port() -> int:
    """Of this machine, for a viewer."""
    with socket.socket() as probe:
        probe.bind((THIS_MACHINE, 0))
        return int(probe.getsockname()[1])


def _answers(program: subprocess.Popen[bytes], port: int) -> bool:
    """Whether a program listens at its port before it ends, or time is up."""
    until = time.monotonic() + 20.0
    while program.poll() is None and time.monotonic() < until:
        with suppress(OSError):
            socket.create_connection((THIS_MACHINE, port), timeout=1.0).close()
            return True
        time.sleep(0.05)
    return False
