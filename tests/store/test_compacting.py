"""Months that were made one: what is kept, that it is drawn evenly, what still counts, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from streets import summed

from dirprim_filter import write_tracks
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store import compacting, learn_from_summary
from dirprim_filter.store.adding import add_logs, failures
from dirprim_filter.store.compacting import compacted, month_of, thinned
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.folder import LocalFolder
from dirprim_filter.store.lattice import NONE
from dirprim_filter.store.log_files import find_logs
from dirprim_filter.store.pseudo_tracks import pseudo_tracks
from dirprim_filter.store.steps import BEFORE
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.table import read_summary
from dirprim_filter.store.updating import learn_from_store, update_map
from dirprim_filter.tracks import Tracks
from situations import ring_traffic

DAY_NS = 24 * 3600 * 10**9
ROWS = "5" * 64


def traffic(seed):
    made = ring_traffic(np.random.default_rng(seed), n_vehicles=8, n_rows=20)
    return replace(made, time_ns=made.time_ns + 20 * seed * DAY_NS)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Of 1 and 21 January, 10 February, 2 and 22 March 1970."""
    folder = tmp_path_factory.mktemp("logs")
    for seed in range(5):
        write_tracks(traffic(seed), folder / f"{seed}.mcap")
    return folder


@pytest.fixture
def full(logs, tmp_path):
    store = Store.create(tmp_path / "store", StoreConfig())
    add_logs(store, find_logs([str(logs / "*.mcap")]))
    return store


def files(store):
    return {str(path.relative_to(store.path)): path.read_bytes() for path in store.path.rglob("*") if path.is_file()}


def map_of(store, min_vehicles=1):
    return learn_from_summary(
        summed(store), min_vehicles=min_vehicles, tessellation="grid", cell_size=8.0,
        rng=np.random.default_rng(0),
    )  # fmt: skip


def test_months_that_are_over_are_made_one_each(full):
    made = compacted(full)
    assert [(archive.month, len(archive.recordings)) for archive in made] == [("1970-01", 2), ("1970-02", 1)]
    assert sorted(full.rows()) == sorted(path.stem for path in (full.path / "recordings").iterdir())
    assert len(full.rows()) == 4
    assert compacted(full) == []
    (march,) = compacted(full, before_ns=91 * DAY_NS)
    assert march.month == "1970-03"


def test_where_all_vehicles_are_kept_nearly_the_same_is_learned(full):
    """Steps are given back within a part of a degree and of a metre per second: some hundredths of a nat."""
    rows = Tracks.concatenate([replace(traffic(seed), time_ns=traffic(seed).time_ns + seed) for seed in range(5)])

    def density():
        return map_of(full).log_density(rows.position, rows.direction, rows.speed).mean()

    before = density()
    assert all(archive.share == 1.0 for archive in compacted(full, n_vehicles=1000))
    assert density() == pytest.approx(before, abs=0.05)
    assert all(archive.share < 1.0 for archive in compacted(full, before_ns=91 * DAY_NS, n_vehicles=1))
    assert density() < before - 0.05


def test_it_is_the_same_one_by_one_and_at_once_and_in_whatever_order_logs_came(full, logs, tmp_path):
    other = Store.create(tmp_path / "other", StoreConfig())
    for seed in (4, 2, 0, 3, 1):
        add_logs(other, find_logs([str(logs / f"{seed}.mcap")]))
    for day in (30, 60, 91):
        compacted(other, before_ns=day * DAY_NS, n_vehicles=2)
    compacted(full, before_ns=91 * DAY_NS, n_vehicles=2)
    assert files(other) == files(full)


def test_a_share_of_whole_vehicles_is_kept():
    summary = Summary.of(ring_traffic(np.random.default_rng(0), n_vehicles=200, n_rows=30))
    for share in (0.0, 0.1, 0.5, 1.0):
        some = thinned(summary, ROWS, share)
        begins = some.steps.value[some.steps.key[:, BEFORE] == NONE, 0].sum()
        assert begins == pytest.approx(200 * share, abs=2)
        if begins:
            assert pseudo_tracks(some.steps, summary.lattice)[0].n_tracks == begins
        assert some.passed == summary.passed
    assert thinned(summary, ROWS, 1.0).steps == summary.steps


def crossing(n):
    """Of n vehicles the first three tenths, in order of their names, go north from where all others go east."""
    t = np.arange(0.0, 6.0, 0.2)
    north = np.repeat(np.arange(n) < 0.3 * n, t.size)
    along = np.tile(8.0 * t, n)
    rng = np.random.default_rng(1)
    beside = np.repeat(rng.normal(0.0, 1.0, n), t.size)
    return Tracks(
        track_id=np.repeat(np.arange(n), t.size), time_ns=np.tile((t * 1e9).astype(np.int64), n),
        position=np.where(north[:, None], np.column_stack([beside, along]), np.column_stack([along, beside])),
        direction=np.where(north, np.pi / 2, 0.0), speed=np.full(north.size, 8.0),
    )  # fmt: skip


def share_going_north(summary):
    tracks, _ = pseudo_tracks(summary.steps, summary.lattice)
    return float(np.mean(tracks.direction[tracks.first_rows] > 0.8))


def test_who_is_kept_is_drawn_evenly():
    """A tenth of a thousand, in ten recordings: beyond four standard errors of a fair draw once in 16,000."""
    summary = Summary.of(crossing(1000))
    error = np.sqrt(0.3 * 0.7 / 100)
    found = [share_going_north(thinned(summary, f"{i:08x}{ROWS[8:]}", 0.1)) for i in range(10)]
    assert np.abs(np.array(found) - 0.3).max() < 4 * error
    made = crossing(1000)
    assert abs(share_going_north(Summary.of(made[made.track_id < 100])) - 0.3) > 4 * error


def turning(seed, n=150):
    """Of n vehicles that come from one place about four tenths, in no order, leave 24 m to the north of the others."""
    made = crossing(1000)
    made = made[made.track_id >= 1000 - n]
    goes = np.random.default_rng(seed).random(1000)[made.track_id] < 0.4
    north = np.where(goes, 3.0 * np.clip(made.position[:, 0] - 16.0, 0.0, 8.0), 0.0)
    return replace(made, position=made.position + np.column_stack([np.zeros(len(made)), north]))


def off_by(summary, i):
    """The share that leaves in the north, of a tenth that is kept, less that of all, in fair standard errors."""
    share, n = [], []
    for some in (summary, thinned(summary, f"{i * 197:08x}{ROWS[8:]}", 0.1)):
        tracks, _ = pseudo_tracks(some.steps, some.lattice)
        ends = np.append(tracks.first_rows[1:], len(tracks)) - 1
        share.append(np.mean(tracks.position[ends, 1] > 12.0))
        n.append(ends.size)
    return (share[1] - share[0]) / np.sqrt(share[0] * (1 - share[0]) / n[1])


def test_as_many_are_kept_of_each_turn(monkeypatch):
    """Their shares are nearer to those of all than a draw by chance would be; and so it is not by where they begin."""
    summaries = [Summary.of(turning(i)) for i in range(20)]
    assert np.sqrt(np.mean([off_by(summary, i) ** 2 for i, summary in enumerate(summaries)])) < 0.6
    monkeypatch.setattr(compacting, "_places", lambda key, begins, lattice: np.arange(np.count_nonzero(begins)))
    assert np.sqrt(np.mean([off_by(summary, i) ** 2 for i, summary in enumerate(summaries)])) > 0.8


def test_logs_of_archives_are_known_and_copies_of_them_count_once(full, logs, tmp_path):
    compacted(full, n_vehicles=2)
    before = full.digest
    assert add_logs(full, find_logs([str(logs / "*.mcap")])).known == 5
    copy = tmp_path / "copy.mcap"
    copy.write_bytes((logs / "0.mcap").read_bytes())
    assert not list(failures(add_logs(full, find_logs([str(copy)]))))
    assert full.digest == before
    assert sorted(full.rows()) == sorted(path.stem for path in (full.path / "recordings").iterdir())


def test_of_an_archive_nothing_is_taken_out_alone(full, logs, tmp_path):
    compacted(full, n_vehicles=2)
    before = files(full)
    with pytest.raises(ValueError, match=r"0\.mcap: `store compact` made one of 2 recordings of 1970-01"):
        full.forget(str(logs / "0.mcap"), str(logs / "4.mcap"))
    assert files(full) == before
    full.forget(*(str(logs / f"{seed}.mcap") for seed in (0, 1)))
    rest = Store.create(tmp_path / "rest", StoreConfig())
    add_logs(rest, find_logs([str(logs / f"{seed}.mcap") for seed in (2, 3, 4)]))
    compacted(rest, n_vehicles=2)
    assert files(full) == files(rest)


def test_another_version_of_an_archived_log_is_refused(full, logs, tmp_path):
    log = tmp_path / "day.mcap"
    log.write_bytes((logs / "0.mcap").read_bytes())
    store = Store.create(tmp_path / "one", StoreConfig())
    add_logs(store, find_logs([str(log)]))
    compacted(store, before_ns=40 * DAY_NS)
    before = store.digest
    log.write_bytes((logs / "1.mcap").read_bytes())
    (why,) = failures(add_logs(store, find_logs([str(log)])))
    assert "day.mcap: `store compact` made one of 1 recordings of 1970-01" in why
    assert store.digest == before


def test_what_is_killed_counts_once(full, monkeypatch):
    write = LocalFolder.write

    def killed_once_it_counts(folder, files):
        write(folder, files)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(LocalFolder, "write", killed_once_it_counts)
        with pytest.raises(KeyboardInterrupt):
            compacted(full, n_vehicles=2)
    (january,) = full.archives()
    assert not set(january.recordings) & set(full.rows())
    again = compacted(full, n_vehicles=2)
    assert [archive.month for archive in again] == ["1970-02"]
    assert sorted(full.rows()) == sorted(path.stem for path in (full.path / "recordings").iterdir())


def test_stores_with_archives_merge_unless_both_hold_the_same_otherwise(full, logs, tmp_path):
    compacted(full, n_vehicles=2)
    empty = Store.create(tmp_path / "empty", StoreConfig())
    assert empty.merge(full) == 5
    assert files(empty) == files(full)
    assert empty.merge(full) == 0
    single = Store.create(tmp_path / "single", StoreConfig())
    add_logs(single, find_logs([str(logs / "0.mcap")]))
    before = files(single)
    with pytest.raises(ValueError, match="holds 1970-01 in an archive with recordings that"):
        single.merge(full)
    assert files(single) == before
    digest = full.digest
    assert full.merge(single) == 0
    assert full.digest == digest


def test_a_map_is_updated_where_a_month_was_made_one(full):
    cells = map_of(full).tessellation
    learned = learn_from_store(full, min_vehicles=1, tessellation=cells, rng=np.random.default_rng(0))
    compacted(full, n_vehicles=2)
    done = update_map(learned, full)
    assert done.n_cells > 0
    assert update_map(done.primitive_map, full).n_cells == 0


def test_an_archive_that_is_damaged_is_named(full):
    compacted(full)
    path = next((full.path / "archives").iterdir())
    path.write_text('{"name": "../../passwd", "month": "1970-01", "share": 1.0, "recordings": [], "tiles": []}')
    with pytest.raises(RecordingError, match="expected an archive of a store, got recordings: expected hashes"):
        full.rows()


def test_fewer_than_one_vehicle_is_refused(full):
    with pytest.raises(ValueError, match="n_vehicles: expected at least 1, got 0"):
        compacted(full, n_vehicles=0)


def test_months_are_those_of_utc():
    assert [month_of(time_ns) for time_ns in (0, 31 * DAY_NS - 1, 31 * DAY_NS)] == ["1970-01", "1970-01", "1970-02"]


def test_an_archive_is_read_as_any_recording(full):
    (january, _) = compacted(full, n_vehicles=2)
    held = read_summary(full.recording(january.name))
    assert held.digest == january.name
    assert 0 < held.whens.value.sum() < 2 * 8 * 10
