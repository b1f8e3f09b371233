"""Whatever happens to a store in whatever order, and whoever is killed at whatever step: it holds what a dict would."""

import shutil
import tempfile
from collections import Counter
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
from streets import GRID, bytes_of, logs_of, store_of, street

from dirprim_filter.store import add_logs, find_logs, keep, learn_from_store
from dirprim_filter.store.forgetting import forget, merge
from dirprim_filter.store.keeping import month_of, whole
from dirprim_filter.store.sampling import kept_of, turns_in
from dirprim_filter.store.store import Store

NAMES = ("one", "two", "copy", "far", "next_month")
ONCE = {"deadline": None, "derandomize": True, "phases": [Phase.generate]}
KILLS = st.none() | st.integers(0, 6)
"""At which step, of writing a file and of a commit before and after it, if at any."""


class Killed(BaseException):
    """Nothing after it takes place, nor is it caught."""


class killed_at:  # noqa: N801 (a context)
    """Within, the process is killed at a step."""

    def __init__(self, step):
        self.left = np.inf if step is None else step

    def step(self):
        self.left -= 1
        if self.left < 0:
            raise Killed

    def __enter__(self):
        put, committed = Store.put, Store._committed

        def dying_put(store, path, data):
            self.step()
            put(store, path, data)

        def dying_commit(store, *files):
            self.step()
            done = committed(store, *files)
            self.step()
            return done

        self.patches = [patch.object(Store, "put", dying_put), patch.object(Store, "_committed", dying_commit)]
        for each in self.patches:
            each.start()

    def __exit__(self, kind, *_):
        for each in self.patches:
            each.stop()
        return kind is Killed


class StoreModel(RuleBasedStateMachine):
    """A store beside a dict of what its logs say."""

    root: str  # where stores are; a folder of its own if empty
    path: dict  # of the logs, by name
    fresh: dict  # their rows, as a store has them at first

    @initialize()
    def begin(self):
        self.folder = Path(tempfile.mkdtemp())
        self.store = None
        self.holds = {}  # which Rows, by name

    def teardown(self):
        if hasattr(self, "folder"):
            shutil.rmtree(self.folder)

    @property
    def at(self):
        return self.folder / "store" if not self.root else f"{self.root}/{self.folder.name}"

    def settle(self, *possible):
        """Of what a killed step may have left, take what it did leave: the one or the other, never a mixture."""
        now = self.now()
        said = [{name: rows.digest + str(rows.weight.tolist()) for name, rows in each.items()} for each in possible]
        found = {name: rows.digest + str(rows.weight.tolist()) for name, rows in now.items()}
        assert found in said
        self.holds = now

    def now(self):
        if not Store.is_at(self.at):
            return {}
        self.store = Store.open(self.at)
        entries = self.store.contents().entries
        of = {path: name for name, path in self.path.items()}
        return {of[log]: whole(self.store, entry) for log, entry in entries.items()}

    @rule(names=st.sets(st.sampled_from(NAMES), min_size=1), kill=KILLS)
    def add(self, names, kill):
        with killed_at(kill):
            add_logs(self.at, find_logs([self.path[name] for name in sorted(names)]))
        after = self.fresh | {name: rows for name, rows in self.holds.items() if name in names}
        self.settle(self.holds, self.holds | {name: after[name] for name in names})

    @precondition(lambda self: self.holds)
    @rule(data=st.data(), kill=KILLS)
    def forget(self, data, kill):
        names = data.draw(st.sets(st.sampled_from(sorted(self.holds)), min_size=1))
        with killed_at(kill):
            forget(self.store, [self.path[name] for name in sorted(names)])
        self.settle(self.holds, {name: rows for name, rows in self.holds.items() if name not in names})

    @precondition(lambda self: self.store is not None)
    @rule(names=st.sets(st.sampled_from(NAMES), min_size=1), kill=KILLS)
    def merge(self, names, kill):
        other = store_of(Path(tempfile.mkdtemp(dir=self.folder)) / "other", *(self.path[name] for name in names))
        with killed_at(kill):
            merge(self.store, other)
        self.settle(self.holds, {name: self.fresh[name] for name in names} | self.holds)

    @precondition(lambda self: self.holds)
    @rule(n_vehicles=st.integers(1, 3), kill=KILLS)
    def keep(self, n_vehicles, kill):
        of_month, once = {}, {}
        for name, rows in sorted(self.holds.items(), key=lambda item: self.path[item[0]]):
            once[self.fresh[name].digest] = (month_of(int(self.start(name))), rows)
        for month, rows in once.values():
            of_month.setdefault(month, Counter()).update(turns_in(rows))
        with killed_at(kill):
            keep(self.store, n_vehicles=n_vehicles, month="1970-01")
        now, left = self.now(), {}
        for name, rows in self.holds.items():
            thinned = rows
            if month_of(int(self.start(name))) == "1970-01":
                thinned = kept_of(rows, self.fresh[name].digest, of_month["1970-01"], n_vehicles)
            left[name] = thinned
        assert now.keys() == self.holds.keys()
        for name, rows in now.items():
            known = [left[name]] if kill is None else [left[name], self.holds[name]]
            assert any(
                rows.digest == each.digest and np.allclose(rows.weight, each.weight, rtol=1e-6) for each in known
            )
        self.holds = now

    def start(self, name):
        (entry,) = (e for e in self.store.contents().entries.values() if e.log == self.path[name])
        return entry.start_ms

    @invariant()
    def every_log_that_counts_has_its_files(self):
        if self.store is not None:
            for entry in self.store.contents().entries.values():
                assert len({file.added for file in entry.files}) == 1
                assert sum(len(self.store.read(file)) for file in entry.files if not file.halo) == entry.n_rows


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """The logs, of which two are copies, and what a store has of each."""
    folder = tmp_path_factory.mktemp("known")
    one = street(3)
    path = logs_of(folder, one=one, two=street(2), copy=one, far=street(4, start=400.0, length=200.0),
                   next_month=street(5, day=40))  # fmt: skip
    alone = {name: store_of(folder / f"alone {name}", log) for name, log in path.items()}
    fresh = {name: whole(store, store.contents().recordings()[0]) for name, store in alone.items()}
    return {"path": path, "fresh": fresh}


@pytest.mark.parametrize(("remote", "examples", "steps"), [(False, 12, 8), (True, 2, 4)])
def test_a_store_holds_what_a_dict_would(known, request, remote, examples, steps):
    root = request.getfixturevalue("bucket") if remote else ""
    kind = type("Model", (StoreModel,), known | {"root": root})
    run_state_machine_as_test(kind, settings=settings(max_examples=examples, stateful_step_count=steps, **ONCE))


@pytest.mark.parametrize("kill", range(4))
def test_the_map_is_the_same_in_whatever_order_logs_came_and_went_and_whoever_was_killed(tmp_path, kill):
    path = logs_of(tmp_path, **{name: street(seed, start=-500.0 * (seed % 2)) for seed, name in enumerate("abcd")})
    at_once = store_of(tmp_path / "at once", path["a"], path["b"], path["c"])
    slowly = tmp_path / "slowly"
    for names in ("d", "cd", "bc"):
        with killed_at(kill):
            add_logs(slowly, find_logs([path[name] for name in names]))
    store_of(slowly, path["d"])
    forget(Store.open(slowly), [path["d"]])
    part = store_of(tmp_path / "part", path["a"], path["b"])
    merge(Store.open(slowly), part)
    store = store_of(slowly, path["a"], path["b"], path["c"])
    maps = [learn_from_store(each, **GRID).primitive_map for each in (at_once, store)]
    assert bytes_of(maps[0], tmp_path) == bytes_of(maps[1], tmp_path)
    assert bytes_of(learn_from_store(part, **GRID).primitive_map, tmp_path) != bytes_of(maps[0], tmp_path)
