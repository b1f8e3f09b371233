"""Stores in an object store: what holds of a folder holds there, with few requests, and whatever fails is said."""

import pickle
import sys
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from streets import bytes_of

from dirprim_filter import write_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.recording.errors import MissingExtraError, RecordingError
from dirprim_filter.store import Store, learn_from_store
from dirprim_filter.store.adding import add_logs, failures
from dirprim_filter.store.compacting import compacted
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.folder import LocalFolder, folder_at
from dirprim_filter.store.log_files import find_logs
from dirprim_filter.store.table import read_summary
from dirprim_filter.store.workers import InProcess, LocalWorkers
from situations import ring_traffic

URL = "s3://bucket/city/fleet"


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A folder of three logs."""
    folder = tmp_path_factory.mktemp("logs")
    for seed in range(3):
        tracks = ring_traffic(np.random.default_rng(seed), n_vehicles=4, n_rows=30)
        write_tracks(tracks, folder / f"{seed}.mcap")
    return folder


@pytest.fixture
def here(tmp_path):
    return Store.create(tmp_path / "here", StoreConfig())


@pytest.fixture
def there(object_store):
    return Store.create(URL, StoreConfig())


def added(store, logs, *numbers, **options):
    for number in numbers:
        assert not list(failures(add_logs(store, find_logs([str(logs / f"{number}.mcap")]), **options)))
    return store


def files(store):
    """All of a store, byte by byte."""
    if isinstance(store.folder, LocalFolder):
        found = {str(path.relative_to(store.path)): path.read_bytes() for path in store.path.rglob("*")
                 if path.is_file()}  # fmt: skip
    else:
        import s3fs

        direct = s3fs.S3FileSystem(skip_instance_cache=True, use_listings_cache=False)
        found = {path.partition("fleet/")[2]: direct.cat_file(path) for path in direct.find(store.path)}
    return found


def is_whole(store):
    """Whether all that counts can be read."""
    with suppress(RecordingError, OSError):
        for rows in store.rows():
            read_summary(store.recording(rows))
        return True
    return False


def learned(store, tmp_path):
    m = learn_from_store(
        store, min_vehicles=2, tessellation="grid", cell_size=10.0, rng=np.random.default_rng(0)
    )  # fmt: skip
    return bytes_of(m, tmp_path / "map.mcap")


def test_a_remote_store_holds_what_a_local_one_does_and_gives_the_same_map(here, there, logs, tmp_path):
    """Control: of other logs it is another map."""
    added(here, logs, 0, 1), added(there, logs, 1, 0)
    assert files(there) == files(here)
    assert Store.open(URL) == there
    of_both = learned(here, tmp_path)
    assert learned(Store.open(URL), tmp_path) == of_both
    added(there, logs, 2)
    assert learned(there, tmp_path) != of_both
    there.forget(str(logs / "2.mcap"))
    assert files(there) == files(here)
    assert learned(there, tmp_path) == of_both


def test_stores_merge_both_ways_and_compact_alike(here, there, logs, tmp_path):
    added(here, logs, 0, 1), added(there, logs, 1, 2)
    whole = added(Store.create(tmp_path / "whole", StoreConfig()), logs, 0, 1, 2)
    back = Store.create(tmp_path / "back", StoreConfig())
    assert (there.merge(here), there.merge(here)) == (1, 0)
    assert back.merge(there) == 3
    assert files(there) == files(back) == files(whole)
    far_ns = 10**17
    for store in (there, whole):
        assert [archive.month for archive in compacted(store, before_ns=far_ns, n_vehicles=2)] == ["1970-01"]
    assert files(there) == files(whole) != files(back)
    empty = Store.create(tmp_path / "empty", StoreConfig())
    assert empty.merge(there) == 3
    assert files(empty) == files(whole)
    there.forget(*(entry.url for entry in there.entries()))
    assert sorted(files(there)) == ["frame.json", "store.json"]


@pytest.mark.parametrize("after", [False, True], ids=["refused", "connection lost after it"])
def test_a_put_that_fails_leaves_nothing_that_counts(there, logs, object_store, monkeypatch, after):
    """Whichever it is. Control: where a put of half a file were possible, what counts would not be whole."""
    added(there, logs, 0)
    kind, put, n = type(object_store), type(object_store)._pipe_file, 0
    before = files(there)
    while True:
        n, left = n + 1, n
        for name in files(there).keys() - before.keys():
            object_store.rm_file(f"{URL}/{name}")

        async def failing(files, path, data, **options):
            nonlocal left
            left -= 1
            if left >= 0 or after:
                await put(files, path, data, **options)
            if left < 0:
                raise OSError("connection reset")

        with monkeypatch.context() as patch:
            patch.setattr(kind, "_pipe_file", failing)
            try:
                lines = list(failures(add_logs(there, find_logs([str(logs / "1.mcap")]))))
            except RecordingError as error:
                lines = [str(error)]
        assert is_whole(Store.open(URL))
        if left >= 0:
            break
        assert all("connection reset" in line for line in lines)
        assert len(lines) == 1
    assert n == 3  # a recording, an entry
    added(there, logs, 1)
    whole = files(there)
    assert whole.keys() - before.keys()
    (new,) = (name for name in whole.keys() - before.keys() if name.startswith("recordings/"))
    object_store.pipe_file(f"{URL}/{new}", whole[new][:200])
    assert not is_whole(Store.open(URL))
    object_store.rm_file(f"{URL}/{new}")
    assert not is_whole(Store.open(URL))


def test_what_others_write_is_seen_at_once(there, logs, object_store):
    added(there, logs, 0)
    other = Store.open(URL)
    digests = {other.digest}
    added(there, logs, 1)
    digests.add(other.digest)
    (first, _) = other.entries()
    object_store.pipe_file(f"{URL}/{first.file_of(first.url)}", replace(first, n_rows=7).to_json())
    assert other.entries()[0].n_rows == 7
    object_store.rm_file(f"{URL}/{first.file_of(first.url)}")
    digests.add(other.digest)
    assert len(digests) == 3
    assert len(other.entries()) == 1


def test_workers_add_to_a_remote_store(here, there, logs):
    pytest.importorskip("distributed")
    assert len(pickle.dumps(there)) < 1000
    found = find_logs([str(logs / "*.mcap")])
    assert not list(failures(add_logs(there, found, workers=LocalWorkers(2))))
    assert files(there) == files(added(here, logs, 0, 1, 2))


def test_commands_take_urls(object_store, logs, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    grid = ["--tessellation", "grid", "--cell-size", "10", "--min-vehicles", "2"]
    maps = {}
    for store in ("fleet", URL):
        assert run(["store", "add", store, str(logs / "0.mcap"), str(logs / "1.mcap")]) == 0
        assert f"{store}: added 2 logs" in capsys.readouterr().out
        assert run(["store", "learn", store, "-o", "map.mcap", "--force", *grid]) == 0
        assert run(["store", "add", store, str(logs / "2.mcap")]) == 0
        assert run(["store", "update", "map.mcap", store]) == 0
        assert f"of {store} changed" in capsys.readouterr().out
        maps[store] = (tmp_path / "map.mcap").read_bytes()
        assert run(["store", "forget", store, str(logs / "2.mcap")]) == 0
        assert run(["store", "info", store]) == 0
        assert f"{store}: 2 logs of 2 recordings" in capsys.readouterr().out
        assert run(["store", "compact", store, "--before", "1970-02-01"]) == 0
        assert f"{store}: 1970-01, 2 recordings in " in capsys.readouterr().out
    assert maps["fleet"] == maps[URL]
    assert run(["store", "merge", f"{URL}-merged", "fleet"]) == 0
    assert run(["store", "merge", "copy", f"{URL}-merged"]) == 0
    assert files(Store.open("copy")) == files(Store.open("fleet"))


def test_another_tool_reads_it_by_fsspec(here, there, object_store, logs):
    duckdb = pytest.importorskip("duckdb")
    added(here, logs, 0, 1), added(there, logs, 0, 1)
    connection = duckdb.connect()
    connection.register_filesystem(object_store)
    counted = [
        connection.sql(f"SELECT sum(begins), count(*) FROM '{store.path}/recordings/*.parquet'").fetchall()  # noqa: S608
        for store in (here, there)
    ]
    assert counted[0] == counted[1]
    assert counted[0][0][1] > 0


def test_any_protocol_of_fsspec_serves_and_file_is_a_folder(logs, tmp_path):
    store = added(Store.create("memory://some/fleet/", StoreConfig()), logs, 0)
    assert str(store.path) == "memory://some/fleet"
    assert len(Store.open("memory://some/fleet").entries()) == 1
    assert is_whole(store)
    added(Store.create(f"file://{tmp_path}/fleet", StoreConfig()), logs, 0)
    assert Store.open(tmp_path / "fleet") == Store.open(f"file://{tmp_path}/fleet")
    store.forget(store.entries()[0].url)
    with pytest.raises(RecordingError, match="expected a store or an empty folder, found other files"):
        Store.create("memory://some", StoreConfig())


def test_workers_of_other_processes_do_not_see_this_ones_memory_and_that_is_said(logs, tmp_path, capsys):
    """Controls: in this process all goes well, as in a folder by workers."""
    url, log, grid = "memory://workers/fleet", str(logs / "0.mcap"), ["--tessellation", "grid", "--cell-size", "10"]
    options = [*grid, "--min-vehicles", "2", "--force", "-o", str(tmp_path / "map.mcap")]
    assert run(["store", "add", url, log]) == run(["store", "learn", url, *options]) == 0
    capsys.readouterr()
    for command in (
        ["store", "add", url, str(logs / "1.mcap"), "--workers", "2"],
        ["store", "learn", url, *options, "--workers", "2"],
        ["store", "update", str(tmp_path / "map.mcap"), url, "--workers", "2"],
        ["store", "update", str(tmp_path / "map.mcap"), url, "--scheduler", "tcp://127.0.0.1:1"],
    ):  # fmt: skip
        assert run(command) == 1
        reported = capsys.readouterr().err
        assert reported.startswith(f"error: {url}: is in the memory of this process, and --workers and --scheduler see")
        assert reported.count("\n") == 1
    assert run(["store", "update", str(tmp_path / "map.mcap"), url]) == 0
    Store.open(url).check_seen_by(InProcess())
    Store.create(tmp_path / "fleet", StoreConfig()).check_seen_by(LocalWorkers(2))


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("s3://absent/fleet", "s3://absent/fleet: expected a folder that can be written: The specified bucket does"),
        ("nosuchscheme://fleet", "nosuchscheme://fleet/store.json: expected a folder that can be read: Protocol not"),
        ("s3://bucket/fl*t", "s3://bucket/fl*t: expected the URL of one store, got a pattern"),
        ("closed://vault/fleet", "closed://vault/fleet/store.json: expected a folder that can be read: no credentials"),
    ],
)
def test_what_is_wrong_is_one_line_that_names_the_url(object_store, logs, capsys, url, said):
    import fsspec

    class Closed(fsspec.AbstractFileSystem):
        protocol = "closed"

        def info(self, path, **_):
            raise PermissionError("no credentials")

    fsspec.register_implementation("closed", Closed, clobber=True)
    assert run(["store", "add", url, str(logs / "0.mcap")]) == 1
    reported = capsys.readouterr().err
    assert reported.startswith(f"error: {said}")
    assert reported.count("\n") == 1
    assert object_store.ls("") == ["bucket"]


def test_where_no_store_is_that_is_said(object_store, capsys):
    assert run(["store", "info", "s3://bucket/none"]) == 1
    assert "s3://bucket/none: expected a store, found none; make one" in capsys.readouterr().err
    assert run(["learn", "s3://bucket/none", "-o", "map.mcap"]) == 1
    assert "s3://bucket/none" in capsys.readouterr().err


@pytest.mark.parametrize("library", ["fsspec", "s3fs"])
def test_without_its_library_one_line_says_which_extra_has_it(monkeypatch, library):
    if library == "s3fs":
        monkeypatch.delitem(sys.modules["fsspec.registry"]._registry, "s3", raising=False)
    monkeypatch.setitem(sys.modules, library, None)
    kind = MissingExtraError if library == "fsspec" else RecordingError
    with pytest.raises(kind, match=r"s3://bucket/fleet.*dirprim-filter\[fleet\]"):
        Store.open("s3://bucket/fleet")


def test_a_file_far_away_is_only_read(there):
    with pytest.raises(ValueError, match="mode: expected rb, got 'wb'"):
        folder_at(URL).file("store.json").open("wb")
