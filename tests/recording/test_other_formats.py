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
    "t.gz": (b"\x1f\x8b\x08\x08", "gzip; it does not decompress; `dirprim convert` reads a .csv.gz"),
    "t.dat": (b"time_s,track_id\n", "`dirprim convert` makes logs of tables"),
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


@pytest.mark.parametrize("encoding", ["flatbuffer", "", "cdr2"])
def test_an_encoding_that_is_not_read_is_named_and_no_fields_are_advised(tmp_path, capsys, encoding):
    sent = [(f"/topic_{i}", i, b"\0") for i in range(2)]
    log = write_log(tmp_path / "log.mcap", sent, ("std_msgs/String", "", b""), encoding)
    assert run(["info", str(log)]) == 0
    said = capsys.readouterr().out
    for fields in ([], ["--set", "fields=x=.x,y=.y"], ["--topics", "/topic_0"]):
        assert run(["learn", str(log), "-o", str(tmp_path / "m"), *fields]) == 1
        said += capsys.readouterr().err
    assert said.count(f"messages encoded as {encoding or 'nothing'} are not read") == 4
    assert "choose a topic" not in said
