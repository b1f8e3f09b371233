"""Maps through a file: the same to the last bit, or one clear line."""

from collections import Counter
from dataclasses import fields
from functools import partial

import numpy as np
import pyarrow as pa
import pytest
from numba import typeof

from dirprim_filter.config import FilterConfig
from dirprim_filter.forecasting import leader_table
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.leader import LeaderResponse
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.motion_table import motion_table
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import load_map, save_map, topic_names
from dirprim_filter.recording.container.records import Schema
from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.recording.log_writer import LogWriter, schema_of
from dirprim_filter.recording.map_file import decode, encode, encoded
from dirprim_filter.recording.scan import scan
from dirprim_filter.recording.schemas import dirprim_pb2
from tessellation import GridTessellation, VoronoiTessellation

LEADER = LeaderResponse(gain=np.arange(10.0), push=1.0, trust=0.5, start_rate=np.ones(3))
FEW, N_MODES = 40, 3
SCHEMA = schema_of(dirprim_pb2.PrimitiveMap)


def some_map(n_cells, *, voronoi=False):
    rng = np.random.default_rng([0, n_cells])
    rows = (n_cells + 1, N_MODES)
    square = np.sort(rng.choice(2 * n_cells + 1, size=n_cells, replace=False))
    grid = GridTessellation(
        origin=rng.normal(size=2), cell_size=1 / 3, n_x=200, n_y=(2 * n_cells) // 200 + 1, square=square
    )
    generators = 5e6 / 7 + rng.normal(size=(n_cells, 2))
    return PrimitiveMap(
        tessellation=VoronoiTessellation(generators=generators, region=grid) if voronoi else grid,
        modes=Modes(
            rng.dirichlet(np.ones(N_MODES), size=n_cells + 1), rng.uniform(-np.pi, np.pi, rows),
            10.0 ** rng.uniform(-3, 6, rows), *rng.gamma(2.0, 1.0, (2, *rows)), *rng.normal(size=(2, *rows, 2)),
        ),
        n_rows=rng.integers(0, 2**40, n_cells + 1), n_background_modes=1,
        motion=some_motion(n_cells, rng),
    )  # fmt: skip


def some_motion(n_cells, rng):
    """Some manoeuvres of some of the cells, and three of no place."""
    cell = np.sort(rng.integers(n_cells, size=2 * n_cells))
    n = cell.size + 3
    first = np.cumsum(rng.integers(3, size=n + 1) if n_cells else np.zeros(n + 1, np.int64))
    first -= first[0]
    wide = {"bend": 2, "gain": 2, "path": 3, "acceleration": 4}
    return Motion(
        cell=np.append(cell, [-1] * 3), mode=rng.integers(N_MODES, size=n), first=first,
        **{name: rng.gamma(2.0, size=(n, wide[name]) if name in wide else n) for name in FLOATS},
        following=rng.integers(max(cell.size, 1), size=first[-1]), count=rng.gamma(2.0, size=first[-1]),
        background_visits=rng.gamma(2.0), course_rate=rng.gamma(2.0),
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
@pytest.mark.parametrize("n_cells", [0, 1, 500])
def test_a_map_loads_equal(tmp_path, n_cells, voronoi):
    sent = some_map(n_cells, voronoi=voronoi)
    save_map(sent, tmp_path / "map.mcap", metadata={"seed": "0"})
    assert_equal(load_map(tmp_path / "map.mcap"), sent)
    n_messages = Counter(message.topic for message in scan(tmp_path / "map.mcap"))
    assert n_messages == dict.fromkeys(("/dirprim/map", "/dirprim/map/scene", "/tf"), 1)


def test_what_was_learned_loads_equal_in_equal_bytes_that_any_reader_of_arrow_opens(tmp_path, ring_map):
    assert ring_map.motion.count.size > 0
    for name, sent in (("a", ring_map), ("b", ring_map), ("some", some_map(33))):
        save_map(sent, tmp_path / name)
        loaded = load_map(tmp_path / name)
        assert_equal(loaded, sent)
        for table in (motion_table, partial(leader_table, config=FilterConfig(interaction="leader"))):
            assert typeof(table(loaded)) == typeof(table(sent))  # or each kernel is compiled twice
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    (message,) = (message for message in scan(tmp_path / "some") if message.topic == "/dirprim/map")
    assert message.schema_name == "dirprim.PrimitiveMap"
    (read,) = pa.ipc.open_stream(dirprim_pb2.PrimitiveMap.FromString(message.data).arrow).read_all().to_pylist()
    assert [row["rate"] for row in read["row"]] == sent.speed.rate.tolist()
    assert [row["push"] for row in read["manoeuvre"]] == sent.motion.push.tolist()


def opened(data):
    """The scalars and the tables of a message, to be changed."""
    scalars, tables = decode(data)
    return scalars, {name: {of: column.copy() for of, column in table.items()} for name, table in tables.items()}


def in_protobuf(data):
    return dirprim_pb2.PrimitiveMap(arrow=data).SerializeToString()


def write(path, messages, *, schema=SCHEMA, wrapped=in_protobuf, topic=topic_names.MAP):
    with LogWriter(path, metadata={}, force=True) as writer:
        for data in messages:
            writer.write_encoded(topic, schema, wrapped(data), 0)
    return path


def test_a_map_is_read_as_it_was_written_before_it_was_in_protobuf(tmp_path):
    sent, before = encoded(some_map(FEW)), Schema(name="dirprim.PrimitiveMap", encoding="arrow", data=b"")
    assert encoded(load_map(write(tmp_path / "map.mcap", [sent], schema=before, wrapped=bytes))) == sent


def test_a_map_of_before_the_rate_of_courses_was_learned_has_that_of_all_of_then(tmp_path):
    scalars, tables = opened(encoded(some_map(FEW)))
    del scalars["course_rate"]
    assert load_map(write(tmp_path / "map.mcap", [encode(scalars, tables)])).motion.course_rate == 2.0


def test_what_is_no_map_is_reported(tmp_path):
    path, data = tmp_path / "log.mcap", encoded(some_map(FEW))
    for messages, given, why in (
        ([], {}, "expected a map.*dirprim learn"),
        ([data], {"topic": "/other"}, "expected a map.*dirprim learn"),
        ([b"\x58\x04"], {"wrapped": bytes}, ".*of an older version.*learn it again"),
        ([b"\x0a\xff"], {"wrapped": bytes}, ".*of protobuf, got.*learn it again"),
        ([data] * 2, {}, ".*expected one message, got 2, as of an older version"),
    ):
        with pytest.raises(RecordingError, match=rf"log\.mcap: {why}"):
            load_map(write(path, messages, **given))
    save_map(some_map(500), path, force=True)
    whole = path.read_bytes()
    middle = len(whole) // 2
    for harmed, why in (
        (b"no log at all", "expected an MCAP log"),
        (whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :], r"log\.mcap: cannot be read.*damaged"),
    ):
        path.write_bytes(harmed)
        with pytest.raises(RecordingError, match=why):
            load_map(path)


def number(name, value):
    """Set a scalar."""
    return lambda scalars, tables: scalars.__setitem__(name, value)


def cell(table, column, row, value):
    """Set a number of a table, or all of a row's."""
    return lambda scalars, tables: tables[table][column].__setitem__(row, value)


def column(table, name, made):
    return lambda scalars, tables: tables[table].__setitem__(name, made(tables[table][name]))


HARMS = [
    (number("version", 6), "an older version, 6"),
    (number("version", "7"), "version: expected a whole number, got '7'"),
    (number("n_x", 1.5), "n_x: expected int, got 1.5"),
    (number("kind", "hexagons"), "kind: expected grid or voronoi"),
    (number("n_x", 2**40), "squares, more than"),
    (number("origin_x", -1e300), "origin: expected places within"),
    (number("n_background_modes", 9), "n_background_modes: expected 0 to 3"),
    (number("background_visits", np.nan), "background_visits: expected a positive"),
    (number("course_rate", 0.0), "course_rate: expected a positive"),
    (lambda _, tables: tables.pop("row"), "row.weight: expected float64, got none"),
    (lambda _, tables: tables["manoeuvre"].pop("push"), "manoeuvre.push: expected float64, got none"),
    (column("square", "number", lambda of: of.astype(np.float64)), "square.number: expected int64"),
    (column("row", "rate", lambda of: of[:, :2]), "expected"),
    (cell("row", "weight", 0, 0.9), "expected to sum to one"),
    (cell("row", "rate", 0, np.nan), "rate: expected finite"),
    (cell("square", "number", -1, 2**62), "square: expected numbers"),
    (cell("manoeuvre", "path", 2, -np.inf), "expected finite"),
    (cell("manoeuvre", "push", 2, -1.0), "push: expected no negative"),
    (cell("transition", "count", 2, -1.0), "count: expected no negative"),
    (cell("manoeuvre", "cell", -1, -2), "expected cells in ascending order"),
    (cell("manoeuvre", "cell", 19, 2**62), "expected manoeuvres of 10 cells and 3 modes"),
    (cell("manoeuvre", "mode", 0, -1), "expected manoeuvres of 10 cells and 3 modes"),
    (cell("manoeuvre", "n_following", 0, -(2**63)), "n_following: expected numbers that sum to"),
    (cell("transition", "following", 0, 23), "expected transitions to manoeuvres 0 to 22"),
    (cell("place", "center", 0, np.inf), "generators: expected finite"),
    (column("place", "center", lambda of: 1e300 + 1e290 * of), "places within 1e.09 m"),
]  # the fuzzer has them by the hundred, with checks of bounds


@pytest.mark.parametrize(("harm", "message"), HARMS)
def test_a_harmed_map_is_reported_in_one_line(tmp_path, harm, message):
    """Of Voronoi cells, which have the squares of a grid too."""
    scalars, tables = opened(encoded(some_map(10, voronoi=True)))
    harm(scalars, tables)
    path = write(tmp_path / "map.mcap", [encode(scalars, tables)])
    with pytest.raises(RecordingError, match=message) as caught:
        load_map(path)
    assert "map.mcap" in str(caught.value)
    assert "\n" not in str(caught.value)
