"""A message as an Arrow IPC stream: one record batch with one row, of numbers, texts and tables.

A table is a list of structs, so that its columns are of one length however the bytes were made; a column of several
numbers in each row is one of fixed-size lists. Any reader of Arrow opens it, such as `pyarrow.ipc.open_stream(data)`.
Source: https://arrow.apache.org/docs/format/Columnar.html.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from dirprim_filter.arrays import AnyArray

Columns = dict[str, AnyArray]
ENCODING = "arrow"
"""Of messages and schemas, as MCAP names it."""


def encode(scalars: Mapping[str, int | float | str], tables: Mapping[str, Mapping[str, AnyArray]]) -> bytes:
    """The message.

    Args:
        scalars: by name.
        tables: by name, (n, ...) int64 or float64 columns by name.
    """
    arrays = [pa.array([value]) for value in scalars.values()] + [_listed(columns) for columns in tables.values()]
    batch = pa.RecordBatch.from_arrays(arrays, names=[*scalars, *tables])
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
    return bytes(sink.getvalue())


def _listed(columns: Mapping[str, AnyArray]) -> Any:
    struct = pa.StructArray.from_arrays([_array(column) for column in columns.values()], names=list(columns))
    return pa.ListArray.from_arrays(pa.array([0, len(struct)], pa.int32()), struct)


def _array(column: AnyArray) -> Any:
    flat = pa.array(np.ascontiguousarray(column).reshape(-1))
    return flat if column.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, int(np.prod(column.shape[1:])))


def decode(data: bytes) -> tuple[dict[str, Any], dict[str, Columns]]:
    """The scalars and the tables of a message, of bytes that may be anybody's: as `encode` takes them.

    Raises:
        ValueError: they are no such message, or hold a null.
    """
    try:
        with pa.ipc.open_stream(data) as stream:
            batch = stream.read_next_batch()
        batch.validate(full=True)  # offsets within their buffers, texts of UTF-8
    except (pa.ArrowException, OSError, StopIteration) as error:
        reason = str(error).partition("\n")[0] or "an end before a row"
        raise ValueError(f"expected an Arrow stream, got {reason}") from error
    if batch.num_rows != 1:
        raise ValueError(f"expected an Arrow stream of one row, got {batch.num_rows}")
    scalars, tables = dict[str, Any](), dict[str, Columns]()
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        if name in scalars or name in tables or column.null_count:
            raise ValueError(f"{name}: expected once, and no null")
        if pa.types.is_list(column.type) and pa.types.is_struct(column.type.value_type):
            struct = column.flatten()
            parts = zip(struct.type, struct.flatten(), strict=True)
            tables[name] = {of.name: _numbers(f"{name}.{of.name}", array) for of, array in parts}
        elif column.type in (pa.int64(), pa.float64(), pa.string()):
            scalars[name] = column[0].as_py()
        else:
            raise ValueError(f"{name}: expected a number, a text or a table, got {column.type}")
    return scalars, tables


def _numbers(name: str, array: Any) -> AnyArray:
    width = array.type.list_size if pa.types.is_fixed_size_list(array.type) else 0
    flat = array.flatten() if width and not array.null_count else array
    if flat.type not in (pa.int64(), pa.float64()) or flat.null_count:
        raise ValueError(f"{name}: expected int64 or float64 without nulls, got {array.type}")
    numbers = flat.to_numpy()
    return np.asarray(numbers.reshape(len(array), width) if width else numbers)
