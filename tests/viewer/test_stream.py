"""What was sent to an .rrd file is what comes back, at the log's own times; files are whole or not there.

A viewer that is started listens to this machine alone; where there is no screen, the error says what to do.
"""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rrd_files import rows_of, write_run

from cli.commands import python
from dirprim_filter.viewer import process as viewer_room
from dirprim_filter.viewer import stream
from dirprim_filter.viewer.sink import RerunSink


def test_the_same_file_has_the_same_identity_in_every_run(tmp_path, scene_map):
    def identity(name):
        path = write_run(tmp_path / name, [], scene_map, force=True)
        (recording,) = RrdReader(path).recordings()
        return str(recording.recording_id)

    assert identity("a.rrd") == identity("a.rrd")
    assert identity("a.rrd") != identity("b.rrd")


def test_ctrl_c_leaves_a_whole_file(tmp_path, scene_frames):
    def interrupt():
        with RerunSink(save=tmp_path / "run.rrd") as sink:
            sink.write(scene_frames[0])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupt()
    assert len(rows_of(tmp_path / "run.rrd", "/detections", "Points3D:positions")) == 1


def test_a_stream_needs_a_place_to_go_and_a_viewer_that_answers():
    with pytest.raises(ValueError, match=r"^expected at least one place to stream to"):
        RerunSink()
    port = viewer_room.free_port()
    with pytest.raises(ConnectionError, match=f"127.0.0.1:{port}/proxy: no viewer answers"):
        RerunSink(connect=f"rerun+http://127.0.0.1:{port}/proxy")
    with pytest.raises(ConnectionError, match="expected an address such as"):
        RerunSink(connect="localhost")


def test_a_viewer_that_is_started_is_a_new_one_reported_to_listen_here_alone(monkeypatch):
    """A program that listens as the viewer would, and is left running."""
    commands: list[list[str]] = []
    running: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def started(command, **options):
        commands.append(command)
        listens = f"import socket, time; s = socket.create_server(('127.0.0.1', {command[4]})); time.sleep(60)"
        running.append(start([sys.executable, "-c", listens], **options))  # type: ignore[call-overload]
        return running[-1]

    monkeypatch.setattr(viewer_room, "SETTLING_S", 0.0)
    monkeypatch.setattr(subprocess, "Popen", started)
    urls = [viewer_room.spawn_viewer(), viewer_room.spawn_viewer([Path("a.rrd")])]
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
    monkeypatch.setattr(viewer_room, "viewer_program", lambda: viewer)
    with pytest.raises(ConnectionError, match=r"use --save FILE.rrd, and `rerun --serve-web --bind 127.0.0.1"):
        viewer_room.spawn_viewer()


@pytest.fixture
def running_viewer():
    """A viewer without a window that takes streams, and its address."""
    port = viewer_room.free_port()
    viewer = subprocess.Popen(
        [viewer_room.viewer_program() or "rerun", "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    assert viewer_room._answers(viewer, port)
    yield viewer, f"rerun+http://127.0.0.1:{port}/proxy"
    viewer.kill()
    viewer.wait()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP, None])
def test_a_viewer_that_goes_away_or_freezes_ends_alone(
    tmp_path, scene_frames, scene_map, running_viewer, monkeypatch, *, how
):
    """The file beside it is whole; control: a viewer that stays is no failure."""
    monkeypatch.setattr(stream, "FROZEN_S", 1.0)
    viewer, address = running_viewer
    path, rng = tmp_path / "run.rrd", np.random.default_rng(0)
    with RerunSink(save=path, connect=address) as shown:
        shown.log_map(scene_map)
        shown.write(scene_frames[0])
        shown.flush()
        if how is not None:
            viewer.send_signal(how)
        for frame in scene_frames[1:]:
            for _ in range(60):  # more than what a connection holds
                shown.stream.log("/report", rr.TextDocument(rng.bytes(50_000).hex()))
            shown.write(frame)
    assert len(rows_of(path, "/detections", "Points3D:positions")) == len(scene_frames)
    assert [p.name for p in tmp_path.iterdir()] == ["run.rrd"]
    assert [line.startswith(f"{address}: is left") for line in shown.stream.failures] == [True] * (how is not None)


FULL_DISK = """
import resource, sys, numpy as np, rerun as rr
from pathlib import Path
from dirprim_filter.viewer.sink import RerunSink
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
with RerunSink(save=Path(sys.argv[1])) as shown:
    for _ in range(40):
        shown.stream.log("/report", rr.TextDocument(np.random.default_rng(0).bytes(100_000).hex()))
print(len(shown.stream.failures))
"""


@pytest.mark.slow
def test_a_disk_that_is_full_is_a_failure_and_a_part_never_takes_the_name(tmp_path):
    assert python(FULL_DISK, tmp_path / "run.rrd").stdout == "1\n"
    (left,) = tmp_path.iterdir()
    assert left.name.endswith(".partial")
