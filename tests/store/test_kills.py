"""A command may be killed at any time: nothing of the user's is touched, and it is done as it is given once more."""

import shutil
from pathlib import Path

import pytest
from killed_commands import kill_command, run_command
from streets import logs_of, store_of, street
from test_foreign_files import NAMES, put_foreign

from cli.commands import DONE
from dirprim_filter import load_map
from dirprim_filter.store import Store

GRID = "--force --tessellation grid --cell-size 32"
COMMANDS = {
    "add": "store add store ../b.mcap ../c.mcap", "keep": "store keep store --of-month 1970-01 --vehicles 1",
    "forget": "store forget store ../b.mcap", "merge": "store merge new store",
    "store learn": f"store learn store -o precious.mcap {GRID}", "learn": f"learn ../a.mcap -o precious.mcap {GRID}",
}  # fmt: skip
STEPS = (3, 12)
"""Of the writing of each command, before or after which it is killed."""
LATER_S = (0.001, 0.03)
"""Of a command's own time, from the first step on."""


FOREIGN = {Path(name).name for name in NAMES}


class Ground:
    """A folder with a store and a map, and files of the user's beside and within them; made anew for each kill."""

    def __init__(self, top):
        path = logs_of(top, a=street(1), b=street(2), c=street(3))
        self.whole, self.folder = top / "whole", top / "folder"
        store = store_of(self.whole / "store", path["a"], path["b"])
        assert run_command(self.whole, f"learn ../a.mcap -o precious.mcap {GRID}")[0] == DONE
        (self.whole / "notes.txt").write_bytes(b"mine")
        put_foreign(store, self.whole / "store")

    def begin(self):
        """As it was."""
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(self.whole, self.folder, symlinks=True)
        there = foreign_files(self.folder)
        assert len(there) > 20
        return there

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


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_is_killed_as_it_writes_touches_nothing_else_and_can_be_given_again(name, ground):
    aim, command = ground.after(COMMANDS[name]), COMMANDS[name]
    for step in STEPS:
        there = ground.begin()
        assert kill_command(ground.folder, command, step=step) or step > STEPS[0]
        ground.check(command, there, aim)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_kills_at_any_time_of_the_writing(name, ground):
    aim, command = ground.after(COMMANDS[name]), COMMANDS[name]
    n_killed = 0
    for after_s in LATER_S:
        there = ground.begin()
        n_killed += kill_command(ground.folder, command, after_s=after_s)
        ground.check(command, there, aim)
    assert n_killed > 0


def foreign_files(folder):
    """What the files hold, and where links lead, that no command is to touch."""
    return {path: path.readlink() if path.is_symlink() else path.read_bytes() for path in folder.rglob("*")
            if path.is_symlink() or (path.name in FOREIGN and path.is_file())}  # fmt: skip
