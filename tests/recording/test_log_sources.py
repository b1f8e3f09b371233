"""Pipes, standard input and URLs read as files do; seeking opens no more chunks than needed; memory is bounded."""

import gzip
import io
import os
import subprocess
import sys
import tempfile
import threading
from collections import deque
from pathlib import Path

import fsspec
import numpy as np
import pytest
import zstandard
from mcap_files import CHUNK, MESSAGE, log_bytes, records, rows, write_log

from dirprim_filter import read_estimates, read_tracks, save_map, write_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.detections import Detections
from dirprim_filter.recording.container import mcap_file, message_columns, temporary_copy
from dirprim_filter.recording.container.errors import NoRoomError, without_secrets
from dirprim_filter.recording.container.log import Log, Scan
from dirprim_filter.recording.errors import NotMcapError, RecordingError
from dirprim_filter.recording.inspection import inspect
from dirprim_filter.recording.reader import stream_detections
from dirprim_filter.recording.scan import scan
from peak_memory import FORGET, with_growth

SENT = [(f"/topic{i // 100}", 1000 * i, str(i).encode() * 9) for i in range(300)]


def put_in(monkeypatch, data):
    """Standard input holds the bytes."""
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))


def test_pipes_are_read_as_files(tmp_path):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    writer = threading.Thread(target=fifo.write_bytes, args=(log_bytes(SENT),))
    writer.start()
    with scan(fifo) as log:
        assert rows(log) == rows(log) == SENT  # a pipe gives its bytes once; the copy stays while it is open
    writer.join()
    done = subprocess.run(
        [sys.executable, "-m", "dirprim_filter", "info", "-"], input=log_bytes(SENT), capture_output=True, check=True
    )
    assert b"300 messages" in done.stdout


def test_urls(tmp_path):
    with fsspec.open("memory://folder/log.mcap", "wb") as file:
        file.write(log_bytes(SENT))
    assert rows(scan("memory://folder/log.mcap")) == SENT
    assert run(["info", "memory://folder/log.mcap"]) == 0
    (tmp_path / "log.mcap").write_bytes(log_bytes(SENT))
    assert rows(scan((tmp_path / "log.mcap").as_uri())) == SENT
    with pytest.raises(RecordingError, match="fsspec can read"):
        scan("nosuchscheme://log.mcap")
    with pytest.raises(FileNotFoundError, match=r"No such file: 'memory://none.mcap'"):
        scan("memory://none.mcap")


def test_an_error_of_a_remotes_own_library_is_one_line_that_names_the_url(capsys):

    class NoCredentialsError(Exception):
        """As botocore's, of no kind that Python knows."""

    class Remote(fsspec.AbstractFileSystem):
        def _open(self, path, **_):
            raise NoCredentialsError("unable to locate credentials")

    fsspec.register_implementation("vault", Remote, clobber=True)
    assert run(["info", "vault://bucket/log.mcap"]) == 1
    reported = capsys.readouterr().err
    assert reported.startswith("error: vault://bucket/log.mcap: expected a URL that fsspec can read: unable to locate")
    assert reported.count("\n") == 1


@pytest.mark.parametrize(
    "asked",
    [{"start_ns": 120_000}, {"end_ns": 50_000}, {"start_ns": 99_000, "end_ns": 101_001}, {"start_ns": 10**9},
     {"start_ns": -5, "end_ns": 0}, {"topics": "/topic1".__eq__}, {"topics": "/topic1".__eq__, "start_ns": 150_000}],
)  # fmt: skip
def test_filters_give_what_filtering_afterwards_would_and_leave_chunks_closed(log_file, monkeypatch, asked):
    log = scan(log_file(log_bytes(SENT, chunk_size=500)), **asked)
    opened = []
    read = mcap_file.read_contents
    monkeypatch.setattr(mcap_file, "read_contents", lambda file, chunk: opened.append(chunk) or read(file, chunk))
    start_ns, end_ns = asked.get("start_ns", 0), asked.get("end_ns", 1 << 62)
    wanted = [m for m in SENT if start_ns <= m[1] < end_ns and asked.get("topics", bool)(m[0])]
    assert rows(log) == wanted
    assert len(opened) <= len(wanted) * 60 / 500 + 3 < len(log.log.chunks)


def test_without_an_index_that_can_be_trusted_every_chunk_is_opened(log_file):
    """A chunk's own times have no checksum: alone they are no reason to pass over it."""
    log = scan(log_file(log_bytes(SENT, chunk_size=500)[:-60]), start_ns=120_000)
    assert rows(log) == SENT[120:]
    assert log.damage


@pytest.mark.parametrize("held", [0, message_columns.HELD_BYTES])
@pytest.mark.parametrize("longest", [40, 1 << 13])
@pytest.mark.parametrize("span", [1, 500, 10**6])
def test_chunks_that_overlap_are_merged_in_memory_and_on_disk(log_file, monkeypatch, held, longest, span):
    """Of one time, some, or all over the log; those of one time stay in the order of the file."""
    monkeypatch.setattr(message_columns, "HELD_BYTES", held)
    monkeypatch.setattr(message_columns, "WINDOW_BYTES", 40 * longest)
    rng = np.random.default_rng(span)
    sent = [("/a", i // 100 + int(rng.integers(span)), rng.bytes(int(rng.integers(longest)))) for i in range(1000)]
    log = scan(log_file(log_bytes(sent, chunk_size=20 * longest)))
    assert len(log.log.chunks) > 20
    assert rows(log) == sorted(sent, key=lambda row: row[1])
    assert sorted(m.data for part in log.parts() for m in part.messages()) == sorted(data for _, _, data in sent)


@pytest.mark.skipif(not FORGET.exists(), reason="only Linux says how much memory was the most")
def test_memory_stays_bounded_when_everything_overlaps(log_file):
    """100 MB of contents, every chunk over the whole time: the process grows by less than 70 MB."""
    payload, grown = bytes(100_000), []
    for n in (20, 1000):  # the first takes what any log takes
        path = log_file(log_bytes([("/a", 1000 * (i % 5), payload) for i in range(n)]))
        grown.append(with_growth(lambda path=path: deque(scan(path), maxlen=0))[1])
    assert grown[1] < 70 << 20


def test_a_copy_that_finds_no_room_blames_the_disk_and_not_the_pipe(tmp_path, log_file, monkeypatch):
    """And of a copy nothing is left when the process is killed: it has no name."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    put_in(monkeypatch, b"hello")
    with pytest.raises(NotMcapError, match=r"^-: expected an MCAP log"):
        scan("-")
    put_in(monkeypatch, log_bytes(SENT))
    with scan("-") as log:
        assert rows(log) == rows(log) == SENT
        assert not any(tmp_path.iterdir())
    put_in(monkeypatch, log_bytes(SENT))
    monkeypatch.setattr(temporary_copy.tempfile, "TemporaryFile", lambda **_: io.FileIO("/dev/full", "w"))
    with pytest.raises(NoRoomError, match=r"-: expected to copy it to .*: No space left .* TMPDIR"):
        scan("-")
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(RecordingError, match="-: expected a log on standard input, which is closed"):
        scan("-")
    monkeypatch.setattr(message_columns, "HELD_BYTES", 100)
    overlapping = log_file(log_bytes([("/a", i % 3, b"x" * 90) for i in range(90)], chunk_size=500))
    with pytest.raises(NoRoomError, match=r"chunks that overlap in time: expected to copy .* TMPDIR"):
        list(scan(overlapping))


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("https://u:secret@host/a.mcap?X-Sig=se/cret:1: expected", "https://host/a.mcap?...: expected"),
        ("https:/u:secret@host/a.mcap: cut", "https:/host/a.mcap: cut"),
        ("s3://key:secret@bucket/a b?v=secret", "s3://bucket/a b?v=secret"),
        ("why? a/b@c?", "why? a/b@c?"),
        ("rerun+http://127.0.0.1:9876/proxy, 7", "rerun+http://127.0.0.1:9876/proxy, 7"),
    ],
)
def test_what_gives_access_to_a_url_is_not_shown(text, shown):
    """A blank ends a URL: what is behind it is a text of its own."""
    assert without_secrets(text) == shown
    assert str(RecordingError(text)) == shown


def test_a_signed_url_is_no_pattern_and_its_signature_is_nowhere(tmp_path, capsys):
    url = "https://u:secret@127.0.0.1:1/log.mcap?X-Amz-Signature=secret"
    assert run(["learn", url, "-o", str(tmp_path / "map.mcap")]) == 1
    said = capsys.readouterr().err
    assert "127.0.0.1:1/log.mcap" in said
    assert "secret" not in said
    assert "pattern" not in said


@pytest.fixture
def opened(tmp_path, ring, ring_map, monkeypatch):
    """A log with and one without a Summary section, a map, and the files and chunks that were opened."""
    monkeypatch.chdir(tmp_path)
    write_tracks(ring[ring.track_id < 6], "log.mcap")
    Path("cut.mcap").write_bytes(Path("log.mcap").read_bytes()[:-30])
    save_map(ring_map, "map.mcap")
    monkeypatch.setattr("dirprim_filter.cli.motion.load_map", lambda _: ring_map)
    read, outline, seen = mcap_file.read_contents, mcap_file.Outline, []
    monkeypatch.setattr(mcap_file, "read_contents", lambda file, chunk: seen.append(chunk.offset) or read(file, chunk))
    monkeypatch.setattr(mcap_file, "Outline", lambda file: seen.append("outline") or outline(file))
    return seen


@pytest.mark.parametrize("log", ["log.mcap", "cut.mcap"])
@pytest.mark.parametrize(
    ("command", "more"),
    [
        ("info", []),
        ("learn", ["-o", "new.mcap", "--tessellation", "grid", "--cell-size", "8"]),
        ("track", ["--map", "map.mcap", "-o", "out.mcap", "--particles", "20"]),
    ],
)
def test_a_command_opens_and_decompresses_a_log_once(opened, log, command, more):
    assert run([command, log, *more]) == (0 if log == "log.mcap" else 3)
    assert 2 <= len(opened) == len(set(opened))


@pytest.mark.parametrize("log", ["log.mcap", "cut.mcap"])
def test_an_open_log_is_read_as_often_as_wanted(opened, log):
    with Log(log) as one:
        assert inspect(one).messages > 0
        assert read_tracks(one) == read_tracks(one) == read_tracks(log)
        assert len(list(stream_detections(one))) == len(list(stream_detections(log)))
        assert len(list(Scan(one))) == inspect(one).messages
    n_chunks = len(one.chunks)
    assert len(opened) == 3 * (n_chunks + 1)  # once as it is open, and twice by its name


@pytest.fixture
def written_live(tmp_path, ring):
    """A pipe, and a log that is written to it frame by frame, no more than three ahead of those that came."""
    write_tracks(ring[(ring.track_id < 4) & (ring.time_ns < 4e9)], tmp_path / "ring.mcap")
    os.mkfifo(tmp_path / "pipe")
    ahead, late = threading.Semaphore(3), []

    def write(*, chunked):
        sent = [message for message in scan(tmp_path / "ring.mcap") if message.topic == "/objects"]
        said, schema = sent[0].channel, sent[0].channel.schema
        how = (schema.name, schema.encoding, schema.data), said.message_encoding
        log = write_log(tmp_path / "live.mcap", rows(sent), *how, use_chunking=chunked, chunk_size=1).read_bytes()
        with (tmp_path / "pipe").open("wb", buffering=0) as pipe:
            pipe.write(log[:8])
            for opcode, start, end in records(log):
                late.extend([not ahead.acquire(timeout=10)] if opcode in (MESSAGE, CHUNK) else [])
                pipe.write(log[start:end])
            pipe.write(log[-8:])

    return tmp_path, write, ahead, late


@pytest.mark.parametrize("chunked", [False, True])
def test_a_live_pipe_is_read_as_it_is_written(written_live, chunked):
    """Of a log of 10 Hz an instant comes at most .2 s late: when the second one behind it was written."""
    folder, write, ahead, late = written_live
    thread = threading.Thread(target=write, kwargs={"chunked": chunked}, daemon=True)
    thread.start()
    stream = stream_detections(folder / "pipe", live=True)
    came = []
    for seen in stream:
        came.append(seen)
        ahead.release()
    thread.join()
    assert not any(late)
    assert not stream.losses.damage
    assert Detections.concatenate(came) == Detections.concatenate(list(stream_detections(folder / "ring.mcap")))


def test_track_with_a_lag_takes_a_live_pipe_as_a_file(written_live, ring_map):
    folder, write, ahead, late = written_live
    save_map(ring_map, folder / "map.mcap")
    given = ["--map", str(folder / "map.mcap"), "--lag", "0.5", "--noise", "0.5", "--particles", "20"]
    ahead.release(10_000)
    thread = threading.Thread(target=write, kwargs={"chunked": False}, daemon=True)
    thread.start()
    for name in ("pipe", "ring.mcap"):
        assert run(["track", str(folder / name), "-o", str(folder / f"{name}.out"), *given]) == 0
    thread.join()
    assert not any(late)
    piped, filed = (read_estimates(folder / f"{name}.out") for name in ("pipe", "ring.mcap"))
    np.testing.assert_array_equal(piped.position, filed.position)


@pytest.mark.parametrize("pack", [zstandard.ZstdCompressor().compress, gzip.compress], ids=["zstd", "gzip"])
def test_a_log_that_is_compressed_as_a_whole_is_read_as_the_log(tmp_path, caplog, pack):
    """In several frames too; cut, what comes before is read and both losses are said; a bomb is refused."""
    whole = Path("recordings/roundabout_track.mcap").read_bytes()
    tracks = read_tracks(Path("recordings/roundabout_track.mcap"))
    packed = tmp_path / "log.mcap.packed"
    for parts in ([whole], [whole[:1000], whole[1000:]]):
        packed.write_bytes(b"".join(map(pack, parts)))
        read = read_tracks(packed)
        np.testing.assert_array_equal(read.position, tracks.position)
    packed.write_bytes(pack(whole)[: len(pack(whole)) // 2])
    log = scan(packed)
    assert sum(1 for _ in log) > 0
    assert log.damage
    packed.write_bytes(pack(bytes((1 << 26) + 1)))
    with pytest.raises(RecordingError, match="expected a log of at most 67108864 bytes inside, got more"):
        read_tracks(packed)
