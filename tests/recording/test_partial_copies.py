"""Remote logs read in parts: what is fetched, that it reads as the whole, and when the whole is fetched after all."""

import io

import numpy as np
import pytest
from mcap.writer import Writer

from dirprim_filter import read_tracks, write_tracks
from dirprim_filter.recording.container import partial_copy, source, summary_section
from dirprim_filter.recording.container.log import scan
from dirprim_filter.store.adding import add_logs, failures
from dirprim_filter.store.logs import find_logs
from situations import ring_traffic

fsspec = pytest.importorskip("fsspec", reason="reading URLs needs fsspec")
URL = "counting://log.mcap"


class Counting(fsspec.AbstractFileSystem):
    """One log, and how many bytes of it were asked for."""

    protocol = "counting"
    cachable = False
    log = b""
    fetched = 0
    knows_ranges = True

    def info(self, path, **_):
        return {"name": path, "size": len(self.log), "type": "file", "ETag": "1"}

    def cat_file(self, path, start=None, end=None, **_):
        data = self.log[start:end] if self.knows_ranges else self.log
        Counting.fetched += len(data)
        return data

    def _open(self, path, mode="rb", **_):
        Counting.fetched += len(self.log)
        return io.BytesIO(self.log)


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
def asked(monkeypatch, drive, tmp_path):
    """Nothing was fetched before, no log is short, and nothing is left over in the folder of temporary files."""
    monkeypatch.setattr(Counting, "fetched", 0)
    monkeypatch.setattr(Counting, "log", drive[1])
    monkeypatch.setattr(Counting, "knows_ranges", True)
    monkeypatch.setattr(partial_copy, "SHORT_BYTES", 0)
    monkeypatch.setattr(partial_copy, "BLOCK_BYTES", 1 << 9)
    yield
    source.drop_copy(URL)
    assert not source._in_parts
    assert not source._copies


def bytes_of_chunks(topic):
    """Of those that hold messages of a topic, with their message indexes."""
    with scan(URL) as log:
        (summary,) = (file.outline.summary for file in log.log.files)
        (wanted,) = (number for number, channel in summary.channels.items() if channel.topic == topic)
        chunks = [index for index in summary.chunks.values() if wanted in index.message_index_offsets]
    source.drop_copy(URL)
    return sum(index.chunk_length + index.message_index_length for index in chunks)


def test_little_more_is_fetched_than_the_chunks_that_carry_tracks(drive):
    tracks, camera = bytes_of_chunks("/tracks"), bytes_of_chunks("/camera")
    Counting.fetched = 0
    assert source.copy_in_parts(URL)
    assert read_tracks(URL) == drive[0]
    assert tracks <= Counting.fetched <= 1.1 * tracks < 0.5 * camera
    before = Counting.fetched
    assert read_tracks(URL) == drive[0]
    assert Counting.fetched == before
    with scan(URL) as every:  # who wants all gets all
        found = [(message.topic, message.log_time_ns, message.data) for message in every]
        assert not every.damage
    assert Counting.fetched - len(Counting.log) < 0.02 * len(Counting.log)
    source.drop_copy(URL)
    with scan(URL) as whole:
        assert [(message.topic, message.log_time_ns, message.data) for message in whole] == found


def changed(log, at, to=b"x"):
    return log[:at] + to + log[at + len(to) :]


def without_summary(log):
    """The log cut behind its data."""
    return log[: log.rindex(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")]


def first_chunk():
    """One of tracks."""
    with scan(URL) as opened:
        chunk = opened.log.files[0].outline.chunks[0]
    source.drop_copy(URL)
    return chunk


HARMLESS = ("another time in the chunk", "another length of the chunk", "another message index")
"""The contents have a checksum of their own, and the Summary section says where they stand."""


@pytest.mark.parametrize(
    ("name", "harm"),
    [
        ("no summary", lambda log, _: without_summary(log)),
        ("summary damaged", lambda log, _: changed(log, len(log) - 60)),
        ("footer cut", lambda log, _: log[:-9]),
        ("contents damaged", lambda log, chunk: changed(log, chunk.data_offset + 40)),
        ("another time in the chunk", lambda log, chunk: changed(log, chunk.offset + 9)),
        ("another length of the chunk", lambda log, chunk: changed(log, chunk.offset + 1)),
        ("another message index", lambda log, chunk: changed(log, chunk.end + 9)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_damaged_log_is_read_whole_and_as_if_it_were_here(name, harm, drive, tmp_path, monkeypatch):
    harmed = harm(drive[1], first_chunk())
    Counting.fetched = 0
    (tmp_path / "log.mcap").write_bytes(harmed)
    monkeypatch.setattr(Counting, "log", harmed)
    entries = []
    for place, log in (("here", tmp_path / "log.mcap"), ("there", URL)):
        added = add_logs(tmp_path / place, find_logs([str(log)]))
        assert not list(failures(added))
        entries += added.store.contents().recordings()
    here, there = entries
    assert there.recording == here.recording, name
    assert there.status == ("whole" if name in HARMLESS else here.status)
    assert (Counting.fetched >= len(harmed)) == (name not in HARMLESS)


def test_a_sound_log_is_added_in_parts(tmp_path, drive):
    added = add_logs(tmp_path / "store", find_logs([URL]))
    assert not list(failures(added))
    assert added.store.contents().recordings()[0].n_vehicles == drive[0].n_tracks
    assert Counting.fetched < 0.5 * len(Counting.log)


def test_from_a_server_without_ranges_the_whole_is_fetched(drive, monkeypatch):
    monkeypatch.setattr(Counting, "knows_ranges", False)
    assert not source.copy_in_parts(URL)
    assert read_tracks(URL) == drive[0]


@pytest.mark.parametrize(
    ("module", "name", "value"), [(partial_copy, "SHORT_BYTES", 1 << 30), (summary_section, "MOST_BYTES", 10)]
)
def test_a_log_that_is_short_or_claims_too_much_is_copied_whole(module, name, value, monkeypatch):
    assert source.copy_in_parts(URL)
    source.drop_copy(URL)
    monkeypatch.setattr(module, name, value)
    assert not source.copy_in_parts(URL)
    assert not source.copy_in_parts("log.mcap")


def test_a_connection_that_breaks_is_said_in_one_line(monkeypatch, tmp_path):
    def broken(self, path, start=None, end=None, **_):
        if end - start > 2000:
            raise TimeoutError("no answer")
        return self.log[start:end]

    monkeypatch.setattr(Counting, "cat_file", broken)
    (line,) = failures(add_logs(tmp_path / "store", find_logs([URL])))
    assert line.startswith("counting://log.mcap: log.mcap: expected its bytes")
    assert "no answer; try again" in line
