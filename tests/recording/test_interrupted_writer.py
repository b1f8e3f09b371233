"""Ctrl-C at any moment of writing: a log of estimates ends there and is whole, of anything else nothing appears."""

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from dirprim_filter.recording.container.mcap_writer import uninterrupted
from dirprim_filter.recording.container.recovery import recover
from dirprim_filter.recording.foxglove.elements import scene_transform
from dirprim_filter.recording.log_writer import LogWriter

N = 9
N_IN_CHUNK = 4


def interrupting(*_):
    raise KeyboardInterrupt


class Interrupt:
    """Sends SIGINT when so many lines of the writer's modules have run; None: never."""

    MODULES = ("log_writer.py", "mcap_writer.py", "writer.py")

    def __init__(self, after):
        self.after = after
        self.lines = 0

    def __call__(self, frame, event, _):
        if Path(frame.f_code.co_filename).name not in self.MODULES:
            return None
        if event == "line":
            self.lines += 1
            if self.lines == self.after:
                signal.raise_signal(signal.SIGINT)
        return self


def write(path, *, keep, interrupt):
    """A log of N instants in chunks of four. -> how many were handed over before the interrupt."""
    handed_over = 0
    before = sys.gettrace()
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    try:
        with LogWriter(path, metadata={}, max_chunk_ns=N_IN_CHUNK + 1, keep_when_interrupted=keep) as log:
            sys.settrace(interrupt)
            for time_ns in range(N):
                log.write("/tf", scene_transform(time_ns, np.zeros(2)), time_ns)
                handed_over += 1
    except KeyboardInterrupt:
        pass
    finally:
        sys.settrace(before)
        signal.signal(signal.SIGINT, handler)
    return handed_over


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # of the one line that nothing can protect
@pytest.mark.parametrize("keep", [True, False])
def test_an_interrupt_at_any_line_costs_nothing_that_was_handed_over(tmp_path, keep):
    total = Interrupt(None)
    assert write(tmp_path / "whole.mcap", keep=keep, interrupt=total) == N
    assert total.lines > 200
    n_kept = set()
    for after in range(1, total.lines + 1, 13):  # a prime, so that at each instant other lines are hit
        path = tmp_path / f"{after}.mcap"
        handed_over = write(path, keep=keep, interrupt=Interrupt(after))
        if not path.exists() and handed_over == N:  # behind the body, before the end could begin: as after a kill
            (left,) = tmp_path.glob(f"{path.name}.*.partial")
            assert recover(left, path).saved == N - N % N_IN_CHUNK
            continue
        if not path.exists():
            assert not keep
            continue
        with path.open("rb") as file:
            times = [message.log_time for _, _, message in make_reader(file, validate_crcs=True).iter_messages()]
        assert times == list(range(len(times)))
        assert handed_over <= len(times) <= handed_over + 1
        assert keep or len(times) == N
        n_kept.add(len(times))
    assert n_kept >= (set(range(N + 1)) if keep else {N})


def test_what_a_process_of_the_same_number_left_is_kept(tmp_path):
    path = tmp_path / "a.mcap"
    left = [tmp_path / f"a.mcap.{os.getpid()}{number}.partial" for number in ("", ".2")]
    with LogWriter(tmp_path / "b.mcap", metadata={}) as log:
        log.write("/tf", scene_transform(1, np.zeros(2)), 1)
    for one in left:
        one.write_bytes((tmp_path / "b.mcap").read_bytes()[:-40])  # as a kill leaves it
    with LogWriter(path, metadata={}, force=True) as first, LogWriter(path, metadata={}) as second:
        first.write("/tf", scene_transform(2, np.zeros(2)), 2)
        second.write("/tf", scene_transform(3, np.zeros(2)), 3)
    assert sorted(tmp_path.iterdir()) == sorted([path, tmp_path / "b.mcap", *left])
    for one in left:
        assert recover(one, one.with_suffix(".mcap")).saved == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_either_signal_waits_until_the_body_is_done(number):
    done = []

    def body():
        with uninterrupted():
            signal.raise_signal(number)
            done.append(True)

    before = signal.signal(number, interrupting)
    try:
        with pytest.raises(KeyboardInterrupt):
            body()
        assert signal.getsignal(number) is interrupting
    finally:
        signal.signal(number, before)
    assert done
