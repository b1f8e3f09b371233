"""A store of logs: what counts, what is skipped, forgotten, merged and refused, and what a crash leaves."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest
from dying import once_killed
from streets import summed

from dirprim_filter import write_tracks
from dirprim_filter.recording.container import partial_copy, source
from dirprim_filter.recording.errors import MissingExtraError, RecordingError
from dirprim_filter.recording.reader import read_track_logs
from dirprim_filter.store import adding, learning, recorded_ways, table, workers
from dirprim_filter.store import store as store_module
from dirprim_filter.store.adding import add_logs, failures, hash_of_rows
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.lattice import NONE, Lattice
from dirprim_filter.store.learning import is_passed
from dirprim_filter.store.log_files import find_logs
from dirprim_filter.store.recorded_ways import EVERYWHERE, sampled
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.workers import LocalWorkers
from situations import ring_traffic


def traffic(seed):
    return ring_traffic(np.random.default_rng(seed), n_vehicles=3, n_rows=20)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A folder of three logs."""
    folder = tmp_path_factory.mktemp("logs")
    for seed in range(3):
        write_tracks(traffic(seed), folder / f"{seed}.mcap")
    return folder


@pytest.fixture
def store(tmp_path):
    return Store.create(tmp_path / "store", StoreConfig())


@pytest.fixture
def full(store, logs):
    add_logs(store, find_logs([str(logs / "*.mcap")]))
    return store


@pytest.fixture
def opened(monkeypatch):
    """Which logs were read."""
    opened = []
    monkeypatch.setattr(adding, "read_track_logs", lambda url, *how: opened.append(url) or read_track_logs(url, *how))
    return opened


def files(store):
    return {str(path.relative_to(store.path)): path.read_bytes() for path in store.path.rglob("*") if path.is_file()}


def test_a_store_sums_its_recordings_whatever_the_order(full, logs, tmp_path):
    backwards = Store.create(tmp_path / "backwards", StoreConfig())
    for seed in (2, 0, 1):
        add_logs(backwards, find_logs([str(logs / f"{seed}.mcap")]))
    assert files(backwards) == files(full)
    frame = full.frame
    assert summed(full) == Summary.total([Summary.of(traffic(seed), frame=frame) for seed in range(3)])


def test_a_map_is_of_the_recordings_that_are_there(full, monkeypatch):
    monkeypatch.setattr(recorded_ways, "SUMMED_AT_ONCE", 1)
    before, whole = full.digest, summed(full)
    (sample,) = sampled(full, [EVERYWHERE], most_rows=10**9, min_vehicles=2)
    passed = is_passed(sample.ways.visible().tracks, whole.passed, whole.lattice, 2)
    assert passed.all()
    assert sample.ways.way.size < whole.whens.value.sum()
    (every,) = sampled(full, [EVERYWHERE], most_rows=10**9, min_vehicles=1)
    assert every.ways.way.size == whole.whens.value.sum()
    full.forget(full.entries()[0].url)
    assert full.digest != before
    (rest,) = sampled(full, [EVERYWHERE], most_rows=10**9, min_vehicles=1)
    assert rest.ways.way.size == summed(full).whens.value.sum() < every.ways.way.size


def test_what_memory_cannot_hold_at_once_is_the_same_in_blocks(full, monkeypatch):
    whole = learning.visible_tracks(summed(full), min_vehicles=2).tracks
    monkeypatch.setattr(learning, "BLOCK_STEPS", 15)
    assert learning.visible_tracks(summed(full), min_vehicles=2).tracks.n_tracks == whole.n_tracks


def test_of_another_lattice_nothing_is_counted(full):
    with pytest.raises(RecordingError, match="expected statistics of a recording"):
        table.read_counts(full.recording(full.rows()[0]), Lattice(square_m=2.0))


def test_known_logs_are_not_opened_again(full, logs, monkeypatch):
    before = files(full)
    monkeypatch.setattr(adding, "read_track_logs", None)
    assert add_logs(full, find_logs([str(logs / "*.mcap")])).known == 3
    assert files(full) == before


def test_a_log_that_has_changed_replaces_what_it_was(full, tmp_path):
    log = tmp_path / "log.mcap"
    for seed in (7, 8):
        write_tracks(traffic(seed), log, force=True)
        os.utime(log, ns=(seed, seed))
        add_logs(full, find_logs([str(log)]))
    assert len(full.entries()) == 4
    assert len(list((full.path / "recordings").iterdir())) == 4
    assert full.entry_of(str(log)).rows == hash_of_rows(traffic(8))


def test_a_copy_counts_once_and_stays_when_one_is_forgotten(full, logs, tmp_path):
    total = summed(full)
    (tmp_path / "copy.mcap").write_bytes((logs / "0.mcap").read_bytes())
    add_logs(full, find_logs([str(tmp_path / "copy.mcap")]))
    assert (len(full.entries()), summed(full)) == (4, total)
    full.forget(str(logs / "0.mcap"))
    assert summed(full) == total


def test_forgetting_leaves_what_never_adding_would(full, logs, tmp_path):
    without = Store.create(tmp_path / "without", StoreConfig())
    add_logs(without, find_logs([str(logs / "0.mcap"), str(logs / "2.mcap")]))
    full.forget(str(logs / "1.mcap"))
    assert files(full) == files(without)
    with pytest.raises(ValueError, match=r"1.mcap: is not in the store"):
        full.forget(str(logs / "1.mcap"))


def test_stores_merge_to_what_one_would_be(full, logs, tmp_path):
    halves = [Store.create(tmp_path / name, StoreConfig()) for name in "ab"]
    for half, numbers in zip(halves, ([0, 1], [1, 2]), strict=True):
        add_logs(half, find_logs([str(logs / f"{number}.mcap") for number in numbers]))
    assert (halves[0].merge(halves[1]), halves[0].merge(halves[1])) == (1, 0)
    assert files(halves[0]) == files(full)
    other = Store.create(tmp_path / "c", StoreConfig(lattice=Lattice(square_m=2.0)))
    with pytest.raises(ValueError, match="expected lattice"):
        full.merge(other)


def test_another_frame_is_refused_and_the_rest_is_added(store, logs, tmp_path, monkeypatch):
    write_tracks(traffic(5), tmp_path / "other.mcap")

    def read(url, options):
        result = read_track_logs(url, options)
        return replace(result, frame="odom") if url.endswith("other.mcap") else result

    monkeypatch.setattr(adding, "read_track_logs", read)
    found = find_logs([str(logs / "0.mcap"), str(tmp_path / "other.mcap"), str(logs / "1.mcap")])
    added = add_logs(store, sorted(found, key=lambda log: log.url != str(logs / "0.mcap")))
    (line,) = failures(added)
    assert f"{tmp_path / 'other.mcap'}: expected positions in frame 'map'" in line
    assert [entry.url for entry in store.entries()] == [str(logs / "0.mcap"), str(logs / "1.mcap")]


def test_a_log_that_cannot_be_read_does_not_stop_the_others(store, logs, tmp_path):
    (tmp_path / "broken.mcap").write_text("no log")
    added = add_logs(store, find_logs([str(tmp_path / "broken.mcap"), str(logs / "*.mcap")]))
    assert [line.partition(":")[0] for line in failures(added)] == [str(tmp_path / "broken.mcap")]
    assert len(store.entries()) == 3


def test_a_crash_leaves_nothing_that_counts(store, logs, monkeypatch):
    real = store_module.write_summary

    def half(summary, file):
        file.write(b"PAR1 half of it")
        raise KeyboardInterrupt

    monkeypatch.setattr(store_module, "write_summary", half)
    with pytest.raises(KeyboardInterrupt):
        add_logs(store, find_logs([str(logs / "0.mcap")]))
    assert not any((store.path / "recordings").iterdir())
    mine, theirs = (
        store.path / "recordings" / f".{os.uname().nodename}-{number}-x.part" for number in (os.getpid(), 2**22 + 1)
    )
    mine.touch(), theirs.touch()
    monkeypatch.setattr(store_module, "write_summary", real)
    add_logs(store, find_logs([str(logs / "0.mcap")]))
    assert mine.exists()
    assert not theirs.exists()
    assert len(store.entries()) == 1


def test_a_summary_comes_back_from_its_file(tmp_path):
    summary = Summary.of(traffic(1), frame="odom")
    for name in ("one", "other"):
        with (tmp_path / name).open("wb") as file:
            table.write_summary(summary, file)
    assert table.read_summary(tmp_path / "one") == summary
    written = (tmp_path / "one").read_bytes()
    assert written == (tmp_path / "other").read_bytes()
    for broken in (b"", written[:-20], written[:400] + b"xxxx" + written[404:], b"no table"):
        (tmp_path / "broken").write_bytes(broken)
        with pytest.raises(RecordingError, match=r"broken: expected statistics of a recording"):
            table.read_summary(tmp_path / "broken")


def test_another_tool_counts_the_same(full):
    duckdb = pytest.importorskip("duckdb")
    rows = f"read_parquet('{full.path}/recordings/*.parquet')"
    found = duckdb.sql(
        f"SELECT sum(begins), sum(count), sum(sum_east), sum(sum_speed) FROM {rows} WHERE kind = 'step'"  # noqa: S608
    ).fetchall()[0]
    steps = summed(full).steps
    assert found == (np.sum(steps.value[steps.key[:, 1] == NONE, 0]), *steps.value[:, [0, 1, 4]].sum(axis=0))


@pytest.mark.parametrize(
    ("file", "text"),
    [("store.json", "{}"), ("store.json", "[1]"), ("store.json", '{"config": {}, "format": 9}'), ("logs/x.json", "[]"),
     ("frame.json", "{}"), ("frame.json", ""),
     ("logs/x.json", '{"url": 3}')],
)  # fmt: skip
def test_damaged_files_of_a_store_are_named(full, file, text):
    (full.path / file).write_text(text)
    with pytest.raises(RecordingError, match=file):
        _ = Store.open(full.path).entries(), Store.open(full.path).frame


def test_an_entry_names_no_file_outside_of_the_store(full):
    entry = full.entries()[0]
    path = full.path / "logs" / entry.name_of(entry.url)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"rows": "../../x"}))
    with pytest.raises(RecordingError, match="expected the hash of a recording"):
        full.entries()


def test_what_finds_nothing_is_said(tmp_path):
    for pattern, match in (("*.mcap", "expected logs, found none"), ("-", "expected a file or a URL")):
        with pytest.raises(RecordingError, match=match):
            find_logs([pattern if pattern == "-" else str(tmp_path / pattern)])
    with pytest.raises(FileNotFoundError):
        find_logs([str(tmp_path / "absent.mcap")])
    with pytest.raises(RecordingError, match="expected a store, found none"):
        Store.open(tmp_path / "absent")
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="expected a store or an empty folder"):
        Store.create(tmp_path, StoreConfig())


def test_urls_are_known_by_what_their_file_system_says(store, logs):
    pytest.importorskip("fsspec")
    found = find_logs([f"file://{logs}/*.mcap"])
    assert [log.size for log in found] == [(logs / f"{i}.mcap").stat().st_size for i in range(3)]
    assert all(log.url.startswith("file://") and log.mark for log in found)
    add_logs(store, found[:1])
    assert add_logs(store, found[:1]).known == 1
    assert store.entry_of(found[0].url).rows == hash_of_rows(traffic(0))


def test_logs_of_an_object_store_are_added_by_pattern_and_known_by_their_etags(
    object_store, store, logs, tmp_path, monkeypatch
):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(partial_copy, "SHORT_BYTES", 0)  # no log is short: all come by their ranges of bytes
    for i in range(2):
        object_store.put_file(str(logs / f"{i}.mcap"), f"bucket/day{i}/log.mcap")
    pattern = "s3://bucket/**/*.mcap"
    added = add_logs(store, find_logs([pattern]))
    assert [entry.url for entry in store.entries()] == [f"s3://bucket/day{i}/log.mcap" for i in range(2)]
    assert not list(failures(added))
    assert summed(store) == Summary.total([Summary.of(traffic(i), frame=store.frame) for i in range(2)])
    object_store.put_file(str(logs / "2.mcap"), "bucket/day1/log.mcap")
    changed = add_logs(store, find_logs([pattern]))
    assert (changed.known, list(failures(changed))) == (1, [])
    assert store.entry_of("s3://bucket/day1/log.mcap").rows == hash_of_rows(traffic(2))
    assert not source._copies
    assert not list(tmp_path.glob("dirprim-*"))


def test_without_an_extra_one_line_says_which(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dirprim-filter\[fleet\]'"):
        list(LocalWorkers(2).each(str, [1]))
    assert isinstance(workers.workers_for(3, None), workers.InProcess)
    assert isinstance(workers.workers_for(3, 2), LocalWorkers)


def test_a_killed_worker_loses_nothing(tmp_path):
    pytest.importorskip("distributed")
    tasks = [(tmp_path / "killed", number) for number in range(4)]
    shared = np.arange(100)  # is lost with the one worker that has it
    assert sorted(LocalWorkers(1).each(once_killed, tasks, shared)) == [4950 + number for number in range(4)]
    assert (tmp_path / "killed").exists()


class DyingScheduler:
    """Workers whose scheduler dies after one task, or after all but before the client hears of them."""

    in_process = False

    def __init__(self, *, after_all):
        self.after_all = after_all

    def each(self, work, tasks):
        done = work(tasks[0])
        if self.after_all:
            for task in tasks[1:]:
                work(task)
        else:
            yield done
        raise ConnectionError("the scheduler died")


@pytest.mark.parametrize("after_all", [False, True])
def test_after_the_scheduler_died_no_finished_log_is_opened_again(full, logs, opened, after_all):
    whole, found = files(full), find_logs([str(logs / "*.mcap")])
    for log in found:
        full.forget(log.url)
    with pytest.raises(ConnectionError):
        add_logs(full, found, workers=DyingScheduler(after_all=after_all))
    done = {entry.url for entry in full.entries()}
    assert len(done) == (3 if after_all else 1)
    opened.clear()
    assert add_logs(full, found).known == len(done)
    assert set(opened) == {log.url for log in found} - done
    assert files(full) == whole


def test_a_task_that_is_done_again_opens_no_log_that_it_finished(full, logs, opened):
    """Controls: another version of the log, a log without a mark, and one whose recording is gone are read again."""
    frame = full.frame
    full.forget(str(logs / "0.mcap"))
    (log,) = find_logs([str(logs / "0.mcap")])
    first = adding.summarise_log(log, store=full, frame=frame)
    assert opened == [log.url]
    assert adding.summarise_log(log, store=full, frame=frame) == first
    assert opened == [log.url]
    later, unmarked = replace(log, mark="later"), replace(log, mark="")
    assert adding.summarise_log(later, store=full, frame=frame).entry == replace(first.entry, mark="later")
    for _ in range(2):
        assert adding.summarise_log(unmarked, store=full, frame=frame).entry.mark == ""
    assert opened == [log.url] * 4
    adding.summarise_log(log, store=full, frame=frame)
    full.recording(first.entry.rows).unlink()
    assert adding.summarise_log(log, store=full, frame=frame) == first
    assert opened == [log.url] * 6
    assert full.recording(first.entry.rows).exists()


def test_logs_that_changed_leave_nothing_of_what_they_were_though_a_later_one_cannot_be_asked_for(full, tmp_path):
    """The recording of a log before is removed at the end, whatever ends it; one that others hold stays."""
    log, copy = tmp_path / "log.mcap", tmp_path / "copy.mcap"
    write_tracks(traffic(7), log)
    copy.write_bytes(log.read_bytes())
    add_logs(full, find_logs([str(log), str(copy)]))
    for path, seed in ((log, 8), (copy, 9)):
        write_tracks(traffic(seed), path, force=True)
        os.utime(path, ns=(seed, seed))
        with pytest.raises(ConnectionError):
            add_logs(full, find_logs([str(path)]), workers=DyingScheduler(after_all=False))
        assert full.recording(hash_of_rows(traffic(7))).exists() == (path == log)


def test_config_refuses_what_differs(store):
    with pytest.raises(ValueError, match="expected labels None, as its logs are counted, got car"):
        store.check_config(replace(store.config, labels="car"))
    assert Store.open(store.path) == store
