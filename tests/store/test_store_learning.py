"""Maps of stores: of the same rows the same, whoever learns them and however often, and never of what was forgotten."""

from collections import Counter
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from streets import GRID, bytes_of, logs_of, store_of, street

from dirprim_filter import Tracks, learn_primitives, write_tracks
from dirprim_filter.store import learn_from_store
from dirprim_filter.store.blocks import Block
from dirprim_filter.store.forgetting import forget
from dirprim_filter.store.keeping import whole
from dirprim_filter.store.sampling import Ageing, Hours
from dirprim_filter.store.store import Store

LONG = {"start": -700.0, "length": 1400.0}
"""A street across three blocks."""


@pytest.fixture(scope="module")
def long_street(tmp_path_factory):
    """A store of a street across three blocks, its logs, and another log of it."""
    folder = tmp_path_factory.mktemp("long")
    logs = logs_of(folder, **{f"log{seed}": street(seed, **LONG, n_vehicles=8) for seed in range(3)})
    return store_of(folder / "store", *logs.values()), logs, street(9, **LONG, n_vehicles=8)


def test_a_store_of_one_block_is_learned_as_its_rows_are(tmp_path):
    store = store_of(tmp_path / "store", *logs_of(tmp_path, a=street(1), b=street(2)).values())
    entries = store.contents().recordings()
    parts = []
    for number, entry in enumerate(entries):
        rows = whole(store, entry)
        parts.append(rows.tracks(rows.track + 100 * number, np.full(len(rows), number)))
    learned = learn_primitives(Tracks.concatenate(parts), rng=np.random.default_rng(0), **GRID)
    assert bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path) == bytes_of(learned, tmp_path)


def test_what_is_stored_is_what_the_log_says_but_for_rounding(tmp_path):
    said = street(1)
    store = store_of(tmp_path / "store", *logs_of(tmp_path, a=said).values())
    rows = whole(store, store.contents().recordings()[0])
    stored = rows.tracks(rows.track, rows.group)
    assert (stored.time_ns == said.time_ns).all()
    assert np.abs(stored.position - said.position).max() <= 0.0201
    assert np.abs(np.angle(np.exp(1j * (stored.direction - said.direction)))).max() <= np.radians(0.126)
    assert np.abs(stored.speed - said.speed).max() <= 0.051


def test_a_map_of_several_blocks_is_as_good_as_one_of_all_rows(long_street):
    store, _, held_out = long_street
    found = learn_from_store(store, **GRID)
    assert found.n_blocks == 3
    joined = found.primitive_map
    parts = []
    for number, entry in enumerate(store.contents().recordings()):
        rows = whole(store, entry)
        parts.append(rows.tracks(rows.track + 100 * number, np.full(len(rows), number)))
    at_once = learn_primitives(Tracks.concatenate(parts), rng=np.random.default_rng(0), **GRID)
    seen = (held_out.position, held_out.direction, held_out.speed)
    apart = (joined.log_density(*seen) - at_once.log_density(*seen)).mean()
    assert abs(apart) < 0.05
    assert joined.tessellation.n_cells == at_once.tessellation.n_cells
    motion = joined.motion
    source, target = np.repeat(motion.cell, np.diff(motion.first)), motion.cell[motion.following]
    block = np.floor(joined.tessellation.centers[:, 0] / 1024.0 + 0.5)
    crossing = (source >= 0) & (target >= 0) & (block[source] != block[target])
    assert motion.count[crossing].sum() == pytest.approx(2 * 24)  # two borders, each vehicle over both


def test_nothing_is_learned_twice_and_an_update_is_what_learning_anew_would_be(long_street, tmp_path):
    _, logs, _ = long_street
    local = logs_of(tmp_path, near=street(7, start=-50.0))
    store = store_of(tmp_path / "store", *logs.values())
    before = learn_from_store(store, **GRID)
    assert (before.n_fitted, learn_from_store(store, **GRID).n_fitted) == (3, 0)
    store_of(store.path, local["near"])
    updated = learn_from_store(store, **GRID)
    assert updated.n_fitted == 1
    anew = store_of(tmp_path / "anew", local["near"], *logs.values())
    assert bytes_of(updated.primitive_map, tmp_path) == bytes_of(learn_from_store(anew, **GRID).primitive_map, tmp_path)
    forget(store, [local["near"]])
    after = learn_from_store(store, **GRID)
    assert after.n_fitted == 1  # what was learned from a log goes with it
    assert bytes_of(after.primitive_map, tmp_path) == bytes_of(before.primitive_map, tmp_path)
    assert after.digest == before.digest != updated.digest
    assert bytes_of(updated.primitive_map, tmp_path) != bytes_of(before.primitive_map, tmp_path)


def test_a_fit_that_is_damaged_is_made_again(long_street, tmp_path):
    store = store_of(tmp_path / "store", *long_street[1].values())
    before = bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path)
    for path in (tmp_path / "store" / "_fits").rglob("*.mcap"):
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    again = learn_from_store(store, **GRID)
    assert again.n_fitted == 3
    assert bytes_of(again.primitive_map, tmp_path) == before


def test_a_copy_of_a_log_counts_once_and_stays_when_the_log_goes(tmp_path):
    path = logs_of(tmp_path, a=street(1), copy=street(1), b=street(2))
    store = store_of(tmp_path / "store", path["a"], path["b"])
    once = bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path)
    store_of(store.path, path["copy"])
    assert bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path) == once
    forget(store, [path["a"]])
    assert bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path) == once


def test_rows_are_read_once_and_those_near_borders_twice(tmp_path):
    path = logs_of(tmp_path, **{f"km{km}": street(km, start=-300.0, length=1000.0 * km) for km in (1, 4)})
    store, read = store_of(tmp_path / "store", *path.values()), Counter()

    def counting(store, file, reads=Store.read):
        read[file.log] += file.n_rows
        return reads(store, file)

    with patch.object(Store, "read", counting):
        learn_from_store(store, **GRID)
    for log, entry in store.contents().entries.items():
        assert read[log] <= 1.2 * entry.n_rows


def test_a_log_may_be_forgotten_while_it_is_learned_from(long_street, tmp_path):
    path = dict(long_street[1])
    store, first = store_of(tmp_path / "store", *path.values()), []

    def forgetting(store, file, reads=Store.read):
        if not first:
            first.append(file.log)
            forget(store, [file.log])
        return reads(store, file)

    with patch.object(Store, "read", forgetting):
        found = learn_from_store(store, **GRID)
    others = store_of(tmp_path / "others", *(log for log in path.values() if log not in first))
    assert bytes_of(found.primitive_map, tmp_path) == bytes_of(learn_from_store(others, **GRID).primitive_map, tmp_path)


def test_places_of_few_vehicles_are_left_out(tmp_path):
    path = logs_of(tmp_path, a=street(1, n_vehicles=8, back=0.0), quiet=street(2, north=200.0, n_vehicles=2, back=0.0))
    store = store_of(tmp_path / "store", *path.values())
    everywhere = learn_from_store(store, **GRID).primitive_map
    supported = learn_from_store(store, min_vehicles=3, **GRID).primitive_map
    at = np.array([[0.0, 0.0], [0.0, 200.0]])
    assert (everywhere.tessellation.cell_of(at) >= 0).all()
    assert (supported.tessellation.cell_of(at) >= 0).tolist() == [True, False]
    with pytest.raises(ValueError, match="20 vehicles passed the same way"):
        learn_from_store(store, min_vehicles=20, **GRID)


@pytest.mark.parametrize(("hours", "days"), [("23-2", "ab"), ("2-23", "c"), ("0-24", "abc"), ("5-5", "abc")])
def test_a_map_of_some_hours_is_that_of_the_logs_of_these_hours(tmp_path, hours, days):
    """By the clocks of a zone: in Kathmandu it is 5:45 later, so that the first log comes at 23:45."""
    path = logs_of(tmp_path, **{
        name: replace(of, time_ns=of.time_ns + hour * 3600 * 10**9)
        for name, hour, of in (("a", 18, street(1)), ("b", 20, street(2)), ("c", 30, street(3)))
    })  # fmt: skip
    store, alone = store_of(tmp_path / "all", *path.values()), store_of(tmp_path / "some", *(path[d] for d in days))
    of_hours = learn_from_store(store, hours=Hours.parse(hours, "Asia/Kathmandu"), **GRID).primitive_map
    assert bytes_of(of_hours, tmp_path) == bytes_of(learn_from_store(alone, **GRID).primitive_map, tmp_path)
    everything = bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path)
    assert (bytes_of(of_hours, tmp_path) == everything) == (days == "abc")


@pytest.mark.parametrize(("hours", "zone"), [("7", "UTC"), ("7-25", "UTC"), ("a-b", "UTC"), ("7-9", "../etc/passwd")])
def test_what_is_no_part_of_a_day_is_refused(hours, zone):
    with pytest.raises(ValueError, match="expected"):
        Hours.parse(hours, zone)


def test_older_vehicles_count_half_after_the_half_life(tmp_path):
    days = {f"day{day}": street(day, n_vehicles=20, back=0.0 if day < 20 else 1.0, day=day) for day in (0, 20)}
    store = store_of(tmp_path / "store", *logs_of(tmp_path, **days).values())
    at = np.array([0.0, 2.0])
    eastward = []
    for half_life_s in (None, 20 * 86_400.0, 5 * 86_400.0):
        found = learn_from_store(store, half_life_s=half_life_s, tessellation="grid", cell_size=64.0).primitive_map
        density = np.exp(found.direction_log_density(at, np.array([0.0, np.pi])))
        eastward.append(density[0] / density.sum())
    # Prior weights pull towards a half: within .1 of the shares by weights 1, 1/2 and 1/16.
    assert np.abs(np.array(eastward) - [0.5, 1 / 3, 1 / 17]).max() < 0.1
    with_now = learn_from_store(store, half_life_s=1e6, now_ns=0, **GRID).primitive_map
    assert bytes_of(with_now, tmp_path) == bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path)


def test_ages_are_of_half_lives():
    ageing = Ageing(half_life_s=10.0, now_ms=20_000)
    assert ageing.weight(np.array([20_000, 10_000, 0, 99_000])) == pytest.approx([1.0, 0.5, 0.25, 1.0])


def test_blocks_have_names_and_the_origin_in_their_middle():
    assert Block.parse(str(Block(-3, 12))) == Block(-3, 12)
    assert Block(0, 0).holds(np.array([[-511.0, 511.0], [0.0, 513.0]])).tolist() == [True, False]
    for wrong in ("", "1", "a_b", "1_2_3", "../x"):
        with pytest.raises(ValueError, match="expected a name"):
            Block.parse(wrong)


def test_what_cannot_be_learned_is_said(tmp_path, long_street):
    store, _, _ = long_street
    with pytest.raises(ValueError, match="give --cell-size"):
        learn_from_store(store, tessellation="grid", n_cells=10)
    with pytest.raises(ValueError, match="min_vehicles: expected at least 1"):
        learn_from_store(store, min_vehicles=0)
    write_tracks(street(1), tmp_path / "one.mcap")
    empty = store_of(tmp_path / "store", str(tmp_path / "one.mcap"))
    forget(empty, [str(tmp_path / "one.mcap")])
    with pytest.raises(ValueError, match="the store is empty"):
        learn_from_store(empty, **GRID)
