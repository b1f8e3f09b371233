"""Protobuf messages encoded once, with holes for the numbers that change from frame to frame.

The same vehicles are drawn again and again, and nothing but numbers changes. A double takes eight bytes whatever it is,
so a message encoded with numbers that stand for the holes shows where the numbers go. While the vehicles are the same,
so is all between the holes.
Source: the wire format, https://protobuf.dev/programming-guides/encoding.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from google.protobuf.message import Message

from dirprim_filter.arrays import AnyArray, FloatArray, IntArray

_BYTES = np.arange(8)
_LENGTH_DELIMITED = 2


class MessageTemplates:
    """The items of a repeated field, by name: each drawn when its name is first given, and kept while it is given.

    Args:
        draw: makes the message of a name, with these numbers in it, each once.
        n_holes: how many numbers.
        field: the number of the repeated field that the messages are items of.
    """

    def __init__(self, draw: Callable[[str, Sequence[float]], Message], n_holes: int, *, field: int) -> None:
        self._draw = draw
        self._hole = [struct.pack("<4sHH", b"hole", i, 0x7EAD) for i in range(n_holes)]
        self._field = field
        self._drawn: dict[str, tuple[bytes, list[int]]] = {}
        self._names: Sequence[str] = ()
        self._laid_out: dict[int, tuple[bytes, AnyArray, AnyArray]] = {}  # by the bytes that are shared

    def encode(self, names: Sequence[str], numbers: FloatArray, *, shared: bytes) -> bytes:
        """The field as it stands in its message.

        Args:
            names: (n) of the items.
            numbers: (n, n_holes) that are filled in.
            shared: encoded fields that all items have beside those that are drawn: their time.
        """
        if not names:
            return b""
        if names != self._names:
            self._names = list(names)
            self._laid_out.clear()
        if len(shared) not in self._laid_out:
            self._laid_out[len(shared)] = self._lay_out(names, len(shared))
        template, shared_at, hole_at = self._laid_out[len(shared)]
        encoded = bytearray(template)
        view = np.frombuffer(encoded, np.uint8)
        view[shared_at] = np.frombuffer(shared, np.uint8)
        view[hole_at] = np.ascontiguousarray(numbers, "<f8").view(np.uint8).reshape(hole_at.shape)
        return bytes(encoded)

    def _lay_out(self, names: Sequence[str], n_shared: int) -> tuple[bytes, AnyArray, AnyArray]:
        """The field of these items, where what they share goes, (n, n_shared), and the numbers, (n, n_holes, 8)."""
        before = self._drawn
        self._drawn = drawn = {name: before.get(name) or self._template(name) for name in names}
        parts, shared_at, at = [], [], 0
        for name in names:
            body = drawn[name][0]
            part = delimited(self._field, bytes(n_shared) + body)
            parts.append(part)
            at += len(part)
            shared_at.append(at - len(body) - n_shared)
        start: IntArray = np.array(shared_at)[:, None]
        holes = np.array([drawn[name][1] for name in names]) + start + n_shared
        return b"".join(parts), start + np.arange(n_shared), holes[..., None] + _BYTES

    def _template(self, name: str) -> tuple[bytes, list[int]]:
        """The message of a name, and where in it the holes are."""
        numbers = [struct.unpack("<d", hole)[0] for hole in self._hole]
        encoded = self._draw(name, numbers).SerializeToString()
        return encoded, [encoded.index(hole) for hole in self._hole]


def number_of(kind: type[Message], field: str) -> int:
    """The number of a field, by its name."""
    return int(kind.DESCRIPTOR.fields_by_name[field].number)


def delimited(field: int, data: bytes) -> bytes:
    """A field that carries its length: a text, bytes, or an encoded message."""
    return _varint(field << 3 | _LENGTH_DELIMITED) + _varint(len(data)) + data


@lru_cache(maxsize=1 << 12)
def _varint(number: int) -> bytes:
    encoded = bytearray()
    while number > 0x7F:
        encoded.append(number & 0x7F | 0x80)
        number >>= 7
    encoded.append(number)
    return bytes(encoded)
