"""The rerun viewer as a process: started with a file, or as a server of the web viewer.

Run as a program, `python process.py PROGRAM ARGUMENT...`, it is a companion: it starts the program and reads its own
standard input, a pipe that closes when its parent is gone, killed or not. No signal handler of the parent could do
that. It imports the standard library alone, so it starts at once.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from typing import Self
from urllib.parse import quote, urlsplit

VIEWER_PORT = 9876
VIEWER_URL = f"rerun+http://127.0.0.1:{VIEWER_PORT}/proxy"
WEB_PORT = 9090
THIS_MACHINE = "127.0.0.1"
"""Left to itself the viewer takes streams from whoever reaches this machine."""
STARTING_S = 2.0
"""A viewer that still runs after this time has found a screen."""
SETTLING_S = 1.0
"""In which a viewer without a screen ends."""
SERVING_WITHIN_S = 20.0
WITHOUT_A_SCREEN = "it needs a screen; without one, --save FILE.rrd writes a file and --serve serves the web viewer"
ANY_ADDRESS = ("0.0.0.0", "::")  # noqa: S104 - they are what a user may ask for


def viewer_program() -> str | None:
    """The viewer that came with the SDK: the search path may lack it, or hold one of another version."""
    package = find_spec("rerun_cli")
    program = Path(package.origin).with_name("rerun") if package and package.origin else None
    return str(program) if program and program.exists() else None


def show_files(paths: list[Path]) -> None:
    """Open recordings in a new viewer, and leave it open.

    A viewer at the default port is left alone: it may belong to another program.

    Raises:
        ConnectionError: no viewer could be started.
    """
    names = [str(path) for path in paths]
    try:
        failed = _start("--new", *names).wait(timeout=STARTING_S) != 0
    except subprocess.TimeoutExpired:  # it runs
        return
    if failed:
        raise ConnectionError(f"{', '.join(names)}: the viewer did not start; {WITHOUT_A_SCREEN}")


def _start(*arguments: str) -> subprocess.Popen[bytes]:
    """A viewer that outlives this process."""
    try:
        return subprocess.Popen(  # noqa: S603 - the SDK's own program, without a shell
            [viewer_program() or "rerun", "--bind", THIS_MACHINE, *arguments],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        raise ConnectionError(f"the viewer did not start ({error}); {WITHOUT_A_SCREEN}") from error


def spawn_viewer() -> str:
    """Start a viewer on this machine, and leave it open; -> the address to stream to.

    It is always a new one: a viewer at the default port may belong to another program.

    Raises:
        ConnectionError: none could be started.
    """
    port = _free_port(THIS_MACHINE, VIEWER_PORT)
    viewer = _start("--port", str(port), "--expect-data-soon")
    until = time.monotonic() + SERVING_WITHIN_S
    try:
        while viewer.poll() is None and time.monotonic() < until:
            if _answers(THIS_MACHINE, port):
                time.sleep(SETTLING_S)  # it listens before it knows whether there is a screen
                if viewer.poll() is None:
                    return f"rerun+http://{THIS_MACHINE}:{port}/proxy"
            time.sleep(0.05)
    except BaseException:
        viewer.terminate()
        raise
    viewer.terminate()
    raise ConnectionError(f"the viewer did not start; {WITHOUT_A_SCREEN}")


def _answers(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except OSError:
        return False
    return True


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
        data_port: where streams come in and the viewer takes them from.
        web_port: where the browser asks for the viewer.

    Attributes:
        stream_url: to stream to.
        page_url: to open in a browser.

    Raises:
        ConnectionError: it does not start; most often a port is taken.
    """

    def __init__(self, address: str, *, data_port: int = VIEWER_PORT, web_port: int = WEB_PORT) -> None:
        reached = "127.0.0.1" if address in ANY_ADDRESS else address
        self.stream_url = f"rerun+http://{reached}:{data_port}/proxy"
        self.page_url = f"http://{reached}:{web_port}/?url={quote(self.stream_url, safe='')}"
        for port in (data_port, web_port):
            _require_free(address, port)
        self._process = start_companion(
            [viewer_program() or "rerun", "--serve-web", "--bind", address, "--port", str(data_port),
             "--web-viewer-port", str(web_port)]
        )  # fmt: skip
        try:
            self._wait_for(reached, (data_port, web_port))
        except BaseException:
            self.stop()
            raise

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
        """End the server."""
        stop_companion(self._process)

    def _wait_for(self, host: str, ports: tuple[int, ...]) -> None:
        until = time.monotonic() + SERVING_WITHIN_S
        for port in ports:
            while True:
                if self._process.poll() is not None or time.monotonic() > until:
                    raise ConnectionError(f"{host}:{port}: the web viewer's server did not start")
                if _answers(host, port):
                    break
                time.sleep(0.05)


def _free_port(address: str, wanted: int) -> int:
    """The wanted port where it is free, else any."""
    try:
        return _bound(address, wanted)
    except OSError:
        return _bound(address, 0)


def _require_free(address: str, port: int) -> None:
    try:
        _bound(address, port)
    except OSError as error:
        raise ConnectionError(
            f"{address}:{port}: cannot serve there ({error.strerror or error}); end what serves"
        ) from error


def _bound(address: str, port: int) -> int:
    """The port that an address can be bound to; 0 for any.

    Raises:
        OSError: it is taken, or no address of this machine.
    """
    with socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((address, port))
        return int(probe.getsockname()[1])


def start_companion(command: list[str]) -> subprocess.Popen[bytes]:
    """Start a program that ends with this process; it says nothing, and Ctrl-C of the terminal is not for it.

    Raises:
        OSError: it cannot be started.
    """
    return subprocess.Popen(  # noqa: S603 - a program of our choice, without a shell
        [sys.executable, "-I", "-S", str(Path(__file__).resolve()), *command],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip


def stop_companion(companion: subprocess.Popen[bytes]) -> None:
    """End a companion, and wait until its program is gone."""
    if companion.stdin is not None:
        companion.stdin.close()
    companion.wait()


def _accompany(command: list[str]) -> int:
    program = subprocess.Popen(command, stdin=subprocess.DEVNULL)  # noqa: S603 - what `start_companion` was given
    signal.signal(signal.SIGTERM, lambda *_: program.terminate())

    def watch() -> None:
        sys.stdin.buffer.read()  # nothing is ever written: it ends when the writer is gone
        program.terminate()

    Thread(target=watch, daemon=True).start()
    return program.wait()


if __name__ == "__main__":
    sys.exit(_accompany(sys.argv[1:]))
