"""Maps that age or turn with the hour, brought up to date: order does not show, and no place ages unseen."""

from dataclasses import replace

import numpy as np
import pytest
from streets import FAR_M, add, bytes_of, store_of, street

from dirprim_filter import Tracks, load_map, write_tracks
from dirprim_filter.primitives.motion import FLOATS
from dirprim_filter.primitives.schedule import HOUR_NS
from dirprim_filter.store import Fading, learn_from_store, update_map
from dirprim_filter.store.fading import LATEST, refreshed_manoeuvres
from dirprim_filter.store.passages import Passages

DAY_NS = 24 * HOUR_NS
HALF_LIFE_S = 2 * DAY_NS * 1e-9
CHOICES = {"by the hour": {"by": "hour"}, "half-life": {"fading": Fading(half_life_s=HALF_LIFE_S, now_ns=LATEST)}}


def days(seed, *numbers, north):
    """Three vehicles at seven in the morning, half as fast as three at noon."""
    parts = []
    for number in numbers:
        for hour, slower in ((7, 2), (12, 1)):
            one = street(seed + len(parts), north=north, n_vehicles=3)
            begin_ns = number * DAY_NS + hour * HOUR_NS
            parts.append(replace(one, time_ns=begin_ns + slower * one.time_ns, speed=one.speed / slower))
    return parts


LOGS = {
    "both": days(100, *range(4), north=0.0) + days(200, *range(4), north=FAR_M),
    "near": days(300, 6, north=0.0),
    "near again": days(400, 9, north=0.0),
    "far": days(500, 60, north=FAR_M),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("days")
    for name, parts in LOGS.items():
        write_tracks(Tracks.concatenate(parts), folder / f"{name}.mcap")
    return folder


@pytest.fixture(scope="module")
def maps(folder, tmp_path_factory):
    """By what they are learned, of the log of both streets."""
    store = store_of(tmp_path_factory.mktemp("of") / "both", folder, "both")
    return {
        name: learn_from_store(
            store, min_vehicles=2, tessellation="grid", cell_size=15.0,
            rng=np.random.default_rng(0), **choices,
        )
        for name, choices in CHOICES.items()
    }  # fmt: skip


@pytest.fixture
def store(folder, tmp_path):
    return store_of(tmp_path / "store", folder, "both")


def fitted_anew(m, store):
    """All of it, as if of no recording anything were known."""
    counted = replace(m.refit.counted, tile=np.empty((0, 2), np.int64), digest=np.empty(0, np.int64))
    done = update_map(replace(m, refit=replace(m.refit, counted=counted)), store)
    assert done.n_cells == m.tessellation.n_cells
    return done.primitive_map


def columns(m, *, far):
    """What cells of one of the streets hold, and their manoeuvres do."""
    own = (m.tessellation.centers[:, 1] > FAR_M / 2) == far
    placed = np.flatnonzero(np.append(own, False)[m.motion.cell])
    source = np.repeat(np.arange(len(m.motion)), np.diff(m.motion.first))
    there = m.direction.weight > 0
    there[:-1][~own] = there[-1] = False
    modes = [m.direction.weight, m.direction.mean_direction, m.direction.concentration, m.speed.shape, m.speed.rate]
    found = [column[there] for column in modes] + [m.n_rows[:-1][own], m.motion.count[np.isin(source, placed)]]
    found += [getattr(m.motion, name)[placed] for name in ("visits", "log_pace", "acceleration")]
    if m.schedule is not None:
        found += [column[:, there[:-1, : m.n_own_modes]] for column in (m.schedule.flow, m.schedule.pace)]
    return found


def are_same(one, other, *, far):
    return all(np.array_equal(a, b) for a, b in zip(columns(one, far=far), columns(other, far=far), strict=True))


@pytest.mark.parametrize("name", CHOICES)
def test_neither_order_nor_what_was_forgotten_shows(name, maps, store, folder, tmp_path):
    learned, other = maps[name], store_of(tmp_path / "other", folder, "both")
    learned_bytes = bytes_of(learned, saved := tmp_path / "map.mcap")
    for log in ("near again", "far", "near"):  # what was chosen is in the file
        add(other, folder, log)
        found = bytes_of(update_map(load_map(saved), other).primitive_map, saved)
    add(store, folder, "near", "near again", "far")
    at_once = update_map(learned, store).primitive_map
    assert bytes_of(at_once, tmp_path / "a.mcap") == bytes_of(fitted_anew(learned, store), tmp_path / "b.mcap") == found
    for log in ("near", "far", "near again"):
        store.forget(str(folder / f"{log}.mcap"))
    assert bytes_of(update_map(at_once, store).primitive_map, saved) == learned_bytes != found


def test_a_place_ages_only_as_it_is_seen_anew(maps, store, folder):
    """Of the far street there is a log of two months later: its old vehicles fade, those of the near one do not."""
    learned = maps["half-life"]
    add(store, folder, "far")
    updated = update_map(learned, store).primitive_map
    assert are_same(learned, updated, far=False)
    before, after = (m.n_rows[:-1][m.tessellation.centers[:, 1] > FAR_M / 2].sum() for m in (learned, updated))
    assert after < 0.4 * before  # six vehicles of the last day, where thirty had been
    steady = replace(learned.refit.counted, half_life_s=0.0)  # control: that fades by nothing
    whole = fitted_anew(replace(learned, refit=replace(learned.refit, counted=steady)), store)
    assert whole.n_rows.sum() > learned.n_rows.sum() > updated.n_rows.sum()


def test_what_is_later_than_now_is_left_out(maps, store, folder):
    """Control: without `--now` it is not."""
    counted = replace(maps["half-life"].refit.counted, now_ns=3 * DAY_NS, min_vehicles=1)
    m = replace(maps["half-life"], refit=replace(maps["half-life"].refit, counted=counted))
    before = fitted_anew(m, store)
    add(store, folder, "near")
    done = update_map(before, store)
    assert done.n_cells > 0
    assert are_same(before, done.primitive_map, far=False)
    latest = replace(before.refit, counted=replace(before.refit.counted, now_ns=LATEST))
    assert not are_same(before, update_map(replace(before, refit=latest), store).primitive_map, far=False)


def test_a_tile_turns_with_the_hour_by_its_own_vehicles(maps, store, folder):
    learned = maps["by the hour"]
    there = learned.direction.weight[:-1, : learned.n_own_modes] > 0
    there[:, -1] = False  # without standing
    assert np.median(learned.schedule.pace[7][there]) < 0.9
    assert np.median(learned.schedule.pace[12][there]) > 1.1
    add(store, folder, "near")
    updated = update_map(learned, store).primitive_map
    assert are_same(learned, updated, far=True)
    assert not are_same(learned, updated, far=False)
    assert np.array_equal(updated.refit.counted.slot_strength, learned.refit.counted.slot_strength)
    assert np.array_equal(updated.refit.counted.slot_share, learned.refit.counted.slot_share)


def forked(motion):
    """One cell with a mode of two manoeuvres of 60 visits each, and one of another."""
    rows = np.append(np.zeros(3, np.int64), np.arange(motion.n_placed, len(motion)))
    columns = {name: getattr(motion, name)[rows] for name in (*FLOATS, "mode")}
    free = np.full(rows.size - 3, -1)
    columns |= {"cell": np.append([0, 0, 0], free), "visits": np.append([60.0, 60.0, 9.0], np.zeros(free.size))}
    columns["mode"][:3] = 0, 0, 1
    return replace(
        motion, **columns, first=np.zeros(rows.size + 1, np.int64), following=np.empty(0, np.int64), count=np.empty(0)
    )


@pytest.mark.parametrize(("turned", "least", "most"), [(True, 0.0, 0.1), (False, 0.4, 0.6)])
def test_manoeuvres_of_a_mode_are_as_frequent_as_they_are_now(maps, turned, least, most):
    """Of twenty days, six vehicles each: in the last ten all take the second, or as before every other."""
    motion, day = forked(maps["half-life"].motion), np.repeat(np.arange(20), 6)
    manoeuvre = np.where(turned & (day >= 10), 1, np.arange(120) % 2)
    fading = Fading(half_life_s=5 * DAY_NS * 1e-9, now_ns=20 * DAY_NS)
    found = refreshed_manoeuvres(motion, manoeuvre, np.arange(120), day * 24, fading)
    assert least <= found.visits[0] / found.visits[:2].sum() <= most
    np.testing.assert_allclose(found.visits[:2].sum(), 120.0)
    np.testing.assert_array_equal(found.visits[2:], motion.visits[2:])
    np.testing.assert_allclose(found.seconds[:2].sum(), motion.seconds[:2].sum())


def test_who_goes_on_where_fewer_are_left_stands_for_those_who_are_not():
    """Eight ways are left in one place, every other of them in the next, and all in the one after that."""
    parts = [
        Passages(way, *np.full((2, way.size), 10**8 * i), np.full(way.size, i), np.full(way.size, share))
        for i, (way, share) in enumerate(((np.arange(8), 0.5), (np.arange(0, 8, 2), 0.25), (np.arange(8), 0.5)))
    ]
    counted = Passages.together(parts).followed().counted(3, 4)
    assert counted.toarray().tolist() == [[0.0, 8.0, 0.0], [0.0, 0.0, 4.0], [0.0, 0.0, 0.0]]
    assert Passages.together(parts).followed().counted(3, 5).nnz == 0  # seen four times
    assert Passages.together([]).followed().counted(3, 1).nnz == 0
