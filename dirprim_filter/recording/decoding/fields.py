"""Which fields of a message are wanted, by paths such as `.objects[].kinematics.pose.position.x`.

A step is a field's name; `[]` behind it goes through all elements of a repeated field, `[2]` to its third.
Paths that share what stands up to their last `[]` are columns of one table, with a row for each element.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from google.protobuf.message import DecodeError

from dirprim_filter.recording.container.errors import one_line

Kind = Literal["number", "name", "time", "presence"]
"""What is wanted of a field: a number; a text, whatever it is; a time; or whether a message is set at all."""

EACH = -1
"""The selector of `[]`; `[k]` is k itself, and a plain step has None."""
_STEP = re.compile(r"\.([A-Za-z_]\w*)(?:\[(\d{0,6})\])?")


class SchemaError(DecodeError):
    """The definition of a schema cannot be read, or lacks a field that is needed; its text is one line."""

    def __init__(self, text: str) -> None:
        super().__init__(one_line(text))


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """A wanted field.

    Attributes:
        path: where it stands.
        kind: what is wanted of it.
        optional: a schema may lack it; it then reads as missing.
    """

    path: str
    kind: Kind = "number"
    optional: bool = False

    @property
    def table(self) -> str:
        """The path up to its last `[]`; empty where there is a value for each message."""
        return self.path[: self.path.rfind("[]") + 2] if "[]" in self.path else ""


@dataclass(slots=True)
class Wanted:
    """What is wanted of one value: itself, under some labels, and what is below it.

    Attributes:
        labels: label and kind under which the value itself is wanted.
        below: by name and selector, what is wanted of its fields.
    """

    labels: list[tuple[str, Kind]] = field(default_factory=list)
    below: dict[str, dict[int | None, Wanted]] = field(default_factory=dict)


class Place(NamedTuple):
    """Where a program stands while it is made.

    Attributes:
        table: the table whose row is written.
        path: from the message to here.
        presence: columns of the table that all are set when what stands here is there.
    """

    table: int = 0
    path: str = ""
    presence: tuple[int, ...] = ()

    def at(self, step: str, *presence: int) -> Place:
        """A step on in the same row."""
        return Place(self.table, f"{self.path}{step}", (*self.presence, *presence))


def steps_of(path: str) -> list[tuple[str, int | None]]:
    """Name and selector of each step.

    Raises:
        ValueError: it is no path.
    """
    steps, at = [], 0
    while match := _STEP.match(path, at):
        name, selector = match.groups()
        steps.append((name, None if selector is None else int(selector) if selector else EACH))
        at = match.end()
    if at != len(path) or not steps:
        raise ValueError(f"field path: expected steps such as .objects[].pose.position.x, got {path!r}")
    return steps


def wanted(fields: Mapping[str, Field]) -> Wanted:
    """The paths of all fields as one tree.

    Raises:
        ValueError: a path is none.
    """
    root = Wanted()
    for label, one in fields.items():
        at = root
        for name, selector in steps_of(one.path):
            at = at.below.setdefault(name, {}).setdefault(selector, Wanted())
        at.labels.append((label, one.kind))
    return root


def check_found(schema: str, fields: Mapping[str, Field], found: Iterable[str]) -> None:
    """All fields that are not optional were found.

    Raises:
        SchemaError: names those that were not.
    """
    has = set(found)
    lacking = [one.path for label, one in fields.items() if label not in has and not one.optional]
    if lacking:
        raise SchemaError(f"{schema}: expected the fields {', '.join(lacking)}, which its definition lacks")
