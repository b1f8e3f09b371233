"""A map of directional primitives as messages `dirprim.PrimitiveMap`: some cells that follow each other in each.

A message is an `ArrowMessage` of tables: `cell` with a row for each of its cells, `square` (those that are the cells of
a grid, or near the data), `manoeuvre` with a row for each manoeuvre of these cells, `transition` with what followed
them. Put one after the other, tables are those of the map. What every tile repeats is `SHARED`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.leader import LeaderResponse
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.schemas.arrow_message import ArrowMessage, Columns, encode
from tessellation import GridTessellation, Tessellation, VoronoiTessellation

VERSION = 6
"""Of the messages; a map of another version has other tables."""
TILE_CELLS = 4096
"""Cells in a message, at most: some 0.5 MB at three modes, so that a damaged chunk is small."""
MOST_MODES = 4096
"""Of a cell: no map has so many, and kernels make room for them."""

ROW = ("weight", "mean_direction", "concentration", "shape", "rate", "bend", "gain")
"""Columns of the modes of each cell."""
LEADER = ("gain", "push", "trust", "start_rate")
SHARED = (
    "version", "n_tiles", "n_background_modes", "kind", "origin_x", "origin_y", "cell_size", "n_x", "n_y",
    "background_visits",
    "background", "background_manoeuvre", "background_transition", "leader",
)  # fmt: skip
"""What every tile repeats."""


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
    found: dict[int, ArrowMessage] = {}
    for data in messages:
        tile = ArrowMessage(data)
        _check_version(tile)
        number = tile.scalar("tile", int)
        if number in found:
            raise ValueError(f"tile {number}: expected once, got twice")
        found[number] = tile
    if not found:
        raise ValueError("expected at least one tile of a map, got none")
    tiles = [found[number] for number in sorted(found)]
    shared, n_tiles = tiles[0], tiles[0].scalar("n_tiles", int)
    # Compared by number: the count comes from the file, and a range of it could be of any length.
    if len(found) != n_tiles or min(found) != 0 or max(found) != n_tiles - 1:
        raise ValueError(f"expected tiles 0 to {n_tiles - 1}, got {len(found)} of them")
    if not all(tile is shared or tile.part(SHARED).equals(shared.part(SHARED)) for tile in tiles):
        raise ValueError("expected the tiles of one map, got tiles of several")
    cells = _joined(tiles, "cell", floats=(*ROW, "place"), whole=("n_rows",))
    last = shared.table("background", floats=ROW, whole=("n_rows",))
    if any(last[name].shape != (1, *cells[name].shape[1:]) for name in last) or cells["weight"].shape[-1] > MOST_MODES:
        raise ValueError(f"background: expected one row, as wide as those of the cells, at most {MOST_MODES} modes")
    rows = {name: np.concatenate([cells[name], last[name]]) for name in last}
    return PrimitiveMap(
        tessellation=_tessellation(tiles, cells["place"]),
        direction=VonMisesMixture(**{name: rows[name] for name in ROW[:3]}),
        speed=Gamma(**{name: rows[name] for name in ROW[3:5]}),
        n_rows=rows["n_rows"],
        n_background_modes=shared.scalar("n_background_modes", int),
        **{name: _folded(name, rows[name], (*rows["weight"].shape, 2)) for name in ROW[5:]},
        motion=_motion(tiles),
    )


def _check_version(message: ArrowMessage) -> None:
    version = message.scalar("version", int)
    if version != VERSION:
        age = "an older" if version < VERSION else "a newer"
        raise ValueError(f"it is of {age} version, {version}; this program reads version {VERSION}")


def _joined(tiles: list[ArrowMessage], name: str, **columns: Any) -> Columns:
    return _put_together(name, [tile.table(name, **columns) for tile in tiles])


def _put_together(name: str, parts: list[Columns]) -> Columns:
    widths = {of: {column.shape[1:] for column in (part[of] for part in parts)} for of in parts[0]}
    if uneven := [of for of, shapes in widths.items() if len(shapes) > 1]:
        raise ValueError(f"{name}.{uneven[0]}: expected tiles of one map, got tiles of several")
    return {of: np.concatenate([part[of] for part in parts]) for of in parts[0]}


def _tessellation(tiles: list[ArrowMessage], place: AnyArray) -> Tessellation:
    of, kind = tiles[0], tiles[0].scalar("kind", str)
    if kind not in ("grid", "voronoi"):
        raise ValueError(f"kind: expected grid or voronoi, got {kind!r}")
    square = _joined(tiles, "square", whole=("number",))
    squares = GridTessellation(
        origin=np.array([of.scalar("origin_x", float), of.scalar("origin_y", float)]),
        cell_size=of.scalar("cell_size", float),
        n_x=of.scalar("n_x", int), n_y=of.scalar("n_y", int), square=square["number"],
    )  # fmt: skip
    return squares if kind == "grid" else VoronoiTessellation(generators=place, region=squares)


def _motion(tiles: list[ArrowMessage]) -> Motion:
    shared = tiles[0]
    columns, after = (
        _put_together(placed, [_joined(tiles, placed, **names), shared.table(free, **names)])
        for placed, free, names in (
            ("manoeuvre", "background_manoeuvre", {"floats": FLOATS, "whole": ("cell", "mode", "n_following")}),
            ("transition", "background_transition", {"floats": ("count",), "whole": ("following",)}),
        )
    )  # fmt: skip
    n = columns.pop("n_following")
    if ((n < 0) | (n > after["count"].size)).any() or n.sum() != after["count"].size:
        raise ValueError(f"n_following: expected numbers that sum to {after['count'].size} transitions, got others")
    leaders = shared.table("leader", floats=LEADER)
    of_leader: list[dict[str, Any]] = [
        {name: column[i] if column.ndim > 1 else float(column[i]) for name, column in leaders.items()}
        for i in range(len(leaders["trust"]))
    ]
    made: dict[str, Any] = {**columns, **after, "background_visits": shared.scalar("background_visits", float)}
    return Motion(
        **made, first=np.append(0, np.cumsum(n)),
        leader=LeaderResponse(**of_leader[0]) if of_leader else None,
    )  # fmt: skip


def _folded(name: str, column: AnyArray, shape: tuple[int, ...]) -> AnyArray:
    if column.size != np.prod(shape):
        raise ValueError(f"{name}: expected {shape} numbers, got {column.shape}")
    return column.reshape(shape)
