"""How a function becomes a command: its outputs are checked before the work, its `--help` is in groups.

No output takes the place of an input, and none is where it cannot be written: `checked` knows from the options which
of its files are which.
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
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from dirprim_filter.cli.compiling import mend_cache, quiet_unless_watched
from dirprim_filter.cli.options import WRITTEN
from dirprim_filter.cli.reading import OPTIONS
from dirprim_filter.partial_file import PartialFile

Result = TypeVar("Result")


Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Say more on stderr; show where errors come from.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Only errors on stderr.")]


def say_more_or_less(verbose: bool, quiet: bool) -> None:
    """What is logged, as asked for."""
    if verbose or quiet:
        logging.getLogger().setLevel(logging.INFO if verbose else logging.ERROR)


def register(app: typer.Typer, command: Callable[..., Any]) -> None:
    """Add a command, whose outputs are checked before its work, and which takes the options of verbosity too."""
    work = checked(command)

    @wraps(command)
    def run(*, verbose: bool, quiet: bool, **given: Any) -> Any:
        say_more_or_less(verbose, quiet)
        return work(**given)

    hints = get_type_hints(command, include_extras=True) | {"verbose": Verbose, "quiet": Quiet}
    own, named = inspect.signature(command).parameters.values(), inspect.Parameter.KEYWORD_ONLY
    run.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
        *(parameter.replace(annotation=hints[parameter.name]) for parameter in own),
        *(inspect.Parameter(name, named, default=False, annotation=hints[name]) for name in ("verbose", "quiet")),
    ])  # fmt: skip
    run.__annotations__ = hints
    app.command(cls=_Grouped)(run)


class _Grouped(TyperCommand):
    """Lists what all commands that read logs share after a command's own options."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        titled: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": [], "Reading a log": []}
        parameters = self.get_params(ctx)
        reading = (*OPTIONS, "given") if any(of.name == "given" for of in parameters) else ()
        for of in parameters:
            title = "Arguments" if of.param_type_name == "argument" else "Options"
            if (record := of.get_help_record(ctx)) is not None:
                titled["Reading a log" if of.name in reading else title].append(record)
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


def checked(command: Callable[..., Result]) -> Callable[..., Result]:
    """The command, which first asks whether its outputs can be written; options that are no outputs are inputs."""
    marks = {
        name: getattr(hint, "__metadata__", ()) for name, hint in get_type_hints(command, include_extras=True).items()
    }

    @wraps(command)
    def check(*positional: Any, **given: Any) -> Result:
        arguments = inspect.signature(command).bind(*positional, **given).arguments
        written = {name: of for name, of in arguments.items() if WRITTEN in marks[name] and isinstance(of, Path)}
        read = [path for name, of in arguments.items() if WRITTEN not in marks[name] for path in _paths(of)]
        if any(str(path) == "-" for path in written.values()):
            raise typer.BadParameter("expected the name of a file, got -; outputs are renamed when they are whole")
        check_outputs(list(written.values()), read, force=arguments.get("force", False))
        for path, ends in ((path, mark) for name, path in written.items() for mark in marks[name]):
            if isinstance(ends, tuple) and path.suffix.lower() not in ends:
                known, got = ", ".join(ends), path.suffix or "no suffix"
                raise ValueError(f"{path}: expected a name that ends in {known}, got {got}")
        mend_cache()
        quiet_unless_watched()
        from dirprim_filter.recording.container.source import copied_once  # not for `--help`

        with copied_once(), _beside(list(written.values())):
            return command(*positional, **given)

    return check


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
