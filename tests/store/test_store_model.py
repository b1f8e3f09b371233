"""Whatever happens to a store in whatever order, and whoever is killed at whatever step: it holds what a dict would.

And its map is that of a store which was given, at once, what the dict holds: so forgotten logs never were, copies count
once, and neither order nor merging nor kills leave a trace.
"""

import shutil
import tempfile
from collections import Counter
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from streets import GRID, logs_of, map_bytes, rows_stored, store_of, street

from dirprim_filter.store import add_logs, adding, find_logs, keep, learn_from_store
from dirprim_filter.store.forgetting import forget, merge
from dirprim_filter.store.keeping import month_of, whole
from dirprim_filter.store.rows import StoredRows
from dirprim_filter.store.sampling import Recording, turns_of
from dirprim_filter.store.store import Store

ONE = street(3)
SAY = {
    "one": [ONE], "copy": [ONE], "two": [street(2), street(6)], "far": [street(4, start=400.0, length=200.0)],
    "next_month": [street(5, day=40)],
}  # fmt: skip
"""What each log says; one of them changes."""
NAMES = st.sets(st.sampled_from(sorted(SAY)), min_size=1)
KILLS = st.none() | st.integers(0, 6)
"""At which step, of writing a file and of a commit before and after it, if at any."""


class Killed(BaseException):
    """Nothing after it takes place, nor is it caught."""


@contextmanager
def killed_at(step):
    """Within, the process is killed at a step."""
    left, put, committed = np.inf if step is None else step, Store.put, Store._committed

    def go_on():
        nonlocal left
        left -= 1
        if left < 0:
            raise Killed

    def dying_put(store, path, data):
        go_on()
        put(store, path, data)

    def dying_commit(store, *files):
        go_on()
        done = committed(store, *files)
        go_on()
        return done

    with patch.object(Store, "put", dying_put), patch.object(Store, "_committed", dying_commit), suppress(Killed):
        yield


def said(holds):
    """What can be compared."""
    return {name: (rows.digest, rows.weight.astype(np.float32).tolist()) for name, rows in holds.items()}


class StoreModel(RuleBasedStateMachine):
    """A store beside a dict of the rows of its logs."""

    root: str  # where stores are; a folder of its own if empty
    written: dict  # logs of what is said in `SAY`, each name's

    @initialize()
    def begin(self):
        self.folder = Path(tempfile.mkdtemp())
        self.at = f"{self.root}/{self.folder.name}" if self.root else self.folder / "store"
        self.say = {name: tracks[0] for name, tracks in SAY.items()}
        self.path = {name: str(self.folder / f"{name}.mcap") for name in SAY}
        for name, path in self.path.items():
            shutil.copy(self.written[name][0], path)
        self.store, self.holds, self.recording = None, {}, {}

    def teardown(self):
        if hasattr(self, "folder"):
            try:
                if any(len(rows) for rows in self.holds.values()):
                    self.learn(None)
            finally:
                shutil.rmtree(self.folder)

    def fresh(self, names):
        return {name: StoredRows.of(self.say[name]) for name in sorted(names)}

    def settle(self, *possible):
        """Of what a killed step may have left, take what it did leave: the one or the other, never a mixture."""
        if Store.is_at(self.at):
            self.store, of = Store.open(self.at), {path: name for name, path in self.path.items()}
            entries = self.store.contents().entries
            self.holds = {of[log]: whole(self.store, entry) for log, entry in entries.items()}
            self.recording = {of[log]: entry.recording for log, entry in entries.items()}
        assert said(self.holds) in list(map(said, possible))

    @rule()
    def change(self):
        """A log is written anew, and says something else; the store learns of it when it is added again."""
        other = int(self.say["two"] is SAY["two"][0])
        self.say["two"] = SAY["two"][other]
        shutil.copy(self.written["two"][other], self.path["two"])

    @rule(names=NAMES, kill=KILLS, every_s=st.sampled_from([0.0, np.inf]))
    def add(self, names, kill, every_s):
        """By one commit, or one for each log, as where there is one a second: then those before stay."""
        says = {name: StoredRows.of(self.say[name]).digest for name in names & self.holds.keys()}
        known = {name for name, digest in says.items() if self.recording[name] == digest}
        with killed_at(kill), patch.object(adding, "EVERY_S", every_s):
            assert add_logs(self.at, find_logs([self.path[name] for name in names])).known == len(known)
        new = sorted(names - known)
        done = [self.holds | self.fresh(new[:n]) for n in range(len(new) + 1)]
        self.settle(*(done[-1:] if kill is None else done if not every_s else [done[0], done[-1]]))

    @precondition(lambda self: self.holds)
    @rule(data=st.data(), kill=KILLS)
    def forget(self, data, kill):
        names = data.draw(st.sets(st.sampled_from(sorted(self.holds)), min_size=1))
        with killed_at(kill):
            forget(self.store, [self.path[name] for name in sorted(names)])
        self.settle(self.holds, {name: rows for name, rows in self.holds.items() if name not in names})

    @precondition(lambda self: self.store is not None)
    @rule(names=NAMES, kill=KILLS)
    def merge(self, names, kill):
        theirs = self.fresh(names)
        other = store_of(Path(tempfile.mkdtemp(dir=self.folder)) / "other", *(self.path[name] for name in names))
        if any(self.recording[name] != rows.digest for name, rows in theirs.items() if name in self.holds):
            with pytest.raises(ValueError, match="two versions of it"):
                merge(self.store, other)
            return
        with killed_at(kill):
            merge(self.store, other)
        self.settle(self.holds, theirs | self.holds)

    @precondition(lambda self: self.holds)
    @rule(n_vehicles=st.integers(1, 3), kill=KILLS)
    def keep(self, n_vehicles, kill):
        entries = self.store.contents().entries
        month = {name: month_of(entries[self.path[name]].start_ms) for name in self.holds}
        ours = sorted((name for name in self.holds if month[name] == "1970-01"), key=self.path.get)
        once = {self.recording[name]: self.holds[name] for name in ours}
        n_of = sum((Counter(turns_of(rows).tolist()) for rows in once.values()), Counter())
        of = {name: Recording.of(self.recording[name], self.holds[name]) for name in ours}
        left = {name: of[name].thinned(n_of, n_vehicles).weighed(n_of, n_vehicles) for name in ours}
        with killed_at(kill):
            keep(self.store, n_vehicles=n_vehicles, month="1970-01")
        done = [self.holds | {name: left[name] for name in ours[:n]} for n in range(len(ours) + 1)]
        self.settle(*(done[-1:] if kill is None else done))  # log by log

    @precondition(lambda self: any(len(rows) for rows in self.holds.values()))
    @rule(kill=KILLS)
    def learn(self, kill):
        """Whoever is killed while it learns: the next one learns the map of a store with the same rows."""
        with killed_at(kill):
            learn_from_store(self.store, **GRID)
        with tempfile.TemporaryDirectory() as folder:
            at_once = rows_stored(Path(folder) / "store")
            for name, rows in self.holds.items():
                files = at_once.write(
                    rows, log=self.path[name], mark="0", status="whole", recording=self.recording[name]
                )
                at_once.commit(lambda _, files=files: (files, []))
            assert map_bytes(self.store, Path(folder)) == map_bytes(at_once, Path(folder))

    @invariant()
    def every_log_that_counts_has_its_files(self):
        if self.store is not None:
            for entry in self.store.contents().entries.values():
                assert len({file.added for file in entry.files}) == 1
                assert sum(len(self.store.read(file)) for file in entry.files if not file.halo) == entry.n_rows


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Logs of what is said, made once."""
    return {
        name: [logs_of(tmp_path_factory.mktemp(name), log=each)["log"] for each in tracks]
        for name, tracks in SAY.items()
    }


@pytest.mark.slow
@pytest.mark.parametrize(("remote", "examples", "steps"), [(False, 20, 8), (True, 2, 5)])
def test_a_store_holds_what_a_dict_would_and_its_map_follows_from_that(request, written, remote, examples, steps):
    root = request.getfixturevalue("bucket") if remote else ""
    model = type("Model", (StoreModel,), {"root": root, "written": written})
    generated = settings(
        max_examples=examples, stateful_step_count=steps, deadline=None, derandomize=True, phases=[Phase.generate]
    )
    run_state_machine_as_test(model, settings=generated)
