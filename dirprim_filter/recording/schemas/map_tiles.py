"""A map of directional primitives as messages `dirprim.PrimitiveMap`: some cells that follow each other in each.

A message is an Arrow IPC stream: one record batch with one row, of numbers, texts and tables: `cell` with a row for
each of its cells, `square` (those that are the cells of a grid, or near the data), `manoeuvre` with a row for each
manoeuvre of these cells, `transition` with what followed them. Put one after the other, tables are those of the map.
What every tile repeats is `REPEATED`. A table is a list of structs, so that its columns are of one length however the
bytes were made; a column of several numbers in each row is one of fixed-size lists. Any reader of Arrow opens it, such
as `pyarrow.ipc.open_stream(data)`.

Source: https://arrow.apache.org/docs/format/Columnar.html.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from dirprim_filter.arrays import AnyArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.leader import LeaderResponse
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from tessellation import GridTessellation, Tessellation, VoronoiTessellation

Columns = dict[str, AnyArray]
ENCODING = "arrow"
"""Of messages and schemas, as MCAP names it."""


def encode(scalars: Mapping[str, int | float | str], tables: Mapping[str, Mapping[str, AnyArray]]) -> bytes:
    """The message.

    Args:
        scalars: by name.
        tables: by name, (n, ...) int64 or float64 columns by name.
    """
    arrays = [pa.array([value]) for value in scalars.values()] + [_listed(columns) for columns in tables.values()]
    batch = pa.RecordBatch.from_arrays(arrays, names=[*scalars, *tables])
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
    return bytes(sink.getvalue())


def _listed(columns: Mapping[str, AnyArray]) -> Any:
    struct = pa.StructArray.from_arrays([_array(column) for column in columns.values()], names=list(columns))
    return pa.ListArray.from_arrays(pa.array([0, len(struct)], pa.int32()), struct)


def _array(column: AnyArray) -> Any:
    flat = pa.array(np.ascontiguousarray(column).reshape(-1))
    return flat if column.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, int(np.prod(column.shape[1:])))


def decode(data: bytes) -> tuple[dict[str, Any], dict[str, Columns]]:
    """The scalars and the tables of a message, of bytes that may be anybody's: as `encode` takes them.

    Raises:
        ValueError: they are no such message, or hold a null.
    """
    try:
        with pa.ipc.open_stream(data) as stream:
            batch = stream.read_next_batch()
        batch.validate(full=True)  # offsets within their buffers, texts of UTF-8
    except (pa.ArrowException, OSError, StopIteration) as error:
        reason = str(error).partition("\n")[0] or "an end before a row"
        raise ValueError(f"expected an Arrow stream, got {reason}") from error
    if batch.num_rows != 1:
        raise ValueError(f"expected an Arrow stream of one row, got {batch.num_rows}")
    scalars, tables = dict[str, Any](), dict[str, Columns]()
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        if name in scalars or name in tables or column.null_count:
            raise ValueError(f"{name}: expected once, and no null")
        if pa.types.is_list(column.type) and pa.types.is_struct(column.type.value_type):
            struct = column.flatten()
            parts = zip(struct.type, struct.flatten(), strict=True)
            tables[name] = {of.name: _numbers(f"{name}.{of.name}", array) for of, array in parts}
        elif column.type in (pa.int64(), pa.float64(), pa.string()):
            scalars[name] = column[0].as_py()
        else:
            raise ValueError(f"{name}: expected a number, a text or a table, got {column.type}")
    return scalars, tables


def _numbers(name: str, array: Any) -> AnyArray:
    width = array.type.list_size if pa.types.is_fixed_size_list(array.type) else 0
    flat = array.flatten() if width and not array.null_count else array
    if flat.type not in (pa.int64(), pa.float64()) or flat.null_count:
        raise ValueError(f"{name}: expected int64 or float64 without nulls, got {array.type}")
    numbers = flat.to_numpy()
    return np.asarray(numbers.reshape(len(array), width) if width else numbers)


VERSION = 6
"""Of the messages; a map of another version has other tables."""
TILE_CELLS = 4096
"""Cells in a message, at most: some 0.5 MB at three modes, so that a damaged chunk is small."""
MOST_MODES = 4096
"""Of a cell: no map has so many, and kernels make room for them."""

ROW = ("weight", "mean_direction", "concentration", "shape", "rate", "bend", "gain")
"""Columns of the modes of each cell."""
LEADER = ("gain", "push", "trust", "start_rate")
SCALARS = {
    "version": int, "tile": int, "n_tiles": int, "n_background_modes": int, "kind": str, "origin_x": float,
    "origin_y": float, "cell_size": float, "n_x": int, "n_y": int, "background_visits": float,
}  # fmt: skip
_MANOEUVRE, _TRANSITION = ("cell", "mode", "n_following", *FLOATS), ("following", "count")
TABLES = {
    "cell": ("place", *ROW, "n_rows"), "square": ("number",), "manoeuvre": _MANOEUVRE, "transition": _TRANSITION,
    "background": (*ROW, "n_rows"), "background_manoeuvre": _MANOEUVRE, "background_transition": _TRANSITION,
    "leader": LEADER,
}  # fmt: skip
"""Columns by table, of float64 but for `WHOLE`, which are int64."""
WHOLE = {"n_rows", "number", "cell", "mode", "n_following", "following"}
REPEATED = ("background", "background_manoeuvre", "background_transition", "leader")
"""Tables that every tile repeats, as it does all scalars but its own number."""


def encoded_tiles(primitive_map: PrimitiveMap) -> Iterator[bytes]:
    """The message of each tile of a map, at least one.

    Raises:
        TypeError: cells of a kind that the messages do not know.
    """
    cells, motion = primitive_map.tessellation, primitive_map.motion
    if not isinstance(cells, GridTessellation | VoronoiTessellation):
        raise TypeError(f"tessellation: expected a GridTessellation or VoronoiTessellation, got {type(cells).__name__}")
    grid = cells if isinstance(cells, GridTessellation) else cells.region
    n_tiles = max(-(-cells.n_cells // TILE_CELLS), 1)
    scalars = {
        "version": VERSION, "n_tiles": n_tiles, "n_background_modes": primitive_map.n_background_modes,
        "kind": "grid" if grid is cells else "voronoi", "origin_x": float(grid.origin[0]),
        "origin_y": float(grid.origin[1]), "cell_size": float(grid.cell_size), "n_x": grid.n_x, "n_y": grid.n_y,
        "background_visits": float(motion.background_visits),
    }  # fmt: skip
    free, after_free = _manoeuvres(motion, motion.n_placed, len(motion))
    leaders = [motion.leader] if motion.leader else []
    shared = {
        "background": _rows(primitive_map, slice(cells.n_cells, None)), "background_manoeuvre": free,
        "background_transition": after_free,
        "leader": {name: np.array([getattr(of, name) for of in leaders], np.float64) for name in LEADER},
    }  # fmt: skip
    ends = np.minimum(TILE_CELLS * np.arange(n_tiles + 1), cells.n_cells)
    begins = np.searchsorted(motion.cell[: motion.n_placed], ends)
    for i, square in enumerate(np.array_split(grid.square, n_tiles)):
        own = slice(ends[i], ends[i + 1])
        manoeuvres, transitions = _manoeuvres(motion, begins[i], begins[i + 1])
        yield encode(scalars | {"tile": i}, shared | {
            "cell": {"place": cells.centers.reshape(-1, 2)[own]} | _rows(primitive_map, own),
            "square": {"number": square}, "manoeuvre": manoeuvres, "transition": transitions,
        })  # fmt: skip


def _rows(primitive_map: PrimitiveMap, rows: slice) -> Columns:
    direction, speed = primitive_map.direction, primitive_map.speed
    columns = (
        direction.weight, direction.mean_direction, direction.concentration, speed.shape, speed.rate,
        primitive_map.bend, primitive_map.gain,
    )  # fmt: skip
    of_modes = {name: column[rows] for name, column in zip(ROW, columns, strict=True)}
    return of_modes | {"n_rows": primitive_map.n_rows[rows]}


def _manoeuvres(motion: Motion, begin: int, end: int) -> tuple[Columns, Columns]:
    """The manoeuvres from one to before another, and the transitions from them."""
    own, after = slice(begin, end), slice(motion.first[begin], motion.first[end])
    columns: Columns = {"cell": motion.cell[own], "mode": motion.mode[own], "n_following": np.diff(motion.first)[own]}
    columns |= {name: getattr(motion, name)[own] for name in FLOATS}
    return columns, {"following": motion.following[after], "count": motion.count[after]}


def map_of(messages: Iterable[bytes]) -> PrimitiveMap:
    """The map of all its tiles, in any order.

    What they hold is checked where it is made into a value: by `Motion`, `PrimitiveMap` and what these consist of.

    Raises:
        ValueError: bytes that are no such message, another version of it, a tile that is missing, twice there or of
            another map, or numbers that make no map.
    """
    found: dict[int, dict[str, Columns]] = {}
    shared: dict[str, Any] = {}
    for data in messages:
        scalars, tables = decode(data)
        _check(scalars, tables)
        number = scalars.pop("tile")
        if number in found:
            raise ValueError(f"tile {number}: expected once, got twice")
        found[number] = tables
        shared = shared or scalars
        if scalars != shared or not all(_equal(tables[name], next(iter(found.values()))[name]) for name in REPEATED):
            raise ValueError("expected the tiles of one map, got tiles of several")
    if not found:
        raise ValueError("expected at least one tile of a map, got none")
    n_tiles = shared["n_tiles"]
    # Compared by number: the count comes from the file, and a range of it could be of any length.
    if len(found) != n_tiles or min(found) != 0 or max(found) != n_tiles - 1:
        raise ValueError(f"expected tiles 0 to {n_tiles - 1}, got {len(found)} of them")
    tiles = [found[number] for number in sorted(found)]
    cell, square = (_joined(name, [tile[name] for tile in tiles]) for name in ("cell", "square"))
    place = cell.pop("place")
    if len(tiles[0]["background"]["n_rows"]) != 1:
        raise ValueError(f"background: expected one row, got {len(tiles[0]['background']['n_rows'])}")
    rows = _joined("background", [cell, tiles[0]["background"]])
    if rows["weight"].ndim < 2 or rows["weight"].shape[1] > MOST_MODES:
        raise ValueError(f"cell.weight: expected at most {MOST_MODES} modes, got {rows['weight'].shape[1:]}")
    return PrimitiveMap(
        tessellation=_tessellation(shared, square["number"], place),
        direction=VonMisesMixture(**{name: rows[name] for name in ROW[:3]}),
        speed=Gamma(**{name: rows[name] for name in ROW[3:5]}),
        n_rows=rows["n_rows"],
        n_background_modes=shared["n_background_modes"],
        **{name: _folded(name, rows[name], (*rows["weight"].shape, 2)) for name in ROW[5:]},
        motion=_motion(shared, tiles),
    )


def _check(scalars: dict[str, Any], tables: dict[str, Columns]) -> None:
    """A tile is of this version, and has all that one has, of its type."""
    version = scalars.get("version")
    if type(version) is not int:
        raise ValueError(f"version: expected a whole number, got {version!r}")
    if version != VERSION:
        age = "an older" if version < VERSION else "a newer"
        raise ValueError(f"it is of {age} version, {version}; this program reads version {VERSION}")
    for name, kind in SCALARS.items():
        if type(scalars.get(name)) is not kind:
            raise ValueError(f"{name}: expected {kind.__name__}, got {scalars.get(name)!r}")
    for name, columns in TABLES.items():
        for of in columns:
            dtype, column = np.int64 if of in WHOLE else np.float64, tables.get(name, {}).get(of)
            if column is None or column.dtype != dtype:
                got = "none" if column is None else str(column.dtype)
                raise ValueError(f"{name}.{of}: expected {np.dtype(dtype)}, got {got}")


def _equal(one: Columns, other: Columns) -> bool:
    return all(np.array_equal(one[name], column) for name, column in other.items() if name in one)


def _joined(name: str, parts: list[Columns]) -> Columns:
    """The rows of all parts, one after the other."""
    for of in parts[-1]:
        if len(shapes := {part[of].shape[1:] for part in parts if of in part}) > 1:
            raise ValueError(f"{name}.{of}: expected rows as wide as others, got {shapes}")
    return {of: np.concatenate([part[of] for part in parts]) for of in TABLES[name] if of in parts[-1]}


def _tessellation(shared: dict[str, Any], square: AnyArray, place: AnyArray) -> Tessellation:
    if shared["kind"] not in ("grid", "voronoi"):
        raise ValueError(f"kind: expected grid or voronoi, got {shared['kind']!r}")
    squares = GridTessellation(
        origin=np.array([shared["origin_x"], shared["origin_y"]]), cell_size=shared["cell_size"],
        n_x=shared["n_x"], n_y=shared["n_y"], square=square,
    )  # fmt: skip
    return squares if shared["kind"] == "grid" else VoronoiTessellation(generators=place, region=squares)


def _motion(shared: dict[str, Any], tiles: list[dict[str, Columns]]) -> Motion:
    columns, after = (
        _joined(name, [*(tile[name] for tile in tiles), tiles[0][f"background_{name}"]])
        for name in ("manoeuvre", "transition")
    )
    n = columns.pop("n_following")
    if ((n < 0) | (n > after["count"].size)).any() or n.sum() != after["count"].size:
        raise ValueError(f"n_following: expected numbers that sum to {after['count'].size} transitions, got others")
    leader, leaders = None, tiles[0]["leader"]
    if len(leaders["trust"]):
        push, trust = float(leaders["push"][0]), float(leaders["trust"][0])
        leader = LeaderResponse(gain=leaders["gain"][0], push=push, trust=trust, start_rate=leaders["start_rate"][0])
    made: dict[str, Any] = {**columns, **after, "background_visits": shared["background_visits"]}
    return Motion(**made, first=np.append(0, np.cumsum(n)), leader=leader)


def _folded(name: str, column: AnyArray, shape: tuple[int, ...]) -> AnyArray:
    if column.size != np.prod(shape):
        raise ValueError(f"{name}: expected {shape} numbers, got {column.shape}")
    return column.reshape(shape)
