"""The motion of a map as `dirprim.Motion` messages, the manoeuvres of its cells in each tile.

Source: dirprim.proto. Columns travel as packed numbers, so motion comes back bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, cast

import numpy as np

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
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
"""What there is of each manoeuvre or transition."""
INTEGERS = ("number", "cell", "mode", "first", "following")
OF_TRANSITIONS = ("following", "count")
ALL = (*INTEGERS, *FLOATS, "count")
"""The attributes of `Motion` that these are, and `number`: which manoeuvres of the map they are of."""


def encode_manoeuvres(motion: Motion, number: IntArray, arrived: FloatArray) -> dirprim_pb2.Motion:
    """Some manoeuvres (n,), ascending, and the transitions from them; without what all share.

    Args:
        motion: of the map.
        number: which.
        arrived: (z,) of each manoeuvre of a place, how many visits followed that of another.
    """
    following, first = ranges(motion.first, number)
    columns: dict[str, AnyArray] = {
        "number": number, "cell": motion.cell[number], "mode": motion.mode[number], "first": first[:-1],
        "following": motion.following[following], "count": motion.count[following],
        "arrived": np.append(arrived, 0.0)[np.minimum(number, arrived.size)],
    }  # fmt: skip
    for name in FLOATS:
        fields = FIELDS.get(name, (name,))
        columns |= zip(fields, getattr(motion, name)[number].reshape(-1, len(fields)).T, strict=True)
    return dirprim_pb2.Motion(**{name: column.tolist() for name, column in columns.items()})


def ranges(first: IntArray, of: IntArray) -> tuple[IntArray, IntArray]:
    """The ranges from first[i] to first[i + 1] of some i (n,), one after the other, and where each begins, (n + 1,)."""
    begin = np.append(0, np.cumsum(first[of + 1] - first[of]))
    return np.arange(begin[-1]) + np.repeat(first[of] - begin[:-1], np.diff(begin)), begin


def encode_place_free(motion: Motion) -> dirprim_pb2.Motion:
    """The place-free manoeuvres, and what all manoeuvres share."""
    message = encode_manoeuvres(motion, np.arange(motion.n_placed, len(motion)), np.zeros(motion.n_placed))
    message.MergeFrom(dirprim_pb2.Motion(
        course_rate=motion.course_rate,
        strength=motion.strength,
        spread=motion.spread,
        leader=None if motion.leader is None else _encode_leader(motion.leader),
    ))  # fmt: skip
    return message


def motion_columns(part: dirprim_pb2.Motion, names: Iterable[str] = ALL) -> dict[str, AnyArray]:
    """Columns of a tile's part, as `Motion` names them.

    Raises:
        DecodeError: columns of a wrong length.
    """
    columns: dict[str, AnyArray] = {}
    for name in names:
        n = len(part.following if name in OF_TRANSITIONS else part.cell)
        if name in INTEGERS:
            columns[name] = ints_of(part, name, n)
        else:
            fields = [floats_of(part, field, n) for field in FIELDS.get(name, (name,))]
            columns[name] = np.column_stack(fields) if name in FIELDS else fields[0]
    return columns


def motion_of(columns: Mapping[str, AnyArray], knobs: dirprim_pb2.Motion) -> Motion:
    """The motion of columns of all manoeuvres, and of what they share.

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
