"""The compiled walk over ROS 2 messages: a program that skips and reads, run over the bytes of many.

Sources: OMG CORBA 3.3 part 2, 9.3 (CDR) and DDS-XTypes 1.3, 7.4.3.4 (CDR2: alignment of at most four bytes); ROS 1
aligns nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.recording.container._kernels import FOUR, load
from dirprim_filter.recording.decoding._kernels import (
    CUT,
    ENCAPSULATION,
    LONGEST,
    MAX_ELEMENTS,
    OK,
    OVERLONG,
    STATUS_BITS,
    TEXT_BITS,
    TOO_MANY,
    UNEVEN,
    Tables,
    new_row,
)
from tessellation._compiling import inlined, uncounted

READ, TEXT, BLOCK, LOOP, END, END_LOOP, UNLESS_SELECTED, JUMP, PRESENT = range(9)
PADDING = 3
"""Bytes behind a delimited message at most."""


@inlined
def _length(data: AnyArray, at: int, end: int, little: bool, most: int) -> tuple[Any, int, int]:
    """A length, the byte after it, and whether it is one: of at most `most`, 0 for any, and within the message."""
    if at + 4 > end:
        return 0, at, CUT
    length = np.int64(load(data, at, FOUR, little))
    at += 4
    return length, at, OVERLONG if length > end - at or (most > 0 and length > most) else OK


@uncounted
def walk_cdr(
    data: AnyArray, starts: IntArray, stops: IntArray, tables: Tables, status: IntArray, room: IntArray, ops: IntArray,
    encapsulation: int,
) -> bool:  # fmt: skip
    """Run the program `ops` over each message; whether a table was too small: then nothing counts.

    Args:
        data: (n_bytes,) uint8.
        starts: (n_messages,) where each message starts.
        stops: (n_messages,) where it ends.
        tables: out.
        status: (n_messages,) out.
        room: (5, as many as tables, and as nested loops and one) for its work.
        ops: (n_ops, 7) operation and its numbers, see `cdr_plan`; the last two are the sizes to which elements, and
            what it reads first, are aligned, less one.
        encapsulation: what messages begin with, without its last bit, which is set where they are little endian; -1:
            with nothing, they are.
    """
    cells, base, width, n_rows = tables.cells, tables.base, tables.width, tables.n_rows
    n_tables = width.size
    row, before, number, index = room[0], room[1], room[2], room[3]
    outer = room[4]  # the table that the loop was entered from
    top = np.int64(0)  # a literal would compile `new_row` once more
    for message in range(starts.size):
        at, end = starts[message], stops[message]
        for table in range(n_tables):
            before[table] = n_rows[table]
        row[0] = new_row(tables, top, message, message)
        if row[0] < 0:
            return True
        before[0] += 1
        little = True
        if encapsulation >= 0:
            if end - at < 4:
                status[message] = CUT
                continue
            found = np.int64(data[at]) << 8 | np.int64(data[at + 1])
            if found & ~1 != encapsulation:
                status[message] = ENCAPSULATION | found << STATUS_BITS
                continue
            little = found & 1 == 1
            at += 4
        origin = at
        state = OK
        op = 0
        depth = -1
        turns = table = 0
        while True:
            code = ops[op, 0]
            a, b, c = ops[op, 1], ops[op, 2], ops[op, 3]
            if code <= LOOP:
                at += (origin - at) & ops[op, 6]
            op += 1
            if code == READ:
                if at + a <= end:
                    bits = load(data, at, a, little)
                    if c and a < 8 and bits >> np.uint64(8 * a - 1):
                        bits |= ~np.uint64(0) << np.uint64(8 * a)
                    cells[base[table] + row[table] * width[table] + b] = np.int64(bits)
                    at += a
                else:
                    at = end + 1
            elif code == TEXT:
                length, at, state = _length(data, at, end, little, a + 1 if a > 0 else 0)
                if state == OK and b >= 0:
                    used = length - 1 if length > 0 and data[at + length - 1] == 0 else length
                    cells[base[table] + row[table] * width[table] + b] = (at << TEXT_BITS) | min(used, LONGEST)
                at += length
            elif code == BLOCK:
                n, column = a, ops[op - 1, 4]
                if a < 0:
                    n, at, state = _length(data, at, end, little, c)
                if state == OK and column >= 0 and n <= end - at:
                    cells[base[table] + row[table] * width[table] + column] = (at << TEXT_BITS) | min(n, LONGEST)
                if n > 0:
                    at += ((origin - at) & ops[op - 1, 5]) + n * b
            elif code == LOOP:
                n = a
                if a < 0:
                    n, at, state = _length(data, at, end, little, b)
                if state == OK and c >= 0 and n > MAX_ELEMENTS:
                    state = TOO_MANY
                depth += 1
                number[depth], index[depth], outer[depth] = n, -1, table
                op = ops[op - 1, 4] - 1  # its end, at which each of its turns begins
            elif code == END_LOOP:
                index[depth] += 1
                turns += min(index[depth], 1)  # those that are done
                if turns > end - origin:  # of elements without bytes, which ROS 1 has
                    state = TOO_MANY
                elif index[depth] < number[depth]:
                    op = a
                    if b >= 0:
                        made = new_row(tables, b, message, row[outer[depth]])
                        if made < 0:
                            return True
                        row[b] = made
                        table = b
                else:
                    table = outer[depth]
                    depth -= 1
            elif code == UNLESS_SELECTED:
                if index[depth] != a:
                    op = b
            elif code == JUMP:
                op = a
            elif code == PRESENT:
                cells[base[table] + row[table] * width[table] + a] = 1
            else:
                state = UNEVEN if a and end - at > PADDING else OK
                break
            if state != OK or at > end:
                state = state if state != OK else CUT
                break
        if state != OK:
            status[message] = state
            for table in range(n_tables):
                n_rows[table] = before[table]
    return False
