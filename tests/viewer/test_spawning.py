"""A viewer that is started listens to this machine alone; where there is no screen, the error says what to do."""

import subprocess

import pytest

from dirprim_filter.viewer import program


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


def test_it_is_told_to_listen_here_alone(monkeypatch: pytest.MonkeyPatch, started: list[list[str]]) -> None:
    monkeypatch.setattr(program, "_answers", lambda *_: bool(started))
    program.spawn_viewer()
    (command,) = started
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    program.spawn_viewer()  # one that runs is not started again
    assert len(started) == 1


def test_without_a_screen_the_error_says_what_to_do(monkeypatch: pytest.MonkeyPatch, started: list[list[str]]) -> None:
    monkeypatch.setattr(program, "_answers", lambda *_: False)
    with pytest.raises(ConnectionError, match="needs a screen; without one, save to a file or serve"):
        program.spawn_viewer()
