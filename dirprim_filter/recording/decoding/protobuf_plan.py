"""Protobuf messages, by the descriptor set that the log carries.

Message classes are never built: of the wire format the wanted fields alone are read.

Source: https://protobuf.dev/programming-guides/encoding.
"""

from __future__ import annotations

from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError

from dirprim_filter.recording.decoding import _protobuf_kernels as kernels
from dirprim_filter.recording.decoding.column_plan import ColumnPlan, Form, OutputTables
from dirprim_filter.recording.decoding.field_columns import EACH, Field, Place, SchemaError, Wanted

_F = FieldDescriptor
_SCALARS: dict[int, tuple[int, int, Form]] = {
    _F.TYPE_DOUBLE: (1, kernels.PLAIN, "double"), _F.TYPE_FLOAT: (5, kernels.PLAIN, "float"),
    **dict.fromkeys((_F.TYPE_UINT64, _F.TYPE_UINT32, _F.TYPE_BOOL), (0, kernels.PLAIN, "unsigned")),
    **dict.fromkeys((_F.TYPE_INT32, _F.TYPE_ENUM), (0, kernels.SIGNED32, "int")),
    **dict.fromkeys((_F.TYPE_SINT32, _F.TYPE_SINT64), (0, kernels.ZIGZAG, "int")),
    _F.TYPE_INT64: (0, kernels.PLAIN, "int"), _F.TYPE_SFIXED64: (1, kernels.PLAIN, "int"),
    _F.TYPE_FIXED32: (5, kernels.PLAIN, "unsigned"), _F.TYPE_FIXED64: (1, kernels.PLAIN, "unsigned"),
    _F.TYPE_SFIXED32: (5, kernels.SIGNED32, "int"),
}  # fmt: skip
"""Wire type, how its bits are written, and how a cell of it is read."""
_TEXTS: dict[int, Form] = {_F.TYPE_STRING: "cells", _F.TYPE_BYTES: "bytes"}


def protobuf_plan(schema: str, definition: bytes, fields: Mapping[str, Field]) -> ColumnPlan:
    """A plan for messages of a protobuf schema.

    Args:
        schema: full name of the message.
        definition: a serialised FileDescriptorSet.
        fields: what is wanted, by label.

    Raises:
        SchemaError: the definition cannot be read, or lacks a field.
    """
    program = _Program(OutputTables(schema, fields))
    program.message(message_descriptor(schema, definition), program.output.wanted, Place(), 0)
    program.output.check()
    # of several elements the last first: then each that comes is counted for those before it is entered
    nodes = [sorted(node, key=lambda entry: (entry[0], -entry[4])) for node in program.nodes]
    entries = np.array([entry for node in nodes for entry in node], np.int64).reshape(-1, 9)
    starts = np.cumsum([0, *(len(node) for node in nodes)])
    return ColumnPlan(program.output, kernels.walk_protobuf, program.deepest + 2, entries, starts.astype(np.int64))


def message_descriptor(name: str, descriptors: bytes) -> Descriptor:
    """The descriptor of the message called `name`, from a serialised FileDescriptorSet in a pool of its own.

    Raises:
        SchemaError: it is no such set.
    """
    files = FileDescriptorSet()
    try:
        files.ParseFromString(descriptors)
    except DecodeError as error:
        raise SchemaError(
            f"{name}: expected a google.protobuf.FileDescriptorSet, got {len(descriptors)} other bytes"
        ) from error
    pool = DescriptorPool()
    by_name = {file.name: file for file in files.file}
    needed = {file.name: [other for other in file.dependency if other in by_name] for file in by_name.values()}
    try:
        for ready in TopologicalSorter(needed).static_order():
            pool.AddSerializedFile(by_name[ready].SerializeToString())
        return pool.FindMessageTypeByName(name)
    except (KeyError, TypeError, CycleError) as error:
        raise SchemaError(f"{name}: expected a descriptor set that defines it, got {error}") from error


class _Program:
    """Nodes of wanted fields: one for each message that is entered on the way to them."""

    def __init__(self, output: OutputTables) -> None:
        self.output = output
        self.nodes: list[list[list[int]]] = []
        self.deepest = 0

    def message(self, descriptor: Descriptor, want: Wanted, at: Place, depth: int) -> int:
        """The number of a new node for what is wanted of a message."""
        self.deepest = max(self.deepest, depth)
        node, entries = len(self.nodes), list[list[int]]()
        self.nodes.append(entries)
        repeated = _repeated(descriptor)
        for name, selected in want.below.items():
            found = descriptor.fields_by_name.get(name)
            if found is None:
                continue  # reported by `OutputTables.check`
            self._check(found, set(selected), is_repeated=name in repeated)
            entries += [self._entry(found, selector, one, at, depth) for selector, one in selected.items()]
        return node

    def _check(self, found: FieldDescriptor, selectors: set[int | None], *, is_repeated: bool) -> None:
        what = f"{found.full_name} is"
        if is_repeated == (None in selectors):
            expected = "repeated: expected" if is_repeated else "single: expected no"
            raise self.output.error(f"{what} {expected} [] behind it")
        if found.message_type and len(selectors) > 1 and EACH in selectors:
            raise self.output.error(f"{what} repeated: expected one of [] and [k] behind it, got several")
        if found.type == _F.TYPE_GROUP:
            raise self.output.error(f"{what} a group: expected a message")

    def _entry(self, found: FieldDescriptor, selector: int | None, want: Wanted, at: Place, depth: int) -> list[int]:
        """What the walk does with a field: its number, then as `walk_protobuf` has it."""
        step = f".{found.name}" + {None: "", EACH: "[]"}.get(selector, f"[{selector}]")
        which, presence = kernels.LAST if selector is None else selector, -1
        if selector == EACH:
            at = Place(self.output.table(f"{at.path}{step}"), f"{at.path}{step}")
        elif selector is not None:
            presence = self.output.column(at.table, -selector)
            at = at.at(step, presence)
        else:
            at = at.at(step)
        if found.message_type is None:
            wire, what, bits, column = self._value(found, selector, want, at)
            return [found.number, wire, what, bits, which, at.table, column, -1, presence]
        if selector is None and want.labels:
            presence = self.output.column(at.table)
            is_clock = any(kind == "time" for _, kind in want.labels)
            at = at.at("", presence) if is_clock else at
        for label, kind in want.labels if selector != EACH else ():
            if kind == "presence":
                self.output.columns[label] = (at.table, presence, "presence")
            else:
                self.output.clock(label, found.message_type.fields_by_name, want.below)
        child = self.message(found.message_type, want, at, depth + 1)
        return [found.number, 2, kernels.MESSAGE, 0, which, at.table, 0, child, presence]

    def _value(self, found: FieldDescriptor, selector: int | None, want: Wanted, at: Place) -> tuple[int, ...]:
        """Wire type, what is read, how its bits are written, and the column of a value."""
        if want.below:
            raise self.output.error(f"expected a message at {found.full_name}, got a value")
        if found.type in _TEXTS:
            return 2, kernels.TEXT, 0, self.output.value(want, at, _TEXTS[found.type])
        wire, bits, form = _SCALARS[found.type]
        default = _default_bits(found, form) if selector is None else 0
        return wire, kernels.NUMBER, bits, self.output.value(want, at, form, default)


def _repeated(descriptor: Descriptor) -> frozenset[str]:
    """The names of a message's repeated fields.

    By its definition: `FieldDescriptor.label` goes out of protobuf, and 5.29 does not have `is_repeated` yet.
    """
    definition = DescriptorProto()
    descriptor.CopyToProto(definition)
    return frozenset(field.name for field in definition.field if field.label == FieldDescriptorProto.LABEL_REPEATED)


def _default_bits(found: FieldDescriptor, form: Form) -> int:
    """What an unset number reads as, as the bits of a cell."""
    value = found.default_value
    if form in ("double", "float"):
        return int(np.float64(value).view(np.int64) if form == "double" else np.float32(value).view(np.uint32))
    return int(np.uint64(int(value) & 0xFFFFFFFFFFFFFFFF).view(np.int64))
