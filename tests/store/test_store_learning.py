"""Maps of stores: as good as those of all rows at once, by each row read once; of what counts by age and hour."""

from collections import Counter
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from streets import GRID, map_bytes, rows_stored, street

from dirprim_filter import Tracks, learn_primitives
from dirprim_filter.store import learn_from_store
from dirprim_filter.store.forgetting import forget
from dirprim_filter.store.keeping import whole
from dirprim_filter.store.sampling import Ageing, Hours
from dirprim_filter.store.store import Store

LONG = {"start": -700.0, "length": 1400.0, "n_vehicles": 6}
"""A street across three blocks."""
THREE = {f"log{seed}": street(seed, **LONG) for seed in range(3)}


def at_once(store):
    """What `learn_primitives` learns of all rows."""
    parts = []
    for number, entry in enumerate(store.contents().recordings()):
        rows = whole(store, entry)
        parts.append(rows.tracks(rows.track + 100 * number, np.full(len(rows), number)))
    return learn_primitives(Tracks.concatenate(parts), rng=np.random.default_rng(0), **GRID)


def test_a_map_of_several_blocks_is_as_good_as_one_of_all_rows(tmp_path):
    store, held_out = rows_stored(tmp_path / "store", **THREE), street(9, **LONG)
    found = learn_from_store(store, **GRID)
    assert found.n_blocks == 3
    joined, whole_map = found.primitive_map, at_once(store)
    seen = (held_out.position, held_out.direction, held_out.speed)
    assert abs((joined.log_density(*seen) - whole_map.log_density(*seen)).mean()) < 0.05
    assert joined.tessellation.n_cells == whole_map.tessellation.n_cells
    motion = joined.motion
    source, target = np.repeat(motion.cell, np.diff(motion.first)), motion.cell[motion.following]
    block = np.floor(joined.tessellation.centers[:, 0] / 1024.0 + 0.5)
    crossing = (source >= 0) & (target >= 0) & (block[source] != block[target])
    assert motion.count[crossing].sum() == pytest.approx(2 * 18)  # two borders, each vehicle over both
    one_block = rows_stored(tmp_path / "one", a=street(1), b=street(2))
    learned, alone = learn_from_store(one_block, **GRID).primitive_map, at_once(one_block)
    assert all(np.array_equal(m.log_density(*seen), alone.log_density(*seen)) for m in (learned, alone))


def test_only_blocks_that_changed_or_whose_fit_is_damaged_are_learned_again(tmp_path):
    store = rows_stored(tmp_path / "store", log0=THREE["log0"])
    assert [learn_from_store(store, **GRID).n_fitted for _ in range(2)] == [3, 0]
    before = learn_from_store(store, **GRID).digest
    rows_stored(store.path, near=street(7, start=-50.0))
    updated = learn_from_store(store, **GRID)
    assert updated.n_fitted == 1
    forget(store, ["near"])
    after = learn_from_store(store, **GRID)
    assert after.n_fitted == 1  # what was learned from a log goes with it
    assert after.digest == before != updated.digest
    expected = map_bytes(store, tmp_path)
    for path in (tmp_path / "store" / "_fits").rglob("*.arrow"):
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    assert learn_from_store(store, **GRID).n_fitted == 3
    assert map_bytes(store, tmp_path) == expected


def test_rows_are_read_once_and_those_near_borders_twice_and_a_log_may_be_forgotten_meanwhile(tmp_path):
    km = {f"km{km}": street(km, start=-300.0, length=1000.0 * km, n_vehicles=2) for km in (1, 2, 3)}
    store, read = rows_stored(tmp_path / "store", **km), Counter()

    def counting(store, file, reads=Store.read):
        read[file.log] += file.n_rows
        return reads(store, file)

    with patch.object(Store, "read", counting):
        learn_from_store(store, **GRID)
    for log, entry in store.contents().entries.items():
        assert entry.n_rows <= read[log] <= 1.2 * entry.n_rows

    def forgetting(store, file, reads=Store.read):
        if "km2" in store.contents().entries:
            forget(store, ["km2"])
        return reads(store, file)

    options = {"cell_size": 80.0}  # which nothing is learned with yet
    with patch.object(Store, "read", forgetting):
        meanwhile = learn_from_store(store, **GRID | options)
    assert (meanwhile.n_logs, meanwhile.damaged) == (2, [])
    others = rows_stored(tmp_path / "others", km1=km["km1"], km3=km["km3"])
    assert meanwhile.digest == learn_from_store(others, **GRID | options).digest
    assert map_bytes(store, tmp_path, **options) == map_bytes(others, tmp_path, **options)


def test_places_of_few_vehicles_are_left_out_and_what_cannot_be_learned_is_said(tmp_path):
    few = street(2, north=200.0, n_vehicles=2, back=0.0)
    store = rows_stored(tmp_path / "store", a=street(1, n_vehicles=8, back=0.0), quiet=few)
    maps = [learn_from_store(store, min_vehicles=n, **GRID).primitive_map for n in (1, 3)]
    at = np.array([[0.0, 0.0], [0.0, 200.0]])
    assert [(m.tessellation.cell_of(at) >= 0).tolist() for m in maps] == [[True, True], [True, False]]
    store = rows_stored(tmp_path / "store", **THREE)
    for options, because in (
        ({"tessellation": "grid", "n_cells": 10}, "give --cell-size"), ({"min_vehicles": 0}, "expected at least 1"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=because):
            learn_from_store(store, **options)
    with pytest.raises(ValueError, match="the store is empty"):
        learn_from_store(rows_stored(tmp_path / "empty"), **GRID)


@pytest.mark.parametrize(("hours", "days"), [("23-2", "ab"), ("2-23", "c"), ("0-24", "abc")])
def test_a_map_of_some_hours_is_that_of_the_logs_of_these_hours(tmp_path, hours, days):
    """By the clocks of a zone: in Kathmandu it is 5:45 later, so that the first log comes at 23:45."""
    logs = {name: replace(of, time_ns=of.time_ns + hour * 3600 * 10**9)
            for name, hour, of in (("a", 18, street(1)), ("b", 20, street(2)), ("c", 30, street(3)))}  # fmt: skip
    store, alone = rows_stored(tmp_path / "all", **logs), rows_stored(tmp_path / "some", **{d: logs[d] for d in days})
    of_hours = map_bytes(store, tmp_path, hours=Hours.parse(hours, "Asia/Kathmandu"))
    assert of_hours == map_bytes(alone, tmp_path)
    assert (of_hours == map_bytes(store, tmp_path)) == (days == "abc")


@pytest.mark.parametrize(
    ("hours", "zone"), [("7", "UTC"), ("7-25", "UTC"), ("5-5", "UTC"), ("a-b", "UTC"), ("7-9", "../etc/passwd")]
)
def test_what_is_no_part_of_a_day_is_refused(hours, zone):
    with pytest.raises(ValueError, match="expected"):
        Hours.parse(hours, zone)


def test_older_vehicles_count_half_after_the_half_life(tmp_path):
    days = {f"day{day}": street(day, n_vehicles=20, back=0.0 if day < 20 else 1.0, day=day) for day in (0, 20)}
    store = rows_stored(tmp_path / "store", **days)
    at = np.array([0.0, 2.0])
    eastward = []
    for half_life_s in (None, 20 * 86_400.0, 5 * 86_400.0):
        found = learn_from_store(store, half_life_s=half_life_s, tessellation="grid", cell_size=64.0).primitive_map
        density = np.exp(found.direction_log_density(at, np.array([0.0, np.pi])))
        eastward.append(density[0] / density.sum())
    # Prior weights pull towards a half: within .1 of the shares by weights 1, 1/2 and 1/16.
    assert np.abs(np.array(eastward) - [0.5, 1 / 3, 1 / 17]).max() < 0.1
    assert map_bytes(store, tmp_path, half_life_s=1e6, now_ns=0) == map_bytes(store, tmp_path)
    ageing = Ageing(half_life_s=10.0, now_ms=20_000)
    assert ageing.weight(np.array([20_000, 10_000, 0, 99_000])) == pytest.approx([1.0, 0.5, 0.25, 1.0])
