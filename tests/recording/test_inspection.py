"""`info`: the same of a log by its index as by reading it; odd times counted; quick where a log is long."""

import json
import re
import tracemalloc
from dataclasses import replace

import pytest
from mcap_files import CHUNK, log_bytes, records, scene, write_protobuf_log

from dirprim_filter import read_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.recording.container.source import log_files
from dirprim_filter.recording.errors import NoTracksError, RecordingError
from dirprim_filter.recording.inspection import inspect
from dirprim_filter.recording.schemas import decoders
from dirprim_filter.recording.summary import summarise_by_index

SENT = [(f"/topic{i % 3}", 1000 * i, str(i).encode() * 9) for i in range(200)]


def test_the_index_tells_what_reading_tells(log_file):
    path = log_file(log_bytes(SENT, chunk_size=900))
    reported, read = summarise_by_index(log_files(path), from_bytes=0), inspect(path)
    topics = tuple(replace(topic, why="") for topic in read.topics)  # the index does not look at definitions
    assert (reported.topics, reported.messages, reported.start_ns, reported.end_ns) == (
        topics, read.messages, read.start_ns, read.end_ns,
    )  # fmt: skip
    assert (reported.is_checked, read.is_checked) == (False, True)
    assert summarise_by_index(log_files(path)) is None  # a short log is read
    few = summarise_by_index(log_files(path), topics="/topic1", from_bytes=0)  # it knows the span of all topics alone
    assert ([topic.name for topic in few.topics], few.start_ns, few.end_ns) == (["/topic1"], None, None)


def test_an_index_that_is_not_whole_says_nothing(log_file):
    data = log_bytes(SENT, chunk_size=900)
    summary = next(start for opcode, start, _ in records(data) if opcode == 0x0F)
    for at in range(summary, len(data), 37):
        broken = bytearray(data)
        broken[at] ^= 4
        assert summarise_by_index(log_files(log_file(broken)), from_bytes=0) is None, at
    assert summarise_by_index(log_files(log_file(data[:-9])), from_bytes=0) is None


def test_a_long_log_is_reported_by_its_index_unless_it_is_to_be_checked(log_file, capsys, monkeypatch):
    data = bytearray(log_bytes(SENT, chunk_size=900))
    chunk = next(start for opcode, start, _ in records(bytes(data)) if opcode == CHUNK)
    data[chunk + 70] ^= 1
    path = log_file(data)
    monkeypatch.setattr("dirprim_filter.recording.summary.summarise_by_index.__kwdefaults__", {
        "topics": None, "from_bytes": 0,
    })  # fmt: skip
    assert run(["info", str(path)]) == 0
    assert "its chunks were not checked" in capsys.readouterr().out
    assert run(["info", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["is_checked"] is False
    assert run(["info", str(path), "--check"]) == 3
    assert re.search(r"damage: chunk_\w+ at byte \d+ \(\d+ bytes, \d+ messages lost\): ", capsys.readouterr().out)
    assert run(["info", str(path), "--strict"]) == 1


def test_filters(log_file, capsys):
    path = log_file(log_bytes(SENT, chunk_size=900))
    assert run(["info", str(path), "--topics", "/topic[01]", "--start", "60000ns", "--end", "90000ns", "--json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert {topic["name"]: topic["messages"] for topic in reported["topics"]} == {"/topic0": 10, "/topic1": 10}
    assert (reported["start_ns"], reported["end_ns"]) == (60_000, 88_000)


def test_names_in_a_log_do_not_steer_the_terminal(log_file, capsys):
    """An escape that clears the screen, a new line, and a mark that turns the direction of writing."""
    path = log_file(log_bytes([("/a\x1b[2J\nb\u202e", 0, b"")]))
    assert run(["info", str(path)]) == 0
    with pytest.raises(NoTracksError) as caught:
        read_tracks(path)
    assert str(caught.value).isprintable()
    for said in (capsys.readouterr().out, str(caught.value)):
        assert r"/a\x1b[2J\nb\u202e" in said
        assert not set(said) & set("\x1b\u202e")


def test_info_decodes_a_chunk_of_any_size_in_pieces(tmp_path, monkeypatch):
    """One chunk of many equal messages of entities without anything: a few kilobytes that asked for gigabytes."""
    update = scene([("", 0.0, 0.0)] * 40)
    messages = [("/objects", k, update) for k in range(300)]
    path = write_protobuf_log(tmp_path / "log.mcap", messages, chunk_size=1 << 30)
    whole = inspect(path)
    sizes = []
    real = decoders.Decoders.rows
    monkeypatch.setattr(decoders, "BATCH_BYTES", 1 << 14)
    monkeypatch.setattr(
        decoders.Decoders, "rows", lambda of, some: sizes.append(int((some.stop - some.start).sum())) or real(of, some)
    )
    assert inspect(path) == whole
    assert max(sizes) < (1 << 14) + update.ByteSize()
    assert sum(sizes) == 300 * update.ByteSize()


def test_info_decodes_small_chunks_together(tmp_path, monkeypatch):
    """A recorder that closes a chunk for each message: 20,000 of them took 40 s."""
    path = write_protobuf_log(
        tmp_path / "log.mcap", [("/objects", k, scene([("a", k, 0.0)])) for k in range(300)], chunk_size=1
    )
    sizes, real = [], decoders.Decoders.rows
    monkeypatch.setattr(decoders.Decoders, "rows", lambda of, some: sizes.append(len(some)) or real(of, some))
    assert [(topic.messages, topic.tracks) for topic in inspect(path).topics] == [(300, 1)]
    assert sizes == [300]


def test_elements_that_hold_nothing_take_memory_of_one_message_at_a_time_and_are_no_endless_rows(tmp_path):
    """50 messages of 60,000 in 9 kB: what was made of them took 490 MiB."""
    for body, wanted in ((b"", 0), (b"\x42\x04\x0a\x02\x0a\x00", 480_000)):
        update = (b"\x12" + bytes([len(body)]) + body) * 60_000
        path = write_protobuf_log(tmp_path / "log.mcap", [("/objects", k, update) for k in range(8)])
        tracemalloc.start()
        found = inspect(path)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert sum(topic.detections for topic in found.topics) == wanted
        assert peak < 140e6
    write_protobuf_log(path, [("/objects", k, update) for k in range(18)])
    with pytest.raises(RecordingError, match="expected at most 1048576 rows of objects in so small a log, got more"):
        read_tracks(path)
