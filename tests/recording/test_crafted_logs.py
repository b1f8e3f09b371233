"""Logs made to be slow: the work that finding the way through them takes grows as their size does."""

import struct
import zlib

import pytest
from mcap_files import CHUNK, log_bytes, records

from dirprim_filter.recording.container import chunk, resync
from dirprim_filter.recording.container.recovery import recover
from dirprim_filter.recording.scan import scan

HEAD, TAIL = log_bytes([])[:8], log_bytes([("/a", 1, b"x")])[8:]
FIXED = struct.Struct("<BQQQQIIQ")
SIZES = (1 << 16, 1 << 18)


def header(length, data_length, crc=0, size=100):
    """A chunk's record up to its data, uncompressed; opcode to length of the data."""
    return FIXED.pack(CHUNK, length, 1, 2, size, crc, 0, data_length)


FIELDS_SIZE = FIXED.size - 9


def reaching_beyond_the_end(size):
    """Chunks that all claim to reach beyond the end of the file."""
    n = size // FIXED.size
    return HEAD + b"".join(header(FIELDS_SIZE + 2 * size, 2 * size) for _ in range(n))


def claiming_the_rest(size):
    """In turn, a chunk that claims all that follows, but whose lengths contradict each other, and a small whole one."""
    small = header(FIELDS_SIZE + 4, 4, zlib.crc32(bytes(4)), 4) + bytes(4)
    step = FIXED.size + len(small)
    n = size // step
    parts = []
    for i in range(n):
        rest = (n - i) * step - FIXED.size
        parts += [header(7, rest, crc=1, size=rest), small]
    return HEAD + b"".join(parts) + TAIL


def with_bytes_more(size):
    """Records that hold more than their fields, to the end of the file, and chunks in these."""
    small = header(FIELDS_SIZE + 4, 4) + bytes(4)
    metadata = struct.Struct("<BQII")
    step = metadata.size + len(small)
    n = size // step
    parts = []
    for i in range(n):
        parts += [metadata.pack(0x0C, (n - i) * step - 9, 0, 0), small]
    return HEAD + b"".join(parts)


def swallowing(size):
    """Message indexes with an odd opcode behind each chunk: each may be the rest of a chunk before."""
    small = header(FIELDS_SIZE + 4, 4) + bytes(4)
    message = struct.pack("<BQ", 5, 3) + bytes(3)
    return HEAD + (small + message) * (size // (len(small) + len(message)))


@pytest.mark.parametrize("craft", [reaching_beyond_the_end, claiming_the_rest, with_bytes_more, swallowing])
def test_the_work_grows_as_the_file_does(tmp_path, monkeypatch, craft):
    work = []
    for size in SIZES:
        path = tmp_path / f"{size}.mcap"
        path.write_bytes(craft(size))
        with monkeypatch.context() as patch:
            done = count_work(patch)
            recover(path, tmp_path / "out.mcap", force=True)
        work.append({name: n / size for name, n in done.items()})
        assert done["looked through"] < 8 * size
        assert done["headers"] < size // 4
        assert done["checked"] < 12 * size
    assert all(work[1][name] < 1.5 * work[0][name] + 0.1 for name in work[0])


def count_work(monkeypatch):
    """Bytes that are looked through and checked, and headers that are parsed, from now on."""
    done = {"looked through": 0, "headers": 0, "checked": 0}
    pattern, chunk_at, read_contents = resync.CHUNK_HEADER, chunk.chunk_at, chunk.read_contents

    class Pattern:
        def search(self, file, at, until):
            match = pattern.search(file, at, until)
            done["looked through"] += (match.start() if match else until) - at
            return match

    def counted_chunk_at(file, at):
        done["headers"] += 1
        return chunk_at(file, at)

    def counted_contents(file, one):
        done["checked"] += one.data_length
        return read_contents(file, one)

    monkeypatch.setattr(resync, "CHUNK_HEADER", Pattern())
    monkeypatch.setattr(resync, "chunk_at", counted_chunk_at)
    monkeypatch.setattr(resync, "read_contents", counted_contents)
    return done


def test_what_stands_between_crafted_headers_is_still_read(tmp_path):
    """The bound on checksums leaves an honest log alone: of two broken lengths both chunks are read."""
    sent = [("/a", i, bytes([i]) * 50) for i in range(200)]
    data = bytearray(log_bytes(sent, chunk_size=600))
    chunks = [start for opcode, start, _ in records(bytes(data)) if opcode == CHUNK]
    for start in chunks[2:9:3]:
        data[start + 1] ^= 0xFF
    (tmp_path / "a.mcap").write_bytes(data)
    with scan(tmp_path / "a.mcap") as log:
        assert sorted(m.log_time_ns for m in log) == list(range(200))
        assert len(log.damage) == 3
