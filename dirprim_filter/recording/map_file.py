"""A map file: an MCAP log with `/dirprim/map`, a message of its cells, and a drawing of them.

The message `dirprim.PrimitiveMap` holds an Arrow IPC stream in protobuf, as Foxglove reports an error for each topic
that is in no encoding it knows. The stream is one record batch with one row, of numbers, texts and tables:
`row` with the modes of each cell and then of the background, `place` with the cells' centres, `square` (those that are
the cells of a grid, or near the data), `manoeuvre` of all cells and then of the background, and `transition` with what
followed them. A table is a list of structs, so that its columns are of one length however the bytes were made; a column
of several numbers in each row is one of fixed-size lists. Any reader of Arrow opens it, such as
`pyarrow.ipc.open_stream(message.arrow)`. Where positions have an origin, `latitude_deg` and `longitude_deg` are it.

Source: https://arrow.apache.org/docs/format/Columnar.html.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from google.protobuf.message import DecodeError

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray, require
from dirprim_filter.columns import GLOBE
from dirprim_filter.origin import Origin
from dirprim_filter.primitives._modes import Modes
from dirprim_filter.primitives.leader import LeaderResponse
from dirprim_filter.primitives.motion import COURSE_RATE, FLOATS, Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording import topic_names
from dirprim_filter.recording.container.log import Scan
from dirprim_filter.recording.container.records import Message
from dirprim_filter.recording.errors import RecordingError, warn
from dirprim_filter.recording.foxglove.elements import origin_of, scene_transform, view_of
from dirprim_filter.recording.foxglove.scenes import map_scenes
from dirprim_filter.recording.log_writer import LogWriter
from dirprim_filter.recording.schemas import dirprim_pb2
from tessellation import GridTessellation, Tessellation, VoronoiTessellation
from tessellation.protocols import checked

MAP = dirprim_pb2.PrimitiveMap.DESCRIPTOR.full_name
"""Name of the schema."""


def save_map(
    primitive_map: PrimitiveMap, path: str | Path, *, metadata: Mapping[str, str] | None = None, force: bool = False
) -> None:
    """Write a map; `load_map` gives it back bit for bit. The same map gives the same bytes.

    That takes up to 6 kB of memory for each cell, most of it for the drawing.

    Args:
        primitive_map: what to write.
        path: the MCAP file.
        metadata: goes into the `dirprim` metadata record: configuration, seed, the inputs' checksums.
        force: overwrite an existing file.

    Raises:
        OutputExistsError: the file exists, and `force` is not set.
        OSError: the file cannot be written.
        TypeError: it is no map, or its cells do not state their parameters, see `tessellation.Tessellation`.
    """
    require("primitive_map", primitive_map, PrimitiveMap)
    with LogWriter(path, metadata=metadata or {}, force=force) as log:
        origin = origin_of(view_of(primitive_map))
        write_map(log, primitive_map, 0, origin)  # a map holds at no time of its own
        log.write(topic_names.TRANSFORM, scene_transform(0, origin), 0)


def write_map(log: LogWriter, primitive_map: PrimitiveMap, time_ns: int, origin: FloatArray) -> None:
    """Append a map, and its drawing in the scene's frame with this origin, (2,) metres.

    Raises:
        TypeError: as `encoded`.
    """
    log.write(topic_names.MAP, dirprim_pb2.PrimitiveMap(arrow=encoded(primitive_map)), time_ns)
    log.end_chunk()  # damage to the drawing costs no cell
    for drawn in map_scenes(primitive_map, time_ns, origin):
        log.write(topic_names.MAP_SCENE, drawn, time_ns)


def load_map(path: str | Path, *, tessellation: Callable[..., Tessellation] | None = None) -> PrimitiveMap:
    """Read a map that `save_map` wrote.

    A damaged file gives its map if its message can be read; that is logged.

    Args:
        path: the MCAP file.
        tessellation: the class of its cells, where they are neither squares nor Voronoi cells.

    Raises:
        RecordingError: the file is no map, or a part of it is missing or broken.
        OSError: the file cannot be read.
    """
    # Of its topic alone: the drawing of a city is many times as large as what it is drawn from.
    with Scan(path, topic_names.MAP.__eq__) as scan:
        found = [message for message in scan if message.schema_name == MAP]
    if not found and not scan.damage:
        raise RecordingError(f"{path}: expected a map, with messages of {MAP}, got none; make one with `dirprim learn`")
    try:
        primitive_map = map_of(_data(found), tessellation)
    except ValueError as error:
        broken = f" (the file is damaged: {scan.damage[0]})" if scan.damage else ""
        raise RecordingError(
            f"{path}: cannot be read as a map: {error}{broken}; learn it again with `dirprim learn`"
        ) from error
    if scan.damage:
        warn(path, f"the map is whole, but the file is damaged: {scan.damage[0]}")
    return primitive_map


def _data(found: list[Message]) -> bytes:
    """The bytes of the only message.

    Raises:
        ValueError: there is none, or several, as before version 7; or it is no protobuf, or without a stream, as before
            version 5.
    """
    if len(found) != 1:
        raise ValueError(f"expected one message, got {len(found)}{', as of an older version' * bool(found)}")
    if found[0].message_encoding == "arrow":  # as of 2026: the stream alone
        return found[0].data
    try:
        message = dirprim_pb2.PrimitiveMap.FromString(found[0].data)
    except DecodeError as error:
        raise ValueError(f"expected a message of protobuf, got {error}") from error
    if not message.arrow:
        raise ValueError("expected an Arrow stream, got none, as of an older version")
    return message.arrow


Columns = dict[str, AnyArray]
KINDS = ("grid", "voronoi")
VERSION = 7
"""Of the message; a map of another version has other tables."""
MOST_MODES = 4096
"""Of a cell: no map has so many, and kernels make room for them."""

ROW = Modes._fields
"""Columns of the modes of each cell."""
LEADER = ("gain", "push", "trust", "start_rate")
SCALARS = {"version": int, "n_background_modes": int, "kind": str, "background_visits": float, "course_rate": float}
SQUARES = {"origin_x": float, "origin_y": float, "cell_size": float, "n_x": int, "n_y": int}
"""Scalars of grids and of Voronoi cells."""
OTHERS = "cells."
"""Before the names of parameters of other cells."""
TABLES = {
    "row": (*ROW, "n_rows"), "place": ("center",), "square": ("number",),
    "manoeuvre": ("cell", "mode", "n_following", *FLOATS), "transition": ("following", "count"), "leader": LEADER,
}  # fmt: skip
"""Columns by table, of float64 but for `WHOLE`, which are int64."""
WHOLE = {"n_rows", "number", "cell", "mode", "n_following", "following"}


def encoded(primitive_map: PrimitiveMap) -> bytes:
    """The message of a map.

    Raises:
        TypeError: cells of a kind that the message does not know.
    """
    cells, motion = primitive_map.tessellation, primitive_map.motion
    kind, scalars, square, others = _cells(cells)
    leaders = [motion.leader] if motion.leader else []
    scalars = {
        "version": VERSION, "n_background_modes": primitive_map.n_background_modes, "kind": kind, **scalars,
        "background_visits": float(motion.background_visits), "course_rate": float(motion.course_rate),
    }  # fmt: skip
    scalars |= primitive_map.origin._asdict() if primitive_map.origin else {}
    return encode(scalars, {
        "row": primitive_map.modes._asdict() | {"n_rows": primitive_map.n_rows},
        "place": {"center": cells.centers.reshape(-1, 2)}, "square": {"number": square},
        "manoeuvre": {"cell": motion.cell, "mode": motion.mode, "n_following": np.diff(motion.first)}
        | {name: getattr(motion, name) for name in FLOATS},
        "transition": {"following": motion.following, "count": motion.count},
        "leader": {name: np.array([getattr(of, name) for of in leaders], np.float64) for name in LEADER}, **others,
    })  # fmt: skip


def _cells(cells: Tessellation) -> tuple[str, dict[str, Any], IntArray, dict[str, Columns]]:
    """Their kind, scalars, squares and further tables."""
    if isinstance(cells, GridTessellation | VoronoiTessellation):
        kind, grid = ("grid", cells) if isinstance(cells, GridTessellation) else ("voronoi", cells.region)
        values = *grid.origin.tolist(), float(grid.cell_size), grid.n_x, grid.n_y
        return kind, dict(zip(SQUARES, values, strict=True)), grid.square, {}
    kind, parameters = type(cells).__name__, getattr(cells, "parameters", None)
    if not isinstance(parameters, Mapping):
        raise TypeError(f"tessellation: expected {kind}.parameters, a dict by which {kind} makes it again, got none")
    scalars, tables = dict[str, Any](), dict[str, Columns]()
    for name, value in parameters.items():
        array = np.asarray(value)
        if array.dtype not in (np.int64, np.float64) or array.ndim > 2:
            raise TypeError(f"tessellation: expected {kind}.parameters of int64 or float64, got {name} = {value!r}")
        if array.ndim:
            tables[OTHERS + name] = {"value": array}
        else:
            scalars[OTHERS + name] = array.item()
    return kind, scalars, np.empty(0, np.int64), tables


def map_of(data: bytes, tessellation: Callable[..., Tessellation] | None = None) -> PrimitiveMap:
    """The map of a message.

    What it holds is checked where it is made into a value: by `Motion`, `PrimitiveMap` and what these consist of.

    Raises:
        ValueError: bytes that are no such message, another version of it, or numbers that make no map.
    """
    scalars, tables = decode(data)
    scalars.setdefault("course_rate", COURSE_RATE)  # all had this one before it was learned
    _check(scalars, tables)
    rows = tables["row"]
    modes = rows["weight"].shape
    if len(modes) < 2 or modes[1] > MOST_MODES:
        raise ValueError(f"row.weight: expected at most {MOST_MODES} modes, got {modes[1:]}")
    return PrimitiveMap(
        tessellation=_tessellation(scalars, tables, tessellation),
        modes=Modes(
            **{name: rows[name] for name in ROW[:5]}, **{name: rows[name].reshape(*modes, 2) for name in ROW[5:]}
        ),
        n_rows=rows["n_rows"],
        n_background_modes=scalars["n_background_modes"],
        motion=_motion(scalars, tables),
        origin=Origin.of([scalars[name] for name in GLOBE if name in scalars] or None),
    )


def _check(scalars: dict[str, Any], tables: dict[str, Columns]) -> None:
    """It is of this version, and has all that one has, of its type."""
    version = scalars.get("version")
    if type(version) is not int:
        raise ValueError(f"version: expected a whole number, got {version!r}")
    if version != VERSION:
        age = "an older" if version < VERSION else "a newer"
        raise ValueError(f"it is of {age} version, {version}; this program reads version {VERSION}")
    for name, kind in (SCALARS | (SQUARES if scalars.get("kind") in KINDS else {})).items():
        if type(scalars.get(name)) is not kind:
            raise ValueError(f"{name}: expected {kind.__name__}, got {scalars.get(name)!r}")
    for name, columns in TABLES.items():
        for of in columns:
            dtype, column = np.int64 if of in WHOLE else np.float64, tables.get(name, {}).get(of)
            if column is None or column.dtype != dtype:
                got = "none" if column is None else str(column.dtype)
                raise ValueError(f"{name}.{of}: expected {np.dtype(dtype)}, got {got}")


def _tessellation(
    scalars: dict[str, Any], tables: dict[str, Columns], others: Callable[..., Tessellation] | None
) -> Tessellation:
    kind, center = scalars["kind"], tables["place"]["center"]
    if kind in KINDS:
        squares = GridTessellation(
            origin=np.array([scalars["origin_x"], scalars["origin_y"]]), cell_size=scalars["cell_size"],
            n_x=scalars["n_x"], n_y=scalars["n_y"], square=tables["square"]["number"],
        )  # fmt: skip
        return squares if kind == "grid" else VoronoiTessellation(generators=center, region=squares)
    if others is None or getattr(others, "__name__", None) != kind:
        raise ValueError(
            f"kind: expected grid or voronoi, got {kind!r}; load_map(path, tessellation={kind}) takes its class"
        )
    given = scalars | {name: columns.get("value") for name, columns in tables.items()}
    parameters = {name.removeprefix(OTHERS): value for name, value in given.items() if name.startswith(OTHERS)}
    try:
        return checked(others(**parameters), center)
    except (TypeError, LookupError, ArithmeticError) as error:  # of the class of a user, by numbers of a file
        raise ValueError(f"kind: {kind} cannot be made of {', '.join(parameters)}: {error}") from error


def _motion(scalars: dict[str, Any], tables: dict[str, Columns]) -> Motion:
    columns, after = dict(tables["manoeuvre"]), tables["transition"]
    n = columns.pop("n_following")
    if ((n < 0) | (n > after["count"].size)).any() or n.sum() != after["count"].size:
        raise ValueError(f"n_following: expected numbers that sum to {after['count'].size} transitions, got others")
    leader, leaders = None, tables["leader"]
    if len(leaders["trust"]):
        push, trust = float(leaders["push"][0]), float(leaders["trust"][0])
        leader = LeaderResponse(gain=leaders["gain"][0], push=push, trust=trust, start_rate=leaders["start_rate"][0])
    rates = {name: scalars[name] for name in ("background_visits", "course_rate")}
    made: dict[str, Any] = {**columns, **after, **rates}
    return Motion(**made, first=np.append(0, np.cumsum(n)), leader=leader)


def encode(scalars: Mapping[str, int | float | str], tables: Mapping[str, Mapping[str, AnyArray]]) -> bytes:
    """The message.

    Args:
        scalars: by name.
        tables: by name, (n, ...) int64 or float64 columns by name.
    """
    arrays = [pa.array([value]) for value in scalars.values()]
    for columns in tables.values():
        struct = pa.StructArray.from_arrays([_array(column) for column in columns.values()], names=list(columns))
        arrays.append(pa.ListArray.from_arrays(pa.array([0, len(struct)], pa.int32()), struct))
    batch = pa.RecordBatch.from_arrays(arrays, names=[*scalars, *tables])
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
    return bytes(sink.getvalue())


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
            struct = column[0].values  # as does `flatten`, which imports all functions of pyarrow
            parts = zip(struct.type, struct.flatten(), strict=True)
            tables[name] = {of.name: _numbers(f"{name}.{of.name}", array) for of, array in parts}
        elif column.type in (pa.int64(), pa.float64(), pa.string()):
            scalars[name] = column[0].as_py()
        else:
            raise ValueError(f"{name}: expected a number, a text or a table, got {column.type}")
    return scalars, tables


def _numbers(name: str, array: Any) -> AnyArray:
    width = array.type.list_size if pa.types.is_fixed_size_list(array.type) else 0
    first = array.offset * width
    flat = array.values[first : first + len(array) * width] if width and not array.null_count else array
    if flat.type not in (pa.int64(), pa.float64()) or flat.null_count:
        raise ValueError(f"{name}: expected int64 or float64 without nulls, got {array.type}")
    numbers = flat.to_numpy()
    return np.asarray(numbers.reshape(len(array), width) if width else numbers)
