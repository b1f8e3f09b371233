"""The pages of `--help`: commands under titles, and options of reading apart from a command's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from dirprim_filter.cli.outputs import checked
from dirprim_filter.cli.reading import OPTIONS
from dirprim_filter.cli.settings import with_settings_of_today


def register(app: typer.Typer, command: Callable[..., Any]) -> None:
    """Add a command, whose outputs are checked before its work."""
    app.command(cls=_Grouped)(checked(command))


class _Grouped(TyperCommand):
    """Lists what all commands that read logs share after a command's own options; takes former ones too."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        known = {name for of in self.get_params(ctx) for name in of.opts}
        return super().parse_args(ctx, list(with_settings_of_today(args, known)))

    def format_options(self, ctx: Any, formatter: Any) -> None:
        titled: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": [], "Reading a log": []}
        reads = any(of.name == "given" for of in self.get_params(ctx))
        for of in self.get_params(ctx):
            is_reading = reads and of.name in (*OPTIONS, "given")
            title = "Arguments" if of.param_type_name == "argument" else "Options"
            if (record := of.get_help_record(ctx)) is not None:
                titled["Reading a log" if is_reading else title].append(record)
        for title, records in titled.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def titled(commands: Mapping[str, Sequence[str]]) -> type[TyperGroup]:
    """A group that lists its commands, by name, under their titles."""

    class Titled(TyperGroup):
        def format_commands(self, ctx: Any, formatter: Any) -> None:
            for title, names in commands.items():
                with formatter.section(title):
                    formatter.write_dl([(name, self.commands[name].get_short_help_str(66)) for name in names])

    return Titled
