"""Vehicles that are drawn count for those that are not, and no street is drawn to nothing."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm
from streets import GRID, rows_stored, street

from dirprim_filter.store import keep, learn_from_store
from dirprim_filter.store.keeping import whole
from dirprim_filter.store.rows import StoredRows
from dirprim_filter.store.sampling import Recording, drawn, sample_of, turns_of

ERRORS = norm.isf(1e-4 / 2)
"""Standard errors: one test of ten thousand is further off by chance; seeds are fixed."""


def recordings_of(*tracks):
    return [Recording.of(rows.digest, rows) for rows in map(StoredRows.of, tracks)]


def counted(rows):
    """Vehicles by weight, and how many they are."""
    weight = rows.weight[rows.first]
    return weight.sum(), weight.size


def test_a_sample_counts_as_all_do_in_whatever_order_and_quiet_streets_are_whole():
    recordings = recordings_of(
        street(0, n_vehicles=2000, length=60.0), street(1, n_vehicles=50, length=60.0, north=500.0)
    )
    n_rows = sum(len(recording.rows) for recording in recordings)
    left = drawn(recordings, most_rows=n_rows // 4)
    assert sum(len(rows) for rows in left) <= n_rows // 4
    (busy, n_busy), quiet = sorted(map(counted, left), reverse=True)
    assert quiet == (50.0, 50)
    share = n_busy / busy
    assert abs(busy - 2000) < ERRORS * np.sqrt(2000 * (1 - share) / share)
    assert n_busy < 2000 / 4  # and by numbers alone the quiet street would be a fourth of itself: the control
    again = drawn(recordings[::-1], most_rows=n_rows // 4)
    assert [rows.digest for rows in again] == [rows.digest for rows in left]


def test_shares_are_kept_by_weights_and_not_by_numbers():
    """Four in five of a street drive on, the others turn off it: the sample has as many of either."""
    on, off = street(1, n_vehicles=800, back=0.0), street(2, n_vehicles=200, back=0.0)
    turn = np.clip(off.position[:, 0], 0.0, None)
    off = dataclasses.replace(off, position=np.column_stack([off.position[:, 0] - turn, off.position[:, 1] + turn]))
    left = drawn(recordings_of(on, off), most_rows=16_000)
    tracks, weight = sample_of(left, min_vehicles=1, ageing=None)
    end = np.array([tracks[tracks.vehicle == v].position[-1, 1] for v in range(tracks.n_tracks)])
    turned = end > 20.0
    share = weight[turned].sum() / weight.sum()
    error = ERRORS * np.sqrt(0.2 * 0.8 * (1 / turned.sum() + 1 / (~turned).sum()))
    assert abs(share - 0.2) < error
    assert abs(turned.mean() - 0.2) > error  # the negative control


def test_a_street_with_50_vehicles_beside_one_with_4000_keeps_its_density_within_its_standard_error(tmp_path):
    busy, quiet = street(1, n_vehicles=4000, length=60.0), street(2, n_vehicles=50, north=500.0, length=60.0)
    store = rows_stored(tmp_path / "store", busy=busy, quiet=quiet, later=street(3, day=40))
    before = learn_from_store(store, **GRID | {"cell_size": 32.0}).primitive_map
    (month,) = keep(store, n_vehicles=100)
    assert (month.month, month.n_before) == ("1970-01", 4050)
    assert month.n_after < 800
    after = learn_from_store(store, **GRID | {"cell_size": 32.0}).primitive_map
    rows = {entry.log: whole(store, entry) for entry in store.contents().entries.values()}
    assert counted(rows["quiet"]) == (50.0, 50)
    for name, seen, errors in (("quiet", quiet, 1.0), ("busy", busy, ERRORS)):  # of the one all is left, it weighs 1
        density = [m.log_density(seen.position, seen.direction, seen.speed) for m in (before, after)]
        of_vehicle = np.bincount(seen.vehicle, density[0]) / np.bincount(seen.vehicle)
        error = of_vehicle.std() / np.sqrt(counted(rows[name])[1])
        assert abs((density[1] - density[0]).mean()) < errors * error
    keep(store, n_vehicles=25)  # by what is left
    for name, n in (("busy", 4000), ("quiet", 50)):
        by_weight, number = counted(whole(store, store.contents().entries[name]))
        assert number < rows[name].first.size
        assert abs(by_weight - n) < ERRORS * n / np.sqrt(number)


def test_logs_of_which_nothing_is_kept_stay_known(tmp_path):
    one = {f"one{i}": street(i, n_vehicles=1, back=0.0) for i in range(12)}
    store = rows_stored(tmp_path / "store", **one, last=street(50, day=40))
    keep(store, n_vehicles=1)
    entries = store.contents().entries
    assert entries.keys() == {*one, "last"}
    assert not turns_of(whole(store, min(entries.values(), key=lambda entry: entry.n_rows))).size
    with pytest.raises(ValueError, match="20 vehicles passed the same way"):
        learn_from_store(store, min_vehicles=20, **GRID)
