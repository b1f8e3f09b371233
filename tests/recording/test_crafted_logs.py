"""Logs made to be slow: the work that finding the way through them takes grows as their size does."""

import bz2
import cProfile
import os
import struct
import time
import zlib
from types import SimpleNamespace

import lz4.frame
import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from lz4.frame import LZ4FrameDecompressor
from mcap.writer import CompressionType
from mcap_files import CHUNK, log_bytes, records, rows, write_log

from dirprim_filter import Tracks, read_tracks, write_tracks
from dirprim_filter.recording.container import budget, chunk, message_columns
from dirprim_filter.recording.container.recovery import recover
from dirprim_filter.recording.decoding.protobuf_plan import message_descriptor
from dirprim_filter.recording.inspection import inspect
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.tables import read_named
from peak_memory import FORGET, with_growth

HEAD, TAIL = log_bytes([])[:8], log_bytes([("/a", 1, b"x")])[8:]
FIXED = struct.Struct("<BQQQQIIQ")
SIZES = (1 << 15, 1 << 17)


def header(length, data_length, crc=0, size=100):
    """A chunk's record up to its data, uncompressed; opcode to length of the data."""
    return FIXED.pack(CHUNK, length, 1, 2, size, crc, 0, data_length)


FIELDS_SIZE = FIXED.size - 9


def whole(data):
    """A chunk of such contents."""
    return header(FIELDS_SIZE + len(data), len(data), zlib.crc32(data), len(data)) + data


SMALL = header(FIELDS_SIZE + 4, 4) + bytes(4)
MESSAGE = struct.pack("<BQ", 5, 3) + bytes(3)


def in_turn(size, head, small=SMALL):
    """What claims so many bytes, all that follow, and a small chunk."""
    step = len(head(size)) + len(small)
    return b"".join(head((size // step - i) * step) + small for i in range(size // step))


CRAFTED = {
    "chunks that all claim to reach beyond the end of the file":
        lambda size: header(FIELDS_SIZE + 2 * size, 2 * size) * (size // FIXED.size),
    "chunks that claim all that follows, but whose lengths contradict each other, and small whole ones":
        lambda size: in_turn(size, lambda n: header(7, n - FIXED.size, 1, n - FIXED.size), whole(bytes(4))) + TAIL,
    "records that hold more than their fields, to the end of the file, and chunks in these":
        lambda size: in_turn(size, lambda n: struct.pack("<BQII", 0x0C, n - 9, 0, 0)),
    "message indexes with an odd opcode behind each chunk: each may be the rest of a chunk before":
        lambda size: (SMALL + MESSAGE) * (size // len(SMALL + MESSAGE)),
}  # fmt: skip


@pytest.mark.parametrize("what", CRAFTED)
def test_the_work_grows_as_the_file_does(log_file, tmp_path, monkeypatch, what):
    """Bytes that are looked through and checked, and calls of functions."""
    work, pattern, read_contents = [], chunk.CHUNK_HEADER, chunk.read_contents

    def counted_search(data):
        work[-1][0] += len(data)
        return pattern.finditer(data)

    def counted_contents(file, one):
        work[-1][1] += one.data_length
        return read_contents(file, one)

    monkeypatch.setattr(chunk, "CHUNK_HEADER", SimpleNamespace(finditer=counted_search))
    monkeypatch.setattr(chunk, "read_contents", counted_contents)
    for size in SIZES:
        path = log_file(HEAD + CRAFTED[what](size))
        work.append(np.zeros(3))
        with cProfile.Profile() as calls:
            recover(path, tmp_path / "out.mcap", force=True)
        work[-1][2] = sum(one.callcount for one in calls.getstats())
        work[-1] /= size
        assert (work[-1][:2] < [8, 12]).all()
    assert (work[1] < 1.5 * work[0] + 0.1).all()


def test_what_stands_between_crafted_headers_is_still_read(log_file):
    """The bound on checksums leaves an honest log alone: of two broken lengths both chunks are read."""
    data = bytearray(log_bytes([("/a", i, bytes([i]) * 50) for i in range(200)], chunk_size=600))
    chunks = [start for opcode, start, _ in records(bytes(data)) if opcode == CHUNK]
    for start in chunks[2:9:3]:
        data[start + 1] ^= 0xFF
    with scan(log_file(data)) as log:
        assert sorted(m.log_time_ns for m in log) == list(range(200))
        assert len(log.damage) == 3


def test_chunks_that_all_span_the_log_are_merged_in_time_that_grows_as_they_do(log_file, monkeypatch):
    copied, gathered = [], message_columns.gathered
    monkeypatch.setattr(
        message_columns, "gathered", lambda parts, **how: copied.append(parts) or gathered(parts, **how)
    )
    rows = []
    for n in (100, 400):
        sent = [("/a", 1000 * t + k, bytes([k % 256])) for k in range(n) for t in range(20)]
        path = log_file(log_bytes(sent, chunk_size=600))
        del copied[:]
        assert [m.log_time_ns for m in scan(path)] == sorted(time_ns for _, time_ns, _ in sent)
        rows.append(sum(len(part) for parts in copied for part in parts))
    assert rows[1] < 6 * rows[0]


def test_a_log_that_is_cut_while_it_is_read_loses_its_end_and_says_so(log_file):
    path = log_file(log_bytes([("/a", i, os.urandom(5000)) for i in range(1000)], chunk_size=1 << 17))
    log = scan(path)
    for n, _ in enumerate(log, start=1):
        if n == 100:
            os.truncate(path, 1 << 20)
    assert 100 < n < 300
    assert {damage.kind for damage in log.damage} == {"truncated"}
    assert log.damage[0].detail == "the file was cut short while it was read"


def test_a_chunk_within_a_chunk_is_reported(log_file, tmp_path):
    inner = log_bytes([("/a", 1, b"x")], compression=CompressionType.NONE)
    chunk_at, end = next((start, end) for opcode, start, end in records(inner) if opcode == CHUNK)
    for data, said in (
        (inner[chunk_at:end], ["1 records of CHUNK within a chunk, which may hold none, are not read"]),
        (struct.pack("<BQ", 0x80, 3) + b"own", []),
    ):
        with scan(log_file(HEAD + whole(data) + TAIL)) as log:
            assert rows(log) == [("/a", 1, b"x")]
            assert [damage.detail for damage in log.damage if damage.kind != "summary"] == said
        recovered = recover(tmp_path / "log.mcap", tmp_path / "new.mcap", force=True)
        assert recovered.is_lossless == (not said)


def test_a_schema_may_stand_behind_its_channel(log_file):
    bare = log_bytes([("/a", 10, b"x")], use_chunking=False)
    schema, channel, message = (bare[start:end] for _, start, end in records(bare)[1:4])
    with scan(log_file(HEAD + whole(channel + schema + message) + log_bytes([])[8:])) as log:
        assert [(channel.topic, channel.schema.name) for channel in log.channels()] == [("/a", "Blob")]
        assert rows(log) == [("/a", 10, b"x")]


@pytest.mark.skipif(not FORGET.exists(), reason="only Linux says how much memory was taken at most")
@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
def test_a_chunk_that_becomes_more_than_it_may_is_damage_and_takes_that_memory_once(log_file, monkeypatch, compression):
    path = log_file(log_bytes([("/a", 0, bytes(1 << 27))], chunk_size=1 << 30, compression=compression))
    monkeypatch.setattr(budget, "SMALL_BYTES", (1 << 27) - 1)
    with scan(path) as log:
        sent, grown = with_growth(lambda: list(log))
        assert not sent
        assert ["at most, got more" in damage.detail for damage in log.damage] == [True]
    assert grown < 1.2 * (1 << 27)


@pytest.mark.parametrize("size", [0, 1, 9999, 10_000, 10_001, 30_000, 300_001])
def test_what_is_decompressed_in_steps_is_whole(monkeypatch, size):
    monkeypatch.setattr(budget, "STEP", 10_000)
    data = np.random.default_rng(0).integers(0, 4, size, np.uint8).tobytes()
    for kind, packed in ((LZ4FrameDecompressor, lz4.frame.compress(data)), (bz2.BZ2Decompressor, bz2.compress(data))):
        assert budget.decompressed(kind(), packed, size) == data
        assert size == 0 or budget.decompressed(kind(), packed, size - 1) is None
    cut = budget.decompressed(LZ4FrameDecompressor(), lz4.frame.compress(data)[:-8], size)
    assert cut is not None
    assert data.startswith(cut)


def test_descriptors_in_the_worst_order_are_read_soon():
    """Each file needs the next one: asked again for every file that is ready, 4,000 took six seconds."""
    files = FileDescriptorSet()
    for k in range(4000):
        file = files.file.add(name=f"{k}.proto", package="p")
        file.message_type.add(name=f"M{k}")
        file.dependency.extend([f"{k + 1}.proto"] if k < 3999 else [])
    begun = time.process_time()
    assert message_descriptor("p.M0", files.SerializeToString()).name == "M0"
    assert time.process_time() - begun < 1.0


def topics(path, n):
    """One message on each: 65,000 took half a minute when each topic looked through all rows."""
    sent = ((f"/{k}", k, b'{"pose": {"position": {"x": 1}}}') for k in range(n))
    write_log(path, sent, ("foxglove.PoseInFrame", "", b""), "json")
    return lambda: len(inspect(path).topics)


def ids(path, n):
    """Each vehicle is seen twice: so many that a look through all for each would be seen."""
    place = np.tile(np.random.default_rng(0).uniform(-100, 100, (n, 2)), (2, 1)) + np.repeat([0.0, 1.0], n)[:, None]
    seen = Tracks(track_id=np.tile(np.arange(n).astype(str), 2), time_ns=np.repeat([0, 10**8], n), position=place,
                  direction=np.zeros(2 * n), speed=np.ones(2 * n))  # fmt: skip
    write_tracks(seen, path, force=True)
    return lambda: read_tracks(path).n_tracks * (inspect(path).topics[0].tracks == n)


def sensors(path, n):
    path.write_text("time_s,track_id,x_m,y_m,sensor\n" + "".join(f"{k},v{k},{k},0,s{k}\n" for k in range(n)))
    return lambda: len(read_named(path).detections)


@pytest.mark.parametrize(("make", "sizes"), [(topics, (1000, 4000)), (ids, (4000, 16_000)), (sensors, (500, 2000))])
def test_the_work_of_reading_grows_as_what_is_read(tmp_path, make, sizes):
    seconds = []
    for n in sizes:
        read = make(tmp_path / "log", n)
        begun = time.process_time()
        assert read() == n
        seconds.append(time.process_time() - begun)
    assert seconds[1] < 8 * seconds[0]
