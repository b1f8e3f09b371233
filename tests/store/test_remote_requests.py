"""How many requests a store in an object store takes: few, and none twice for what stays as it was."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from streets import summed

from dirprim_filter import write_tracks
from dirprim_filter.store import Store
from dirprim_filter.store import remote_folder as remote
from dirprim_filter.store.adding import add_logs
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.log_files import find_logs
from dirprim_filter.store.recorded_ways import EVERYWHERE, sampled
from situations import ring_traffic

URL = "s3://bucket/city/fleet"


def written(folder, *seeds):
    """Logs, each of other vehicles."""
    folder.mkdir(exist_ok=True)
    for seed in seeds:
        tracks = ring_traffic(np.random.default_rng(seed), n_vehicles=2, n_rows=20)
        write_tracks(tracks, folder / f"{seed}.mcap")
    return find_logs([f"{folder}/*.mcap"])


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    return written(tmp_path_factory.mktemp("logs"), 0, 1, 2)


@pytest.fixture
def there(object_store):
    return Store.create(URL, StoreConfig())


def test_many_known_logs_take_one_request_each_and_no_more_while_they_stay(there, logs, tmp_path, requests):
    """Control: an entry that changed is fetched again."""
    n_logs = 120
    add_logs(there, logs[:1])
    (entry,) = there.entries()
    known = []
    for i in range(n_logs):
        path = tmp_path / f"{i}.mcap"
        path.touch()
        known.append(replace(entry, url=str(path), size=0, mark=str(path.stat().st_mtime_ns)))
    there.folder.write({one.file_of(one.url): one.to_json() for one in known})
    store, found = Store.open(URL), find_logs([str(tmp_path / "*.mcap")])
    requests.clear()
    assert add_logs(store, found).known == n_logs
    few = 20
    assert requests.pop("get_object") <= n_logs + 1
    assert requests.total() <= few
    requests.clear()
    assert len(store.entries()) == n_logs + 1
    assert requests.pop("get_object") == n_logs + 2  # and whether there is a bundle of them
    assert requests.total() <= 1  # to list them
    requests.clear()
    assert len(store.entries()) == n_logs + 1
    assert requests.total() <= 1
    there.folder.write({known[5].file_of(known[5].url): replace(known[5], n_rows=1).to_json()})
    requests.clear()
    assert sum(one.n_rows for one in store.entries()) == n_logs * entry.n_rows + 1
    assert requests.pop("get_object") == 1
    assert requests.total() <= 1


def test_a_log_takes_four_requests_and_a_run_as_many_as_any(object_store, logs, tmp_path, requests):
    """To look whether it is known, first and when its turn comes, and to write a recording and an entry.

    Workers of other processes ask for the last three: then this one asks once for each log.
    """
    asked = {}
    for n_logs in (1, 4):
        store = Store.create(f"{URL}-{n_logs}", StoreConfig())
        add_logs(store, logs[:1])  # says the frame
        found = written(tmp_path / str(n_logs), *range(10, 10 + n_logs))
        for workers in (ElsewhereWorkers(requests), None):
            requests.clear()
            add_logs(store, found, workers=workers)
            asked[n_logs, workers is None] = requests.total()
            assert len(store.entries()) == n_logs + 1
            store.forget(*(log.url for log in found))
    assert asked[4, True] - asked[1, True] == 3 * 4
    assert asked[4, False] - asked[1, False] == 3


class ElsewhereWorkers:
    """Workers of another process, whose requests are their own."""

    in_process = False

    def __init__(self, requests):
        self.requests = requests

    def each(self, work, tasks):
        for task in tasks:
            before = self.requests.copy()
            done = work(task)
            self.requests.clear()
            self.requests.update(before)
            yield done


def test_a_recording_is_fetched_once_by_a_process_and_leaves_nothing(there, logs, requests, tmp_path, monkeypatch):
    """Control: where the disk has no room for copies it is fetched each time, and all else is the same."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    add_logs(there, logs)
    fetched = {}
    for spare in (0.0, 1.0):
        monkeypatch.setattr(remote, "SPARE", spare)
        store = Store.open(URL)
        sampled(store, [EVERYWHERE], most_rows=10**9, min_vehicles=1)
        requests.clear()
        for _ in range(2):
            sampled(pickle.loads(pickle.dumps(store)), [EVERYWHERE], most_rows=10**9, min_vehicles=1)  # noqa: S301
        fetched[spare] = requests["get_object"]
    assert fetched == {0.0: 0, 1.0: 6}
    remote._known.clear()
    assert not list(tmp_path.glob("dirprim-*"))


def test_processes_that_are_given_a_store_share_what_one_fetched(there, logs, requests, tmp_path, monkeypatch):
    """Control: who opens it anew fetches all."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    add_logs(there, logs)
    store = Store.open(URL)
    everything = [summed(store), store.entries()]
    first = remote._known.pop(URL)  # from here on it is another process
    requests.clear()
    given = pickle.loads(pickle.dumps(store))  # noqa: S301
    assert [summed(given), given.entries()] == everything
    assert requests["get_object"] == 0
    del first
    assert not list(tmp_path.glob("dirprim-*"))  # who made the copies is gone, and all goes on
    assert summed(given) == everything[0]
    again = Store.open(URL)
    requests.clear()
    assert [summed(again), again.entries()] == everything
    assert requests["get_object"] == 6


def test_logs_of_a_pattern_are_listed_and_not_asked_for_one_by_one(object_store, requests, monkeypatch):
    """Control: each by its own name is."""
    kind, asked = type(object_store), []
    info = kind._info

    async def noted(files, path, *given, **options):
        asked.append(path)
        return await info(files, path, *given, **options)

    object_store.pipe({f"bucket/day/{i}.mcap": b"log" for i in range(9)})
    monkeypatch.setattr(kind, "_info", noted)
    requests.clear()
    found = find_logs(["s3://bucket/day/*.mcap"])
    assert (len(found), requests.total()) == (9, 1)
    assert len(asked) <= 1  # whether there is such a folder
    assert find_logs([log.url for log in found]) == found
    assert len(asked) >= 9
