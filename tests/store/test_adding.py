"""Logs are added once each, whatever they are called; what is wrong with one is said, and stops no other."""

import json
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from streets import GRID, bytes_of, logs_of, store_of, street

from dirprim_filter import write_tracks
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store import Store, add_logs, find_logs, learn_from_store
from dirprim_filter.store.adding import failures
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.delta import shown
from dirprim_filter.store.forgetting import forget, merge
from dirprim_filter.store.rows import Rows


def test_a_store_is_the_same_wherever_it_is(place, tmp_path):
    path = logs_of(tmp_path, a=street(1), b=street(2, start=-700.0, length=400.0))
    store = store_of(place, *path.values())
    assert add_logs(place, find_logs([str(tmp_path / "*.mcap")])).known == 2
    here = store_of(tmp_path / "here", *path.values())
    assert [e.recording for e in store.contents().recordings()] == [e.recording for e in here.contents().recordings()]
    maps = [learn_from_store(each, **GRID).primitive_map for each in (store, here)]
    assert bytes_of(maps[0], tmp_path) == bytes_of(maps[1], tmp_path)
    assert learn_from_store(store, **GRID).n_fitted == 0
    forget(store, [path["a"]])
    merge(store, here)
    assert bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path) == bytes_of(maps[0], tmp_path)


def test_a_log_that_changed_takes_the_place_of_what_it_was(tmp_path):
    path = logs_of(tmp_path, a=street(1))
    store = store_of(tmp_path / "store", path["a"])
    before = store.contents().entries[path["a"]]
    write_tracks(street(2), path["a"], force=True)
    added = add_logs(store.path, find_logs([path["a"]]))
    assert (added.known, len(added.receipts)) == (0, 1)
    (entry,) = store.contents().entries.values()
    assert entry.recording != before.recording
    assert len(list((tmp_path / "store" / "rows").iterdir())) == 1


def test_one_log_that_fails_stops_no_other(tmp_path):
    path = logs_of(tmp_path, b=street(1), d=street(2))
    (tmp_path / "a.mcap").write_text("no log")
    added = add_logs(tmp_path / "store", find_logs([str(tmp_path / "*.mcap")]))
    assert list(added.store.contents().entries) == [path["b"], path["d"]]
    (line,) = failures(added)
    assert "a.mcap" in line
    alone = add_logs(tmp_path / "none", find_logs([str(tmp_path / "a.mcap")]))
    assert alone.store is None
    assert not Store.is_at(tmp_path / "none")


def test_logs_in_another_frame_are_refused(tmp_path):
    path = logs_of(tmp_path, a=street(1))
    store = Store.create(tmp_path / "store", StoreConfig(), "odom")
    (line,) = failures(add_logs(store.path, find_logs([path["a"]])))
    assert "a.mcap: expected positions in frame 'odom' as in the rest of the store, got 'map'" in line
    assert not store.contents().entries
    with pytest.raises(ValueError, match="expected positions in frame 'odom'"):
        merge(store, store_of(tmp_path / "other", path["a"]))


def test_logs_are_read_as_the_store_s_are(tmp_path):
    path = logs_of(tmp_path, a=street(1), b=street(2))
    config = StoreConfig(time_source="publish")
    store = add_logs(tmp_path / "store", find_logs([path["a"]]), config=config).store
    assert Store.open(store.path).config == config
    with pytest.raises(ValueError, match="expected time_source publish, as its logs are read, got header"):
        add_logs(store.path, find_logs([path["b"]]), config=StoreConfig())
    with pytest.raises(ValueError, match="expected time_source publish"):
        merge(store, store_of(tmp_path / "other", path["b"]))


def test_stores_that_hold_two_versions_of_a_log_do_not_merge(tmp_path):
    path = logs_of(tmp_path, a=street(1))
    one = store_of(tmp_path / "one", path["a"])
    write_tracks(street(2), path["a"], force=True)
    with pytest.raises(ValueError, match="two versions of it"):
        merge(one, store_of(tmp_path / "two", path["a"]))


def test_many_who_begin_a_store_at_once_lose_nothing(place, tmp_path):
    path = logs_of(tmp_path, **{f"log{i}": street(i, n_vehicles=1) for i in range(4)})
    together = threading.Barrier(len(path))

    def begin(log):
        together.wait()
        return add_logs(place, find_logs([log]))

    with ThreadPoolExecutor(len(path)) as several:
        assert [list(failures(added)) for added in several.map(begin, path.values())] == [[]] * len(path)
    assert set(Store.open(place).contents().entries) == set(path.values())


def test_to_add_beside_forgetting_loses_nothing_else(tmp_path):
    path = logs_of(tmp_path, **{f"log{i}": street(i, n_vehicles=1) for i in range(6)}, stays=street(9))
    store, failed = store_of(tmp_path / "store", path.pop("stays")), []

    def come_and_go(log):
        try:
            store_of(store.path, log)
            forget(store, [log])
            store_of(store.path, log)
        except Exception as error:  # noqa: BLE001 (of a thread)
            failed.append(error)

    threads = [threading.Thread(target=come_and_go, args=(log,)) for log in path.values()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed
    entries = store.contents().entries
    assert len(entries) == 7
    assert all(len(store.read(file)) == file.n_rows for entry in entries.values() for file in entry.files)


def test_ten_thousand_known_logs_are_skipped_without_reading_them(tmp_path):
    path = logs_of(tmp_path, a=street(1, n_vehicles=1))
    store = store_of(tmp_path / "store", path["a"])
    (file,) = store.contents().entries[path["a"]].files
    (log,) = find_logs([path["a"]])
    known = [(f"/logs/{i}.mcap", f"{i:032x}") for i in range(10_000)]
    store.commit(lambda _: ([file._replace(log=url, path=f"rows/{n}-{file.digest}.parquet") for url, n in known], []))
    logs = [type(log)(url=url, size=log.size, mark=log.mark) for url, _ in known]
    began_s = time.process_time()
    assert add_logs(store.path, logs).known == 10_000
    assert time.process_time() - began_s < 10.0


def test_what_a_killed_process_left_goes_a_day_later(tmp_path):
    path = logs_of(tmp_path, a=street(1), b=street(2))
    store = store_of(tmp_path / "store", *path.values())
    left = [tmp_path / "store" / "rows" / f"{n}.parquet" for n in "xy"]
    for file in left:
        file.write_bytes(b"PAR1")
    day_ago = time.time() - 25 * 3600
    os.utime(left[0], (day_ago, day_ago))
    forget(store, [path["a"]])
    assert [file.exists() for file in left] == [False, True]
    assert len(list((tmp_path / "store" / "rows").iterdir())) == 2


def test_duckdb_reads_a_store(tmp_path):
    duckdb = pytest.importorskip("duckdb")
    deltalake = pytest.importorskip("deltalake")
    store = store_of(tmp_path / "store", *logs_of(tmp_path, a=street(1), b=street(2)).values())
    rows = deltalake.DeltaTable(store.path).to_pyarrow_dataset()  # noqa: F841 (the query's)
    found = duckdb.sql("SELECT log, count(*), max(speed_dm_s) FROM rows WHERE NOT halo GROUP BY log ORDER BY log")
    entries = store.contents().entries.values()
    assert [row[:2] for row in found.fetchall()] == [(entry.log, entry.n_rows) for entry in entries]


def test_a_row_takes_four_bytes(tmp_path):
    tracks = street(1, n_vehicles=200, length=400.0)
    rows = Rows.of(tracks)
    assert len(rows.to_parquet()) <= 4.0 * len(rows)


def test_rows_that_learning_leaves_out_are_not_kept(tmp_path):
    tracks = street(1)
    often = np.repeat(np.arange(len(tracks)), 2)
    shift = np.tile([0, 100_000_000], len(tracks))
    twice = type(tracks)(
        track_id=tracks.track_id[often], time_ns=tracks.time_ns[often] + shift, position=tracks.position[often],
        direction=tracks.direction[often], speed=tracks.speed[often],
    )  # fmt: skip
    assert Rows.of(twice).digest == Rows.of(tracks).digest


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("s3://key:verysecret@bucket/fleet", "s3://***bucket/fleet"),
        ("https://host/fleet?X-Amz-Signature=abc&x=1", "https://host/fleet?***&x=1"),
        ("a folder/fleet", "a folder/fleet"),
    ],
)
def test_no_secret_is_said(url, said):
    assert shown(url) == said


def test_what_cannot_be_reached_is_said_in_one_line_without_secrets(bucket, tmp_path):
    for url in (f"{bucket}-that-is-not/fleet", "nothing://host/fleet"):
        with pytest.raises(RecordingError) as error:
            store_of(url, *logs_of(tmp_path, a=street(1)).values())
        (tmp_path / "a.mcap").unlink()
        assert "\n" not in str(error.value)
        assert "\x1b" not in str(error.value)
        assert "verysecret" not in str(error.value)
        assert url in str(error.value)


def test_positions_and_speeds_that_no_vehicle_has_are_refused(tmp_path):
    far = street(1)
    moved = type(far)(
        track_id=far.track_id, time_ns=far.time_ns, position=far.position + 1e8, direction=far.direction,
        speed=far.speed,
    )  # fmt: skip
    added = add_logs(tmp_path / "store", find_logs(list(logs_of(tmp_path, a=moved).values())))
    (line,) = failures(added)
    assert "a.mcap: position, speed: expected at most 2e+07 m from the origin" in line
    assert json.dumps(line)
