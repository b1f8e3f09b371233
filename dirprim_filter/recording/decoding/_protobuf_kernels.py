"""The compiled walk over protobuf messages: of the wire format the wanted fields alone.

Source: https://protobuf.dev/programming-guides/encoding.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.recording.container._kernels import load
from dirprim_filter.recording.decoding._kernels import (
    CUT,
    LONGEST,
    MAX_ELEMENTS,
    OK,
    OVERLONG,
    TEXT_BITS,
    TOO_MANY,
    WIRE_TYPE,
    Tables,
    new_row,
)
from tessellation._compiling import uncounted

NUMBER, TEXT, MESSAGE = range(3)
PLAIN, ZIGZAG, SIGNED32 = range(3)
LAST, EACH = -2, -1
"""Of a field's values: the last one, as of single fields; each in a row of its own. From 0 on: that one."""


@uncounted
def _varint(data: AnyArray, at: int, end: int) -> Any:
    """A varint and where it ends; -1 where it is cut or too long."""
    value = np.uint64(0)
    shift = np.uint64(0)
    while at < end:
        byte = data[at]
        at += 1
        value |= np.uint64(byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += np.uint64(7)
        if shift > np.uint64(63):
            return value, -1
    return value, -1


@uncounted
def _scalar(data: AnyArray, at: int, end: int, wire: Any, form: int) -> Any:
    """The bits of a number and where it ends; -1 where it is cut."""
    if wire == 0:
        bits, at = _varint(data, at, end)
        if form == ZIGZAG:
            bits = (bits >> np.uint64(1)) ^ (~(bits & np.uint64(1)) + np.uint64(1))
        elif form == SIGNED32:
            bits = np.uint64(np.int64(np.int32(bits & np.uint64(0xFFFFFFFF))))
        return np.int64(bits), at
    size = 8 if wire == 1 else 4
    if at + size > end:
        return np.int64(0), -1
    bits = load(data, at, size, True)
    if form == SIGNED32:
        bits = np.uint64(np.int64(np.int32(bits)))
    return np.int64(bits), at + size


@uncounted
def _tag(data: AnyArray, at: int, end: int) -> tuple[int, Any, Any, Any, Any]:
    """Of the field at `at`: whether it can be read, its number, its wire type, where its bytes start, and end."""
    key, at = _varint(data, at, end)
    wire, number = np.int64(key & np.uint64(7)), np.int64(key >> np.uint64(3))
    if at < 0 or key > np.uint64(0xFFFFFFFF):
        return CUT, number, wire, at, at
    after: Any = at + (8 if wire == 1 else 4)
    if wire == 2:
        length, at = _varint(data, at, end)
        if at >= 0 and length > np.uint64(end - at):
            return OVERLONG, number, wire, at, at
        after = at + np.int64(length)
    elif number == 0 or wire not in (0, 1, 5):
        return WIRE_TYPE, number, wire, at, at
    elif wire == 0:
        _, after = _varint(data, at, end)
    return CUT if at < 0 or after < 0 or after > end else OK, number, wire, at, after


@uncounted
def walk_protobuf(
    data: AnyArray, starts: IntArray, stops: IntArray, tables: Tables, status: IntArray, room: IntArray,
    entries: IntArray, node_start: IntArray,
) -> bool:  # fmt: skip
    """Read the wanted fields of each message; whether a table was too small: then nothing counts.

    Args:
        data: (n_bytes,) uint8.
        starts: (n_messages,) where each message starts.
        stops: (n_messages,) where it ends.
        tables: out.
        status: (n_messages,) out.
        room: (5, as many as tables, and as levels of wanted messages and two) for its work.
        entries: (n_entries, 9) field number, wire type, what it holds, form, which of its values, table, column,
            child node, presence; those of a node one after the other, sorted. Which of several values came is counted
            in the presence, which is 1 with the one that is wanted.
        node_start: (n_nodes + 1,) where the entries of each node start.
    """
    cells, base, width, n_rows = tables.cells, tables.base, tables.width, tables.n_rows
    n_tables = width.size
    before, ends, nodes = room[0], room[1], room[2]
    rows, numbers = room[3], room[4]  # cell where the row of that level starts, and its number in its table
    top = np.int64(0)  # a literal would compile `new_row` once more
    for message in range(starts.size):
        at = starts[message]
        for table in range(n_tables):
            before[table] = n_rows[table]
        made = new_row(tables, top, message, message)
        if made < 0:
            return True
        before[0] += 1
        depth = 0
        ends[0], nodes[0], rows[0], numbers[0] = stops[message], 0, base[0] + made * width[0], made
        state = OK
        while state == OK:
            end = ends[depth]
            if at >= end:
                if depth == 0:
                    break
                depth -= 1
                continue
            state, number, wire, at, after = _tag(data, at, end)
            entry, last = node_start[nodes[depth]], node_start[nodes[depth] + 1]
            while entry < last and entries[entry, 0] < number:
                entry += 1
            descends = False
            while state == OK and entry < last and entries[entry, 0] == number and not descends:
                want, what, which = entries[entry, 1], entries[entry, 2], entries[entry, 4]
                table, column, presence = entries[entry, 5], entries[entry, 6], entries[entry, 8]
                form, child = entries[entry, 3], entries[entry, 7]
                entry += 1
                is_packed = what == NUMBER and which != LAST and wire == 2
                if wire != want and not is_packed:
                    continue
                here, stop = at, after if what == NUMBER else at + 1  # a text or a message may be empty
                bits = (at << TEXT_BITS) | min(after - at, LONGEST)
                while here < stop:
                    if what == NUMBER:
                        bits, here = _scalar(data, here, stop, want, form)
                        if here < 0:
                            state = CUT
                            break
                    else:
                        here = stop
                    row, of = rows[depth], numbers[depth]
                    if which == EACH:
                        if n_rows[table] - before[table] >= MAX_ELEMENTS:
                            state = TOO_MANY
                            break
                        of = new_row(tables, table, message, of)
                        if of < 0:
                            return True
                        row = base[table] + of * width[table]
                    elif which != LAST:
                        cells[row + presence] += 1
                        if cells[row + presence] != 1:
                            continue
                    if what != MESSAGE:
                        cells[row + column] = bits
                        continue
                    if presence >= 0:
                        cells[row + presence] = 1
                    depth += 1
                    ends[depth], nodes[depth], rows[depth], numbers[depth] = after, child, row, of
                    descends = True
            if not descends:
                at = after
        if state != OK:
            status[message] = state
            for table in range(n_tables):
                n_rows[table] = before[table]
    return False
