"""The rerun viewer as a process: on this machine's screen, or as a server of the web viewer.

The SDK's own `spawn` and `serve_grpc` would listen to whoever reaches this machine, and their server would outlive a
killed parent: so the viewer's program is started here.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Self
from urllib.parse import quote, urlsplit

VIEWER_PORT, WEB_PORT = 9876, 9090
VIEWER_URL = f"rerun+http://127.0.0.1:{VIEWER_PORT}/proxy"
THIS_MACHINE = "127.0.0.1"
SETTLING_S = 1.0
"""In which a viewer without a screen ends: it listens before it knows whether there is one."""
SERVING_WITHIN_S = 20.0
WITHOUT_A_SCREEN = "it needs a screen; without one, --save FILE.rrd writes a file and --serve serves the web viewer"
ANY_ADDRESS = ("0.0.0.0", "::")  # noqa: S104 - they are what a user may ask for
COMPANION = """
import subprocess, sys, threading
program = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
def watch():
    sys.stdin.buffer.read()  # nothing is ever written: it ends when the writer is gone, killed or not
    program.terminate()
threading.Thread(target=watch, daemon=True).start()
sys.exit(program.wait())
"""
"""Starts a program that ends with this process."""


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
    port = _free_port(THIS_MACHINE, 0)
    shown = [str(path) for path in recordings] or ["--expect-data-soon"]
    try:
        viewer = subprocess.Popen(  # noqa: S603 - the SDK's own program, without a shell
            [viewer_program() or "rerun", "--bind", THIS_MACHINE, "--port", str(port), *shown],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        raise ConnectionError(f"the viewer did not start ({error}); {WITHOUT_A_SCREEN}") from error
    try:
        if _answers(viewer, THIS_MACHINE, (port,)):
            time.sleep(SETTLING_S)
            if viewer.poll() is None:
                return f"rerun+http://{THIS_MACHINE}:{port}/proxy"
    except BaseException:
        viewer.terminate()
        raise
    viewer.terminate()
    raise ConnectionError(f"the viewer did not start; {WITHOUT_A_SCREEN}")


def require_listener(url: str, way_out: str) -> None:
    """Make sure that a viewer answers: the SDK would retry for seconds and then lose what was logged.

    Raises:
        ConnectionError: none does, or that is no address.
    """
    place = urlsplit(url)
    if place.hostname is None:
        raise ConnectionError(f"{url}: expected an address such as {VIEWER_URL}")
    try:
        socket.create_connection((place.hostname, place.port or VIEWER_PORT), timeout=5.0).close()
    except OSError as error:
        raise ConnectionError(f"{url}: no viewer answers ({error}); {way_out}") from error


class WebServer:
    """A server of the web viewer and of what is streamed to it; a context manager. It never outlives this process.

    Args:
        address: the machine's own address to answer at; 127.0.0.1 is reached from this machine alone.
        recordings: .rrd files to show.
        data_port: where streams come in and the viewer takes them from.
        web_port: where the browser asks for the viewer.

    Attributes:
        stream_url: to stream to.
        page_url: to open in a browser.

    Raises:
        ConnectionError: it does not start; most often a port is taken.
    """

    def __init__(
        self, address: str, recordings: Sequence[Path] = (), *, data_port: int = VIEWER_PORT, web_port: int = WEB_PORT
    ) -> None:
        reached = THIS_MACHINE if address in ANY_ADDRESS else address
        self.stream_url = f"rerun+http://{reached}:{data_port}/proxy"
        self.page_url = f"http://{reached}:{web_port}/?url={quote(self.stream_url, safe='')}"
        for port in (data_port, web_port):
            try:
                _free_port(address, port)
            except OSError as error:
                raise ConnectionError(
                    f"{address}:{port}: cannot serve there ({error.strerror or error}); end what serves"
                ) from error
        self._process = start_companion(
            [viewer_program() or "rerun", "--serve-web", "--bind", address, "--port", str(data_port),
             "--web-viewer-port", str(web_port), *map(str, recordings)]
        )  # fmt: skip
        serves = False
        try:
            serves = _answers(self._process, reached, (data_port, web_port))
        finally:
            if not serves:
                self.stop()
        if not serves:
            raise ConnectionError(f"{reached}:{data_port}: the web viewer's server did not start")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def wait(self) -> None:
        """Serve until Ctrl-C, or until the server ends."""
        try:
            self._process.wait()
        except KeyboardInterrupt:
            return

    def stop(self) -> None:
        """End the server, and wait until it is gone."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()


def start_companion(command: list[str]) -> subprocess.Popen[bytes]:
    """Start a program that ends with this process; it says nothing, and Ctrl-C of the terminal is not for it."""
    return subprocess.Popen(  # noqa: S603 - a program of our choice, without a shell
        [sys.executable, "-I", "-S", "-c", COMPANION, *command],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip


def _answers(program: subprocess.Popen[bytes], host: str, ports: Sequence[int]) -> bool:
    """Whether a program listens at its ports before it ends, or time is up."""
    until = time.monotonic() + SERVING_WITHIN_S
    for port in ports:
        while True:
            if program.poll() is not None or time.monotonic() > until:
                return False
            try:
                socket.create_connection((host, port), timeout=1.0).close()
                break
            except OSError:
                time.sleep(0.05)
    return True


def _free_port(address: str, port: int) -> int:
    """The port, or any for 0, if it can be listened to.

    Raises:
        OSError: it is taken, or the address is none of this machine.
    """
    with socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((address, port))
        return int(probe.getsockname()[1])
