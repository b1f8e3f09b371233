"""Settings: what has no option of its own, as `--set NAME=VALUE`."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from contextlib import suppress
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
        BadParameter: a text is no NAME=VALUE, or a name comes twice.
    """
    settings: Settings = {}
    for text in given:
        name, _, value = (part.strip() for part in text.partition("="))
        if not (name and value):
            raise typer.BadParameter(f"expected NAME=VALUE, got {text!r}", param_hint="--set")
        if (name := name.replace("-", "_")) in settings:
            raise typer.BadParameter(f"{name}: expected it once, got it twice", param_hint="--set")
        settings[name] = value
    return settings


def deal(settings: Settings, *kinds: type) -> list[dict[str, Any]]:
    """For each dataclass the settings that are its fields, with their values; the first that has a name gets it.

    A value is read as one of TOML where it is one (a number, true, a list), else it is text.

    Raises:
        BadParameter: none has the name.
    """
    types = [{field.name: field.type for field in fields(kind)} for kind in kinds]
    dealt: list[dict[str, Any]] = [{} for _ in kinds]
    for name, text in settings.items():
        number = next((number for number, known in enumerate(types) if name in known), None)
        if number is None:
            known = ", ".join([*READING, *(name for of in types for name in of)])
            raise typer.BadParameter(f"{name}: expected one of {known}", param_hint="--set")
        dealt[number][name] = text
        if types[number][name] != "str":
            with suppress(tomllib.TOMLDecodeError, RecursionError):
                dealt[number][name] = tomllib.loads(f"value = {text}")["value"]
    return dealt


def taken(kind: type[Own], settings: Settings) -> Own:
    """A command's own settings out of all, as a dataclass of flags, numbers and texts.

    Raises:
        BadParameter: a value is of another type.
    """
    from dirprim_filter.config import from_table

    names = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    (own,) = deal({name: text for name, text in settings.items() if name in names}, kind)
    try:
        return from_table(kind, own)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--set") from error
