"""What the compiled walks over messages share: tables of cells, and where texts stand.

A batch is one array of bytes and where each message starts. A walk writes *tables*: table 0 has a row for each
message, another one a row for each element of a repeated field. A row is `width` cells of 64 bits: the message,
the row above it, then the columns, as bits. Texts are cells of offset and length, see `TEXT_BITS`. A message
that cannot be read leaves no row in any table but its own in table 0, and a status.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from dirprim_filter.arrays import IntArray
from tessellation._compiling import uncounted

OK, CUT, OVERLONG, ENCAPSULATION, WIRE_TYPE, TOO_MANY, UNEVEN = range(7)
STATUS_BITS = 8
"""Of a status; above them stands what was found."""
MAX_ELEMENTS = 1 << 16
"""More elements of one repeated field than this in one message are no objects of traffic."""

TEXT_BITS = 16
"""A text's cell is its offset, then so many bits of its length: offsets of 2^47 bytes fit."""
LONGEST = (1 << TEXT_BITS) - 1
"""Longer texts count as so long; names are cut well before."""


class Tables(NamedTuple):
    """Tables under way: their cells one after the other, and for each where it starts, and its row of defaults."""

    cells: IntArray  # (sum of capacity * width,)
    base: IntArray  # (n_tables,)
    width: IntArray  # (n_tables,)
    capacity: IntArray  # (n_tables,) rows
    n_rows: IntArray  # (n_tables,) so far
    defaults: IntArray  # (sum of width,)
    default_base: IntArray  # (n_tables,)


@uncounted
def new_row(tables: Tables, table: int, message: int, parent: int) -> Any:
    """Append a row of defaults to a table; its number, or -1 where the table is full."""
    row = tables.n_rows[table]
    if row >= tables.capacity[table]:
        return -1
    at = tables.base[table] + row * tables.width[table]
    for column in range(tables.width[table]):
        tables.cells[at + column] = tables.defaults[tables.default_base[table] + column]
    tables.cells[at] = message
    tables.cells[at + 1] = parent
    tables.n_rows[table] = row + 1
    return row
