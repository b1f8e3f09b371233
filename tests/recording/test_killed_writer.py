"""A tracker killed at any moment leaves a file out of which all but the last chunk is recovered."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from mcap.reader import make_reader

from dirprim_filter.recording.recovery import recover
from dirprim_filter.recording.scan import scan

KILLS = int(os.environ.get("DIRPRIM_KILLS", "10"))
"""How often a process is killed; set it higher for a longer look."""

TRACKER = """
import os, sys
import numpy as np
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates, Particles, TrackedFrame
from dirprim_filter.recording.writer import EstimateLog

n, n_particles = 4, 200


def track(output):
    rng = np.random.default_rng(0)
    told = os.open(output + ".told", os.O_CREAT | os.O_WRONLY)
    ids, ones = np.array([str(k) for k in range(n)]), np.ones(n)
    with EstimateLog(output, metadata={"by": "a test"}) as log:
        for i in range(1_000_000):
            time_ns = i * 100_000_000
            times, place = np.full(n, time_ns), rng.normal(size=(n, 2))
            log.write(TrackedFrame(
                time_ns=time_ns,
                detections=Detections(track_id=ids, time_ns=times, position=place),
                estimates=Estimates(
                    track_id=ids, time_ns=times, position=place, covariance=np.tile(np.eye(2), (n, 1, 1)),
                    direction=ones, direction_resultant=ones, speed=ones, speed_std=ones,
                    effective_sample_size=ones, log_evidence=ones,
                ),
                particles=Particles(
                    position=rng.normal(size=(n_particles, 2)), direction=np.zeros(n_particles),
                    speed=np.zeros(n_particles), weight=np.ones(n_particles),
                    vehicle=np.zeros(n_particles, np.int64),
                ),
            ))
            os.pwrite(told, time_ns.to_bytes(8, "little"), 0)


for line in sys.stdin:  # a process for each line, without the imports
    pid = os.fork()
    if pid == 0:
        track(line.strip())
    print(pid, flush=True)
    os.waitpid(pid, 0)
    print("gone", flush=True)
"""


@pytest.fixture(scope="module")
def trackers(tmp_path_factory):
    """Starts a process that tracks for each path that it is told."""
    script = tmp_path_factory.mktemp("tracker") / "tracker.py"
    script.write_text(TRACKER)
    with subprocess.Popen(
        [sys.executable, script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    ) as server:
        yield server
        server.stdin.close()


def killed_at_random(trackers, output, rng):
    """-> the last time that a tracker had handed over when it was killed."""
    told = output.with_name(output.name + ".told")
    trackers.stdin.write(f"{output}\n")
    pid = int(trackers.stdout.readline())
    while not told.exists() or told.stat().st_size < 8:
        time.sleep(0.005)
    time.sleep(float(rng.uniform(0.0, 0.3)))
    os.kill(pid, signal.SIGKILL)
    assert trackers.stdout.readline() == "gone\n"
    return int.from_bytes(told.read_bytes(), "little")


def test_kill_9_costs_no_more_than_the_last_chunk(trackers, tmp_path):
    rng = np.random.default_rng(5)
    n_recovered = 0
    for kill in range(KILLS):
        output = tmp_path / f"{kill}.mcap"
        last_ns = killed_at_random(trackers, output, rng)
        assert not output.exists()
        (partial,) = tmp_path.glob(f"{kill}.mcap.*.partial")
        recover(partial, output)
        with scan(output) as log:
            frames = [m.log_time_ns for m in log if m.topic == "/dirprim/tracks"]
            assert log.damage == []
        assert frames == [i * 100_000_000 for i in range(len(frames))]
        # What was handed over before the kill, but for the chunk that was open: a second of the log's time.
        assert last_ns - (frames[-1] if frames else -100_000_000) <= 1_000_000_000
        with output.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            assert sum(c.topic == "/dirprim/tracks" for _, c, _ in reader.iter_messages()) == len(frames)
        n_recovered += len(frames) > 0
    assert n_recovered > KILLS // 2
