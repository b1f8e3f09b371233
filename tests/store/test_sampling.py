"""Vehicles that are drawn count for those that are not, and no street is drawn to nothing."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm
from streets import logs_of, store_of, street

from dirprim_filter.store import keep, learn_from_store
from dirprim_filter.store.keeping import whole
from dirprim_filter.store.rows import Rows
from dirprim_filter.store.sampling import Recording, drawn, sample_of, turns_in

FALSE_ALARM = 1e-4
"""Of each statistical test, with seeds that are fixed."""


def crowd(n_busy, n_quiet, seed=0):
    """Rows of two streets 500 m apart, in recordings of a hundred vehicles."""
    busy = street(seed, n_vehicles=n_busy, length=60.0, back=0.3)
    quiet = street(seed + 1, n_vehicles=n_quiet, length=60.0, north=500.0, back=0.3)
    return [Recording(rows.digest, rows) for rows in map(Rows.of, (busy, quiet))]


def counted(recordings):
    """Vehicles by weight, of the busy and of the quiet street, and how many they are."""
    found = []
    for low, high in ((-100.0, 250.0), (250.0, 1000.0)):
        weights = [
            recording.rows.weight[recording.rows.first]
            for recording in recordings
            if len(recording.rows) and low < recording.rows.position[0, 1] < high
        ]
        found.append((sum(w.sum() for w in weights), sum(w.size for w in weights)))
    return found


def test_a_sample_counts_as_all_do_and_quiet_streets_are_whole():
    recordings = crowd(2000, 50)
    n_rows = sum(len(recording.rows) for recording in recordings)
    left, n_vehicles = drawn(recordings, most_rows=n_rows // 4)
    assert n_vehicles == 2050
    assert sum(len(recording.rows) for recording in left) <= n_rows // 4
    (busy, n_busy), quiet = counted(left)
    assert quiet == (pytest.approx(50.0), 50)
    share = n_busy / busy
    assert abs(busy - 2000) < norm.isf(FALSE_ALARM / 2) * np.sqrt(2000 * (1 - share) / share)
    assert n_busy < 2000 / 4  # and by numbers alone the quiet street would be a fourth of all: the control


def test_a_sample_does_not_depend_on_order():
    recordings = crowd(300, 20)
    one, other = (drawn(each, most_rows=4000)[0] for each in (recordings, recordings[::-1]))
    assert [r.name for r in one] == [r.name for r in other]
    assert all(a.rows.digest == b.rows.digest for a, b in zip(one, other, strict=True))


def test_shares_are_kept_by_weights_and_not_by_numbers():
    """Four in five of a street drive on, the others turn off it: the sample has as many of either."""
    on, off = street(1, n_vehicles=800, back=0.0), street(2, n_vehicles=200, back=0.0)
    turn = np.clip(off.position[:, 0], 0.0, None)
    off = dataclasses.replace(off, position=np.column_stack([off.position[:, 0] - turn, off.position[:, 1] + turn]))
    recordings = [Recording(rows.digest, rows) for rows in map(Rows.of, (on, off))]
    left, _ = drawn(recordings, most_rows=16_000)
    sample = sample_of(left, 1000, min_vehicles=1, ageing=None)
    end = np.array([sample.tracks[sample.tracks.vehicle == v].position[-1, 1] for v in range(sample.tracks.n_tracks)])
    turned = end > 20.0
    share = sample.weight[turned].sum() / sample.weight.sum()
    error = norm.isf(FALSE_ALARM / 2) * np.sqrt(0.2 * 0.8 * (1 / turned.sum() + 1 / (~turned).sum()))
    assert abs(share - 0.2) < error
    assert abs(turned.mean() - 0.2) > error  # the negative control


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A store of a busy street and a quiet one, the share that drives back on each, and a log of the next month."""
    folder = tmp_path_factory.mktemp("kept")
    busy, quiet = street(1, n_vehicles=1600, length=60.0), street(2, n_vehicles=50, north=500.0, length=60.0)
    path = logs_of(folder, busy=busy, quiet=quiet, later=street(3, day=40))
    store = store_of(folder / "store", *path.values())
    before = learn_from_store(store, tessellation="grid", cell_size=64.0).primitive_map
    return store, keep(store, n_vehicles=100), before


def test_a_quiet_street_keeps_its_density_beside_a_busy_one(kept):
    store, months, before = kept
    assert [(each.month, each.n_before) for each in months] == [("1970-01", 1650)]
    assert months[0].n_after < 500
    rows = {entry.log.rsplit("/", 1)[1]: whole(store, entry) for entry in store.contents().entries.values()}
    assert rows["quiet.mcap"].first.size == 50
    assert rows["quiet.mcap"].weight.max() == 1.0
    after = learn_from_store(store, tessellation="grid", cell_size=64.0).primitive_map
    for north, n in ((2.0, 200), (502.0, 50)):
        share = []
        for learned in (before, after):
            of = learned.primitive_at(np.array([-30.0, north])).direction
            share.append(of.weight[np.abs(of.mean_direction) > 0.5 * np.pi].sum())
        assert abs(share[1] - share[0]) < norm.isf(FALSE_ALARM / 2) * np.sqrt(0.24 / n)
    assert (after.tessellation.cell_of(np.array([[-30.0, 2.0], [-30.0, 502.0]])) >= 0).all()


def test_to_keep_twice_is_to_keep_by_what_is_left(kept):
    store, _, _ = kept
    total = []
    for n_vehicles in (100, 25):
        keep(store, n_vehicles=n_vehicles)
        total.append(counted([Recording("", whole(store, e)) for e in store.contents().entries.values()]))
    (busy, n_busy), (quiet, n_quiet) = total[1]
    assert n_busy < 100
    assert n_quiet < 50
    assert abs(busy - 1605) < norm.isf(FALSE_ALARM / 2) * 1605 / np.sqrt(n_busy)
    assert abs(quiet - 50) < norm.isf(FALSE_ALARM / 2) * 50 / np.sqrt(n_quiet)


def test_logs_of_which_nothing_is_kept_stay_known_and_can_be_forgotten(tmp_path):
    one = {f"one{i}": street(i, n_vehicles=1, back=0.0) for i in range(12)}
    path = logs_of(tmp_path, **one, last=street(50, day=40))
    store = store_of(tmp_path / "store", *path.values())
    keep(store, n_vehicles=1)
    entries = store.contents().entries
    assert min(entry.n_rows for entry in entries.values()) == 0
    assert entries.keys() == set(path.values())
    assert turns_in(whole(store, next(e for e in entries.values() if not e.n_rows))) == {}
    learn_from_store(store, tessellation="grid", cell_size=32.0)
