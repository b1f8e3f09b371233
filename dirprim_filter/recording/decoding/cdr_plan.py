"""Messages of ROS and DDS, by the definition that the log carries: "ros2msg", "ros2idl", "omgidl" or "ros1msg".

`rosbags` parses the definitions; the program made of them skips what is not wanted, where the decoders of
rosbags and of mcap-ros2-support build an object for every field.

Sources: OMG CORBA 3.3 part 2, 9.3; DDS-XTypes 1.3, 7.4.3.5 (sizes in front) and 7.6.2.1.2 (encapsulations); ROS 2
interface definitions, https://design.ros2.org/articles/legacy_interface_definition.html.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.recording.decoding import _cdr_kernels as kernels
from dirprim_filter.recording.decoding.column_plan import (
    ColumnPlan,
    Form,
    OutputTables,
    TooManyRowsError,
    encapsulation_name,
)
from dirprim_filter.recording.decoding.field_columns import EACH, Field, FieldColumns, Place, SchemaError, Wanted

MAX_FIXED = 1 << 24
"""More elements of a fixed array than this are no message, but would overflow offsets."""
MAX_BOUND = (1 << 32) - 1
"""Lengths in messages have 32 bits."""
DEFINITIONS = ("ros2msg", "ros2idl", "omgidl", "ros1msg")
_UNREAD = re.compile(r"//.*|/\*(?s:.*?)\*/|^\s*#.*|@\w+(?:\s*\((?:[^()\"]|\"[^\"]*\")*\))?", re.MULTILINE)
"""Of omgidl: comments, directives and annotations."""
_ENUM = re.compile(r"\benum\s+(\w+)\s*\{[^}]*\}")
Description = tuple[Any, Any]
"""rosbags' description of a field: (Nodetype, its arguments)."""
_BYTES = ("uint8", "byte", "octet", "char")
_SIZES: dict[str, tuple[int, Form]] = {
    "float32": (4, "float"), "float64": (8, "double"), **dict.fromkeys((*_BYTES, "bool"), (1, "unsigned")),
    **{f"uint{8 * n}": (n, "unsigned") for n in (2, 4, 8)}, **{f"int{8 * n}": (n, "int") for n in (1, 2, 4, 8)},
}  # fmt: skip
MAX_DEPTH = 32
"""Definitions nest no deeper; one that names itself would for ever."""
MAX_OPERATIONS = 1 << 16
"""Definitions that name each other many times grow without end when written out."""
CDR, CDR2, DELIMITED, ROS_1 = range(4)
"""Representations: in CDR2 arrays of anything but numbers have their size in front, in the delimited messages too, all:
those that are `@final` would not, whose bytes then do not come out even."""
_REPRESENTATIONS = {0x00: CDR, 0x06: CDR2, 0x10: CDR2, 0x08: DELIMITED, 0x14: DELIMITED}
"""By encapsulation: the numbers of RTPS, and those that some writers had before."""
_READ_BY = np.array([number & ~1 if number & ~1 in _REPRESENTATIONS else 0 for number in range(256)])
"""By the second byte of a message: others fail as those of CDR."""
_WIDEST = (8, 4, 4, 1)
"""Bytes to which numbers are aligned at most."""


class CdrPlan:
    """Plans for messages of a schema in CDR or of ROS 1: one for each encapsulation, made when first met.

    Args:
        schema: "package/msg/Name", "package/Name" or "module::Name".
        encoding: of the definition, "ros2msg", "ros2idl", "omgidl" or "ros1msg": messages are those of ROS 1 then.
        definition: with those of all it depends on.
        fields: what is wanted, by label.

    Raises:
        SchemaError: the definition cannot be read, or lacks a field.
    """

    def __init__(self, schema: str, encoding: str, definition: bytes, fields: Mapping[str, Field]) -> None:
        self._schema, self._fields = schema, fields
        self._types = types_of(schema, encoding, definition)
        self._last = -1 if encoding == "ros1msg" else 0x00  # what the last messages began with
        self._plan = cache(self._made)
        self._plan(self._last)

    def read(self, data: AnyArray, start: IntArray, stop: IntArray) -> FieldColumns:
        """As `ColumnPlan.read`."""
        columns = self._plan(self._last).read(data, start, stop)
        if columns.failures and self._last >= 0:
            found = np.unique(_READ_BY[data[start[stop - start >= 4] + 1]])
            if found.size > 1:
                raise TooManyRowsError
            if found.size and found[0] != self._last:
                self._last = int(found[0])
                return self.read(data, start, stop)
        if self._last > 0:  # rare, and of several dialects
            columns.failures = {i: f"{why}; {encapsulation_name(self._last)}" for i, why in columns.failures.items()}
        return columns

    def _made(self, encapsulation: int) -> ColumnPlan:
        representation = _REPRESENTATIONS.get(encapsulation, ROS_1)
        program = _Program(OutputTables(self._schema, self._fields), self._types, representation)
        program.structure(full_name(self._schema), program.output.wanted, Place())
        program.emit(kernels.END, int(representation == DELIMITED))
        program.output.check()
        ops = np.array(program.ops, np.int64)
        return ColumnPlan(program.output, kernels.walk_cdr, program.deepest + 1, ops, encapsulation)


class _Program:
    """The operations of a walk over one schema, emitted type by type."""

    def __init__(
        self, output: OutputTables, types: Mapping[str, list[tuple[str, Description]]], representation: int
    ) -> None:
        from rosbags.interfaces import Nodetype  # noqa: PLC0415

        self.output = output
        self.ops: list[list[int]] = []
        self.deepest = 0
        self._types = types
        self._sizes_arrays, self._sizes_all = representation in (CDR2, DELIMITED), representation == DELIMITED
        self._widest = _WIDEST[representation]
        self._least = int(representation != ROS_1)  # bytes of an empty message
        self._node = Nodetype
        self._loops = 0
        self._nesting = 0
        self._entered = 0
        self._target = 0  # behind this operation nothing jumps, so skips may be joined

    def emit(self, code: int, *numbers: int) -> int:
        """Append an operation; its number."""
        if len(self.ops) >= MAX_OPERATIONS:
            raise self.output.error(f"expected at most {MAX_OPERATIONS} fields, all written out")
        is_counted = code == kernels.TEXT or (code in (kernels.BLOCK, kernels.LOOP) and numbers[0] < 0)
        element = numbers[int(code == kernels.BLOCK)] if code in (kernels.READ, kernels.BLOCK) else 1
        aligned = (min(size, self._widest) - 1 for size in (element, 4 if is_counted else element))
        self.ops.append([code, *numbers, *[0] * (4 - len(numbers)), *aligned])
        return len(self.ops) - 1

    def skip(self, size: int, count: int = 1) -> None:
        """Pass over numbers, at once with those before."""
        last = self.ops[-1] if len(self.ops) > self._target else [kernels.END]
        if last[0] == kernels.BLOCK and last[2] == size and last[1] >= 0 > last[4] and last[1] + count <= MAX_FIXED:
            last[1] += count
        elif count:
            self.emit(kernels.BLOCK, count, size, 0, -1)

    def structure(self, name: str, want: Wanted | None, at: Place) -> None:
        """Walk a message; `want` is what is wanted of it, None for nothing."""
        name = full_name(name)
        if name not in self._types:
            raise self.output.error(f"expected a definition of {name}, which is missing or not supported")
        self._nesting += 1
        if self._nesting > MAX_DEPTH:
            raise self.output.error(f"expected at most {MAX_DEPTH} messages within each other")
        self._entered += 1
        if self._entered > MAX_OPERATIONS:  # skips of messages without fields are one operation, however many
            raise self.output.error(f"expected at most {MAX_OPERATIONS} messages, all written out")
        members = self._types[name]
        if self._sizes_all:
            self.skip(4)
        below = dict(want.below) if want else {}
        if want and any(kind == "presence" for _, kind in want.labels):  # in CDR all that is defined is set
            self.emit(kernels.PRESENT, self.output.value(want, at, "presence"))
        elif want:
            for label, _ in want.labels:
                self.output.clock(label, [member for member, _ in members], below)
        for member, description in members:
            self._member(description, below.get(member), at.at(f".{member}"))
        if not members:
            self.skip(1, self._least)
        self._nesting -= 1

    def _member(self, description: Description, want: dict[int | None, Wanted] | None, at: Place) -> None:
        node, arguments = description
        if not want:
            self._skip(description, at.path)
        elif node == self._node.NAME and set(want) == {None}:
            self.structure(arguments, want[None], at)
        elif node == self._node.BASE and set(want) == {None} and not want[None].below:
            self._value(arguments, want[None], at)
        elif node in (self._node.ARRAY, self._node.SEQUENCE):
            self._array(description, want, at)
        else:
            raise self.output.error(f"expected {at.path} to be otherwise built than its definition says")

    def _value(self, base: tuple[str, int], want: Wanted, at: Place) -> None:
        name, bound = base
        if name == "string":
            self.emit(kernels.TEXT, bound, self.output.value(want, at, "cells"))
            return
        size, form = self._number(name)
        self.emit(kernels.READ, size, self.output.value(want, at, form), int(form == "int"))

    def _number(self, name: str) -> tuple[int, Form]:
        if name not in _SIZES:
            raise self.output.error(f"expected numbers and strings, got {name}, which is not supported")
        return _SIZES[name]

    def _array(self, description: Description, want: dict[int | None, Wanted], at: Place) -> None:
        element, length = description[1]
        fixed = description[0] == self._node.ARRAY
        is_bytes = element[0] == self._node.BASE and element[1][0] in _BYTES
        if set(want) == {None} and is_bytes and not want[None].below:
            column = self.output.value(want[None], at, "bytes")
            self.emit(kernels.BLOCK, length if fixed else -1, 1, 0 if fixed else length, column)
            return
        if None in want or (EACH in want and len(want) > 1):
            raise self.output.error(f"expected [], or numbers in brackets, behind the repeated {at.path}")
        if self._has_size(element):
            self.skip(4)
        if EACH in want:
            inner = Place(self.output.table(f"{at.path}[]"), f"{at.path}[]")
            start = self._open_loop(description, inner.table)
            self._member(element, {None: want[EACH]}, inner)
            self._close_loop(start)
            return
        chosen = {k: want[k] for k in sorted(k for k in want if k is not None)}
        size = self._size(element)
        if fixed and size and max(chosen) < length:
            done = 0
            for k, one in chosen.items():
                self.skip(size, k - done)
                self._member(element, {None: one}, at.at(f"[{k}]"))
                done = k + 1
            self.skip(size, length - done)
            return
        selected = {k: self.output.column(at.table) for k in chosen}
        start = self._open_loop(description, -1)
        jumps = []
        for k, presence in selected.items():
            unless = self.emit(kernels.UNLESS_SELECTED, k, 0)
            self._target = len(self.ops)
            self.emit(kernels.PRESENT, presence)
            self._member(element, {None: want[k]}, at.at(f"[{k}]", presence))
            jumps.append(self.emit(kernels.JUMP, 0))
            self.ops[unless][2] = self._target = len(self.ops)
        self._skip(element, at.path)
        for jump in jumps:
            self.ops[jump][1] = len(self.ops)
        self._close_loop(start)

    def _has_size(self, element: Description) -> bool:
        """Whether an array of such elements has its size in bytes in front."""
        return self._sizes_arrays and (element[0] != self._node.BASE or element[1][0] == "string")

    def _open_loop(self, description: Description, table: int) -> int:
        length = description[1][1]
        fixed = description[0] == self._node.ARRAY
        self._loops += 1
        self.deepest = max(self.deepest, self._loops)
        self._target = len(self.ops) + 1
        return self.emit(kernels.LOOP, length if fixed else -1, 0 if fixed else length, table, 0)

    def _close_loop(self, start: int) -> None:
        self.emit(kernels.END_LOOP, start + 1, self.ops[start][3])
        self.ops[start][4] = self._target = len(self.ops)
        self._loops -= 1

    def _skip(self, description: Description, path: str) -> None:
        node, arguments = description
        if size := self._size(description):
            self.skip(size)
        elif node == self._node.BASE:
            self.emit(kernels.TEXT, arguments[1], -1)
        elif node == self._node.NAME and not self._sizes_all:
            self.structure(arguments, None, Place(path=path))
        elif node == self._node.NAME or self._has_size(arguments[0]):
            self.emit(kernels.TEXT, 0, -1)  # as long as the number in front of it says
        elif (size := self._size(arguments[0])) and node == self._node.ARRAY:
            self.skip(size, arguments[1])
        elif size:
            self.emit(kernels.BLOCK, -1, size, arguments[1], -1)
        else:
            start = self._open_loop(description, -1)
            self._skip(arguments[0], path)
            self._close_loop(start)

    def _size(self, description: Description) -> int:
        """Bytes of a number; 0 of anything else."""
        node, arguments = description
        return self._number(arguments[0])[0] if node == self._node.BASE and arguments[0] != "string" else 0


def full_name(schema: str) -> str:
    """package/msg/Name, also of what leaves out "msg", and of modules of IDL, with what DDS adds to names of ROS."""
    name = re.sub(r"/dds_/(\w+)_$", r"/\1", schema.replace("::", "/"))
    return name.replace("/", "/msg/") if name.count("/") == 1 else name


def types_of(schema: str, encoding: str, definition: bytes) -> dict[str, list[tuple[str, Description]]]:
    """By type, names and descriptions of its fields."""
    from rosbags.interfaces import Nodetype  # noqa: PLC0415  (0.2 s)
    from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg  # noqa: PLC0415

    types: dict[str, Any] = {}
    try:
        text = definition.decode()
        if encoding in ("ros2msg", "ros1msg"):
            types = dict(get_types_from_msg(text, full_name(schema)))
        elif encoding == "ros2idl":
            for part in re.split(r"^=+\nIDL: .*\n", text, flags=re.MULTILINE):
                if part.strip():
                    types.update(get_types_from_idl(re.sub(r"^\s*#.*$", "", part, flags=re.MULTILINE)))
        elif encoding == "omgidl":
            types = dict(get_types_from_idl(_ENUM.sub(r"typedef unsigned long \1", _UNREAD.sub(" ", text))))
        else:
            raise SchemaError(f"{schema}: expected a definition in {', '.join(DEFINITIONS)}, got {encoding!r}")
    except (UnicodeDecodeError, TypesysError, RecursionError) as error:
        reason = str(error).split("\n", 1)[0]
        raise SchemaError(
            f"{schema}: expected a definition in {encoding}, got one that does not parse: {reason}"
        ) from error
    for name, (_, members) in types.items():
        for member, description in members:
            _check_lengths(f"{schema}: {name}.{member}", description)
    halves = [(half, (Nodetype.BASE, ("uint32", 0))) for half in ("sec", "nanosec")]
    built_in = {f"builtin_interfaces/msg/{name}": halves for name in ("Time", "Duration")} if "1" in encoding else {}
    return built_in | {full_name(name): members for name, (_, members) in types.items()}


def _check_lengths(what: str, description: Description) -> None:
    """Every element then takes a byte at least, and walks of a message no more turns than it has bytes.

    Raises:
        SchemaError: a fixed array that is empty or too long, or a bound that no length can reach.
    """
    from rosbags.interfaces import Nodetype  # noqa: PLC0415

    node, arguments = description
    if node == Nodetype.NAME:
        return
    least, most = (1, MAX_FIXED) if node == Nodetype.ARRAY else (0, MAX_BOUND)
    if not least <= arguments[1] <= most:
        raise SchemaError(f"{what}: expected a length from {least} to {most}, got {arguments[1]}")
    if node != Nodetype.BASE:
        _check_lengths(what, arguments[0])
