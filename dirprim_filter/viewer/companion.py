"""A program that ends with the one that started it, however that ended: `python companion.py PROGRAM ARGUMENT...`.

It starts the program and reads its own standard input, a pipe that closes when its parent is gone, killed or not. No
signal handler of the parent could do that. It imports the standard library alone, so it starts at once.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from threading import Thread


def start(command: list[str]) -> subprocess.Popen[bytes]:
    """Start a program as a companion of this process; it says nothing, and Ctrl-C of the terminal is not for it.

    Raises:
        OSError: it cannot be started.
    """
    return subprocess.Popen(  # noqa: S603 - a program of our choice, without a shell
        [sys.executable, "-I", "-S", str(Path(__file__).resolve()), *command],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip


def stop(companion: subprocess.Popen[bytes]) -> None:
    """End a companion, and wait until its program is gone."""
    if companion.stdin is not None:
        companion.stdin.close()
    companion.wait()


def _accompany(command: list[str]) -> int:
    program = subprocess.Popen(command, stdin=subprocess.DEVNULL)  # noqa: S603 - what `start` was given
    signal.signal(signal.SIGTERM, lambda *_: program.terminate())

    def watch() -> None:
        sys.stdin.buffer.read()  # nothing is ever written: it ends when the writer is gone
        program.terminate()

    Thread(target=watch, daemon=True).start()
    return program.wait()


if __name__ == "__main__":
    sys.exit(_accompany(sys.argv[1:]))
