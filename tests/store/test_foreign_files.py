"""What a store did not write it leaves alone: files of the user's beside it and within it, whatever is done to it."""

import os
import time
from pathlib import Path

import pytest
from streets import GRID, logs_of, store_of, street

from cli.commands import DONE, FAILED, dirprim
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store import Store, add_logs, find_logs, keep, learn_from_store
from dirprim_filter.store.forgetting import forget, merge

NAMES = [
    "notes.txt", "sub/thesis.tex", "rows/notes.txt", "rows/sub/a.parquet", "rows/a.parquet", f"rows/{'0' * 32}.parquet",
    f"rows/{'G' * 32}-{'0' * 64}.parquet", f"rows/sub/{'0' * 32}-{'0' * 64}.parquet", "_fits/notes", "_fits/0_0/notes",
    f"_fits/0_0/{'0' * 64}.csv", f"_fits/sub/{'0' * 64}.mcap", "_delta_log/README", "_delta_log/sub/00.json",
    f"{'0' * 32}-{'0' * 64}.parquet", "rows.mcap",
]  # fmt: skip
"""Nearly as a store's own."""
OLD_S = time.time() - 60 * 86_400


def put_foreign(store, folder):
    """Files of the user's within a store; -> what each holds, to be asked for again."""
    for name in NAMES:
        store.put(name, name.encode())
    if folder is None:
        return lambda: {name: store.get(name) for name in NAMES}
    for number, name in enumerate(("link", "rows/link", "rows/dangling", "_fits/0_0/link")):
        (folder / name).symlink_to("nowhere" if number == 2 else folder / "notes.txt")
    for name in NAMES:
        os.utime(folder / name, (OLD_S, OLD_S))
    names = [path.relative_to(folder) for path in folder.rglob("*") if path.is_symlink() or path.name in ours()]
    assert len(names) >= len(NAMES) + 4

    def there():
        return {name: path.readlink() if path.is_symlink() else path.read_bytes() for name in names
                for path in [folder / name]}  # fmt: skip

    return there


def ours():
    return {Path(name).name for name in NAMES}


def test_no_command_touches_what_a_store_did_not_write(place, tmp_path):
    path = logs_of(tmp_path, a=street(1), b=street(2), c=street(3))
    store = store_of(place, path["a"], path["b"])
    there = put_foreign(store, None if "://" in place else Path(place))
    before = there()
    commands = [
        lambda: add_logs(place, find_logs([path["c"]])), lambda: learn_from_store(store, **GRID),
        lambda: keep(store, n_vehicles=1, month="1970-01"), lambda: forget(store, [path["b"]]),
        lambda: merge(store, store_of(tmp_path / "other", path["b"])), lambda: learn_from_store(store, **GRID),
        store.tidy,
    ]  # fmt: skip
    for command in commands:
        command()
        assert there() == before
    assert set(store.contents().entries) == set(path.values())


@pytest.mark.parametrize(
    "name", ["notes.txt", "sub/thesis.tex", "rows/notes.txt", "_delta_log/README", ".git/HEAD", "rows"]
)
def test_a_store_is_made_in_no_folder_of_something_else(name, place, tmp_path):
    (log,) = logs_of(tmp_path, a=street(1)).values()
    other = store_of(tmp_path / "other", log)
    Store(place, other.config, "map").put(name, b"mine")
    for make in (lambda: add_logs(place, find_logs([log])), lambda: Store.create(place, other.config, "map")):
        with pytest.raises(
            RecordingError, match=f"expected a store or an empty folder, got one with {name.split('/')[0]}"
        ):
            make()
    assert not Store.is_at(place)
    assert Store(place, other.config, "map").get(name) == b"mine"


def test_what_a_killed_process_left_keeps_none_from_making_the_store(place, tmp_path):
    path = logs_of(tmp_path, a=street(1))
    other = store_of(tmp_path / "other", path["a"])
    half = Store(place, other.config, "map")
    half.put(f"rows/{'0' * 32}-{'0' * 64}.parquet", b"PAR1")
    half.put("_delta_log/_commit_0a.json.tmp", b"{")
    assert list(store_of(place, path["a"]).contents().entries) == [path["a"]]


def test_the_command_says_so_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (log,) = logs_of(tmp_path, a=street(1)).values()
    assert dirprim("store add .", log) == FAILED
    error = capsys.readouterr().err
    assert "expected a store or an empty folder, got one with a.mcap in it; choose another name" in error
    assert error.count("\n") == 1
    assert dirprim("store add new", log) == DONE


def test_what_nobody_knows_of_goes_a_day_later(tmp_path):
    """Of a store's own names alone; what an entry names that is damaged is known."""
    (log,) = logs_of(tmp_path, a=street(1)).values()
    store = store_of(tmp_path / "store", log)
    (file,) = store.contents().entries[log].files
    damaged = file._replace(path=f"rows/{'d' * 32}-{'0' * 64}.parquet", recording="no hash")
    left = [f"rows/{n * 32}-{'0' * 64}.parquet" for n in "ab"]
    for name in (*left, damaged.path):
        store.put(name, b"PAR1")
    store.commit(lambda _: ([damaged], []))
    for name in (left[0], damaged.path, file.path):
        os.utime(tmp_path / "store" / name, (OLD_S, OLD_S))
    store.tidy()
    kept = [store.get(name) is not None for name in (*left, damaged.path, file.path)]
    assert kept == [False, True, True, True]
