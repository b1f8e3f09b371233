"""Rows of objects as columns of one length; of most columns many sources know nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from dirprim_filter.arrays import AnyArray, ArrayValue, BoolArray, IntArray
from dirprim_filter.columns import chosen, joined

LEFT_OUT: Any = None
"""Stands for a column that nothing is known of."""


class Rows(ArrayValue):
    """A frozen dataclass of columns.

    Attributes:
        NOTHING: of the columns that may be left out, a row that says nothing: one then stands for all.
        OF_ALL: fields that are no columns.
    """

    __slots__ = ()
    NOTHING: ClassVar[Mapping[str, Any]]
    OF_ALL: ClassVar[tuple[str, ...]] = ()
    position: AnyArray

    def __post_init__(self) -> None:
        for name, nothing in self.NOTHING.items():
            if getattr(self, name) is LEFT_OUT:
                object.__setattr__(self, name, np.broadcast_to(nothing, (len(self), *np.shape(nothing))))

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, rows: BoolArray | IntArray) -> Self:
        """The rows of a mask or of indices; the same rows where a mask leaves out none."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        return replace(self, **{name: chosen(getattr(self, name), rows) for name in self._columns()})  # type: ignore[type-var]

    @classmethod
    def concatenate(cls, parts: Iterable[Self], **of_all: AnyArray) -> Self:
        """All rows of all parts, of which there is at least one."""
        whole = list(parts)
        return cls(**{name: joined([getattr(part, name) for part in whole]) for name in cls._columns()}, **of_all)

    @classmethod
    def _columns(cls) -> list[str]:
        return [f.name for f in fields(cls) if f.name not in cls.OF_ALL]  # type: ignore[arg-type]
