"""The command `dirprim`: its entry, its errors and its exit codes.

Exit codes: 0 done; 1 error; 2 usage; 3 done, but a part of the input was lost; 130 ended by Ctrl-C, 143 by SIGTERM.
"""

from __future__ import annotations

import gc
import logging
import sys
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from itertools import chain
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.commands import Quiet, Verbose, register, say_more_or_less
from dirprim_filter.cli.texts import Shown, hold_standard_streams

COMMANDS = {
    "See what is there": ["info", "plot", "view", "doctor"],
    "Learn and track": ["learn", "store", "track", "smooth", "forecast"],
    "Judge": ["score", "evaluate", "calibrate"],
    "Logs and tables": ["convert", "export", "recover", "simulate", "demo"],
}
"""The commands, and groups of them, under the titles that `dirprim --help` gives them; each in a module so called."""


class _Titled(TyperGroup):
    """Lists the commands under their titles."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for title, names in COMMANDS.items():
            with formatter.section(title):
                formatter.write_dl([(name, self.commands[name].get_short_help_str(66)) for name in names])


app = typer.Typer(
    name="dirprim",
    cls=_Titled,
    help=(
        "Learn from MCAP logs how vehicles move at each place, and track vehicles with what was learned. "
        "New here? Run `dirprim demo`, then `dirprim info` on a log of your own."
    ),
    epilog=(
        "\b\nFirst steps with a log of your own (docs/guides/log.md has all of them):\n"
        "  dirprim info  LOG                                  what is in it?\n"
        "  dirprim learn LOG -o map.mcap                      how do vehicles move there?\n"
        "  dirprim plot  map.mcap -o map.png --log LOG        look at it\n"
        "  dirprim track LOG --map map.mcap -o tracks.mcap --save tracks.rrd\n"
        "  dirprim view  tracks.rrd                           play it\n"
        "A table (.csv, .parquet) may stand wherever a log does.\n\n"
        "Exit codes: 0 done; 1 error, in one line; 2 usage; 3 done, but a part of the input was lost; 130 ended by "
        "Ctrl-C, 143 by SIGTERM."
    ),
    no_args_is_help=True,
    rich_markup_mode=None,  # plain help answers three times as fast
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"dirprim {version('dirprim-filter')}")
        raise typer.Exit


_version = typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version and exit.")


@app.callback()
def _every_command(verbose: Verbose = False, quiet: Quiet = False, version: Annotated[bool, _version] = False) -> None:
    form = "%(levelname)s: %(message)s"
    logging.basicConfig(level=logging.WARNING, stream=sys.stderr, force=True, format=form)
    logging.getLogger().handlers[0].addFilter(_Once())
    say_more_or_less(verbose, quiet)


class _Once(logging.Filter):
    """A command that reads a log twice, for its tracks and its detections, says once what of it is lost."""

    def __init__(self) -> None:
        super().__init__()
        self._said = set[str]()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether it is no warning, or one that was not given before; what it names does not break the line."""
        from dirprim_filter.recording.container.errors import one_line

        record.msg, record.args, n_said = one_line(record.getMessage()), (), len(self._said)
        self._said |= {record.msg} if record.levelno >= logging.WARNING else set()
        return record.levelno < logging.WARNING or len(self._said) > n_said


for name in chain.from_iterable(COMMANDS.values()):
    command = getattr(import_module(f"dirprim_filter.cli.{name}"), name)
    if isinstance(command, typer.Typer):
        app.add_typer(command)
    else:
        register(app, command)


def main() -> None:
    """Run the command line and exit with its code.

    Imports make half a million objects, none of them garbage. Looking through these again and again, and twice more
    before the interpreter ends, would take a third of a short command.
    """
    gc.set_threshold(100_000)  # Python's 700 new objects suit programs that import little
    hold_standard_streams()
    exit_codes.listen()
    code = run(sys.argv[1:])
    gc.freeze()
    sys.exit(code)


def run(arguments: list[str]) -> int:
    """Run the command line; -> its exit code."""
    with redirect_stdout(Shown(sys.stdout)), redirect_stderr(Shown(sys.stderr)):
        try:
            code = app(arguments, prog_name="dirprim", standalone_mode=False)
        except KeyboardInterrupt:
            code = exit_codes.INTERRUPTED
        except Exception as error:
            if hasattr(error, "exit_code") and hasattr(error, "show"):  # the parser's own: usage
                error.show()
                return int(error.exit_code)
            if exit_codes.Terminated.came:
                return exit_codes.of_interruption()
            if not _is_the_users(error) or logging.getLogger().isEnabledFor(logging.INFO):
                raise
            sys.stderr.write(f"error: {_one_line(error)}\n")
            return exit_codes.FAILED
    if code == exit_codes.INTERRUPTED:  # as the parser returns it too
        return exit_codes.of_interruption()
    return code if isinstance(code, int) else exit_codes.DONE


def _is_the_users(error: Exception) -> bool:
    """Whether the error is about input, files or the machine; a bug keeps its traceback."""
    if isinstance(error, ValueError | OSError | MemoryError):
        return True
    from dirprim_filter.recording.container.errors import RecordingError
    from dirprim_filter.simulation.traffic import SimulationError

    return isinstance(error, RecordingError | SimulationError)


def _one_line(error: Exception) -> str:
    from dirprim_filter.recording.container.errors import one_line

    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return one_line(f"{error.filename}: {error.strerror}")
    if isinstance(error, MemoryError):
        return "expected more memory than there is; give less of the input, as by --start and --end"
    return one_line(" ".join(str(error).split())) or type(error).__name__
