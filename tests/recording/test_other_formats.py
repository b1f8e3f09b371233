"""What is not read says what it is and what to do, in one short line."""

import pytest
from mcap_files import write_log

from dirprim_filter import read_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.recording.errors import NotMcapError, TableError
from dirprim_filter.recording.tables import read_named

LONGEST = 600
FILES = {
    "bag_0": (b"SQLite format 3\0", "a ROS 2 bag in SQLite; `dirprim` reads its folder, or a file named .db3"),
    "old.rosbag": (b"#ROSBAG V2.0\n", "a ROS 1 bag; `dirprim` reads a file named .bag"),
    "run.rrd": (b"RRF2\0\0\0\0", "a rerun recording; `dirprim view`"),
    "av2.bin": (b"ARROW1\0\0", "a Feather table; `dirprim convert` without --format makes"),
    "t.bin": (b"PAR1\x15\x04", "a Parquet table; `dirprim convert` without --format makes"),
    "t.gz": (b"\x1f\x8b\x08\x08", "gzip; decompress it; `dirprim convert` reads a .csv.gz as it is"),
    "t.txt": (b"time_s,track_id\n", "`dirprim convert` makes logs of tables"),
    "empty.mcap": (b"", "an empty file"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_another_format_says_the_way(tmp_path, name):
    opening, reported = FILES[name]
    (tmp_path / name).write_bytes(opening + bytes(100) if opening else b"")
    with pytest.raises(NotMcapError, match="expected an MCAP log, got") as caught:
        read_tracks(tmp_path / name)
    assert reported in str(caught.value)
    assert len(str(caught.value).replace(str(tmp_path), "")) < LONGEST


@pytest.mark.parametrize("opening", [b"SQLite format 3\0", b"\x89MCAP0\r\n"])
def test_a_table_of_another_format_says_the_way(tmp_path, opening):
    (tmp_path / "t.csv").write_bytes(opening + bytes(100))
    with pytest.raises(TableError, match=r"expected a table of text, got an? [^;]*; .*`"):
        read_named(tmp_path / "t.csv")


def test_a_log_of_ros_1_is_reported_by_its_encoding_and_no_fields_are_advised(tmp_path, capsys):
    sent = [(f"/topic_{i}", i, b"\0") for i in range(2)]
    bag = write_log(tmp_path / "ros1.mcap", sent, ("std_msgs/String", "ros1msg", b"string data"), "ros1")
    assert run(["info", str(bag)]) == 0
    said = capsys.readouterr().out
    for fields in (None, "x=.x,y=.y"):
        assert run(["learn", str(bag), "-o", str(tmp_path / "m"), *(["--fields", fields] if fields else [])]) == 1
        said += capsys.readouterr().err
    assert said.count("messages encoded as ros1 are not read, but protobuf, cdr, json; give the ROS 1 bag itself") == 3
    assert "--fields says" not in said
