"""A column under way."""

from __future__ import annotations

import numpy as np

from dirprim_filter.arrays import AnyArray


class GrowingColumn:
    """One block that grows: of many small ones the system would not get its memory back.

    Args:
        kind: of the values.
        width: the shape of a row.
    """

    def __init__(self, kind: type, *width: int) -> None:
        self._values: AnyArray = np.empty((0, *width), kind)
        self._n = 0

    def extend(self, values: AnyArray) -> None:
        """Append rows."""
        end = self._n + len(values)
        if end > len(self._values):
            self._values.resize((end + end // 8, *self._values.shape[1:]), refcheck=False)
        self._values[self._n : end] = values
        self._n = end

    def whole(self) -> AnyArray:
        """All rows; nothing is appended afterwards."""
        self._values.resize((self._n, *self._values.shape[1:]), refcheck=False)
        return self._values
