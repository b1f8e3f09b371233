"""A viewer that is started listens to this machine alone; where there is no screen, the error says what to do."""

import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dirprim_filter.viewer import process as program


def test_it_is_a_new_one_reported_to_listen_here_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that listens as the viewer would, and is left running."""
    commands: list[list[str]] = []
    running: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def started(command: list[str], **options: object) -> subprocess.Popen[bytes]:
        commands.append(command)
        listens = f"import socket, time; s = socket.create_server(('127.0.0.1', {command[4]})); time.sleep(60)"
        running.append(start([sys.executable, "-c", listens], **options))  # type: ignore[call-overload]
        return running[-1]

    monkeypatch.setattr(program, "SETTLING_S", 0.0)
    monkeypatch.setattr(subprocess, "Popen", started)
    urls = [program.spawn_viewer(), program.spawn_viewer([Path("a.rrd")])]
    ports = [command[command.index("--port") + 1] for command in commands]
    assert [command[1:3] for command in commands] == [["--bind", "127.0.0.1"]] * 2
    assert urls == [f"rerun+http://127.0.0.1:{port}/proxy" for port in ports]
    assert [command[-1] for command in commands] == ["--expect-data-soon", "a.rrd"]
    for viewer in running:
        assert viewer.poll() is None
        viewer.kill()
        viewer.wait()


@pytest.mark.parametrize("viewer", ["false", "/no/such/viewer"])
def test_without_a_screen_the_error_says_what_to_do(monkeypatch: pytest.MonkeyPatch, viewer: str) -> None:
    monkeypatch.setattr(program, "viewer_program", lambda: viewer)
    with pytest.raises(ConnectionError, match=r"needs a screen; without one, --save FILE.rrd .* --serve"):
        program.spawn_viewer()


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="the kernel does not tell who listens where")
def test_a_server_answers_on_this_machine_alone_and_a_taken_port_is_reported() -> None:
    def listening(port: int) -> set[str]:
        """The addresses at which something listens on the port, as the kernel writes them."""
        rows = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()]
        return {row[1].split(":")[0] for row in rows if row[3] == "0A" and int(row[1].split(":")[1], 16) == port}

    with socket.socket() as first, socket.socket() as second:
        first.bind(("127.0.0.1", 0))
        second.bind(("127.0.0.1", 0))
        data, web = first.getsockname()[1], second.getsockname()[1]
    with program.WebServer("127.0.0.1", data_port=data, web_port=web) as server:
        assert [listening(port) for port in (data, web)] == [{"0100007F"}] * 2  # 127.0.0.1
        assert f"127.0.0.1:{web}/" in server.page_url
        with pytest.raises(ConnectionError, match=f"127.0.0.1:{data}: cannot serve there"):
            program.WebServer("127.0.0.1", data_port=data, web_port=web)
    assert all(listening(port) == set() for port in (data, web))


ORPHAN = """
import os, signal, sys
from dirprim_filter.viewer import process
started = process.start_companion([sys.executable, "-c", "import os, time; open(1, 'w'); time.sleep(60)"])
children = lambda pid: open(f"/proc/{pid}/task/{pid}/children").read().split()
while not children(started.pid):
    pass
print(*children(started.pid), flush=True)
if sys.argv[1] == "stop":
    started.stdin.close()
    started.wait()
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
