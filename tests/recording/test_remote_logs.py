"""Remote logs: what of them is fetched, and that they read as if they were here."""

import contextlib
import hashlib
import io
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from mcap_files import log_bytes

from dirprim_filter import read_tracks, write_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.cli.results import checksum
from dirprim_filter.recording.container import remote_file, source
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.reader import read_track_logs
from dirprim_filter.recording.scan import scan
from dirprim_filter.store.adding import add_logs
from dirprim_filter.store.logs import find_logs
from situations import ring_traffic

fsspec = pytest.importorskip("fsspec", reason="reading URLs needs fsspec")
URL = "counting://log.mcap"


class Part(fsspec.spec.AbstractBufferedFile):
    def _fetch_range(self, start, end):
        if not Counting.knows_ranges:
            raise ValueError("no range requests")
        if Counting.most_bytes < end < len(Counting.log):
            raise TimeoutError("no answer")
        Counting.fetched += end - start
        return Counting.log[start:end]


class Counting(fsspec.AbstractFileSystem):
    """One log, and how many bytes of it were asked for."""

    protocol = "counting"
    cachable = False
    log = b""
    fetched, most_bytes, knows_ranges = 0, 1 << 30, True

    def info(self, path, **_):
        return {"name": path, "size": len(self.log), "type": "file", "ETag": "1"}

    def _open(self, path, mode="rb", block_size=None, **options):
        if block_size == 0:
            Counting.fetched += len(self.log)
            return io.BytesIO(self.log)
        return Part(self, path, mode, block_size, **options)


fsspec.register_implementation("counting", Counting, clobber=True)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Tracks, and a log of them and of a camera that says much after every tenth of their messages."""
    path = tmp_path_factory.mktemp("drive") / "tracks.mcap"
    rng = np.random.default_rng(0)
    write_tracks(ring_traffic(rng, n_vehicles=40, n_rows=60), path)
    sent = [message for message in scan(path) if message.channel.schema.name == "dirprim.Observations"]
    file = io.BytesIO()
    writer = Writer(file, chunk_size=1 << 14)
    writer.start()
    said = sent[0].channel
    schema = writer.register_schema(said.schema.name, said.schema.encoding, said.schema.data)
    tracks = writer.register_channel("/tracks", said.message_encoding, schema)
    camera = writer.register_channel("/camera", "raw", 0)
    for i, message in enumerate(sent):
        writer.add_message(tracks, message.log_time_ns, message.data, message.publish_time_ns)
        for _ in range(8 if i % 10 == 9 else 0):
            writer.add_message(camera, message.log_time_ns, rng.bytes(1 << 15), message.publish_time_ns)
    writer.finish()
    return read_tracks(path), file.getvalue()


@pytest.fixture(autouse=True)
def asked(monkeypatch, drive):
    """Nothing was fetched before, and blocks are small."""
    for name, value in {"fetched": 0, "log": drive[1], "knows_ranges": True, "most_bytes": 1 << 30}.items():
        monkeypatch.setattr(Counting, name, value)
    monkeypatch.setattr(remote_file, "FETCHED_BYTES", 1 << 9)


def test_little_more_is_fetched_than_the_chunks_that_carry_tracks(drive):
    with scan(URL) as log:
        summary = log.log.files[0].outline.summary
        size = dict.fromkeys(summary.channels, 0)
        for index in summary.chunks.values():
            for channel in index.message_index_offsets:
                size[channel] += index.chunk_length + index.message_index_length
    tracks, camera = (size[k] for k, _ in sorted(summary.channels.items(), key=lambda item: item[1].topic)[::-1])
    Counting.fetched = 0
    with source.copied_once():
        assert read_tracks(URL) == drive[0]
        assert tracks <= Counting.fetched <= 1.1 * tracks < 0.5 * camera
        before = Counting.fetched
        assert read_tracks(URL) == drive[0]
        assert Counting.fetched == before
        assert checksum(URL) == hashlib.sha256(drive[1]).hexdigest()
    assert 0 <= Counting.fetched - len(drive[1]) < remote_file.FETCHED_BYTES  # each block once, the last to its end


def changed(log, at, to=b"x"):
    return log[:at] + to + log[at + len(to) :]


HARMLESS = ("another time in the chunk", "another length of the chunk", "another message index")
"""The contents have a checksum of their own, and the Summary section says where they stand."""


HARMS = {
    "none": lambda log, _: log,
    "no summary": lambda log, _: log[: log.rindex(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")],
    "summary damaged": lambda log, _: changed(log, len(log) - 60),
    "footer cut": lambda log, _: log[:-9],
    "contents damaged": lambda log, chunk: changed(log, chunk.data_offset + 40),
    "another time in the chunk": lambda log, chunk: changed(log, chunk.offset + 9),
    "another length of the chunk": lambda log, chunk: changed(log, chunk.offset + 1),
    "another message index": lambda log, chunk: changed(log, chunk.end + 9),
}


@pytest.mark.parametrize("name", HARMS)
@pytest.mark.parametrize("knows_ranges", [True, False])
def test_a_log_reads_as_if_it_were_here(name, knows_ranges, drive, tmp_path, monkeypatch):
    path = tmp_path / "log.mcap"
    path.write_bytes(drive[1])
    with scan(path) as whole:
        first = whole.log.chunks[0]
    harmed = HARMS[name](drive[1], first)
    path.write_bytes(harmed)
    monkeypatch.setattr(Counting, "log", harmed)
    monkeypatch.setattr(Counting, "knows_ranges", knows_ranges)
    here, there = read_track_logs(path), read_track_logs(URL)
    assert there.tracks == here.tracks
    assert bool(there.losses.damage) == (bool(here.losses.damage) and not (knows_ranges and name in HARMLESS))
    with scan(URL) as far, scan(path) as near:
        assert list(far) == list(near)
        assert far.metadata == near.metadata


def test_a_connection_that_breaks_is_said_in_one_line_and_the_next_read_goes_on(monkeypatch, tmp_path, drive):
    monkeypatch.setattr(remote_file, "FETCHED_BYTES", 1 << 12)
    with scan(URL) as log:
        monkeypatch.setattr(Counting, "most_bytes", 1 << 12)
        with pytest.raises(RecordingError, match="no answer; try again"):
            list(log)
        (line,) = add_logs(tmp_path / "store", find_logs([URL])).failures
        assert line.startswith("counting://log.mcap: ")
        assert "no answer" in line
        monkeypatch.setattr(Counting, "most_bytes", 1 << 30)
        assert list(log)


class Server(SimpleHTTPRequestHandler):
    """Sends parts where it `knows_ranges`, of which those behind `cut_after` are cut short; else all of a file."""

    knows_ranges, cut_after, more = False, 1 << 60, 0

    def log_message(self, *_):
        pass

    def do_GET(self):
        data, asked = Path(self.translate_path(self.path)).read_bytes(), self.headers.get("Range")
        if not self.knows_ranges or asked is None:
            return super().do_GET()
        first, last = map(int, asked.removeprefix("bytes=").split("-"))
        part = data[first : last + 1]
        part = part[: len(part) // 2] if first > self.cut_after else part
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{min(last, len(data) - 1)}/{len(data)}")
        self.send_header("Content-Length", str(len(part)))
        self.end_headers()
        return self.wfile.write(part)

    def end_headers(self):
        if self.knows_ranges:
            self.send_header("Accept-Ranges", "bytes")
        super().end_headers()

    def send_header(self, name, value):
        is_length = name == "Content-Length" and not self.headers.get("Range")
        super().send_header(name, str(int(value) + self.more) if is_length else value)


@pytest.fixture
def served(tmp_path, monkeypatch):
    """A log of 1.5 MiB, and what serves it; -> its URL."""
    monkeypatch.setattr(remote_file, "FETCHED_BYTES", 1 << 17)
    pytest.importorskip("aiohttp", reason="reading URLs of http needs aiohttp")
    rng = np.random.default_rng(0)
    sent = [("/camera", k, rng.bytes(1 << 15)) for k in range(48)]
    (tmp_path / "log.mcap").write_bytes(log_bytes(sent, chunk_size=1 << 17))
    with contextlib.ExitStack() as servers:

        def serve(**how):
            handler = partial(type("Handler", (Server,), how), directory=tmp_path)
            server = servers.enter_context(ThreadingHTTPServer(("127.0.0.1", 0), handler))
            threading.Thread(target=server.serve_forever, daemon=True).start()
            servers.callback(server.shutdown)
            return f"http://127.0.0.1:{server.server_port}/log.mcap"

        yield serve


@pytest.mark.parametrize("knows_ranges", [True, False])
def test_any_server_is_read_and_one_that_knows_no_ranges_as_a_whole(served, tmp_path, knows_ranges):
    with scan(served(knows_ranges=knows_ranges)) as there, scan(tmp_path / "log.mcap") as here:
        assert list(there) == list(here)
        assert not there.damage


@pytest.mark.parametrize("query", ["?sig=x", "?sig=[x]*&part=1"])
def test_a_url_with_a_query_is_no_pattern_of_files(served, capfd, query):
    assert run(["info", served(knows_ranges=True) + query]) == 0
    assert "/camera" in capfd.readouterr().out


@pytest.mark.parametrize("how", [{"more": 100}, {"knows_ranges": True, "more": 100}])
def test_an_answer_that_is_cut_short_is_the_networks_fault_and_no_damage(served, capfd, how):
    assert run(["info", "--check", served(**how)]) == 1
    (said,) = [line for line in capfd.readouterr().err.splitlines() if line.startswith("error")]
    assert said.startswith("error: http://127.0.0.1")
    assert said.endswith("try again")


def test_so_is_a_part_that_is_cut_short(served, monkeypatch):
    url = served(knows_ranges=True)
    monkeypatch.setattr(remote_file, "FETCHED_BYTES", 1 << 14)
    with scan(url) as log:
        monkeypatch.setattr(Server, "cut_after", 1 << 18)
        with pytest.raises(RecordingError, match=r"expected its bytes .*; try again"):
            list(log)
        assert not log.damage
