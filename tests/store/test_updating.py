"""A map brought up to date with its store: where, with what, and that the order of things does not show."""

from dataclasses import replace

import numpy as np
import pytest
from streets import FAR_M, add, bytes_of, store_of, street, summed

from dirprim_filter import Tracks, learn_primitives, load_map, save_map, write_tracks
from dirprim_filter.primitives.choice import Leaning
from dirprim_filter.primitives.learning import _learned
from dirprim_filter.primitives.motion_learning import label_visits, modes_of, motion_of
from dirprim_filter.primitives.motion_sums import MotionSums
from dirprim_filter.primitives.place_free_motion import learn_place_free
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.schedule import Schedule
from dirprim_filter.primitives.visits import Visits
from dirprim_filter.store import Store, learn_from_store, update_map
from dirprim_filter.store.basis import Basis
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.fading import Fading
from dirprim_filter.store.lattice import Lattice
from dirprim_filter.store.learning import visible_tracks
from dirprim_filter.store.recorded_ways import EVERYWHERE, Box, sampled
from dirprim_filter.store.tiles import Digests, around, tiles_at
from dirprim_filter.store.withholding import withheld

LOGS = {
    "both": [street(1, north=0.0, n_vehicles=9), street(2, north=FAR_M, n_vehicles=9)],
    "near": [street(3, north=0.0)],
    "near again": [street(4, north=0.0)],
    "far": [street(5, north=FAR_M)],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("streets")
    for name, parts in LOGS.items():
        write_tracks(Tracks.concatenate(parts), folder / f"{name}.mcap")
    return folder


def motion_of_whole(primitives, visits):
    rng = np.random.default_rng(0)
    labels = label_visits(primitives, visits, rng=rng)
    return motion_of(MotionSums.of(visits, *labels, primitives), labels, primitives, learn_place_free(visits, rng=rng))


def learned_from(store, *, min_vehicles=2):
    return learn_from_store(
        store, min_vehicles=min_vehicles, tessellation="voronoi", n_cells=120,
        rng=np.random.default_rng(0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def learned(folder, tmp_path_factory):
    """Of the log of both streets."""
    return learned_from(store_of(tmp_path_factory.mktemp("of") / "both", folder, "both"))


@pytest.fixture
def store(folder, tmp_path):
    return store_of(tmp_path / "store", folder, "both")


def test_where_nothing_changed_the_map_is_the_same(store, learned, tmp_path):
    done = update_map(learned, store)
    assert done.primitive_map is learned
    assert done.n_tiles == done.n_cells == 0
    save_map(learned, saved := tmp_path / "map.mcap")
    again = load_map(saved)
    assert update_map(again, store).n_tiles == 0
    assert bytes_of(again, tmp_path / "again.mcap") == saved.read_bytes()


def test_the_order_of_recordings_does_not_show_nor_that_some_were_forgotten(store, learned, folder, tmp_path):
    found = {}
    for order in (("near", "far", "near again"), ("near again", "near", "far")):
        other, m = store_of(tmp_path / " ".join(order), folder, "both"), learned
        for name in order:
            add(other, folder, name)
            m = update_map(m, other).primitive_map
        found[order] = bytes_of(m, tmp_path / "map.mcap")
    add(store, folder, "near", "near again", "far")
    at_once = update_map(learned, store).primitive_map
    assert set(found.values()) == {bytes_of(at_once, tmp_path / "map.mcap")}
    for name in ("near", "far", "near again"):
        store.forget(str(folder / f"{name}.mcap"))
    back = update_map(at_once, store).primitive_map
    assert bytes_of(back, tmp_path / "map.mcap") == bytes_of(learned, tmp_path / "map.mcap")


def test_what_is_fitted_anew_is_what_all_of_it_would_be(store, learned, folder, tmp_path):
    """Control: what is out of reach stays bit by bit, and what is not does not."""
    add(store, folder, "near")
    done = update_map(learned, store)
    assert done.uncovered < 0.01
    unknown = replace(learned.refit.counted, tile=np.empty((0, 2), np.int64), digest=np.empty(0, np.int64))
    every = update_map(replace(learned, refit=replace(learned.refit, counted=unknown)), store)
    assert every.n_cells == learned.tessellation.n_cells > done.n_cells > 0
    assert bytes_of(every.primitive_map, tmp_path / "a.mcap") == bytes_of(done.primitive_map, tmp_path / "b.mcap")
    far = learned.tessellation.centers[:, 1] > FAR_M / 2
    before, after = learned, done.primitive_map
    n = min(before.n_own_modes, after.n_own_modes) - 1
    for column in ("weight", "mean_direction", "concentration"):
        one, other = (getattr(m.direction, column)[:-1, :n] for m in (before, after))
        assert np.array_equal(one[far], other[far])
        assert not np.array_equal(one[~far], other[~far])
    assert np.array_equal(before.n_rows[:-1][far], after.n_rows[:-1][far])
    assert (after.n_rows[:-1][~far] >= before.n_rows[:-1][~far]).all()


def test_it_agrees_with_what_is_learned_as_a_whole(store, learned, folder):
    """By the same choices in the same cells, whose vehicles the store sums up and nothing divides into tiles."""
    unseen = street(9, north=0.0, n_vehicles=20)
    add(store, folder, "near", "near again", "far")
    updated = update_map(learned, store).primitive_map
    refit, layouts = updated.refit, Basis.of(updated, updated.refit)
    rows = TrackRows.thinned(visible_tracks(summed(store), min_vehicles=2).tracks, interval_s=0.0)
    lean = Leaning(refit.place_free, refit.borrowed)
    whole = _learned(rows, [layouts.own, *layouts.lenders], refit.recipe, layouts.free, lean)
    visits = Visits.of(rows, whole.tessellation)
    whole = withheld(whole, visits, modes_of(whole, visits), 2)
    old, new, other = (
        m.log_density(unseen.position, unseen.direction, unseen.speed).mean() for m in (learned, updated, whole)
    )
    assert new > old + 0.1  # it learned
    assert abs(new - other) < 0.01
    of_tile = tiles_at(updated.tessellation.centers, Lattice())[:, 0]
    across = []
    for m in (updated, replace(whole, motion=motion_of_whole(whole, visits))):
        n, source = m.motion.n_placed, np.repeat(m.motion.cell, np.diff(m.motion.first))
        placed = (source >= 0) & (m.motion.following < n)
        source, following = source[placed], m.motion.cell[m.motion.following[placed]]
        across.append(m.motion.count[placed][of_tile[source] != of_tile[following]].sum())
    assert across[1] >= 60  # of 36 vehicles
    assert 0.9 * across[1] <= across[0] <= across[1]  # but for what one vehicle alone did


def test_of_few_vehicles_nothing_is_said(store, folder, tmp_path):
    """Three vehicles more than nine: what three do alone is kept from a map of four, in an updated one as well."""
    m = learned_from(store, min_vehicles=4)
    odd = street(8, north=0.0, n_vehicles=3)
    odd = replace(odd, position=odd.position + np.array([0.0, 2.0]), direction=np.full(len(odd), np.pi / 2))
    write_tracks(odd, tmp_path / "odd.mcap")
    add(store, tmp_path, "odd")
    assert update_map(m, store).n_cells > 0
    updated = update_map(m, store).primitive_map
    own = updated.direction.weight[:-1, : updated.n_own_modes + updated.n_borrowed_modes] > 0
    assert (np.abs(np.cos(updated.direction.mean_direction[:-1, : own.shape[1]][own])) > 0.5).all()
    assert updated.motion.visits[: updated.motion.n_placed].min() >= 4


def test_of_too_many_steps_whole_ways_are_taken_by_their_share(store):
    (every,) = sampled(store, [EVERYWHERE], most_rows=10**6, min_vehicles=1)
    n = every.ways.way.size
    (some,) = sampled(store, [EVERYWHERE], most_rows=n - 1, min_vehicles=1)
    assert (every.share, some.share) == (1.0, 0.5)
    assert np.unique(every.ways.way).size == 18
    assert abs(np.unique(some.ways.way).size - 9) <= 2
    kept = np.isin(every.ways.way, some.ways.way)
    assert all(np.array_equal(one[kept], other) for one, other in zip(every.ways, some.ways, strict=True))
    (few,) = sampled(store, [EVERYWHERE], most_rows=n // 10, min_vehicles=1)
    assert few.share == 0.0625


def test_of_boxes_that_are_read_together_each_has_what_it_has_alone(store, folder):
    """Of overlapping boxes, of which the busier keep a smaller share; of recordings added after rows were dropped."""
    add(store, folder, "near", "near again", "far")
    boxes = [
        Box(np.array([west, 0.0]), np.array([east, 200.0]), fading)
        for west, east in ((-200.0, 400.0), (-50.0, 50.0), (0.0, 30.0), (150.0, 550.0))
        for fading in (None, Fading(half_life_s=20.0, now_ns=60 * 10**9))
    ]
    most = sum(sample.ways.way.size for sample in sampled(store, boxes[:1], most_rows=10**9, min_vehicles=1)) // 12
    shares = []
    for box, together in zip(boxes, sampled(store, boxes, most_rows=most, min_vehicles=3), strict=True):
        (alone,) = sampled(store, [box], most_rows=most, min_vehicles=3)
        assert alone.share == together.share
        assert alone.ways.way.size > 0
        assert all(np.array_equal(one, other) for one, other in zip(alone.ways, together.ways, strict=True))
        shares.append(alone.share)
    assert len(set(shares)) >= 3


def test_where_no_cell_is_nothing_is_fitted_and_of_no_recording_nothing_is_known(store, learned, tmp_path):
    write_tracks(street(7, north=5 * FAR_M), tmp_path / "elsewhere.mcap")
    add(store, tmp_path, "elsewhere")
    done = update_map(learned, store)
    assert done.n_cells == 0
    assert done.n_tiles > 0
    assert done.uncovered == 1.0
    for entry in store.entries():
        store.forget(entry.url)
    empty = update_map(done.primitive_map, store).primitive_map
    assert empty.motion.n_placed == empty.n_rows.sum() == 0
    place_free = empty.direction.weight[:, : -empty.n_place_free_modes]
    assert not place_free.any()


def test_tiles_are_those_of_recordings():
    assert around({(0, 0)}, 1) == {(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    none = Digests.of({})
    assert none.changed(none) == set()


def slots_of_one(m):
    """As all day."""
    return dict.fromkeys(("flow", "pace"), np.ones((24, m.tessellation.n_cells, m.n_own_modes)))


def test_what_cannot_be_updated_is_refused(store, learned, folder, tmp_path):
    of_logs = learn_primitives(street(1, north=0.0), tessellation="grid", cell_size=10.0, rng=np.random.default_rng(0))
    by_halves = replace(learned, schedule=Schedule(by="hour", zone="UTC", **slots_of_one(learned)))
    for m in (of_logs, replace(learned, refit=replace(learned.refit, counted=None)), by_halves):
        with pytest.raises(ValueError, match="expected one learned from a store"):
            update_map(m, store)
    other = Store.create(tmp_path / "other", StoreConfig(lattice=Lattice(square_m=2.0)))
    add(other, folder, "both")
    with pytest.raises(ValueError, match="expected a store that counts as configuration"):
        update_map(learned, other)
