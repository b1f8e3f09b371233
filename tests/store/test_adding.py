"""What is added, from where, beside whom; and what is refused, in a line."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from streets import logs_of, store_of, street

from dirprim_filter import Tracks, read_tracks
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store import Store, add_logs, find_logs
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.folder import shown
from dirprim_filter.store.forgetting import forget, merge
from dirprim_filter.store.keeping import whole
from dirprim_filter.store.rows import StoredRows

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"


def test_what_is_stored_is_what_the_log_says_but_for_rounding(tmp_path):
    said = street(1)
    store = store_of(tmp_path / "store", *logs_of(tmp_path, a=said).values())
    rows = whole(store, store.contents().recordings()[0])
    stored = rows.tracks(rows.track, rows.group)
    assert (stored.time_ns == said.time_ns).all()
    assert np.abs(stored.position - said.position).max() <= 0.0201
    assert np.abs(np.angle(np.exp(1j * (stored.direction - said.direction)))).max() <= np.radians(0.126)
    assert np.abs(stored.speed - said.speed).max() <= 0.051
    often = np.repeat(np.arange(len(said)), 2)  # at 10 Hz, of which learning leaves every second row out
    columns = {name: getattr(said, name)[often] for name in ("track_id", "position", "direction", "speed")}
    twice = Tracks(time_ns=said.time_ns[often] + np.tile([0, 100_000_000], len(said)), **columns)
    assert StoredRows.of(twice).digest == rows.digest


@pytest.mark.parametrize(
    "path",
    [*sorted((ROOT / "recordings").glob("*.mcap")), DATA / "town03/roundabout.csv", DATA / "town03/intersection.csv",
     DATA / "lankershim/lankershim.csv"],
    ids=lambda path: path.stem,
)  # fmt: skip
def test_a_row_takes_at_most_four_bytes_and_a_file_a_thousand(path):
    if not path.exists():
        pytest.skip(f"{path} is not here")
    rows = StoredRows.of(read_tracks(path))
    assert len(rows.to_parquet()) <= 4 * len(rows) + 1000


def test_logs_that_do_not_fit_are_named_and_stop_no_other(tmp_path):
    far = replace(street(1), position=street(1).position + 1e8)
    path = logs_of(tmp_path, b=street(1), d=street(2), far=far)
    (tmp_path / "a.mcap").write_text("no log")
    assert add_logs(tmp_path / "none", find_logs([str(tmp_path / "a.mcap")])).store is None
    assert not Store.is_at(tmp_path / "none")
    added = add_logs(tmp_path / "store", find_logs([str(tmp_path / "*.mcap")]))
    assert list(added.store.contents().entries) == [path["b"], path["d"]]
    with pytest.raises(RecordingError, match=r"store: expected a file, .* got a store; `dirprim store info`"):
        read_tracks(tmp_path / "store")
    no_log, too_far = added.failures
    assert "a.mcap" in no_log
    assert "far.mcap: position, speed: expected at most 2e+07 m from the origin" in too_far
    odom = Store.create(tmp_path / "odom", StoreConfig(), "odom")
    (line,) = add_logs(odom.path, find_logs([path["b"]])).failures
    assert "b.mcap: expected positions in frame 'odom' as in the rest of the store, got 'map'" in line
    by_publish = StoreConfig(time_source="publish")
    published = add_logs(tmp_path / "published", find_logs([path["b"]]), config=by_publish).store
    assert Store.open(published.path).config == by_publish
    with pytest.raises(ValueError, match="expected time_source=publish, as its logs were read, got time_source=header"):
        add_logs(published.path, find_logs([path["d"]]), config=StoreConfig())
    with pytest.raises(ValueError, match="expected no frame, as its logs were read, got frame=odom; leave it out"):
        add_logs(odom.path, find_logs([path["d"]]), config=StoreConfig(frame="odom"))
    for refuses, because in ((odom, "expected positions in frame 'odom'"), (published, "expected time_source=publish")):
        with pytest.raises(ValueError, match=because):
            merge(refuses, added.store)


@pytest.mark.slow
def test_many_who_begin_add_and_forget_at_once_lose_nothing(place, tmp_path):
    path = logs_of(tmp_path, **{f"log{i}": street(i, n_vehicles=1) for i in range(4)})
    together = threading.Barrier(len(path))

    def come_and_go(log):
        together.wait()
        store = store_of(place, log)
        forget(store, [log])
        store_of(place, log)

    with ThreadPoolExecutor(len(path)) as several:
        list(several.map(come_and_go, path.values()))
    store = Store.open(place)
    assert set(store.contents().entries) == set(path.values())
    assert all(len(store.read(file)) == file.n_rows for e in store.contents().entries.values() for file in e.files)


def test_ten_thousand_known_logs_are_skipped_without_reading_them(place, tmp_path):
    path = logs_of(tmp_path, a=street(1, n_vehicles=1))
    store = store_of(place, path["a"])
    (file,) = store.contents().entries[path["a"]].files
    (log,) = find_logs([path["a"]])
    known = [(f"/logs/{i}.mcap", f"{i:032x}") for i in range(10_000)]
    store.commit(lambda _: ([file._replace(log=url, path=f"rows/{n}-{file.digest}.parquet") for url, n in known], []))
    began_s = time.process_time()
    assert add_logs(place, [replace(log, url=url) for url, _ in known]).known == 10_000
    assert time.process_time() - began_s < 10.0


def test_no_secret_is_said_and_what_cannot_be_reached_is_said_in_a_line(bucket, tmp_path):
    assert shown("s3://key:verysecret@bucket/fleet") == "s3://bucket/fleet"
    assert shown("https://host/fleet?X-Amz-Signature=abc&x=1") == "https://host/fleet?..."
    assert shown("a folder/fleet") == "a folder/fleet"
    (log,) = logs_of(tmp_path, a=street(1)).values()
    for url in (f"{bucket}-that-is-not/fleet", "nothing://host/fleet"):
        with pytest.raises(RecordingError) as error:
            store_of(url, log)
        assert url in str(error.value)
        assert not {"\n", "\x1b"} & set(str(error.value))
        assert "verysecret" not in str(error.value)
