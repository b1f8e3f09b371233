"""A working folder with a log and a map."""

from shutil import copy

import pytest

from cli.commands import DONE, FAILED, USAGE, dirprim
from dirprim_filter import save_map, write_tracks


@pytest.fixture(scope="session")
def few(ring):
    """Six vehicles on a ring, for five seconds."""
    return ring[(ring.track_id < 6) & (ring.time_ns < 5_000_000_000)]


@pytest.fixture(scope="session")
def files(few, ring_map, tmp_path_factory):
    """A folder with `log.mcap` of them, and `map.mcap` of the ring; to be read."""
    folder = tmp_path_factory.mktemp("files")
    write_tracks(few, folder / "log.mcap")
    save_map(ring_map, folder / "map.mcap")
    return folder


@pytest.fixture(scope="session")
def tracked(files):
    """What the vehicles of `log.mcap` were tracked as; to be copied."""
    out = files.with_name("tracked.mcap")
    assert dirprim("track", files / "log.mcap", "--map", files / "map.mcap", "--particles", 20, "-o", out) == DONE
    return out


@pytest.fixture
def here(files, tmp_path, monkeypatch):
    """The working folder, with copies of both."""
    for path in files.iterdir():
        copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def said(capsys):
    """Runs a command, which ends with a code; -> what it says: its `out` and `err`."""

    def run(command, *more, code=DONE):
        capsys.readouterr()
        assert dirprim(command, *more) == code, (command, *more)
        return capsys.readouterr()

    return run


@pytest.fixture
def refused(said):
    """Runs a command, which fails with a text in what it says, of which one line is of the error, the last.

    -> what it says, words set apart by one blank: "error: " stands first where it says nothing else.
    """

    def run(command, text, *more, code=FAILED):
        lines = said(command, *more, code=code).err.splitlines()
        if code != USAGE:
            assert [line.startswith("error: ") for line in lines] == [False] * (len(lines) - 1) + [True], lines
        error = " ".join(" ".join(lines).split())
        assert text in error, (command, *more)
        return error

    return run
