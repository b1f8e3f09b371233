"""A message as an Arrow IPC stream: one record batch with one row, of numbers, texts and tables.

A table is a list of structs, so that its columns are of one length however the bytes were made; a column of several
numbers in each row is one of fixed-size lists. Any reader of Arrow opens it, such as `pyarrow.ipc.open_stream(data)`.
Source: https://arrow.apache.org/docs/format/Columnar.html.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa

from dirprim_filter.arrays import AnyArray

Columns = dict[str, AnyArray]
Scalar = int | float | str
Number = TypeVar("Number", int, float, str)
ARROW: Mapping[type, Any] = {int: pa.int64(), float: pa.float64(), str: pa.string()}
ENCODING = "arrow"
"""Of messages and schemas, as MCAP names it."""


def encode(scalars: Mapping[str, Scalar], tables: Mapping[str, Mapping[str, AnyArray]]) -> bytes:
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


class ArrowMessage:
    """A message out of its bytes, which may be anybody's.

    Args:
        data: the bytes.

    Raises:
        ValueError: they are no such message.
    """

    def __init__(self, data: bytes) -> None:
        try:
            with pa.ipc.open_stream(data) as stream:
                self._batch = stream.read_next_batch()
            self._batch.validate(full=True)  # offsets within their buffers, texts of UTF-8
        except (pa.ArrowException, OSError, StopIteration) as error:
            reason = str(error).partition("\n")[0] or "an end before a row"
            raise ValueError(f"expected an Arrow stream, got {reason}") from error
        if self._batch.num_rows != 1:
            raise ValueError(f"expected an Arrow stream of one row, got {self._batch.num_rows}")

    def part(self, names: Collection[str]) -> Any:
        """Those scalars and tables, to be compared with `equals`."""
        return self._batch.select([name for name in self._batch.schema.names if name in names])

    def scalar(self, name: str, kind: type[Number]) -> Number:
        """A whole number, a float or a text.

        Raises:
            ValueError: it is missing, or of another type.
        """
        column, expected = self._column(name), ARROW[kind]
        if column.type != expected or column.null_count:
            raise ValueError(f"{name}: expected {expected}, got {column.type if column.type != expected else 'null'}")
        return kind(column[0].as_py())

    def _column(self, name: str) -> Any:
        if self._batch.schema.names.count(name) != 1:
            raise ValueError(f"{name}: expected once, got {', '.join(self._batch.schema.names)}")
        return self._batch.column(name)

    def table(self, name: str, *, floats: Collection[str] = (), whole: Collection[str] = ()) -> Columns:
        """Columns of a table.

        Args:
            name: of the table.
            floats: names of columns of float64, (n,) or (n, k).
            whole: names of columns of int64, (n,).

        Raises:
            ValueError: the table or a column is missing, or of another type, or has nulls.
        """
        column = self._column(name)
        if not (pa.types.is_list(column.type) and pa.types.is_struct(column.type.value_type)) or column.null_count:
            raise ValueError(f"{name}: expected a list of structs, got {column.type}")
        struct = column.flatten()
        names = [struct.type.field(i).name for i in range(struct.type.num_fields)]
        fields = dict(zip(names, struct.flatten(), strict=True))
        columns: Columns = {}
        for of, kind in [(of, pa.float64()) for of in floats] + [(of, pa.int64()) for of in whole]:
            if of not in fields:
                raise ValueError(f"{name}.{of}: expected it, got {', '.join(fields) or 'no columns'}")
            columns[of] = _numbers(f"{name}.{of}", fields[of], kind)
        return columns


def _numbers(name: str, array: Any, kind: Any) -> AnyArray:
    n, wide = len(array), pa.types.is_fixed_size_list(array.type)
    flat = array.flatten() if wide and not array.null_count else array
    if flat.type != kind or flat.null_count or (wide and not array.type.list_size):
        raise ValueError(f"{name}: expected {kind} without nulls, got {array.type}")
    numbers = flat.to_numpy()
    return np.asarray(numbers.reshape(n, array.type.list_size) if wide else numbers)
