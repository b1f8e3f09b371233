"""How a function becomes a command: its outputs are checked before the work, its `--help` is in groups.

No output takes the place of an input, and none is where it cannot be written: the options say which of a command's
files are which.
"""

from __future__ import annotations

import inspect
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, redirect_stdout, suppress
from functools import wraps
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand

from dirprim_filter.cli.compiling import mend_cache, quiet_unless_watched
from dirprim_filter.cli.options import WRITTEN
from dirprim_filter.cli.reading import OPTIONS, Reading
from dirprim_filter.cli.settings import READING, assignments, deal
from dirprim_filter.partial_file import PartialFile

Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Say more on stderr; show where errors come from.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Only errors on stderr.")]


def say_more_or_less(verbose: bool, quiet: bool) -> None:
    """What is logged, as asked for."""
    if verbose or quiet:
        logging.getLogger().setLevel(logging.INFO if verbose else logging.ERROR)


def register(app: typer.Typer, command: Callable[..., Any]) -> None:
    """Add a command with options of verbosity; its outputs are checked before its work.

    One with a parameter `reading` has the options of reading, and `--set`. What else `--set` takes its parameter
    `settings` gets, texts by name; for the help it is annotated with their names, or dataclasses that have them.
    """
    hints, named = get_type_hints(command, include_extras=True), inspect.Parameter.KEYWORD_ONLY
    made_of = ("reading", "settings")  # several options
    taken = {name: of.default for name, of in inspect.signature(command).parameters.items() if name not in made_of}
    if "reading" in hints:
        own = [getattr(of, "__dataclass_fields__", [of]) for of in getattr(hints.get("settings"), "__metadata__", ())]
        text = f"NAME=VALUE, again for each: {', '.join([*READING, *chain(*own)])}. See docs/settings.md."
        hints["given"] = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help=text)]
        hints |= {name: hint for name, (hint, _) in OPTIONS.items()}
        taken |= {name: default for name, (_, default) in OPTIONS.items()} | {"given": None}
    hints |= {"verbose": Verbose, "quiet": Quiet}
    taken |= {"verbose": False, "quiet": False}

    @wraps(command)
    def run(*, verbose: bool, quiet: bool, **given: Any) -> Any:
        say_more_or_less(verbose, quiet)
        written = _checked(given, {name: getattr(hints[name], "__metadata__", ()) for name in given})
        mend_cache()
        quiet_unless_watched()
        from dirprim_filter.recording.container.source import copied_once  # not for `--help`

        with copied_once(), _beside(written):
            return command(**_with_reading(given, hints))

    run.__annotations__ = {name: hints[name] for name in taken}
    run.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
        inspect.Parameter(name, named, default=default, annotation=hints[name]) for name, default in taken.items()
    ])  # fmt: skip
    app.command(cls=_Grouped)(run)


def _with_reading(given: dict[str, Any], hints: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments as the command takes them: `reading` and `settings` in place of what they are made of."""
    if "reading" not in hints:
        return given
    settings = assignments(given.pop("given") or [])
    options = {name: of for name, (_, default) in OPTIONS.items() if (of := given.pop(name)) != default}
    options |= {name: settings.pop(name) for name in READING if name in settings}
    if "settings" in hints:
        given["settings"] = settings
    else:
        deal(settings)
    return given | {"reading": Reading(options)}


class _Grouped(TyperCommand):
    """Lists what all commands that read logs share after a command's own options."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        titled: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": [], "Reading a log": []}
        for of in self.get_params(ctx):
            title = "Arguments" if of.param_type_name == "argument" else "Options"
            if (record := of.get_help_record(ctx)) is not None:
                titled["Reading a log" if of.name in (*OPTIONS, "given") else title].append(record)
        for title, records in titled.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def _checked(given: Mapping[str, Any], marks: Mapping[str, Sequence[Any]]) -> list[Path]:
    """The outputs, all of which can be written; options that are marked as no outputs are inputs."""
    written = {name: of for name, of in given.items() if WRITTEN in marks[name] and isinstance(of, Path)}
    read = [path for name, of in given.items() if WRITTEN not in marks[name] for path in _paths(of)]
    if any(str(path) == "-" for path in written.values()):
        raise typer.BadParameter("expected the name of a file, got -; outputs are renamed when they are whole")
    check_outputs(list(written.values()), read, force=given.get("force", False))
    for path, ends in ((path, mark) for name, path in written.items() for mark in marks[name]):
        if isinstance(ends, tuple) and path.suffix.lower() not in ends:
            known, got = ", ".join(ends), path.suffix or "no suffix"
            raise ValueError(f"{path}: expected a name that ends in {known}, got {got}")
    return list(written.values())


def check_outputs(written: Sequence[Path], read: Sequence[Path], *, force: bool) -> None:
    """Whether every output can be written without harm to an input, to another output, or to a file that is there.

    Raises:
        ValueError: an output is an input, or two outputs are one file.
        OSError: as `PartialFile`.
    """
    for i, output in enumerate(written):
        if not output.is_char_device():
            if any(_is_same(output, path) or _is_part(output, path) for path in read):
                raise ValueError(f"{output}: is an input of this command; choose another name for the output")
            if any(_is_same(output, other) for other in written[:i]):
                raise ValueError(f"{output}: expected another file for each output, got it twice")
        PartialFile(output, force=force)


def _paths(value: Any) -> Iterator[Path]:
    """Those in an argument; of texts those that are files, such as `truth=FILE`."""
    if isinstance(value, Path):
        yield Path(re.sub("^(file|local):/+", "/", str(value)))
    elif isinstance(value, str):
        names = (value, value.partition("=")[2])
        yield from (Path(name) for name in names if os.path.isfile(name))  # noqa: PTH113 (no error of long texts)
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _paths(one)


def _is_same(one: Path, other: Path) -> bool:
    """Whether two names are of one file, through links of either kind; or will be, where neither is there yet."""
    try:
        return one.samefile(other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)


def _is_part(output: Path, folder: Path) -> bool:
    """Whether it is a file of a folder that is read, such as a rosbag2 recording."""
    return output.exists() and folder.is_dir() and output.resolve().is_relative_to(folder.resolve())


def _beside(written: Sequence[Path]) -> AbstractContextManager[object]:
    """Within, texts for people go to standard error where an output is what standard output leads to."""
    with suppress(OSError):
        if any(not path.is_char_device() and os.path.samestat(path.stat(), os.fstat(1)) for path in written):
            return redirect_stdout(sys.stderr)
    return nullcontext()
