"""The bundle of a manifest far away: many entries by one request; whatever it holds, entries say what counts."""

import hashlib
import json
import time
from dataclasses import replace

import pytest
import zstandard

from dirprim_filter.store import Store, bundle
from dirprim_filter.store import remote_folder as remote
from dirprim_filter.store.adding import add_logs
from dirprim_filter.store.bundle import VERSION, bundled, lacking, unbundled
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.log_files import find_logs
from dirprim_filter.store.manifest import Entry

URL, BUNDLE = "s3://bucket/fleet", "s3://bucket/fleet/logs.bundle"
N_LOGS = 40


def entry_of(i, **changes):
    return replace(
        Entry(
            url=f"/logs/{i}.mcap", size=0, mark=str(i), rows=f"{i:064x}", n_rows=i, n_vehicles=1, start_ns=0, end_ns=1,
            n_squares=1, tiles=[[i, -i]], config=StoreConfig().digest, status="whole",
        ),
        **changes,
    )  # fmt: skip


def put(store, *entries):
    store.folder.write({entry.file_of(entry.url): entry.to_json() for entry in entries})


@pytest.fixture
def store(object_store, monkeypatch):
    """Of many entries and a bundle of them."""
    monkeypatch.setattr(remote, "FEW", 3)
    store = Store.create(URL, StoreConfig())
    put(store, *map(entry_of, range(N_LOGS)))
    store.gather()
    return store


def read(requests):
    """What one who opens the store finds, and by how many requests for files."""
    store = Store.open(URL)
    requests.clear()
    return {entry.url: entry for entry in store.entries()}, requests["get_object"]


def true(object_store):
    """What the entries themselves say."""
    object_store.invalidate_cache()
    files = [object_store.cat_file(path) for path in object_store.find(f"{URL}/logs")]
    return {entry.url: entry for entry in (Entry.from_json(data, "") for data in files)}


def test_many_entries_come_by_one_request(store, object_store, requests):
    """Control: without the bundle by one each."""
    assert read(requests) == (true(object_store), 1)
    put(store, entry_of(1, n_rows=100), entry_of(N_LOGS))
    store.folder.remove(entry_of(2).file_of(entry_of(2).url))
    found, asked = read(requests)
    assert (found, asked) == (true(object_store), 3)
    assert found["/logs/1.mcap"].n_rows == 100
    object_store.rm_file(BUNDLE)
    assert read(requests) == (found, N_LOGS + 1)


def test_a_bundle_is_written_anew_when_it_lacks_many_or_many_are_gone(store, object_store, monkeypatch):
    """Not when it lacks few, by number or of all."""
    before = object_store.cat_file(BUNDLE)

    def is_written():
        store.gather()
        return object_store.cat_file(BUNDLE) != before

    put(store, *(entry_of(i, n_rows=7) for i in range(3)))
    assert not is_written()
    monkeypatch.setattr(remote, "SHARE", 0.5)
    put(store, *(entry_of(i, n_rows=7) for i in range(N_LOGS // 2)))
    assert not is_written()
    monkeypatch.setattr(remote, "SHARE", 0.05)
    assert is_written()
    before = object_store.cat_file(BUNDLE)
    store.folder.remove(*(entry.file_of(entry.url) for entry in map(entry_of, range(4))))
    assert is_written()


def changed(data):
    """A bundle whose last byte is another."""
    return data[:-1] + bytes([data[-1] ^ 1])


def whole(plain):
    """A bundle whose sum is right, whatever it holds."""
    packed = zstandard.compress(plain)
    return VERSION + hashlib.sha256(packed).digest() + packed


DAMAGES = {
    "empty": lambda _: b"",
    "half of it": lambda data: data[: len(data) // 2],
    "another byte": changed,
    "its sum is another": lambda data: VERSION + bytes(32) + data[len(VERSION) + 32 :],
    "of another version": lambda data: data.replace(b"bundle-1", b"bundle-2"),
    "no files": lambda _: whole(b"[1, 2]"),
    "no texts": lambda _: whole(b'{"logs/x.json": ["mark", 3]}'),
    "no marks": lambda _: whole(b'{"logs/x.json": 3}'),
    "not JSON": lambda _: whole(b"{"),
    "nothing": lambda _: whole(b""),
    "other files": lambda _: whole(b'{"../../x.json": ["mark", "text"], "logs/y.json": ["", ""]}'),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_bundle_changes_nothing_and_is_mended(store, object_store, requests, damage):
    object_store.pipe_file(BUNDLE, damage(object_store.cat_file(BUNDLE)))
    assert read(requests) == (true(object_store), N_LOGS + 1)
    Store.open(URL).gather()
    assert read(requests) == (true(object_store), 1)


def test_a_bundle_that_lied_under_an_entrys_own_mark_would_be_seen(store, object_store, requests):
    """The negative control of these tests: what a bundle holds is used where the mark is the entry's."""
    held = unbundled(object_store.cat_file(BUNDLE))
    name = entry_of(1).file_of(entry_of(1).url)
    object_store.pipe_file(BUNDLE, bundled(held | {name: (held[name][0], entry_of(1, n_rows=100).to_json())}))
    assert read(requests)[0] != true(object_store)


def test_a_bundle_that_would_take_too_much_memory_is_not_unpacked(store, object_store, requests, monkeypatch):
    """Nor is one written. Control: within the limit it is used."""
    plain = zstandard.decompress(object_store.cat_file(BUNDLE)[len(VERSION) + 32 :])
    monkeypatch.setattr(bundle, "LARGEST", len(plain))
    assert read(requests)[1] == 1
    monkeypatch.setattr(bundle, "LARGEST", len(plain) - 1)
    assert read(requests) == (true(object_store), N_LOGS + 1)
    object_store.rm_file(BUNDLE)
    store.gather()
    object_store.invalidate_cache()
    assert not object_store.exists(BUNDLE)


def test_of_a_large_file_in_the_place_of_a_bundle_no_more_is_fetched_than_a_bundle_may_have(
    store, object_store, requests, monkeypatch
):
    monkeypatch.setattr(remote, "LARGEST", len(object_store.cat_file(BUNDLE)))
    assert read(requests)[1] == 1
    monkeypatch.setattr(remote, "LARGEST", 100)
    assert read(requests) == (true(object_store), N_LOGS + 1)


def test_of_two_who_write_a_bundle_at_once_neither_changes_what_counts(store, object_store, requests, monkeypatch):
    """One has read the entries before the other's came and writes its bundle after the other's."""
    write = remote.RemoteFolder.write
    late = Store.open(URL)
    put(store, *(entry_of(i, n_rows=7) for i in range(5)))

    def overtaken(folder, files):
        with monkeypatch.context() as patch:
            patch.setattr(remote.RemoteFolder, "write", write)
            put(store, *(entry_of(i, n_rows=8) for i in range(5)), *(entry_of(N_LOGS + i) for i in range(5)))
            store.gather()
            assert read(requests) == (true(object_store), 1)
        write(folder, files)

    monkeypatch.setattr(remote.RemoteFolder, "write", overtaken)
    late.gather()
    monkeypatch.setattr(remote.RemoteFolder, "write", write)
    found, asked = read(requests)
    assert found == true(object_store)
    assert found["/logs/0.mcap"].n_rows == 8
    assert asked == 11  # the bundle is the older one
    Store.open(URL).gather()
    assert read(requests) == (found, 1)


@pytest.mark.parametrize("times", [remote.TIMES, ()], ids=["by ETag and time", "by ETag alone"])
def test_an_entry_that_changes_while_it_is_fetched_and_back_is_what_it_was(
    store, object_store, requests, monkeypatch, times
):
    """Control: where an ETag alone were the mark, the bundle would hold what it was in between."""
    monkeypatch.setattr(remote, "TIMES", times)
    object_store.rm_file(BUNDLE)
    fetched, once = remote.RemoteFolder._fetched, iter([True])

    def meanwhile(folder, names):
        if next(once, False):
            put(store, entry_of(1, n_rows=100))
        return fetched(folder, names)

    monkeypatch.setattr(remote.RemoteFolder, "_fetched", meanwhile)
    Store.open(URL).gather()
    monkeypatch.setattr(remote.RemoteFolder, "_fetched", fetched)
    time.sleep(1.1)  # the server's clock counts seconds
    put(store, entry_of(1))
    found, _ = read(requests)
    assert (found == true(object_store)) == bool(times)


def test_adding_merging_and_forgetting_write_it(store, object_store, requests, tmp_path):
    """And one who adds logs that are all known, if it is not there."""
    logs = []
    for i in range(6):
        path = tmp_path / f"{i}.mcap"
        path.write_text("no log")
        logs.append(entry_of(i, url=str(path), size=6, mark=str(path.stat().st_mtime_ns)))
    put(store, *logs)
    for entry in logs:
        object_store.pipe_file(f"{URL}/recordings/{entry.rows}.parquet", b"rows")
    object_store.rm_file(BUNDLE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(remote, "MANY", 3)
        assert add_logs(Store.open(URL), find_logs([str(tmp_path / "*.mcap")])).known == 6
    assert len(unbundled(object_store.cat_file(BUNDLE))) == N_LOGS + 6
    store.check_frame("log", "map")
    store.forget(*(entry_of(i).url for i in range(N_LOGS)))
    assert len(unbundled(object_store.cat_file(BUNDLE))) == 6
    other = Store.create("s3://bucket/other", StoreConfig())
    put(other, *map(entry_of, range(10, 20)))
    other.check_frame("log", "map")
    for entry in map(entry_of, range(10, 20)):
        object_store.pipe_file(f"s3://bucket/other/recordings/{entry.rows}.parquet", b"rows")
    assert store.merge(other) == 10
    assert len(unbundled(object_store.cat_file(BUNDLE))) == 16
    assert read(requests) == (true(object_store), 1)


def test_what_is_bundled_comes_back_and_what_is_not_in_it_is_lacking():
    files = {"a": ("1", b"\x00\xff"), "b": ("", b"{}"), "c": ("3", json.dumps("\u00e4").encode())}
    assert unbundled(bundled(files)) == files
    marks = {"a": "1", "b": "", "c": "4", "d": "5"}
    assert lacking(files, marks) == {"b", "c", "d"}
