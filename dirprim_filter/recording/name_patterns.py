"""Names of topics and files: one by one, by a regular expression, by their ends, or each with what it stands for."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from os import PathLike
from typing import Literal, TypeGuard

TableFormat = Literal["csv", "parquet", "feather", "sumo-fcd", "sdd", "trajnet"]
FORMATS: Mapping[TableFormat, tuple[str, ...]] = {
    "csv": (".csv", ".csv.gz", ".tsv", ".txt"), "parquet": (".parquet",), "feather": (".feather", ".arrow"),
    "sumo-fcd": (".xml",), "sdd": (), "trajnet": (),
}  # fmt: skip
"""Of tables, which stand wherever a log does, and how their names end; of some only the user can say it."""
WRITTEN_TABLES = (".csv", ".parquet")
"""Ends of the names of tables that are written."""


def form_of(path: object) -> TableFormat:
    """The format that the end of a table's name says; csv of others, whose readers look at the file too."""
    return next((form for form, ends in FORMATS.items() if str(path).lower().endswith(ends)), "csv")


def is_table(source: object) -> TypeGuard[str | PathLike[str]]:
    """Whether a source is a table, by the end of its name."""
    return isinstance(source, str | PathLike) and any(map(str(source).lower().endswith, FORMATS.values()))


def matching(text: str, *, of: str) -> Callable[[str], bool]:
    """Says whether a name is the one given, or matches the expression in full.

    Args:
        text: a name or an expression.
        of: what has such names; stands in the error.

    Raises:
        ValueError: it is no regular expression; a name may still be meant.
    """
    try:
        pattern = re.compile(text)
    except (re.error, RecursionError, OverflowError) as error:
        raise ValueError(f"{of}: expected a name or a regular expression, got {text!r}: {error}") from error
    return lambda name: name == text or pattern.fullmatch(name) is not None


def named_values(text: str, known: Collection[str], *, of: str, emptied: bool = False) -> dict[str, str]:
    """Of `name=value,name=value,...` the values by name.

    Args:
        text: what the user wrote.
        known: the names that there are, each once at most.
        of: what has them; stands in the error.
        emptied: `name=` is taken too, of any name.

    Raises:
        ValueError: names the part that is none.
    """
    values: dict[str, str] = {}
    for part in text.split(","):
        name, _, value = (word.strip() for word in part.partition("="))
        is_fine = (name in known and value) or (emptied and name and not value and "=" in part)
        if not is_fine or name in values:
            raise ValueError(f"{of}: expected NAME=VALUE, each of {', '.join(known)} once, got {part!r}")
        values[name] = value
    return values
