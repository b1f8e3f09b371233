"""Maps through a file: the same to the last bit, or one clear line."""

import tempfile
from collections import Counter
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.leader import LeaderResponse
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import load_map, save_map, topic_names
from dirprim_filter.recording.container.records import Schema
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.foxglove.elements import scene_transform
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.map_file import MAP
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.schemas import map_tiles
from dirprim_filter.recording.schemas.map_tiles import TILE_CELLS, decode, encode
from tessellation import GridTessellation, VoronoiTessellation

LEADER = LeaderResponse(gain=np.arange(10.0), push=1.0, trust=0.5, start_rate=np.ones(3))
FEW, N_CELLS = 40, 150
"""Cells of a tile, and of a map in tiles, where they are small."""


def some_map(n_cells, *, n_modes=3, seed=0, voronoi=False):
    rng = np.random.default_rng([seed, n_cells])
    rows = (n_cells + 1, n_modes)
    square = np.sort(rng.choice(2 * n_cells + 1, size=n_cells, replace=False))
    grid = GridTessellation(
        origin=rng.normal(size=2), cell_size=1 / 3, n_x=200, n_y=(2 * n_cells) // 200 + 1, square=square
    )
    generators = 5e6 / 7 + rng.normal(size=(n_cells, 2))
    return PrimitiveMap(
        tessellation=VoronoiTessellation(generators=generators, region=grid) if voronoi else grid,
        direction=VonMisesMixture(
            weight=rng.dirichlet(np.ones(n_modes), size=n_cells + 1),
            mean_direction=rng.uniform(-np.pi, np.pi, rows), concentration=10.0 ** rng.uniform(-3, 6, rows),
        ),
        speed=Gamma(shape=rng.gamma(2.0, 1.0, rows), rate=rng.gamma(2.0, 1.0, rows)),
        n_rows=rng.integers(0, 2**40, n_cells + 1), n_background_modes=1,
        bend=rng.normal(size=(*rows, 2)), motion=some_motion(n_cells, n_modes, rng),
    )  # fmt: skip


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
        background_visits=rng.gamma(2.0),
        leader=LEADER if n_cells else None,
    )  # fmt: skip


def assert_equal(a, b):
    """Every number of every value in the two, and its type."""
    assert type(a) is type(b)
    if isinstance(a, tuple):
        for one, other in zip(a, b, strict=True):
            assert_equal(one, other)
        return
    if not hasattr(a, "__dataclass_fields__"):
        np.testing.assert_array_equal(a, b)
        assert np.asarray(a).dtype == np.asarray(b).dtype
        return
    for field in fields(a):
        if field.init and field.compare:
            assert_equal(getattr(a, field.name), getattr(b, field.name))


@pytest.mark.parametrize("voronoi", [False, True])
@pytest.mark.parametrize("n_cells", [0, 1, TILE_CELLS + 1])
def test_a_map_loads_equal(tmp_path, n_cells, voronoi):
    sent = some_map(n_cells, voronoi=voronoi)
    save_map(sent, tmp_path / "map.mcap", metadata={"seed": "0"})
    assert_equal(load_map(tmp_path / "map.mcap"), sent)
    n_messages = Counter(message.topic for message in scan(tmp_path / "map.mcap"))
    once = dict.fromkeys(("/dirprim/map/scene", "/tf"), 1)
    assert n_messages == {"/dirprim/map": max(1, -(-n_cells // TILE_CELLS))} | once


def test_what_was_learned_loads_equal_and_an_equal_map_has_equal_bytes(tmp_path, ring_map):
    assert ring_map.motion.count.size > 0
    for name, sent in (("a", ring_map), ("b", ring_map), ("some", some_map(33))):
        save_map(sent, tmp_path / name)
        assert_equal(load_map(tmp_path / name), sent)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_any_reader_of_arrow_opens_a_tile(tmp_path):
    sent = some_map(20)
    save_map(sent, tmp_path / "map.mcap")
    (message,) = (message for message in scan(tmp_path / "map.mcap") if message.topic == "/dirprim/map")
    assert message.schema_name == "dirprim.PrimitiveMap"
    (tile,) = pa.ipc.open_stream(message.data).read_all().to_pylist()
    assert [row["rate"] for row in tile["cell"]] == sent.speed.rate[:-1].tolist()
    assert [row["push"] for row in tile["manoeuvre"]] == sent.motion.push[: sent.motion.n_placed].tolist()


def test_what_is_no_map_is_reported(tmp_path):
    path = tmp_path / "log.mcap"
    with LogWriter(path, metadata={}) as writer:
        writer.write("/tf", scene_transform(0, np.zeros(2)), 0)
    with pytest.raises(RecordingError, match=r"log\.mcap: expected a map.*dirprim learn"):
        load_map(path)
    path.write_text("no log at all")
    with pytest.raises(RecordingError, match="expected an MCAP log"):
        load_map(path)
    with LogWriter(path, metadata={}, force=True) as writer:
        writer.write_encoded(topic_names.MAP, Schema(name=MAP.name, encoding="protobuf", data=b""), b"\x58\x04", 0)
    with pytest.raises(RecordingError, match=r"log\.mcap: .*of an older version, in protobuf.*learn it again"):
        load_map(path)


# Tiles


@pytest.fixture
def small_tiles(monkeypatch):
    monkeypatch.setattr(map_tiles, "TILE_CELLS", FEW)


def test_a_tile_has_the_manoeuvres_of_its_cells_and_what_follows_them(small_tiles):
    sent = some_map(2 * FEW + 9).motion
    tiles = [opened(data)[1] for data in map_tiles.encoded_tiles(some_map(2 * FEW + 9))]
    assert len(tiles) == 3
    every, n = np.repeat(np.arange(len(sent)), np.diff(sent.first)), 0
    for i, tile in enumerate(tiles):
        of, after = tile["manoeuvre"], tile["transition"]
        own = np.arange(n, n := n + of["cell"].size)
        np.testing.assert_array_equal(of["cell"], sent.cell[own])
        assert set(of["cell"]) <= set(range(FEW * i, FEW * (i + 1)))
        np.testing.assert_array_equal(of["push"], sent.push[own])
        np.testing.assert_array_equal(after["following"], sent.following[np.isin(every, own)])
        np.testing.assert_array_equal(after["count"], sent.count[np.isin(every, own)])
    assert n == sent.n_placed


def opened(data):
    """The scalars and the tables of a message, to be changed."""
    scalars, tables = decode(data)
    return scalars, {name: {of: column.copy() for of, column in table.items()} for name, table in tables.items()}


def write(path, tiles):
    with LogWriter(path, metadata={}, force=True) as writer:
        for data in tiles:
            writer.write_encoded(topic_names.MAP, MAP, data, 0)
    return path


@pytest.mark.parametrize("voronoi", [False, True])
def test_tiles_are_found_wherever_they_stand(tmp_path, voronoi, small_tiles):
    made = some_map(N_CELLS, voronoi=voronoi)
    tiles = list(map_tiles.encoded_tiles(made))
    assert_equal(load_map(write(tmp_path / "map", tiles[1:] + tiles[:1])), made)


# Harm


def test_a_missing_a_doubled_a_foreign_and_a_damaged_tile_are_reported(tmp_path, small_tiles):
    tiles, foreign, other = (
        list(map_tiles.encoded_tiles(some_map(FEW + 9, **of))) for of in ({}, {"seed": 1}, {"voronoi": True})
    )
    for part, message in (
        (tiles[:1], "expected tiles 0 to 1, got 1"), ([tiles[0], tiles[0]], "tile 0: expected once"),
        ([tiles[0], foreign[1]], "tiles of several"), ([tiles[0], other[1]], "tiles of several"),
        ([], "expected a map"),
    ):  # fmt: skip
        with pytest.raises(RecordingError, match=message):
            load_map(write(tmp_path / "map", part))
    save_map(some_map(500), tmp_path / "damaged.mcap")
    data = bytearray((tmp_path / "damaged.mcap").read_bytes())
    data[len(data) // 2] ^= 0xFF
    (tmp_path / "damaged.mcap").write_bytes(data)
    with pytest.raises(RecordingError, match=r"map\.mcap|damaged\.mcap: cannot be read as a map.*damaged"):
        load_map(tmp_path / "damaged.mcap")


def number(name, value):
    """Set a scalar."""
    return lambda scalars, tables: scalars.__setitem__(name, value)


def cell(table, column, row, value):
    """Set a number of a table, or all of a row's."""
    return lambda scalars, tables: tables[table][column].__setitem__(row, value)


def without(table, column=None):
    return lambda scalars, tables: tables.pop(table) if column is None else tables[table].pop(column)


def column(table, name, made):
    return lambda scalars, tables: tables[table].__setitem__(name, made(tables[table][name]))


TILE = [
    (number("version", 5), "an older version, 5"),
    (number("version", "6"), "version: expected a whole number, got '6'"),
    (number("n_tiles", 2**62), "expected tiles 0 to 4611686018427387903, got 1"),
    (number("kind", "hexagons"), "kind: expected grid or voronoi"),
    (number("n_x", 2**40), "squares, more than"),
    (number("origin_x", -1e300), "origin: expected places within"),
    (number("n_background_modes", 9), "n_background_modes: expected 0 to 3"),
    (number("background_visits", np.nan), "background_visits: expected a positive"),
    (without("background"), "background.weight: expected float64, got none"),
    (without("manoeuvre", "push"), "manoeuvre.push: expected float64, got none"),
    (column("square", "number", lambda of: of.astype(np.float64)), "square.number: expected int64"),
    (column("cell", "rate", lambda of: of[:, :2]), "background.rate: expected rows as wide as others"),
    (cell("cell", "weight", 0, 0.9), "expected to sum to one"),
    (cell("cell", "rate", 0, np.nan), "rate: expected finite"),
    (cell("square", "number", -1, 2**62), "square: expected numbers"),
    (cell("manoeuvre", "path", 2, -np.inf), "expected finite"),
    (cell("manoeuvre", "push", 2, -1.0), "push: expected no negative"),
    (cell("transition", "count", 2, -1.0), "count: expected no negative"),
    (cell("background_manoeuvre", "cell", -1, -2), "expected cells in ascending order"),
    (cell("manoeuvre", "cell", 19, 2**62), "expected manoeuvres of 10 cells and 3 modes"),
    (cell("manoeuvre", "mode", 0, -1), "expected manoeuvres of 10 cells and 3 modes"),
    (cell("manoeuvre", "n_following", 0, -(2**63)), "n_following: expected numbers that sum to"),
    (cell("transition", "following", 0, 23), "expected transitions to manoeuvres 0 to 22"),
]  # map_mutations.py has them by the thousand, with checks of bounds
GENERATORS = [
    (cell("cell", "place", 0, np.inf), "generators: expected finite"),
    (lambda _, tables: tables["cell"].update(place=1e300 + 1e290 * tables["cell"]["place"]), "places within 1e.09 m"),
]


@cache
def tile_of(kind):
    """The message of a small map, which reads back."""
    made = some_map(10, voronoi=kind == "generators")
    (data,) = map_tiles.encoded_tiles(made)
    with tempfile.TemporaryDirectory() as folder:
        assert_equal(load_map(write(Path(folder) / "map", [encode(*opened(data))])), made)
    return data


@pytest.mark.parametrize(
    ("kind", "harm", "message"),
    [(kind, *of) for kind, harms in (("grid", TILE), ("generators", GENERATORS)) for of in harms],
)
def test_a_harmed_tile_is_reported_in_one_line(tmp_path, kind, harm, message):
    scalars, tables = opened(tile_of(kind))
    harm(scalars, tables)
    path = write(tmp_path / "map.mcap", [encode(scalars, tables)])
    with pytest.raises(RecordingError, match=message) as caught:
        load_map(path)
    assert "map.mcap" in str(caught.value)
    assert "\n" not in str(caught.value)
