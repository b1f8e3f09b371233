"""What is sent of a tessellation to another process: what it is made from, and not the rasters that follow from it."""

from __future__ import annotations

from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def from_fields(made: DataclassInstance) -> tuple[partial[Any], tuple[()]]:
    """For `__reduce__`: make it anew from the fields that it was made from."""
    given = {field.name: getattr(made, field.name) for field in fields(made) if field.init}
    return partial(type(made), **given), ()
