"""The motion of a map as `dirprim.Motion` messages, a part of its manoeuvres and transitions in each tile.

Source: dirprim.proto. Columns travel as packed numbers, so motion comes back bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from google.protobuf.message import Message

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


def decode_motion(parts: list[dirprim_pb2.Motion]) -> Motion:
    """The motion that the tiles' parts make, in order.

    Raises:
        DecodeError: columns of a wrong length.
        ValueError: numbers that make no motion.
    """

    def joined(read: Callable[[Message, str, int], AnyArray], name: str, *, rows: str = "cell") -> AnyArray:
        return np.concatenate([read(part, name, len(getattr(part, rows))) for part in parts])

    following = joined(ints_of, "following", rows="following")
    floats = {}
    for name in FLOATS:
        columns = [joined(floats_of, field) for field in FIELDS.get(name, (name,))]
        floats[name] = np.column_stack(columns) if name in FIELDS else columns[0]
    return Motion(
        cell=joined(ints_of, "cell"),
        mode=joined(ints_of, "mode"),
        first=np.append(joined(ints_of, "first"), following.size),
        following=following,
        count=joined(floats_of, "count", rows="following"),
        **floats,
        course_rate=parts[0].course_rate,
        strength=parts[0].strength,
        spread=parts[0].spread or 1.0,  # maps of before it was kept
        leader=_decode_leader(parts[0].leader) if parts[0].HasField("leader") else None,
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
