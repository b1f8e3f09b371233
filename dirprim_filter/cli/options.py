"""The options that several commands share."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from glob import glob, has_magic
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from dirprim_filter.recording.name_patterns import FORMATS, WRITTEN_TABLES

WRITTEN = "written"
"""Marks the options for output files, which are checked before the work; a tuple beside it: the ends of their names."""
PICTURES = (".png", ".pdf", ".svg")
"""Ends of the names of pictures."""
AUTO = "auto"
"""In place of a sensor's file: learn it from the log."""


def time_ns(text: str | None, option: str) -> int | None:
    """A time on the command line: seconds from a log's start, nanoseconds with ns behind, or RFC 3339; None stays None.

    Raises:
        ValueError: none of these; names the option.
    """
    if text is None:
        return None
    with suppress(InvalidOperation, OverflowError, ValueError):
        if text.endswith("ns"):
            return int(text.removesuffix("ns"))
        from dirprim_filter.recording.objects.options import FromStart

        if (seconds := Decimal(text.removesuffix("s"))).adjusted() < 10:  # more are no nanoseconds of 64 bits
            return FromStart(seconds * 1_000_000_000)
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(
            f"{option}: expected seconds from the start such as 12.5, nanoseconds such as 5ns, or a time such as "
            f"2026-01-31T12:00:00Z, got {text!r}"
        ) from None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000


def existing_log(text: str) -> Path:
    """A file or folder that exists, "-", a URL, or a quoted pattern.

    Raises:
        BadParameter: it is none.
    """
    path = Path(text)
    if text != "-" and "://" not in text and not has_magic(text) and not (text and path.exists()):
        raise typer.BadParameter(f"File '{text}' does not exist.")
    return path


def _found(paths: list[Path]) -> list[Path]:
    """The files of quoted patterns, in order of their names, and others as they are; each once."""
    from dirprim_filter.recording.container.remote_file import as_url

    found: list[Path] = []
    for path in paths:
        is_pattern = has_magic(str(path)) and not path.exists() and as_url(str(path)) is None  # a query begins with ?
        own = sorted(map(Path, glob(str(path), recursive=True))) if is_pattern else [path]  # noqa: PTH207 (Path has no absolute patterns)
        if not own:
            raise typer.BadParameter(f"'{path}': expected files, found none; check the pattern")
        found += own
    if len({os.path.realpath(path) for path in found}) < len(found):
        raise typer.BadParameter("expected each file once, got one twice")
    return found


def _several(text: str, **more: Any) -> Any:
    """Files, URLs and quoted patterns, with a text for the help."""
    return typer.Argument(help=text, parser=existing_log, callback=_found, **more)


def seconds(text: str) -> float:
    """A duration such as 12h, 30d or 2w, in seconds.

    Raises:
        BadParameter: it is none.
    """
    unit = {"s": 1.0, "h": 3600.0, "d": 86400.0, "w": 604800.0}.get(text[-1:], 0.0)
    try:
        duration = float(text[:-1]) * unit
    except ValueError:
        duration = 0.0
    if not 0.0 < duration < float("inf"):
        raise typer.BadParameter(f"{text!r}: expected a positive duration such as 12h, 30d or 2w")
    return duration


def month(text: str) -> str:
    """A month such as 2026-08.

    Raises:
        BadParameter: it is none.
    """
    if not re.fullmatch(r"\d{4}-(0[1-9]|1[0-2])", text):
        raise typer.BadParameter(f"{text!r}: expected a month such as 2026-08")
    return text


def _sensor(text: str) -> str:
    """A file that exists, or `AUTO`."""
    if text != AUTO and not Path(text).is_file():
        fault = "is no file" if Path(text).exists() else "does not exist"
        raise typer.BadParameter(f"expected {AUTO} or a file, but '{text}' {fault}")
    return text


def _answered(url: str | None) -> str | None:
    """The address of a viewer that answers: asked before the work."""
    if url is not None:
        from dirprim_filter.viewer.process import require_listener

        require_listener(url)
    return url


FILE: dict[str, Any] = {"exists": True, "dir_okay": False}
LOGS = "MCAP logs, rosbag2 folders, tables, URLs or quoted patterns; - is standard input."
SENSOR = "How the sensor errs: a sensor.toml, as of `dirprim calibrate`"
MAP = "A map that `dirprim learn` wrote."

Log = Annotated[Path, typer.Argument(help="An MCAP log, bag, table or URL; - is standard input.", parser=existing_log)]
Logs = Annotated[list[Path], _several(LOGS)]
LogsOrStore = Annotated[list[Path], _several(f"{LOGS} Or one store.", metavar="LOG...|STORE")]
Files = Annotated[list[Path], _several("An .rrd, a map, a log, the tracks of `dirprim track`; or several.")]
Outputs = Annotated[list[Path], _several(f"Logs of `dirprim track`, or tables: {', '.join(FORMATS)}.")]
EstimatesFile = Annotated[Path, typer.Argument(help="A log of `dirprim track`.", **FILE)]
MapFile = Annotated[Path, typer.Argument(help=MAP, **FILE)]
Map = Annotated[Path, typer.Option("--map", help=MAP, **FILE)]
MapOrNone = Annotated[Path | None, typer.Option("--map", help="A learned map.", **FILE)]
Motion = Annotated[
    Literal["learned", "constant-velocity"],
    typer.Option(metavar="learned|constant-velocity", help="By the map or log; or a Kalman filter."),
]
_truth = typer.Option(help="A log of the true tracks, to compare with.", parser=existing_log)
Truth = Annotated[Path, _truth]
MaybeTruth = Annotated[Path | None, _truth]
Output = Annotated[Path, typer.Option("--output", "-o", help="The file to write."), WRITTEN]
_picture = typer.Option("--output", "-o", help=f"The picture: {', '.join(PICTURES)}.")
Picture = Annotated[Path, _picture, WRITTEN, PICTURES]
MaybePicture = Annotated[Path | None, _picture, WRITTEN, PICTURES]
Table = Annotated[
    Path, typer.Option("--output", "-o", help=f"The table: {', '.join(WRITTEN_TABLES)}."), WRITTEN, WRITTEN_TABLES
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite what exists.")]
Json = Annotated[bool, typer.Option("--json", help="Print all figures, and what they follow from, as JSON.")]
Seed = Annotated[int, typer.Option(min=0, help="The same seed gives the same result.")]
Split = Annotated[
    Literal["vehicle", "group"] | None, typer.Option(help="Held out together. Default: groups, if several.")
]
Folds = Annotated[int, typer.Option(min=1, help="Number of folds, each held out once.")]
Tessellation = Annotated[
    Literal["joint", "voronoi", "grid"],
    typer.Option(help="joint: with the primitives; voronoi: by positions; grid: squares."),
]
CellSize = Annotated[float | None, typer.Option(help="Metres. Default: chosen on held-out vehicles.")]
CellCount = Annotated[int | None, typer.Option("--cells", help="Approximate number of cells, instead of their size.")]
HowModes = Annotated[Literal["bic", "dbscan"], typer.Option(help="bic, or the paper's dbscan.")]
HowShaped = Annotated[Literal["curved", "flat"], typer.Option(help="How a primitive varies inside its cell.")]
Topics = Annotated[str | None, typer.Option(help="Name or regular expression. Default: the best there is.")]
Start = Annotated[str | None, typer.Option(help="Seconds from the log's first time; 5ns; or RFC 3339.")]
End = Annotated[str | None, typer.Option(help="End, exclusive, likewise.")]
Strict = Annotated[bool, typer.Option("--strict", help="Treat damage in a log as an error.")]
Config = Annotated[Path | None, typer.Option(help="TOML, or an earlier run's --json or -o.", **FILE)]
Particles = Annotated[int | None, typer.Option(min=1, help="Particles for each vehicle. Default: 1000.")]
Noise = Annotated[float | None, typer.Option(min=1e-6, help="Standard deviation of positions, m. Default: learned.")]
Rate = Annotated[
    float | None,
    typer.Option(metavar="HZ", min=1e-3, max=1e3, help="Estimate so many times a second where no frame comes."),
]
SensorFile = Annotated[Path | None, typer.Option(help=f"{SENSOR}.", **FILE)]
SensorOrAuto = Annotated[
    str | None, typer.Option(help=f"{SENSOR}; auto, the default: learned from the log.", parser=_sensor)
]
NoIds = Annotated[bool, typer.Option("--no-ids", help="Ignore the ids of a log.")]
StoreFolder = Annotated[Path, typer.Argument(metavar="STORE", help="Its folder, or a URL such as s3://bucket/fleet.")]
StoreWorkers = Annotated[int | None, typer.Option(min=1, help="Processes. Default: one; to add logs, one per core.")]
Scheduler = Annotated[str | None, typer.Option(help="Of Dask, such as tcp://192.168.0.7:8786.")]
Save = Annotated[Path | None, typer.Option(help="Write an .rrd for the rerun viewer."), WRITTEN]
Spawn = Annotated[bool, typer.Option("--spawn", help="Start a new rerun viewer and stream to it.")]
Connect = Annotated[
    str | None, typer.Option(help="Stream to a viewer, such as rerun+http://127.0.0.1:9876/proxy.", callback=_answered)
]
