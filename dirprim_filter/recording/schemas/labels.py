"""What an object is: the name of its class, in the words of its schema, lower case; empty where that is not told."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dirprim_filter.recording.decoding.field_columns import Shredded
from tessellation.arrays import AnyArray, IntArray

UNTOLD = -1
"""The number of an object whose class is not told; as an index, the last of the names."""


def label_names(numbers: IntArray, names: Sequence[str]) -> AnyArray:
    """(n,) str: the names of (n,) numbers, a number that has none in decimal; empty for `UNTOLD`."""
    is_named = (numbers >= UNTOLD) & (numbers < len(names))
    named = np.array([*names, ""])[np.where(is_named, numbers, UNTOLD)]
    return named if is_named.all() else np.where(is_named, named, numbers.astype(np.str_))


def most_probable(shredded: Shredded, label: str, probability: str) -> tuple[IntArray, IntArray]:
    """Of the guesses at each object the row of the most probable one, the first of equals.

    Args:
        shredded: guesses are a table below that of the objects.
        label: of a column of the guesses.
        probability: of another one.

    Returns:
        (k,) rows of the guesses, and (k,) the rows of their objects, each once.
    """
    of = shredded.parent_of(shredded.fields[label].table)
    if (np.diff(of) > 0).all():  # one guess at each, as is usual
        return np.arange(of.size), of
    order = np.lexsort((-np.nan_to_num(shredded.numbers(probability)), of))
    objects, first = np.unique(of[order], return_index=True)
    return order[first], objects
