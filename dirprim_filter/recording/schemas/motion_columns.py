"""The motion of a map as `dirprim.Motion` messages, a part of its manoeuvres and transitions in each tile.

Source: dirprim.proto. Columns travel as packed numbers, so motion comes back bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, cast

import numpy as np

from dirprim_filter.arrays import AnyArray
from dirprim_filter.primitives.leader import N_FEATURES, N_PACES, LeaderResponse
from dirprim_filter.primitives.motion import FLOATS, Motion
from dirprim_filter.recording.schemas import dirprim_pb2
from dirprim_filter.recording.schemas.dirprim import floats_of, ints_of

FIELDS = {
    "bend": ("bend_east", "bend_north"),
    "gain": ("gain_east", "gain_north"),
    "path": ("path_offset", "path_slope", "path_curvature"),
    "acceleration": ("acceleration", "acceleration_east", "acceleration_north", "acceleration_speed"),
}
"""The message's fields of the attributes that have several columns; of others it is the one of that name."""
KNOBS = ("course_rate", "strength", "spread", "leader")
COLUMNS = tuple(field.name for field in dirprim_pb2.Motion.DESCRIPTOR.fields if field.name not in KNOBS)
"""What tiles have parts of; all else they repeat."""
INTEGERS = ("cell", "mode", "first", "following")
ALL = (*INTEGERS, *FLOATS, "count")
"""The attributes of `Motion` that these are."""


def encode_motion(motion: Motion, tile: int, n_tiles: int) -> dirprim_pb2.Motion:
    """A tile's part: of the manoeuvres as many as any other tile has, and of the transitions."""
    of_manoeuvre: dict[str, AnyArray] = {"cell": motion.cell, "mode": motion.mode, "first": motion.first[:-1]}
    for name in FLOATS:
        fields = FIELDS.get(name, (name,))
        of_manoeuvre |= zip(fields, getattr(motion, name).reshape(-1, len(fields)).T, strict=True)
    columns = of_manoeuvre | {"following": motion.following, "count": motion.count}
    return dirprim_pb2.Motion(
        **{name: column[_part(column.size, tile, n_tiles)].tolist() for name, column in columns.items()},
        course_rate=motion.course_rate,
        strength=motion.strength,
        spread=motion.spread,
        leader=None if motion.leader is None else _encode_leader(motion.leader),
    )


def motion_columns(part: dirprim_pb2.Motion, names: Iterable[str] = ALL) -> dict[str, AnyArray]:
    """Columns of a tile's part, as `Motion` names them.

    Raises:
        DecodeError: columns of a wrong length.
    """
    n = {name: len(part.following if name in ("following", "count") else part.cell) for name in ALL}
    columns: dict[str, AnyArray] = {}
    for name in names:
        if name in INTEGERS:
            columns[name] = ints_of(part, name, n[name])
        else:
            fields = [floats_of(part, field, n[name]) for field in FIELDS.get(name, (name,))]
            columns[name] = np.column_stack(fields) if name in FIELDS else fields[0]
    return columns


def motion_of(columns: Mapping[str, AnyArray], knobs: dirprim_pb2.Motion) -> Motion:
    """The motion of columns of all tiles, and of what each tile repeats.

    Raises:
        DecodeError: a response to leaders of another length.
        ValueError: numbers that make no motion.
    """
    return Motion(
        **cast(dict[str, Any], columns),
        course_rate=knobs.course_rate,
        strength=knobs.strength,
        spread=knobs.spread or 1.0,  # maps of before it was kept
        leader=_decode_leader(knobs.leader) if knobs.HasField("leader") else None,
    )


def _encode_leader(leader: LeaderResponse) -> dirprim_pb2.Leader:
    return dirprim_pb2.Leader(
        gain=leader.gain.tolist(), push=leader.push, trust=leader.trust, start_rate=leader.start_rate.tolist()
    )


def _decode_leader(leader: dirprim_pb2.Leader) -> LeaderResponse:
    return LeaderResponse(
        gain=floats_of(leader, "gain", N_FEATURES), push=leader.push, trust=leader.trust,
        start_rate=floats_of(leader, "start_rate", N_PACES),
    )  # fmt: skip


def _part(n: int, tile: int, n_tiles: int) -> slice:
    return slice(n * tile // n_tiles, n * (tile + 1) // n_tiles)
