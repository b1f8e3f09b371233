"""What `write_tracks` writes: read back exactly, in order, and safe from half-written files."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader

from dirprim_filter.columns import is_held
from dirprim_filter.detections import Detections
from dirprim_filter.recording import read_tracks
from dirprim_filter.recording.foxglove.elements import scene_transform
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.writer import write_tracks
from dirprim_filter.tracks import Tracks

NAMES = ["a", "Ünïcode", "07", "a/b", "-"]
COLUMNS = ("track_id", "time_ns", "position", "direction", "speed", "group")


def crossing(vehicles):
    """1000 instants of some of the vehicles; numbers of many magnitudes and at the edges of intervals."""
    rng = np.random.default_rng(5)
    instant, vehicle = np.nonzero(rng.random((1000, len(vehicles))) < 0.6)
    n = len(instant)
    return Tracks(
        track_id=np.asarray(vehicles)[vehicle],
        time_ns=1_700_000_000_000_000_001 + instant * 33_333_333,
        position=rng.normal(size=(n, 2)) * 10.0 ** rng.uniform(-9, 6, (n, 1)),
        direction=np.where(rng.random(n) < 0.1, np.pi, rng.uniform(-np.pi, np.pi, n)),
        speed=np.where(rng.random(n) < 0.1, 0.0, rng.gamma(2.0, 5.0, n)),
        group=rng.integers(-(10**17), 10**17, n),
        heading=np.where(rng.random(n) < 0.2, np.nan, rng.uniform(-np.pi, np.pi, n)),
        size=np.where(rng.random((n, 3)) < 0.2, np.nan, rng.gamma(2.0, size=(n, 3))),
    )


@pytest.mark.parametrize("vehicles", [[3, -7, 10**17, 0, 12], NAMES])
def test_tracks_read_back_equal(tmp_path, vehicles):
    tracks = crossing(vehicles)
    write_tracks(tracks, tmp_path / "a.mcap", detections=Detections.of(tracks))
    back = read_tracks(tmp_path / "a.mcap")
    for name in (*COLUMNS, "heading", "size"):
        assert getattr(back, name).dtype.kind == getattr(tracks, name).dtype.kind
        np.testing.assert_array_equal(getattr(back, name), getattr(tracks, name), err_msg=name)
    write_tracks(replace(tracks, heading=[], size=np.full((len(tracks), 3), np.nan)), tmp_path / "b.mcap")
    back = read_tracks(tmp_path / "b.mcap")
    assert not is_held(back.heading)
    assert not is_held(back.size)


def test_the_same_tracks_give_the_same_bytes_and_a_record_names_producer_and_source(tmp_path):
    digests = set()
    for name in ("a", "b"):
        write_tracks(crossing(NAMES), tmp_path / name)
        digests.add(hashlib.sha256((tmp_path / name).read_bytes()).digest())
    assert len(digests) == 1
    write_tracks(crossing(NAMES[1:]), tmp_path / "c")
    assert hashlib.sha256((tmp_path / "c").read_bytes()).digest() not in digests
    write_tracks(crossing(NAMES), tmp_path / "a.mcap", metadata={"source": "x.csv"})
    with (tmp_path / "a.mcap").open("rb") as file:
        (record,) = make_reader(file).iter_metadata()
    assert record.name == "dirprim"
    assert record.metadata["producer"] == "dirprim-filter"
    assert record.metadata["source"] == "x.csv"
    assert "version" in record.metadata


def test_a_negative_time_is_refused_and_nothing_stays(tmp_path):
    tracks = crossing(NAMES)
    early = replace(tracks, time_ns=tracks.time_ns - tracks.time_ns[50])
    with pytest.raises(ValueError, match=r"a\.mcap: expected times from 0 ns on"):
        write_tracks(early, tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_after_a_kill_all_but_the_last_chunk_is_in_the_partial_file(tmp_path):
    """What stands on the disk at any moment is what a kill would leave."""
    with LogWriter(tmp_path / "a.mcap", metadata={}, max_chunk_ns=1_000_000_000) as log:
        for time_ns in range(0, 10_000_000_000, 100_000_000):
            log.write("/tf", scene_transform(time_ns, np.zeros(2)), time_ns)
        (partial,) = tmp_path.iterdir()
        assert partial.name.startswith("a.mcap.")
        left = scan(partial)
        assert [m.log_time_ns for m in left] == list(range(0, 9_900_000_000, 100_000_000))
        assert left.damage
        left.close()
