"""Settings: what has no option of its own, as `--set NAME=VALUE`."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

import typer

Own = TypeVar("Own")
Settings = dict[str, str]
"""Texts by name."""

READING = ("frame", "fields", "origin", "labels", "group", "format")
"""Settings of every command that reads a log: fields of `Reading`."""


def assignments(given: Sequence[str]) -> Settings:
    """The texts of `--set`, by name.

    Raises:
        BadParameter: a text is no NAME=VALUE.
    """
    parts = [text.partition("=") for text in given]
    for (name, _, value), text in zip(parts, given, strict=True):
        if not (name and value):
            raise typer.BadParameter(f"expected NAME=VALUE, got {text!r}", param_hint="--set")
    return {name.strip().replace("-", "_"): value for name, _, value in parts}


def deal(settings: Mapping[str, str], *tables: Iterable[str]) -> list[dict[str, Any]]:
    """For each table of names the settings that it has, with their values; the first table that has a name gets it.

    A value is read as one of TOML where it is one (a number, true, a list), else it is text.

    Raises:
        BadParameter: no table has the name.
    """
    names = [tuple(table) for table in tables]
    dealt: list[dict[str, Any]] = [{} for _ in names]
    for name, text in settings.items():
        into = next((found for found, table in zip(dealt, names, strict=True) if name in table), None)
        if into is None:
            known = ", ".join([*READING, *(name for table in names for name in table)])
            raise typer.BadParameter(f"{name}: expected one of {known}", param_hint="--set")
        into[name] = _value(text)
    return dealt


def taken(kind: type[Own], settings: Settings) -> Own:
    """A command's own settings, a dataclass of flags, numbers and texts, taken out of all.

    Raises:
        BadParameter: a value is of another type.
    """
    from dirprim_filter.config import from_table

    own = {field.name: settings.pop(field.name) for field in fields(kind) if field.name in settings}  # type: ignore[arg-type]
    texts = {field.name for field in fields(kind) if field.type == "str"}  # type: ignore[arg-type]
    try:
        return from_table(kind, {name: text if name in texts else _value(text) for name, text in own.items()})
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--set") from error


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return text
