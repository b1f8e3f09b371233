"""A viewer that is started listens to this machine alone; where there is no screen, the error says what to do."""

import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dirprim_filter.viewer import process as program


class Started:
    """A process that lives so many polls."""

    def __init__(self, polls: int) -> None:
        self.left, self.ended = polls, False

    def poll(self) -> int | None:
        self.left -= 1
        return None if self.left > 0 else 1

    def terminate(self) -> None:
        self.ended = True


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    commands: list[list[str]] = []
    monkeypatch.setattr(program, "SETTLING_S", 0.0)

    def start(command: list[str], **_: object) -> Started:
        commands.append(command)
        return Started(3 if len(commands) == 1 else 100)

    monkeypatch.setattr(subprocess, "Popen", start)
    return commands


def test_it_is_a_new_one_reported_to_listen_here_alone(
    monkeypatch: pytest.MonkeyPatch, started: list[list[str]], tmp_path: Path
) -> None:
    """Whatever answers at the usual port, a server that nobody looks at for example, is not used."""
    monkeypatch.setattr(program, "_answers", lambda *_: True)
    with socket.socket() as somebody:
        somebody.bind(("127.0.0.1", 0))
        taken = somebody.getsockname()[1]
        monkeypatch.setattr(program, "VIEWER_PORT", taken)
        somebody.listen()
        url = program.spawn_viewer()
    (command,) = started
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    port = int(command[command.index("--port") + 1])
    assert port != taken
    assert url == f"rerun+http://127.0.0.1:{port}/proxy"
    monkeypatch.setattr(Started, "wait", lambda *_, **__: 0, raising=False)
    program.show_files([tmp_path / "a.rrd"])
    assert "--new" in started[1]


@pytest.mark.parametrize("show", [program.spawn_viewer, lambda: program.show_files([Path("a.rrd")])])
def test_without_a_screen_the_error_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, started: list[list[str]], show: Callable[[], object]
) -> None:
    monkeypatch.setattr(program, "_answers", lambda *_: False)
    monkeypatch.setattr(Started, "wait", lambda *_, **__: 1, raising=False)
    with pytest.raises(ConnectionError, match=r"needs a screen; without one, --save FILE.rrd .* --serve"):
        show()


ORPHAN = """
import os, signal, sys
from dirprim_filter.viewer import process
started = process.start_companion([sys.executable, "-c", "import os, time; open(1, 'w'); time.sleep(60)"])
children = lambda pid: open(f"/proc/{pid}/task/{pid}/children").read().split()
while not children(started.pid):
    pass
print(*children(started.pid), flush=True)
if sys.argv[1] == "stop":
    process.stop_companion(started)
    sys.exit()
os.kill(os.getpid(), getattr(signal, sys.argv[1]))
"""


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="the kernel does not tell of children")
@pytest.mark.parametrize("end", ["SIGKILL", "SIGTERM", "stop"])
def test_a_companion_ends_with_its_parent_however_that_ended(end: str) -> None:
    ended = subprocess.run([sys.executable, "-c", ORPHAN, end], capture_output=True, text=True, check=False, timeout=30)
    program_id = int(ended.stdout)
    until = time.monotonic() + 10
    while Path(f"/proc/{program_id}").exists():
        assert time.monotonic() < until, "an orphan"
        time.sleep(0.02)
