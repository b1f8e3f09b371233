"""Settings: what has no option of its own, as `--set NAME=VALUE`; and the options that were there before."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

import typer

Own = TypeVar("Own")
Settings = dict[str, str]
"""Texts by name."""

READING = ("frame", "fields", "origin", "labels", "group")
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


FORMER = {f"--{name}": f"{name.replace('-', '_')}=" for name in (
    *READING, "interaction", "detection-probability", "clutter-density", "miss-rate", "false-per-frame", "learn",
    "truth", "focus", "particles-out",
)} | {
    "--similarity": "similarity_m=", "--noise": "noise_m=", "--particles": "n_particles=",
    "--rate": "rate_hz=", "--motion": "motion=true", "--place-free": "without_map=true", "--smooth": "smooth=true",
}  # fmt: skip
"""Options that are now settings of the commands that no longer have them; where one takes a value, the text ends with
`=`."""
FORMER_COMMANDS = {"update": ("store", "update"), "replay": ("view", "--rate", "1")}
OF_STORES = {"--min-vehicles", "--half-life", "--now", "--zone", "--workers", "--scheduler"}
"""With these `learn` is `store learn`."""


def with_commands_of_today(arguments: Sequence[str]) -> list[str]:
    """The same arguments with today's name of a former command, and a warning; these go after the first release."""
    words = list(arguments)
    at, command = next(((i, word) for i, word in enumerate(words) if not word.startswith("-")), (0, ""))
    now = FORMER_COMMANDS.get(command, ())
    if command == "learn" and OF_STORES & {word.partition("=")[0] for word in words}:
        now = ("store", "learn")
    if now:
        _warn(f"`dirprim {command}`", f"`dirprim {' '.join(now)}`")
        words[at : at + 1] = now
    return words


def with_settings_of_today(arguments: Sequence[str], known: Iterable[str]) -> Iterator[str]:
    """The same for the options of a command that has `known` ones."""
    rest = iter(arguments)
    for argument in rest:
        name, equals, value = argument.partition("=")
        if name in known or name not in FORMER or "--set" not in known:
            yield argument
            continue
        setting = FORMER[name]
        _warn(name, f"--set {setting}{'...' * setting.endswith('=')}")
        yield from ("--set", setting + (value if equals else next(rest, "")) if setting[-1] == "=" else setting)


def _warn(old: str, new: str) -> None:
    typer.echo(f"warning: {old} is now {new}; the next release removes {old}", err=True)
