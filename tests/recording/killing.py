"""`dirprim track`, killed with signal 9 at a random moment, and what must be true of what it leaves.

Shared by a test, which kills a few, and `tests/benchmarks/killing.py`, which kills a hundred.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from dirprim_filter import PrimitiveMap, save_map, write_tracks
from dirprim_filter.recording.container.recovery import recover
from dirprim_filter.recording.scan import scan
from situations import ring_traffic

STEP_NS = 100_000_000
CHUNK_NS = 1_000_000_000
N_ROWS = 4000
LATEST_FRAME = 100
"""A kill comes when at most so many frames were handed over, of a thousand: on a busy machine too."""

TRACKER = """
import os, sys
import dirprim_filter.cli.track, dirprim_filter.filtering, dirprim_filter.recording.reader
from dirprim_filter.cli.main import run
from dirprim_filter.recording.writer import EstimateWriter

written = EstimateWriter.write


def track(log, learned, output):
    reported = os.open(output + ".reported", os.O_CREAT | os.O_WRONLY)

    def write(self, frame):
        written(self, frame)
        os.pwrite(reported, frame.time_ns.to_bytes(8, "little"), 0)

    EstimateWriter.write = write
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os._exit(run(["track", log, "--map", learned, "-o", output, "--particles", "100"]))


for line in sys.stdin:  # a process for each line, without the imports
    pid = os.fork()
    if pid == 0:
        track(*line.strip().split("\\t"))
    print(pid, flush=True)
    os.waitpid(pid, 0)
    print("gone", flush=True)
"""


@dataclass(frozen=True, kw_only=True)
class Kill:
    """What one kill cost."""

    n_handed_over: int
    n_recovered: int
    lost_ns: int


class Trackers:
    """Starts a process that tracks, as often as asked, in a folder."""

    def __init__(self, folder: Path, server: subprocess.Popen[str]) -> None:
        self.folder = folder
        self._server = server

    def kill_one(self, name: str, rng: np.random.Generator) -> Kill:
        """Track, kill at a random moment, recover, and hold what is left against what was handed over."""
        output = self.folder / f"{name}.mcap"
        last_ns = self._killed(output, int(rng.integers(LATEST_FRAME)))
        assert not output.exists(), "the tracker had ended before it was killed"
        (partial,) = self.folder.glob(f"{name}.mcap.*.partial")
        recover(partial, output)
        with scan(output) as log:
            frames = [m.log_time_ns for m in log if m.topic == "/dirprim/tracks"]
            assert log.damage == []
        assert frames == [i * STEP_NS for i in range(len(frames))], "a frame before the last chunk is missing"
        with output.open("rb") as file:
            stock = make_reader(file, validate_crcs=True)
            assert sum(channel.topic == "/dirprim/tracks" for _, channel, _ in stock.iter_messages()) == len(frames)
        lost_ns = last_ns - (frames[-1] if frames else -STEP_NS)
        assert lost_ns <= CHUNK_NS, "more than the chunk that was open is lost"
        return Kill(n_handed_over=last_ns // STEP_NS + 1, n_recovered=len(frames), lost_ns=max(lost_ns, 0))

    def _killed(self, output: Path, after: int) -> int:
        """-> the time of the last frame that a tracker had handed over when it was killed."""
        reported = output.with_name(output.name + ".reported")
        print(self.folder / "log.mcap", self.folder / "map.mcap", output, sep="\t", file=self._server.stdin, flush=True)
        assert self._server.stdout is not None
        pid = int(self._server.stdout.readline())
        while not reported.exists() or not (last := reported.read_bytes()) or _time_of(last) < after * STEP_NS:
            time.sleep(0.001)
        os.kill(pid, signal.SIGKILL)
        assert self._server.stdout.readline() == "gone\n"
        return _time_of(reported.read_bytes())


def _time_of(reported: bytes) -> int:
    return int.from_bytes(reported, "little")


@contextmanager
def trackers(folder: Path, ring_map: PrimitiveMap) -> Iterator[Trackers]:
    """A log of the ring, its map, and a server that tracks the one with the other."""
    write_tracks(ring_traffic(np.random.default_rng(0), n_vehicles=4, n_rows=N_ROWS), folder / "log.mcap")
    save_map(ring_map, folder / "map.mcap")
    script = folder / "tracker.py"
    script.write_text(TRACKER)
    with subprocess.Popen([sys.executable, script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        yield Trackers(folder, server)
        assert server.stdin is not None
        server.stdin.close()
