"""Progress is reported on a terminal alone: how far, how long still; and changes nothing of what is done."""

import re
from contextlib import redirect_stderr

import pytest

from cli.commands import DONE, GRID, Terminal, dirprim
from dirprim_filter.cli.progress import learning_progress, step_progress, with_progress, working
from situations import seen_at


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("TERM", "xterm-256color")


def text_of(shown):
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.getvalue())


@pytest.mark.parametrize("end_ns", [9_000_000_000, None, -1, 0])
def test_frames_are_as_they_were_and_the_bar_ends_with_the_log(end_ns, capsys):
    """An end that is not known, or a wrong one, is no end."""
    frames = [seen_at(second, [[0.0, 0.0]], ["a"]) for second in range(10)]
    with redirect_stderr(Terminal()) as shown:
        assert list(with_progress(frames, what="tracking x", end_ns=end_ns)) == frames
    assert "tracking x" in text_of(shown)
    assert "10 frames" in text_of(shown)
    assert ("9.0 of 9.0 s of the log" in text_of(shown)) == bool(end_ns and end_ns > 0)
    assert list(with_progress(frames, what="tracking x", end_ns=end_ns)) == frames
    with step_progress("x", "y") as report, learning_progress() as learned, working("z"):
        assert report is None
        assert learned == (None, None, None)
    assert capsys.readouterr().err == ""  # a pipe gets nothing


def test_the_long_commands_tell_of_their_steps(here):
    (here / "t.csv").write_text("time_s,track_id,x_m,y_m\n" + "".join(f"{t},a,{t},0\n" for t in range(9)))
    for command, reported in (
        ("convert t.csv -o t.mcap", r"9 of 9 instants"), (f"learn log.mcap -o m {GRID}", r"how vehicles go on"),
        ("recover t.mcap -o whole.mcap", r"(\d+) of \1 chunks"),
        ("evaluate cues log.mcap --folds 2 --tessellation grid", r"2 of 2 folds"),
    ):  # fmt: skip
        with redirect_stderr(Terminal()) as shown:
            assert dirprim(command) == DONE
        assert re.search(reported, text_of(shown)), command
    with redirect_stderr(Terminal()) as shown:
        with learning_progress() as report:
            report.stage(0)
            report.progress(18, -0.625)
        with learning_progress() as report:
            report.tiles(3, 7)
    assert "18 cells, log density 0.625" in text_of(shown)
    assert "3 of 7 tiles" in text_of(shown)
