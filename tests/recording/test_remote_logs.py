"""Remote logs: what of them is fetched, and that they read as if they were here."""

import contextlib
import hashlib
import re
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from mcap_files import write_messages

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

pytest.importorskip("fsspec", reason="reading URLs needs fsspec")


class Server(SimpleHTTPRequestHandler):
    """Sends parts where it `knows_ranges`, those behind `cut_after` but the last cut short; else all of a file."""

    knows_ranges, cut_after, more, fetched = False, 1 << 60, 0, 0

    def log_message(self, *_):
        pass

    def do_GET(self):
        data, asked = Path(self.translate_path(self.path)).read_bytes(), self.headers.get("Range")
        if not self.knows_ranges or asked is None:
            return super().do_GET()
        first, last = map(int, asked.removeprefix("bytes=").split("-"))
        part = data[first : last + 1]
        part = part[: len(part) // 2] if self.cut_after < first < len(data) - len(part) else part
        Server.fetched += len(part)
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
def serve(tmp_path, monkeypatch):
    """Serves a log, in small blocks; -> its URL."""
    pytest.importorskip("aiohttp", reason="reading URLs of http needs aiohttp")
    monkeypatch.setattr(remote_file, "FETCHED_BYTES", 1 << 14)
    with contextlib.ExitStack() as servers:

        def serve(log, **how):
            (tmp_path / "log.mcap").write_bytes(log)
            handler = partial(type("Handler", (Server,), how), directory=tmp_path)
            server = servers.enter_context(ThreadingHTTPServer(("127.0.0.1", 0), handler))
            threading.Thread(target=server.serve_forever, daemon=True).start()
            servers.callback(server.shutdown)
            return f"http://127.0.0.1:{server.server_port}/log.mcap"

        yield serve


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Tracks, and a log of them and of a camera that says much after every tenth of their messages."""
    path = tmp_path_factory.mktemp("drive") / "tracks.mcap"
    rng = np.random.default_rng(0)
    write_tracks(ring_traffic(rng, n_vehicles=40, n_rows=60), path)
    sent = []
    for message in scan(path):
        said = message.channel.schema
        if said.name == "dirprim.Observations":
            sent.append(("/tracks", message.log_time_ns, message.data, (said.name, said.encoding, said.data)))
            n = 8 if len(sent) % 18 == 10 else 0  # images behind each tenth
            sent += [("/camera", message.log_time_ns, rng.bytes(1 << 13), ("Image", "", b"")) for _ in range(n)]
    log = write_messages(path.with_name("drive.mcap"), sent, "protobuf", chunk_size=1 << 14)
    return read_tracks(path), log.read_bytes()


def test_little_more_is_fetched_than_the_chunks_that_carry_tracks(serve, drive, monkeypatch):
    monkeypatch.setattr(remote_file, "FETCHED_BYTES", 1 << 11)
    url = serve(drive[1], knows_ranges=True)
    with scan(url) as log:
        summary = log.log.files[0].outline.summary
        size = dict.fromkeys(summary.channels, 0)
        for index in summary.chunks.values():
            for channel in index.message_index_offsets:
                size[channel] += index.chunk_length + index.message_index_length
    tracks, camera = (size[k] for k, _ in sorted(summary.channels.items(), key=lambda item: item[1].topic)[::-1])
    Server.fetched = 0
    with source.copied_once():
        assert read_tracks(url) == drive[0]
        assert tracks <= Server.fetched <= 1.1 * tracks < 0.5 * camera
        before = Server.fetched
        assert read_tracks(url) == drive[0]
        assert Server.fetched == before
        assert checksum(url) == hashlib.sha256(drive[1]).hexdigest()
    assert 0 <= Server.fetched - len(drive[1]) < remote_file.FETCHED_BYTES  # each block once, the last to its end


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
def test_a_log_reads_as_if_it_were_here(name, knows_ranges, serve, drive, tmp_path):
    path = tmp_path / "log.mcap"
    path.write_bytes(drive[1])
    with scan(path) as whole:
        first = whole.log.chunks[0]
    url = serve(HARMS[name](drive[1], first), knows_ranges=knows_ranges)
    here, there = read_track_logs(path), read_track_logs(url)
    assert there.tracks == here.tracks
    assert bool(there.losses.damage) == (bool(here.losses.damage) and not (knows_ranges and name in HARMLESS))
    with scan(url) as far, scan(path) as near:
        assert list(far) == list(near)
        assert far.metadata == near.metadata


def test_a_part_that_is_cut_short_is_said_in_one_line_and_the_next_read_goes_on(serve, tmp_path, drive, monkeypatch):
    url = serve(drive[1], knows_ranges=True)
    with scan(url) as log:
        monkeypatch.setattr(Server, "cut_after", 1 << 15)
        with pytest.raises(RecordingError, match=r"expected its bytes .*; try again"):
            list(log)
        assert not log.damage
        (line,) = add_logs(tmp_path / "store", find_logs([url])).failures
        assert re.match(rf"{url}: expected its bytes .* bytes of 16384; try again$", line)
        monkeypatch.setattr(Server, "cut_after", 1 << 60)
        assert list(log)


def test_a_url_with_a_query_is_no_pattern_of_files(serve, drive, capfd):
    assert run(["info", serve(drive[1], knows_ranges=True) + "?sig=[x]*&part=1"]) == 0
    assert "/camera" in capfd.readouterr().out


@pytest.mark.parametrize("how", [{"more": 100}, {"knows_ranges": True, "more": 100}])
def test_an_answer_that_is_cut_short_is_the_networks_fault_and_no_damage(serve, drive, capfd, how):
    assert run(["info", "--check", serve(drive[1], **how)]) == 1
    (said,) = [line for line in capfd.readouterr().err.splitlines() if line.startswith("error")]
    assert said.startswith("error: http://127.0.0.1")
    assert said.endswith("try again")
