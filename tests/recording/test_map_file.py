"""Maps through a file: the same to the last bit, or one clear line."""

from collections import Counter
from dataclasses import fields

import numpy as np
import pytest

from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.motion import AMOUNTS, FLOATS, Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import load_map, save_map, topic_names
from dirprim_filter.recording.container import log
from dirprim_filter.recording.container.chunk import read_contents
from dirprim_filter.recording.errors import OutputExistsError, RecordingError
from dirprim_filter.recording.foxglove.frames import scene_transform
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.map_file import MapFile
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.schemas import map_tiles
from dirprim_filter.recording.schemas.map_tiles import TILE_CELLS, encode_tiles
from dirprim_filter.recording.schemas.motion_columns import COLUMNS
from tessellation import GridTessellation, VoronoiTessellation


def some_map(n_cells, *, n_modes=3, seed=0, voronoi=False):
    rng = np.random.default_rng([seed, n_cells])
    rows = (n_cells + 1, n_modes)
    n_x = 200
    weight = rng.dirichlet(np.ones(n_modes), size=n_cells + 1)
    square = np.sort(rng.choice(2 * n_cells + 1, size=n_cells, replace=False))
    grid = GridTessellation(
        origin=rng.normal(size=2), cell_size=1 / 3, n_x=n_x, n_y=(2 * n_cells) // n_x + 1, square=square
    )
    generators = 5e6 / 7 + rng.normal(size=(n_cells, 2))
    return PrimitiveMap(
        tessellation=VoronoiTessellation(generators=generators, region=grid) if voronoi else grid,
        direction=VonMisesMixture(
            weight=weight,
            mean_direction=rng.uniform(-np.pi, np.pi, rows),
            concentration=10.0 ** rng.uniform(-3, 6, rows),
        ),
        speed=Gamma(shape=rng.gamma(2.0, 1.0, rows), rate=rng.gamma(2.0, 1.0, rows)),
        n_rows=rng.integers(0, 2**40, n_cells + 1),
        n_place_free_modes=1,
        motion=some_motion(n_cells, n_modes, rng),
    )


def some_motion(n_cells, n_modes, rng):
    """Some manoeuvres of some of the cells, and three of no place."""
    cell = np.sort(rng.integers(n_cells, size=2 * n_cells))
    n = cell.size + 3
    first = np.cumsum(rng.integers(3, size=n + 1) if n_cells else np.zeros(n + 1, np.int64))
    first -= first[0]
    wide = {"bend": 2, "gain": 2, "path": 3, "acceleration": 4}
    return Motion(
        cell=np.append(cell, [-1] * 3), mode=rng.integers(n_modes, size=n), first=first,
        **{name: rng.gamma(2.0, size=(n, wide[name]) if name in wide else n) for name in FLOATS},
        following=rng.integers(max(cell.size, 1), size=first[-1]), count=rng.gamma(2.0, size=first[-1]),
        course_rate=rng.gamma(2.0), strength=rng.gamma(2.0),
    )  # fmt: skip


def assert_equal(a, b):
    assert type(a.tessellation) is type(b.tessellation)
    grids = [a.tessellation, b.tessellation]
    if isinstance(a.tessellation, VoronoiTessellation):
        np.testing.assert_array_equal(a.tessellation.generators, b.tessellation.generators)
        grids = [a.tessellation.region, b.tessellation.region]
    for name in ("origin", "cell_size", "n_x", "n_y", "square"):
        np.testing.assert_array_equal(getattr(grids[0], name), getattr(grids[1], name), err_msg=name)
    for name in ("weight", "mean_direction", "concentration"):
        np.testing.assert_array_equal(getattr(a.direction, name), getattr(b.direction, name), err_msg=name)
    for name in ("shape", "rate"):
        np.testing.assert_array_equal(getattr(a.speed, name), getattr(b.speed, name), err_msg=name)
    np.testing.assert_array_equal(a.n_rows, b.n_rows)
    assert a.n_place_free_modes == b.n_place_free_modes
    assert (a.motion.leader is None) == (b.motion.leader is None)
    for one, other in (
        (a.motion, b.motion),
        *([] if a.motion.leader is None else [(a.motion.leader, b.motion.leader)]),
    ):
        assert_columns_equal(one, other)


def assert_columns_equal(a, b):
    for field in fields(a):
        if field.name == "leader":
            continue
        sent, got = getattr(a, field.name), getattr(b, field.name)
        np.testing.assert_array_equal(sent, got, err_msg=field.name)
        assert np.asarray(sent).dtype == np.asarray(got).dtype, field.name


@pytest.mark.parametrize("voronoi", [False, True])
@pytest.mark.parametrize("n_cells", [0, 1, TILE_CELLS, TILE_CELLS + 1, 3 * TILE_CELLS - 5])
def test_a_map_loads_equal(tmp_path, n_cells, voronoi):
    sent = some_map(n_cells, voronoi=voronoi)
    save_map(sent, tmp_path / "map.mcap", metadata={"seed": "0"})
    assert_equal(load_map(tmp_path / "map.mcap"), sent)
    n_messages = Counter(message.topic for message in scan(tmp_path / "map.mcap"))
    once = dict.fromkeys(("/dirprim/map/summary", "/dirprim/map/scene", "/tf"), 1)
    assert n_messages == {"/dirprim/map": max(1, -(-n_cells // TILE_CELLS))} | once


def test_tiles_of_several_maps_are_none(tmp_path, monkeypatch):
    monkeypatch.setattr(map_tiles, "TILE_CELLS", 20)
    one, other = encode_tiles(some_map(33))
    other.n_place_free_modes = 2
    write_tiles(tmp_path / "mixed.mcap", [one, other])
    with pytest.raises(RecordingError, match="tiles of several"):
        load_map(tmp_path / "mixed.mcap")


def test_what_was_learned_loads_equal(tmp_path, ring_map):
    assert ring_map.motion.count.size > 0
    assert ring_map.motion.leader is not None
    save_map(ring_map, tmp_path / "map.mcap")
    assert_equal(load_map(tmp_path / "map.mcap"), ring_map)


def test_a_tile_has_the_manoeuvres_of_its_cells_and_what_follows_them():
    sent = some_map(2 * TILE_CELLS + 9).motion
    tiles = list(encode_tiles(some_map(2 * TILE_CELLS + 9)))
    assert len(tiles) == 3
    for tile in tiles:
        of, number = tile.motion, np.array(tile.motion.number)
        assert set(of.cell) <= set(tile.cell)
        np.testing.assert_array_equal(sent.cell[number], of.cell)
        np.testing.assert_array_equal(sent.push[number], of.push)
        source = np.repeat(number, np.diff(np.append(of.first, len(of.following))))
        every = np.repeat(np.arange(len(sent)), np.diff(sent.first))
        own = np.isin(every, number)
        np.testing.assert_array_equal(every[own], source)
        np.testing.assert_array_equal(sent.following[own], of.following)
        np.testing.assert_array_equal(sent.count[own], of.count)
    assert sum(len(tile.motion.cell) for tile in tiles) == sent.n_placed


def test_tiles_are_squares_of_the_ground(tmp_path, monkeypatch):
    monkeypatch.setattr(map_tiles, "TILE_M", 12.0)
    sent = some_map(700)
    tiles = list(encode_tiles(sent))
    assert len(tiles) > 5
    for tile in tiles:
        center = sent.tessellation.centers[tile.cell]
        assert np.ptp(center, axis=0).max() < 12.0
        assert (center > [tile.box.west, tile.box.south]).all()
        assert (center < [tile.box.east, tile.box.north]).all()
        np.testing.assert_array_equal(sent.tessellation.square[tile.cell], tile.grid.square)
    save_map(sent, tmp_path / "map.mcap")
    assert_equal(load_map(tmp_path / "map.mcap"), sent)


def test_a_tile_is_read_without_the_chunks_of_others(tmp_path, monkeypatch):
    monkeypatch.setattr(map_tiles, "TILE_CELLS", 50)
    save_map(some_map(300), tmp_path / "map.mcap")
    opened = []
    with MapFile(tmp_path / "map.mcap") as tiles:
        assert len(tiles.box) == 6
        monkeypatch.setattr(log, "read_contents", lambda *of: opened.append(1) or read_contents(*of))
        assert tiles.part(np.array([2])).tessellation.n_cells == 50
        assert len(opened) == 1
        tiles.part(np.array([0, 2, 5]))
        assert len(opened) == 3  # of which one is kept


@pytest.mark.parametrize(("version", "age"), [(0, "an older"), (4, "an older"), (6, "a newer")])
def test_a_map_of_another_version_is_to_be_learned_again(tmp_path, version, age):
    (tile,) = encode_tiles(some_map(10))
    tile.version = version
    tile.ClearField("motion")
    write_tiles(tmp_path / "map.mcap", [tile])
    with pytest.raises(RecordingError, match=rf"map\.mcap: .*of {age} version.*learn it again") as caught:
        load_map(tmp_path / "map.mcap")
    assert "\n" not in str(caught.value)


def test_the_same_map_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        save_map(some_map(50), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_an_existing_file_is_kept_without_force(tmp_path):
    path = tmp_path / "map.mcap"
    save_map(some_map(5), path)
    with pytest.raises(OutputExistsError, match=r"map\.mcap"):
        save_map(some_map(6), path)
    assert_equal(load_map(path), some_map(5))
    save_map(some_map(6), path, force=True)
    assert_equal(load_map(path), some_map(6))


def test_a_log_that_is_no_map_is_reported(tmp_path):
    with LogWriter(tmp_path / "log.mcap", metadata={}) as writer:
        writer.write("/tf", scene_transform(0, np.zeros(2)), 0)
    with pytest.raises(RecordingError, match=r"log\.mcap: expected a map.*dirprim learn"):
        load_map(tmp_path / "log.mcap")
    (tmp_path / "text").write_text("no log at all")
    with pytest.raises(RecordingError, match="expected an MCAP log"):
        load_map(tmp_path / "text")


def write_tiles(path, tiles):
    with LogWriter(path, metadata={}) as writer:
        for tile in tiles:
            writer.write(topic_names.MAP, tile, 0)


@pytest.mark.parametrize("voronoi", [False, True])
def test_tiles_may_come_in_any_order(tmp_path, voronoi):
    sent = some_map(2 * TILE_CELLS + 9, voronoi=voronoi)
    write_tiles(tmp_path / "map.mcap", reversed(list(encode_tiles(sent))))
    assert_equal(load_map(tmp_path / "map.mcap"), sent)


def without_weight(tile):
    tile.cells.weight.pop()


def of_a_huge_count(tile):
    tile.n_modes = 2**31


def of_many_tiles(tile):
    tile.n_tiles = 2**31


def of_an_endless_grid(tile):
    tile.grid.n_x = tile.grid.n_y = 2**40


def of_other_weights(tile):
    tile.cells.weight[0] += 1.0


def of_no_number(tile):
    tile.cells.rate[0] = np.nan


def of_unknown_cells(tile):
    tile.ClearField("grid")


def of_no_place_free_row(tile):
    tile.ClearField("place_free")


def without_a_coordinate(tile):
    tile.voronoi.y.pop()


def with_a_generator_twice(tile):
    tile.voronoi.x[3], tile.voronoi.y[3] = tile.voronoi.x[7], tile.voronoi.y[7]


def of_an_endless_region(tile):
    tile.voronoi.region.n_x = tile.voronoi.region.n_y = 2**40


def of_no_region(tile):
    tile.voronoi.ClearField("region")


def of_a_generator_nowhere(tile):
    tile.voronoi.x[0] = np.inf


def of_all_generators_far_away(tile):
    """Squares of their distances are infinite, so none is the nearest: the kernel read before its table."""
    tile.voronoi.x[:] = (1e300 + 1e290 * np.arange(len(tile.voronoi.x))).tolist()


def of_squares_of_no_size(tile):
    tile.voronoi.region.cell_size = 5e-324


def of_a_region_nowhere(tile):
    tile.voronoi.region.origin_x = -1e300


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (without_a_coordinate, "y: expected 10 numbers, got 9"),
        (with_a_generator_twice, "generators: expected each once"),
        (of_an_endless_region, "squares, more than"),
        (of_no_region, "cell_size: expected a positive"),
        (of_a_generator_nowhere, "generators: expected finite"),
        (of_all_generators_far_away, "generators: expected places within 1e.09 m"),
        (of_squares_of_no_size, "cell_size: expected a positive"),
        (of_a_region_nowhere, "origin: expected places within"),
    ],
)
def test_harmed_generators_are_reported_in_one_line(tmp_path, harm, message):
    (tile,) = encode_tiles(some_map(10, voronoi=True))
    harm(tile)
    write_tiles(tmp_path / "map.mcap", [tile])
    with pytest.raises(RecordingError, match=message) as caught:
        load_map(tmp_path / "map.mcap")
    assert "\n" not in str(caught.value)


def test_tiles_of_two_kinds_make_no_map(tmp_path):
    grids, generators = (list(encode_tiles(some_map(TILE_CELLS + 9, voronoi=kind))) for kind in (False, True))
    write_tiles(tmp_path / "map.mcap", [grids[0], generators[1]])
    with pytest.raises(RecordingError, match="tiles of several"):
        load_map(tmp_path / "map.mcap")


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (without_weight, "weight: expected 30 numbers, got 29"),
        (of_a_huge_count, "weight: expected 21474836480 numbers, got 30"),
        (of_many_tiles, "expected tiles 0 to 2147483647, got 1"),
        (of_an_endless_grid, "squares, more than"),
        (of_other_weights, "expected to sum to one"),
        (of_no_number, "rate: expected finite"),
        (of_unknown_cells, "expected the cells of a grid"),
        (of_no_place_free_row, "weight: expected 3 numbers, got 0"),
    ],
)
def test_a_harmed_tile_is_reported_in_one_line(tmp_path, harm, message):
    (tile,) = encode_tiles(some_map(10))
    harm(tile)
    write_tiles(tmp_path / "map.mcap", [tile])
    with pytest.raises(RecordingError, match=message) as caught:
        load_map(tmp_path / "map.mcap")
    assert "map.mcap" in str(caught.value)
    assert "\n" not in str(caught.value)


def harm_motion(name, index, value):
    """Set one number of a column."""

    def harm(tile):
        getattr(tile.motion, name)[index] = value

    return harm


def harm_place_free(name, index, value):
    """Likewise, of the place-free manoeuvres."""

    def harm(tile):
        getattr(tile.place_free_motion, name)[index] = value

    return harm


def shorten_motion(name):
    def harm(tile):
        getattr(tile.motion, name).pop()

    return harm


def wrap_around(tile):
    """Differences of 64 bits would be positive all along."""
    tile.motion.first[1:4] = [2**63 - 1, -(2**63), -1]


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        *((shorten_motion(name), f"{name}: expected") for name in COLUMNS if name not in ("cell", "following")),
        (shorten_motion("cell"), "expected 19 numbers, got 20"),
        (shorten_motion("following"), "count: expected"),
        *(
            (harm_motion(name, 2, value), "expected finite")
            for name in ("course", "bend_north", "path_curvature", "acceleration_speed", "count")
            for value in (np.nan, -np.inf)
        ),
        *((harm_motion(name, 2, -1.0), f"{name}: expected no negative") for name in AMOUNTS),
        (harm_place_free("cell", -1, 3), "then -1 for two place-free manoeuvres"),
        (harm_motion("cell", 0, -1), "expected cells in ascending order"),
        (harm_place_free("cell", -1, -2), "expected cells in ascending order"),
        (harm_motion("cell", 19, 10), "expected manoeuvres of 10 cells, got others"),
        (harm_motion("cell", 19, 2**62), "expected manoeuvres of 10 cells, got others"),
        (harm_motion("number", 19, 2**62), "manoeuvres: expected numbers 0 to 19, each once"),
        (harm_motion("number", 19, 18), "manoeuvres: expected numbers 0 to 19, each once"),
        (harm_motion("mode", 0, 3), "expected manoeuvres of 10 cells and 3 modes"),
        (harm_motion("mode", 0, -1), "expected manoeuvres of 10 cells and 3 modes"),
        (harm_motion("first", 0, 1), "first: expected ascending numbers from 0"),
        (harm_motion("first", 4, 2**62), "first: expected ascending numbers from 0"),
        (harm_motion("first", -1, -(2**63)), "first: expected ascending numbers from 0"),
        (wrap_around, "first: expected ascending numbers from 0"),
        (harm_motion("following", 0, 23), "expected transitions to manoeuvres 0 to 22"),
        (harm_motion("following", 0, -1), "expected transitions to manoeuvres 0 to 22"),
        (lambda tile: tile.ClearField("place_free_motion"), "then -1 for two place-free manoeuvres"),
        (lambda tile: tile.place_free_motion.ClearField("strength"), "strength: expected a positive number"),
        (lambda tile: tile.place_free_motion.ClearField("course_rate"), "course_rate: expected a positive number"),
    ],
)
def test_harmed_motion_is_reported_in_one_line(tmp_path, harm, message):
    (tile,) = encode_tiles(some_map(10))
    harm(tile)
    write_tiles(tmp_path / "map.mcap", [tile])
    with pytest.raises(RecordingError, match=message) as caught:
        load_map(tmp_path / "map.mcap")
    assert "\n" not in str(caught.value)


def test_a_missing_a_doubled_and_a_foreign_tile_are_reported(tmp_path):
    tiles = list(encode_tiles(some_map(TILE_CELLS + 9)))
    foreign = list(encode_tiles(some_map(TILE_CELLS + 9, seed=1)))
    for name, part, message in (
        ("a", tiles[:1], "expected tiles 0 to 1, got 1"),
        ("b", [tiles[0], tiles[0]], "tile 0: expected once"),
        ("c", [tiles[0], foreign[1]], "tiles of several"),
    ):
        write_tiles(tmp_path / name, part)
        with pytest.raises(RecordingError, match=message):
            load_map(tmp_path / name)


def test_a_damaged_map_is_reported(tmp_path):
    path = tmp_path / "map.mcap"
    save_map(some_map(500), path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"map\.mcap: cannot be read as a map.*damaged"):
        load_map(path)
