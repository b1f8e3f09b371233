"""What a store is asked for once, how logs are read and in which frame: of many who begin at once, one says it."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from streets import summed

from dirprim_filter import write_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store import Store
from dirprim_filter.store.adding import add_logs, failures
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.folder import LocalFolder
from dirprim_filter.store.log_files import find_logs
from dirprim_filter.store.remote_folder import RemoteFolder
from situations import ring_traffic

N_WRITERS = 8


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """In frame map."""
    path = tmp_path_factory.mktemp("logs") / "log.mcap"
    write_tracks(ring_traffic(np.random.default_rng(0), n_vehicles=3, n_rows=20), path)
    return path


@pytest.fixture(params=["folder", "s3", "memory"])
def place(request, tmp_path):
    """Where there may be a store."""
    if request.param == "s3":
        request.getfixturevalue("object_store")
    return {"folder": str(tmp_path / "fleet"), "s3": "s3://bucket/fleet", "memory": f"memory://{tmp_path}"}[
        request.param
    ]


@pytest.fixture
def store(place):
    return Store.create(place, StoreConfig())


class Racing:
    """A folder in which another writes a file just before it is created."""

    def __init__(self, folder, data):
        self.folder, self.data = folder, data

    def __getattr__(self, name):
        return getattr(self.folder, name)

    def create(self, name, data):
        self.folder.create(name, self.data)
        return self.folder.create(name, data)


class Overwriting(Racing):
    """One in which nothing keeps files from being written twice: the negative control."""

    def create(self, name, data):
        self.folder.write({name: self.data})
        self.folder.write({name: data})
        return True


def raced(store, log, frame, kind=Racing):
    """What is said when a store's first log is added and another process adds one of some frame just before."""
    racing = replace(store, folder=kind(store.folder, json.dumps({"frame": frame}).encode()))
    return list(failures(add_logs(racing, find_logs([str(log)]))))


def test_of_two_who_add_the_first_log_one_says_which_frame_it_is(store, log):
    """The other's log is refused, and nothing of it is left. Control: where files may be written twice, both count."""
    (line,) = raced(store, log, "odom")
    assert "expected positions in frame 'odom'" in line
    assert (store.frame, store.entries(), store.recording_sizes()) == ("odom", [], {})
    assert raced(store, log, "map")
    store.folder.remove("frame.json")
    assert raced(store, log, "odom", Overwriting) == []
    assert store.frame == "map"


def test_of_two_who_add_logs_of_the_same_frame_both_do(store, log):
    assert raced(store, log, "map") == []
    assert len(store.entries()) == 1


@pytest.mark.parametrize("place", ["folder", "s3"], indirect=True)
def test_many_that_name_a_frame_at_once_agree(store):
    """Of eight that name four frames those two are right whose frame it became."""

    def named(i):
        try:
            Store.open(store.path).check_frame("log", f"frame{i % 4}")
        except ValueError:
            return False
        return True

    with ThreadPoolExecutor(N_WRITERS) as pool:
        right = list(pool.map(named, range(N_WRITERS)))
    assert right == [store.frame == f"frame{i % 4}" for i in range(N_WRITERS)]
    assert sum(right) == N_WRITERS // 4


def test_of_two_who_make_a_store_at_once_one_is_refused(place, monkeypatch):
    for kind in (LocalFolder, RemoteFolder):
        monkeypatch.setattr(kind, "is_free", lambda _: True)
    first = Store.create(place, StoreConfig())
    with pytest.raises(RecordingError, match="expected a store or an empty folder"):
        Store.create(place, StoreConfig(labels="car"))
    assert Store.open(place) == first


@pytest.mark.parametrize("labels", [None, "car"])
def test_a_command_goes_on_with_the_store_that_another_has_just_made(tmp_path, log, monkeypatch, capsys, labels):
    """Control: one that reads logs otherwise is refused."""
    Store.create(tmp_path / "fleet", StoreConfig(labels=labels))
    looks = iter([False])
    is_at = Store.is_at
    monkeypatch.setattr(Store, "is_at", lambda path: next(looks, None) is not False and is_at(path))
    options = ["--labels", ".*"] if labels else []
    assert run(["store", "add", str(tmp_path / "fleet"), str(log), *options]) == (1 if labels else 0)
    assert ("expected labels car" in capsys.readouterr().err) == bool(labels)


@pytest.mark.parametrize("there", [False, True])
def test_a_disk_without_links_creates_files_as_well(tmp_path, monkeypatch, there):
    def refused(*_):
        raise PermissionError("no links")

    monkeypatch.setattr("pathlib.Path.hardlink_to", refused)
    check_created(LocalFolder(tmp_path), there)
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


@pytest.mark.parametrize("there", [False, True])
def test_a_server_without_conditions_creates_files_as_well(object_store, monkeypatch, there):
    kind, put = type(object_store), type(object_store)._pipe_file

    async def refusing(files, path, data, mode="overwrite", **options):
        if mode == "create":
            raise OSError(38, "A header you provided implies functionality that is not implemented")
        await put(files, path, data, **options)

    monkeypatch.setattr(kind, "_pipe_file", refusing)
    check_created(RemoteFolder("s3://bucket/fleet"), there)


def check_created(folder, there):
    if there:
        folder.write({"x": b"theirs"})
    assert folder.create("x", b"ours") != there
    assert folder.read("x") == (b"theirs" if there else b"ours")


def test_a_connection_that_is_lost_creates_nothing_and_is_an_error(object_store, monkeypatch):
    async def lost(files, path, data, **options):
        raise ConnectionResetError(104, "connection reset")

    monkeypatch.setattr(type(object_store), "_pipe_file", lost)
    with pytest.raises(RecordingError, match=r"s3://bucket/fleet/x: .* connection reset"):
        RemoteFolder("s3://bucket/fleet").create("x", b"ours")


def test_a_store_of_before_is_read_and_added_to(log, tmp_path):
    """Its frame stands where logs' options do. Control: of a later format it is refused."""
    store = Store.create(tmp_path / "fleet", StoreConfig())
    add_logs(store, find_logs([str(log)]))
    frame, whole = store.frame, summed(store)
    store.forget(str(log))
    (store.path / "frame.json").unlink()
    said = json.loads((store.path / "store.json").read_text())
    for before in (None, frame):
        (store.path / "store.json").write_text(json.dumps(said | {"format": 3, "frame": before}))
        assert Store.open(store.path).frame == before
    store = Store.open(store.path)
    with pytest.raises(ValueError, match="expected positions in frame"):
        store.check_frame("log", "odom")
    add_logs(store, find_logs([str(log)]))
    assert (summed(store), store.frame) == (whole, frame)
    assert not (store.path / "frame.json").exists()
    (store.path / "store.json").write_text(json.dumps(said | {"format": 5}))
    with pytest.raises(RecordingError, match=r"store.json: expected a store of format 4, got format 5"):
        Store.open(store.path)
