"""Progress is reported on a terminal alone: how far, how fast, how long still; and changes nothing of what is done."""

import io
import re
from contextlib import redirect_stderr

import numpy as np
import pytest

from dirprim_filter import write_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.cli.progress import learning_progress, step_progress, with_progress, working
from dirprim_filter.detections import Detections
from dirprim_filter.recording.reader import stream_detections


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("TERM", "xterm-256color")


def text_of(shown):
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.getvalue())


def ten_frames():
    ids = np.repeat("a", 10)
    times = np.arange(10, dtype=np.int64) * 1_000_000_000
    return list(Detections(track_id=ids, time_ns=times, position=np.zeros((10, 2))).frames())


def test_frames_are_as_they_were_and_the_bar_ends_with_the_log():
    frames = ten_frames()
    with redirect_stderr(Terminal()) as shown:
        assert list(with_progress(frames, what="tracking x", end_ns=9_000_000_000)) == frames
    assert "tracking x" in text_of(shown)
    assert "9.0 of 9.0 s of the log 10 frames" in text_of(shown)
    assert re.search(r" \d:\d\d:\d\d left \d:\d\d:\d\d", text_of(shown))


@pytest.mark.parametrize("end_ns", [None, -1, 0])
def test_an_end_that_is_not_known_is_no_end(end_ns):
    with redirect_stderr(Terminal()) as shown:
        assert len(list(with_progress(ten_frames(), what="tracking x", end_ns=end_ns))) == 10
    assert "10 frames" in text_of(shown)
    assert " of " not in text_of(shown)


def test_steps_tell_how_many_of_how_many():
    with redirect_stderr(Terminal()) as shown:
        with step_progress("writing", "chunks") as tell:
            for done in range(1, 5):
                tell(done, 4)
        with learning_progress() as reported:
            reported.stage(0)
            reported.progress(17, -0.5)
            reported.progress(18, -0.625)
        with learning_progress() as reported:
            reported.stage(3)
            reported.tiles(3, 7)
        with working("reading y"):
            pass
    assert "4 of 4 chunks" in text_of(shown)
    assert re.search(r"cells 1/4 18, log density 0.625", text_of(shown))
    assert "how vehicles go on 4/4 3 of 7 tiles" in text_of(shown)
    assert "reading y" in text_of(shown)


def test_a_pipe_gets_nothing(capsys):
    frames = ten_frames()
    assert list(with_progress(frames, what="x", end_ns=1)) == frames
    with step_progress("x", "y") as tell, learning_progress() as learned, working("z"):
        assert tell is None
        assert learned == (None, None, None)
    assert capsys.readouterr().err == ""


def test_a_log_tells_when_it_ends(tmp_path, ring):
    write_tracks(ring, tmp_path / "ring.mcap")
    assert stream_detections(tmp_path / "ring.mcap").end_ns == ring.time_ns.max()
    assert stream_detections(tmp_path / "ring.mcap", end_ns=5).end_ns == 5


def test_the_long_commands_tell_of_their_steps(tmp_path, ring, capsys):
    (tmp_path / "t.csv").write_text("time_s,track_id,x_m,y_m\n" + "".join(f"{t},a,{t},0\n" for t in range(9)))
    write_tracks(ring[ring.track_id < 6], tmp_path / "ring.mcap")
    commands = {
        f"convert {tmp_path}/t.csv -o {tmp_path}/t.mcap": r"9 of 9 instants",
        f"learn {tmp_path}/ring.mcap -o {tmp_path}/map.mcap --tessellation grid --cell-size 8": r"go on 4/4",
        f"recover {tmp_path}/t.mcap -o {tmp_path}/whole.mcap": r"(\d+) of \1 chunks",
        f"replay {tmp_path}/ring.mcap --rate inf --save {tmp_path}/r.rrd": r"(\d+\.\d) of \1 s of the log",
        f"evaluate forecast {tmp_path}/ring.mcap --folds 2 --horizon 1 --samples 20": r"8 of 8 fits",
    }
    for command, reported in commands.items():
        with redirect_stderr(Terminal()) as shown:
            assert run(command.split()) == 0
        assert re.search(reported, text_of(shown)), command
