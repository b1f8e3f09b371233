"""What was sent to an .rrd file is what comes back, at the log's own times; files are whole or not there."""

import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rrd_files import rows_of

from dirprim_filter.drawing import shapes
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer import process as viewer_room
from dirprim_filter.viewer import sink, stream
from dirprim_filter.viewer.sink import open_stream
from dirprim_filter.viewer.stream import TIMELINE


@pytest.fixture(autouse=True)
def strict() -> Iterator[None]:
    """Without it the SDK turns every mistake into a warning."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def write_all(path: Path, frames: list[TrackedFrame], primitives: PrimitiveMap, **options: int) -> Path:
    with open_stream(save=path, **options) as sink:
        sink.log_map(primitives)
        sink.log_report("# Run")
        for frame in frames:
            sink.write(frame)
    return path


def test_particles_come_back_at_their_times_to_the_nanosecond(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]
) -> None:
    path = write_all(tmp_path / "run.rrd", scene_frames, scene_map, n_particles=50)
    rows = rows_of(path, "/tracks/particles", "Points3D:positions")
    assert [time for time, _ in rows] == [frame.time_ns for frame in scene_frames]
    for (_, place), frame in zip(rows, scene_frames, strict=True):
        assert (place.reshape(-1, 3)[:, :2] == frame.particles.position.astype(np.float32)).all()


def test_vehicles_that_a_frame_does_not_name_vanish(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]
) -> None:
    path = write_all(tmp_path / "run.rrd", scene_frames, scene_map)
    for entity, column in [
        ("/detections", "Points3D:positions"),
        ("/tracks/estimates", "Points3D:positions"), ("/tracks/ids", "Points3D:labels"),
        ("/tracks/motion", "Arrows3D:vectors"), ("/tracks/covariance", "Ellipsoids3D:half_sizes"),
        ("/tracks/trails", "LineStrips3D:strips"),
    ]:  # fmt: skip
        rows = rows_of(path, entity, column)
        assert len(rows) == len(scene_frames), entity
        assert rows[-2][1].size > 0, entity
        assert rows[-1][1].size == 0, entity
    reported = [v.tolist() for _, v in rows_of(path, "/metrics/existence", "Scalars:scalars")]
    assert reported == [[2, 2, 2, 0]] * 5 + [[0, 0, 0, 0]]
    ess = [v.tolist() for _, v in rows_of(path, "/metrics/ess", "Scalars:scalars")]
    assert ess[:5] == [[30, 30]] * 5
    assert np.isnan(ess[5]).all()


def test_trails_join_the_estimates_of_one_vehicle(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]
) -> None:
    path = write_all(tmp_path / "run.rrd", scene_frames, scene_map)
    steps = [value for _, value in rows_of(path, "/tracks/trails", "LineStrips3D:strips")]
    assert steps[0].size == 0  # nobody was seen before the first frame
    expected = np.stack([scene_frames[0].estimates.position, scene_frames[1].estimates.position], axis=1)
    assert steps[1][..., :2] == pytest.approx(expected, rel=1e-6)


def test_so_many_particles_are_shown_of_each_vehicle(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]
) -> None:
    path = write_all(tmp_path / "run.rrd", scene_frames[:1], scene_map, n_particles=7)
    (_, place), *_ = rows_of(path, "/tracks/particles", "Points3D:positions")
    assert (place[:, :2] == scene_frames[0].particles.position[::7].astype(np.float32)).all()


def test_the_map_is_static_and_its_petals_are_those_of_the_shapes(tmp_path: Path, scene_map: PrimitiveMap) -> None:
    path = write_all(tmp_path / "map.rrd", [], scene_map)
    ((time, vertices),) = rows_of(path, "/map/roses", "Mesh3D:vertex_positions")
    assert time is None
    assert vertices[:, :2] == pytest.approx(shapes.rose_petals(scene_map).polygon.reshape(-1, 2), rel=1e-6)
    ((_, outlines),) = rows_of(path, "/map/cells", "LineStrips3D:strips")
    assert len(outlines) == scene_map.tessellation.n_cells


def test_truth_ends_with_the_last_row(tmp_path: Path, scene_tracks: Tracks) -> None:
    with open_stream(save=tmp_path / "truth.rrd") as sink:
        sink.log_truth(scene_tracks)
    rows = [row for row in rows_of(tmp_path / "truth.rrd", "/truth", "LineStrips3D:strips") if row[0] is not None]
    times = np.unique(scene_tracks.time_ns).tolist()
    assert [time for time, _ in rows] == [*times, times[-1] + 100_000_000]
    assert [len(outlines) for _, outlines in rows] == [2] * 5 + [0]


def test_a_frame_shows_the_same_whether_it_is_sent_alone_or_in_a_batch(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    def shown(name: str, batch: int) -> list[tuple[int | None, np.ndarray]]:
        monkeypatch.setattr(sink, "BATCH_FRAMES", batch)
        path = write_all(tmp_path / name, scene_frames, scene_map)
        columns = [("/tracks/particles", "Points3D:colors"), ("/tracks/trails", "LineStrips3D:strips"),
                   ("/tracks/ids", "Points3D:labels"), ("/metrics/ess", "Scalars:scalars")]  # fmt: skip
        return [row for entity, column in columns for row in rows_of(path, entity, column)]

    alone, pairs, whole = (shown(f"{n}.rrd", n) for n in (1, 2, 99))
    assert len(alone) == 4 * len(scene_frames)
    for other in (pairs, whole):
        assert [time for time, _ in other] == [time for time, _ in alone]
        assert all(
            np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for (_, a), (_, b) in zip(alone, other, strict=True)
        )


def test_forecasts_of_one_time_are_shown_together_until_their_vehicle_goes(
    tmp_path: Path, scene_frames: list[TrackedFrame]
) -> None:
    futures = np.arange(72.0).reshape(3, 12, 2)  # with where the vehicle is, 13 instants, of which seven are shown
    nobody = scene_frames[-1]  # one frame without a vehicle is a report that failed to come, not its end
    later = replace(nobody, time_ns=nobody.time_ns + 1_000_000_000)
    with open_stream(save=tmp_path / "f.rrd") as sink:
        for frame in [*scene_frames, later]:
            sink.write(frame)
            if frame is scene_frames[1]:
                start = frame.estimates.position
                sink.write_forecast(Forecasts.of(frame.time_ns, ["7", "8"], start, np.stack([futures, futures])))
    first, last = rows_of(tmp_path / "f.rrd", "/forecasts/paths", "LineStrips3D:strips")
    assert (first[0], last[0]) == (scene_frames[1].time_ns, later.time_ns)
    assert first[1].shape == (6, 7, 3)
    assert first[1][:3, 1:, :2] == pytest.approx(futures[:, 1::2])
    assert first[1][:3, 0, :2] == pytest.approx(np.tile(scene_frames[1].estimates.position[0], (3, 1)))
    assert last[1].size == 0


def test_the_file_verifies_and_holds_one_blueprint(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame]
) -> None:
    path = write_all(tmp_path / "run.rrd", scene_frames, scene_map)
    subprocess.run([Path(sys.executable).with_name("rerun"), "rrd", "verify", path], check=True, capture_output=True)
    reader = RrdReader(path)
    assert len(reader.blueprints()) == 1
    (recording,) = reader.recordings()
    assert recording.application_id == "dirprim"
    columns = {name for chunk in reader.stream() for name in chunk.to_record_batch().schema.names}
    assert TIMELINE in columns
    assert not columns & {"log_time", "log_tick"}  # the log's own time alone


def test_the_same_file_has_the_same_identity_in_every_run(tmp_path: Path, scene_map: PrimitiveMap) -> None:
    def identity(name: str) -> str:
        path = write_all(tmp_path / name, [], scene_map, force=True)
        (recording,) = RrdReader(path).recordings()
        return str(recording.recording_id)

    assert identity("a.rrd") == identity("a.rrd")
    assert identity("a.rrd") != identity("b.rrd")


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path, scene_map: PrimitiveMap) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError, match=r"run\.rrd: expected a new file, it exists; .*--force"):
        open_stream(save=path)
    assert path.read_bytes() == b"precious"
    write_all(path, [], scene_map, force=True)
    assert len(RrdReader(path).recordings()) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["run.rrd"]


def test_after_an_error_the_file_keeps_its_temporary_name_and_reads(
    tmp_path: Path, scene_frames: list[TrackedFrame], caplog: pytest.LogCaptureFixture
) -> None:
    def fail() -> None:
        with open_stream(save=tmp_path / "run.rrd") as sink:
            sink.write(scene_frames[0])
            raise RuntimeError("the filter broke")

    with caplog.at_level(logging.WARNING), pytest.raises(RuntimeError, match="the filter broke"):
        fail()
    (left,) = tmp_path.iterdir()
    assert left.name == f"run.rrd.{os.getpid()}.partial"
    assert f"{left}: holds what was written" in caplog.text
    left.rename(tmp_path / "left.rrd")
    assert len(rows_of(tmp_path / "left.rrd", "/detections", "Points3D:positions")) == 1


def test_what_is_called_like_a_part_of_it_is_another_file(
    tmp_path: Path, scene_frames: list[TrackedFrame], scene_map: PrimitiveMap
) -> None:
    other = tmp_path / "run.part.rrd"
    other.write_bytes(b"precious")
    write_all(tmp_path / "run.rrd", scene_frames[:1], scene_map)
    assert other.read_bytes() == b"precious"


def test_ctrl_c_leaves_a_whole_file(tmp_path: Path, scene_frames: list[TrackedFrame]) -> None:
    def interrupt() -> None:
        with open_stream(save=tmp_path / "run.rrd") as sink:
            sink.write(scene_frames[0])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupt()
    assert len(rows_of(tmp_path / "run.rrd", "/detections", "Points3D:positions")) == 1


def test_a_stream_needs_a_place_to_go_and_a_viewer_that_answers() -> None:
    with pytest.raises(ValueError, match=r"^expected at least one place to stream to"):
        open_stream()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(ConnectionError, match=f"127.0.0.1:{port}/proxy: no viewer answers"):
        open_stream(connect=f"rerun+http://127.0.0.1:{port}/proxy")
    with pytest.raises(ConnectionError, match="expected an address such as"):
        open_stream(connect="localhost")


def test_a_viewer_that_does_not_start_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for program, error in [
        ("false", "did not start; it needs a screen"),
        ("/no/such/viewer", "did not start"),
    ]:
        monkeypatch.setattr(viewer_room, "viewer_program", lambda program=program: program)
        with pytest.raises(ConnectionError, match=error):
            viewer_room.show_files([tmp_path / "run.rrd"])
    monkeypatch.setattr(viewer_room, "viewer_program", lambda: "true")  # it handed the file to a running viewer
    viewer_room.show_files([tmp_path / "run.rrd"])


def test_the_library_imports_neither_viewer_nor_figures() -> None:
    program = "import sys, dirprim_filter; sys.exit(bool({'rerun', 'matplotlib'} & set(sys.modules)))"
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.fixture
def running_viewer() -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """A viewer without a window that takes streams, and its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    viewer = subprocess.Popen(
        [viewer_room.viewer_program() or "rerun", "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    until = time.monotonic() + 30
    while time.monotonic() < until:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.05)
    yield viewer, f"rerun+http://127.0.0.1:{port}/proxy"
    viewer.kill()
    viewer.wait()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP, None])
def test_a_viewer_that_goes_away_or_freezes_ends_alone(
    tmp_path: Path, scene_frames: list[TrackedFrame], scene_map: PrimitiveMap, running_viewer: tuple,
    monkeypatch: pytest.MonkeyPatch, *, how: signal.Signals | None,
) -> None:  # fmt: skip
    """The file beside it is whole; control: a viewer that stays is no failure."""
    monkeypatch.setattr(stream, "FROZEN_S", 1.0)
    viewer, address = running_viewer
    path, rng = tmp_path / "run.rrd", np.random.default_rng(0)
    with open_stream(save=path, connect=address) as shown:
        shown.log_map(scene_map)
        shown.write(scene_frames[0])
        shown.flush()
        if how is not None:
            viewer.send_signal(how)
        for frame in scene_frames[1:]:
            for _ in range(60):  # more than what a connection holds
                shown.log_report(rng.bytes(50_000).hex())
            shown.write(frame)
    assert len(rows_of(path, "/detections", "Points3D:positions")) == len(scene_frames)
    assert [p.name for p in tmp_path.iterdir()] == ["run.rrd"]
    assert [line.startswith(f"{address}: is left") for line in shown.stream.failures] == [True] * (how is not None)


FULL_DISK = """
import resource, sys, numpy as np
from pathlib import Path
from dirprim_filter.viewer.sink import open_stream
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
with open_stream(save=Path(sys.argv[1])) as shown:
    for _ in range(40):
        shown.log_report(np.random.default_rng(0).bytes(100_000).hex())
print(len(shown.stream.failures))
"""


def test_a_disk_that_is_full_is_a_failure_and_a_part_never_takes_the_name(tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", FULL_DISK, tmp_path / "run.rrd"], capture_output=True, text=True, check=True
    )
    assert ended.stdout == "1\n"
    (left,) = tmp_path.iterdir()
    assert left.name.endswith(".partial")
