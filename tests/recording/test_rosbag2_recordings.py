"""Folders of rosbag2 as one recording: split MCAP files as one file would, bags in SQLite as rosbags reads them."""

import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from mcap_files import log_bytes, rows
from ros_messages import ROS, header, point, quaternion, write_ros2_log
from rosbags.rosbag1 import Writer as OldWriter
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from dirprim_filter import read_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.recording.container import budget
from dirprim_filter.recording.container.recovery import recover
from dirprim_filter.recording.container.ros_bags import copied
from dirprim_filter.recording.container.source import log_files
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.summary import summarise_by_index

DONE, FAILED = 0, 1
PARTS = {  # channel 1 is another topic in each; the second begins before the first ends
    "run_0.mcap": [("/a", t, b"0") for t in range(0, 60, 2)] + [("/b", 40, b"b")],
    "run_1.mcap": [("/b", 55, b"1"), *(("/a", t, b"1") for t in range(55, 90))],
    "run_2.mcap": [("/c", 90, b"2"), ("/a", 91, b"2")],
}
N_MESSAGES = sum(map(len, PARTS.values()))
INFORMATION = "rosbag2_bagfile_information: "
MCAP = INFORMATION + "{storage_identifier: mcap, relative_file_paths: "


@pytest.fixture
def split(tmp_path):
    """A folder, with the metadata that rosbag2 would write."""
    folder = tmp_path / "run"
    folder.mkdir()
    for name, part in PARTS.items():
        (folder / name).write_bytes(log_bytes(part, chunk_size=100))
    names = [f"run/{name}" for name in PARTS]
    (folder / "metadata.yaml").write_text(f"{MCAP}{names}, version: 5, files: {[{'path': name} for name in names]}}}")
    return folder


def test_a_split_recording_is_one_log_one_index_and_recovered_one_file(split, tmp_path):
    log = scan(split)
    expected = sorted((m for part in PARTS.values() for m in part), key=lambda m: m[1])  # stably: in the files' order
    assert rows(log) == expected
    assert log.damage == []
    assert rows(scan(split, topics="/b".__eq__)) == [("/b", 40, b"b"), ("/b", 55, b"1")]
    assert rows(scan(split, start_ns=90)) == PARTS["run_2.mcap"]
    assert [channel.topic for channel in log.channels()] == ["/a", "/b", "/c"]
    assert log.end_ns == 91
    recovery = recover(split, tmp_path / "one.mcap")
    assert recovery.is_lossless
    assert rows(scan(tmp_path / "one.mcap")) == expected
    assert recovery.saved == N_MESSAGES
    summary = summarise_by_index(log_files(split), from_bytes=0)
    assert {topic.name: topic.messages for topic in summary.topics} == {"/a": 66, "/b": 2, "/c": 1}
    assert (summary.messages, summary.start_ns, summary.end_ns) == (69, 0, 91)
    (split / "run_1.mcap").write_bytes(log_bytes(PARTS["run_1.mcap"])[:-50])
    assert summarise_by_index(log_files(split), from_bytes=0) is None
    log = scan(split)  # damage names the file and costs no other
    assert len(rows(log)) == N_MESSAGES
    assert {(damage.kind, damage.detail.partition(": ")[0]) for damage in log.damage} == {("truncated", "run_1.mcap")}


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        (None, r"run: expected a file, or a folder of rosbag2 with metadata\.yaml, got one without"),
        ("a: [", r"metadata\.yaml: expected rosbag2_bagfile_information, got "),
        ("[]", r"metadata\.yaml: expected rosbag2_bagfile_information, got "),
        (INFORMATION + "3", "got TypeError"),
        (INFORMATION + "{storage_identifier: mcap}", "got KeyError 'relative_file_paths'"),
        (MCAP + "[]}", "got an empty list"),
        (MCAP + "[../gone.mcap]}", "no gone.mcap"),
    ],
)
def test_a_folder_that_is_no_recording_is_one_line(split, metadata, message, capsys):
    if metadata is None:
        (split / "metadata.yaml").unlink()
    else:
        (split / "metadata.yaml").write_text(metadata)
    with pytest.raises(RecordingError, match=message) as caught:
        scan(split)
    assert "\n" not in str(caught.value)
    assert run(["info", str(split)]) == FAILED


ODOMETRY = "nav_msgs/msg/Odometry"


def drive(folder, n=20):
    """Messages in CDR of a car that drives 10 m/s to the north, and their times."""
    twist, sent = {"twist": {"linear": point(10, 0, 0), "angular": point(0, 0, 0)}}, []
    for time_ns in range(0, n * 10**8, 10**8):
        pose = {"pose": {"position": point(5, time_ns / 10**8, 0), "orientation": quaternion(0, 0, np.pi / 2)}}
        message = {"header": header(time_ns), "child_frame_id": "car", "pose": pose, "twist": twist}
        sent.append(("/odom", time_ns, ODOMETRY, message))
    return [(m.log_time_ns, m.data) for m in scan(write_ros2_log(folder / "drive.mcap", sent))]


def check_drive(tracks):
    np.testing.assert_allclose(tracks.position[:, 1], np.arange(20))
    np.testing.assert_allclose(tracks.direction, np.pi / 2)
    np.testing.assert_allclose(tracks.speed, 10.0)


def write_bag(path, plugin, *, n=20):
    """A folder of rosbag2. -> its file."""
    with Writer(path, version=9, storage_plugin=plugin) as bag:
        topic = bag.add_connection("/odom", ODOMETRY, typestore=ROS)
        for time_ns, data in drive(path.parent, n):
            bag.write(topic, time_ns, data)
    (file,) = (file for file in path.iterdir() if file.name != "metadata.yaml")
    return file


@pytest.mark.parametrize("plugin", list(StoragePlugin), ids=lambda plugin: plugin.name)
def test_a_bag_reads_whatever_its_storage(tmp_path, plugin, capsys):
    bag = tmp_path / "bag"
    file = write_bag(bag, plugin)
    tracks = read_tracks(bag)
    check_drive(tracks)
    with Reader(bag) as reader:
        assert [(m.log_time_ns, m.data) for m in scan(bag)] == [(time, data) for _, time, data in reader.messages()]
    assert run(["info", str(bag)]) == DONE
    assert "nav_msgs/msg/Odometry" in capsys.readouterr().out
    grid = ["--tessellation", "grid", "--cell-size", "9"]
    assert run(["learn", str(bag), "-o", str(tmp_path / "map.mcap"), *grid]) == DONE
    assert read_tracks(file) == tracks


def write_old_bag(path, *, n):
    store = get_typestore(Stores.ROS1_NOETIC)
    path.unlink(missing_ok=True)
    with OldWriter(path) as bag:
        topic = bag.add_connection("/odom", ODOMETRY, typestore=store)
        for time_ns, data in drive(path.parent, n):
            bag.write(topic, time_ns, ROS.cdr_to_ros1(data, ODOMETRY))
    return path


def test_a_bag_is_read_as_it_is_now_and_nothing_of_it_stays(tmp_path, monkeypatch):
    """Rewritten, or of the same name in another folder; of three neither an open file nor a copy is left."""
    copies, n_rows = tmp_path / "copies", []
    for folder in ("here", "there", "copies"):
        (tmp_path / folder).mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(copies))
    for folder, n in (("here", 3), ("here", 5), ("there", 4), ("here", 5)):
        monkeypatch.chdir(tmp_path / folder)
        write_old_bag(Path("a.bag"), n=n)
        n_rows.append(len(read_tracks("a.bag")))
    assert n_rows == [3, 5, 4, 5]
    descriptors = Path("/proc/self/fd")
    before = len([*descriptors.iterdir()]) if descriptors.exists() else 0
    for k in range(3):
        with scan(write_old_bag(tmp_path / f"{k}.bag", n=2)) as log:
            assert len(list(log)) == 2
    assert not descriptors.exists() or len([*descriptors.iterdir()]) == before
    assert not [*copies.iterdir()]


def test_a_bag_of_ros_1_reads_as_one_of_ros_2(tmp_path):
    """Its headers have a number more, and its messages another encoding."""
    path = write_old_bag(tmp_path / "old.bag", n=20)
    check_drive(read_tracks(path))
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(RecordingError, match=r"old\.bag: expected a bag that rosbags can read.*rosbag reindex"):
        read_tracks(path)


def test_a_bag_without_definitions_is_read_and_a_broken_one_says_how_to_save_what_is_left(tmp_path):
    file = write_bag(tmp_path / "old", StoragePlugin.SQLITE3)
    with sqlite3.connect(file) as database:
        database.execute("DELETE FROM message_definitions")
    assert len(read_tracks(file)) == 20
    file = write_bag(tmp_path / "long", StoragePlugin.SQLITE3, n=200)
    data = bytearray(file.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 20_000] = bytes(20_000)
    file.write_bytes(data)
    with pytest.raises(RecordingError, match=r"long\.db3: expected a bag .*malformed; of a broken one `sqlite3 OLD"):
        scan(file)


@pytest.mark.parametrize(
    "cell",
    ["messages SET timestamp = 'soon'", "messages SET timestamp = 1.5", "messages SET timestamp = x'00'",
     f"messages SET data = {1 << 50}", "messages SET data = 'text'", "topics SET name = x'ff'",
     "topics SET offered_qos_profiles = 5", b"", b"SQLite format 3\0" + bytes(100)],
)  # fmt: skip
def test_a_bag_whose_cells_are_of_another_type_and_a_file_that_is_none_are_one_line(tmp_path, cell):
    """SQLite's columns take anything; nor is a file without tables one, or an empty one."""
    file = write_bag(tmp_path / "typed", StoragePlugin.SQLITE3, n=2)
    if isinstance(cell, bytes):
        file.write_bytes(cell)
    else:
        with sqlite3.connect(file) as database:
            database.execute(f"UPDATE {cell}")
    with pytest.raises(RecordingError, match=r"typed\.db3: expected a bag that rosbags can read, got ") as caught:
        scan(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("compression", list(OldWriter.CompressionFormat))
@pytest.mark.parametrize(("n_messages", "n_bytes"), [(1, 1 << 22), (40, 1 << 15)])
def test_chunks_of_ros_1_are_bounded_by_the_size_of_the_bag(tmp_path, monkeypatch, compression, n_messages, n_bytes):
    monkeypatch.setattr(budget, "SMALL_BYTES", 1 << 20)
    bag = OldWriter(tmp_path / "bomb.bag")
    bag.set_compression(compression)
    with bag:
        topic = bag.add_connection("/a", "std_msgs/msg/String", typestore=get_typestore(Stores.ROS1_NOETIC))
        for k in range(n_messages):
            bag.write(topic, k, (n_bytes - 4).to_bytes(4, "little") + bytes(n_bytes - 4))
    with pytest.raises(RecordingError, match=r"bomb.bag: expected a bag .* more than \d+ bytes, many times the size"):
        copied(tmp_path / "bomb.bag")


@pytest.mark.parametrize(("n_rows", "n_bytes"), [(1, 1 << 21), (3, 1 << 19)])
def test_rows_that_sqlite_generates_are_bounded_by_the_size_of_the_bag(tmp_path, monkeypatch, n_rows, n_bytes):
    monkeypatch.setattr(budget, "SMALL_BYTES", 1 << 20)
    bag = tmp_path / "generated.db3"
    with closing(sqlite3.connect(bag)) as made:
        made.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
            " offered_qos_profiles TEXT); INSERT INTO topics VALUES(1, '/a', 'std_msgs/msg/String', 'cdr', '');"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
            f" data BLOB GENERATED ALWAYS AS (zeroblob({n_bytes})) VIRTUAL);"
        )
        made.executemany("INSERT INTO messages VALUES(?, 1, ?)", [(i, i) for i in range(n_rows)])
        made.commit()
    with pytest.raises(RecordingError, match=r"too big|messages of more than"):
        copied(bag)
