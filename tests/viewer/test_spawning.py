"""A viewer that is started listens to this machine alone; where there is no screen, the error says what to do."""

import subprocess
import sys
from pathlib import Path

import pytest

from dirprim_filter.viewer import process as program


def test_it_is_a_new_one_reported_to_listen_here_alone(monkeypatch):
    """A program that listens as the viewer would, and is left running."""
    commands: list[list[str]] = []
    running: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def started(command, **options):
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
def test_without_a_screen_the_error_says_what_to_do(monkeypatch, viewer):
    monkeypatch.setattr(program, "viewer_program", lambda: viewer)
    with pytest.raises(ConnectionError, match=r"use --save FILE.rrd, and `rerun --serve-web --bind 127.0.0.1"):
        program.spawn_viewer()
