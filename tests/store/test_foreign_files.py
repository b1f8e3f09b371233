"""What a store did not write it leaves alone, whatever is done to it: files of the user's beside it and within it.

Nor does a command that is killed touch them, and it is done as it is given once more.
"""

import os
import shutil
import time
from pathlib import Path

import pytest
from killed_commands import kill_command, run_command
from streets import GRID, logs_of, store_of, street

from cli.commands import DONE
from dirprim_filter import load_map
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
    assert len(foreign_files(folder)) >= len(NAMES) + 4
    return lambda: foreign_files(folder)


def foreign_files(folder):
    """What the files hold, and where links lead, that no command is to touch."""
    names = {Path(name).name for name in NAMES}
    return {path: path.readlink() if path.is_symlink() else path.read_bytes() for path in folder.rglob("*")
            if path.is_symlink() or (path.name in names and path.is_file())}  # fmt: skip


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
    said = f"expected a store or an empty folder, got one with {name.split('/')[0]}.* in it; choose another name"
    for make in (lambda: add_logs(place, find_logs([log])), lambda: Store.create(place, other.config, "map")):
        with pytest.raises(RecordingError, match=said):
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


LEARN = "--force --tessellation grid --cell-size 32"
COMMANDS = {
    "add": "store add store ../b.mcap ../c.mcap", "keep": "store keep store --of-month 1970-01 --vehicles 1",
    "forget": "store forget store ../b.mcap", "merge": "store merge new store",
    "store learn": f"store learn store -o precious.mcap {LEARN}", "learn": f"learn ../a.mcap -o precious.mcap {LEARN}",
}  # fmt: skip


class Ground:
    """A folder with a store and a map, and files of the user's beside and within them; made anew for each kill."""

    def __init__(self, top):
        path = logs_of(top, a=street(1), b=street(2), c=street(3))
        self.whole, self.folder = top / "whole", top / "folder"
        store = store_of(self.whole / "store", path["a"], path["b"])
        assert run_command(self.whole, f"learn ../a.mcap -o precious.mcap {LEARN}")[0] == DONE
        (self.whole / "notes.txt").write_bytes(b"mine")
        put_foreign(store, self.whole / "store")

    def begin(self):
        """As it was."""
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(self.whole, self.folder, symlinks=True)
        return foreign_files(self.folder)

    def after(self, command):
        """What is in the stores after a command that is let be."""
        self.begin()
        assert run_command(self.folder, command)[0] == DONE
        return self.held()

    def held(self):
        """Of each log in each store, how many rows can be read."""
        stores = [Store.open(path) for name in ("store", "new") if Store.is_at(path := self.folder / name)]
        return {(store.path, log): sum(len(store.read(file)) for file in entry.files if not file.halo)
                for store in stores for log, entry in store.contents().entries.items()}  # fmt: skip

    def check(self, command, there, aim):
        """The laws after a kill, and after the command is given once more."""
        before = self.held()
        assert load_map(self.folder / "precious.mcap").n_rows.sum() > 0
        code, said = run_command(self.folder, command)
        assert code == DONE or ("is not in the store" in said and before == aim), said
        assert self.held() == aim
        assert foreign_files(self.folder) == there


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    return Ground(tmp_path_factory.mktemp("kills"))


@pytest.mark.parametrize(
    "killed",
    [
        [{"step": 3}, {"step": 12}],  # of its writing, before or after which it is killed
        pytest.param([{"after_s": 0.001}, {"after_s": 0.03}], marks=pytest.mark.slow),  # of its time, from the first on
    ],
    ids=["at steps", "at times"],
)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_is_killed_as_it_writes_touches_nothing_else_and_can_be_given_again(name, killed, ground):
    aim, command = ground.after(COMMANDS[name]), COMMANDS[name]
    was_killed = []
    for how in killed:
        there = ground.begin()
        was_killed.append(kill_command(ground.folder, command, **how))
        ground.check(command, there, aim)
    assert was_killed[0] if "step" in killed[0] else any(was_killed)
