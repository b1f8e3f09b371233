"""How a command reads its logs: the options that all of them share, and the reading itself.

A command that is decorated with `reads_logs` has one parameter `reading`; on the command line it is an option for each
of `OPTIONS`, and `--set` for the other fields of `Reading`.
"""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import StrEnum
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeVar, get_type_hints

import typer

from dirprim_filter.cli.options import End, Start, Strict, Topics, time_ns
from dirprim_filter.cli.settings import READING, Settings, assignments, deal

if TYPE_CHECKING:
    from dirprim_filter.recording.errors import RecordingError
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.reader import DetectionStream, ReadOptions, TrackResult
    from dirprim_filter.recording.tables.source import TableDetections

logger = logging.getLogger(__name__)
Result = TypeVar("Result")


class TimeSource(StrEnum):
    """Which time of a message to use."""

    LOG = "log"
    PUBLISH = "publish"
    HEADER = "header"


Time = Annotated[
    TimeSource,
    typer.Option(
        "--time-source", help="Time of a message: of logging, publishing, or the stamp in it if there is one."
    ),
]


OPTIONS = {"topics": Topics, "time_source": Time, "start": Start, "end": End, "strict": Strict}
"""Of reading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Which of a log's messages are read, and how.

    Attributes:
        topics: name or regular expression; None: the best available.
        time_source: which time of a message counts.
        start: as `time_ns` reads it.
        end: the same, exclusive.
        strict: damage is an error.
        frame: of the positions; None: the root of the log's transforms.
        fields: where the objects of an unknown schema are, as `id=.objects[].id,x=.objects[].x,...`.
        origin: latitude,longitude, for satellite fixes; None: the first fix.
        labels: a regular expression of classes; None: all.
        group: one of the log's; None: all.
    """

    topics: str | None = None
    time_source: TimeSource = TimeSource.HEADER
    start: str | None = None
    end: str | None = None
    strict: bool = False
    frame: str | None = None
    fields: str | None = None
    origin: str | None = None
    labels: str | None = None
    group: int | None = None

    @classmethod
    def of(cls, options: dict[str, Any], settings: Settings) -> Self:
        """The options and, taken out of the settings, those of reading.

        Raises:
            BadParameter: the group is no number.
        """
        texts: dict[str, Any] = {name: settings.pop(name) for name in READING if name in settings}
        group = texts.pop("group", None)
        if group is not None and not group.isdecimal():
            raise typer.BadParameter(f"group: expected its number in `dirprim info`, got {group!r}", param_hint="--set")
        return cls(**options, **texts, group=None if group is None else int(group))

    def tracks(self, logs: list[Path]) -> TrackResult:
        """The tracks of logs, and what was lost; reports implausible vehicles. On a terminal, a bar for each log.

        Raises:
            RecordingError: as the reader; or nothing is left of what was asked for.
        """
        from dirprim_filter.cli.progress import step_progress
        from dirprim_filter.faults import find_faults
        from dirprim_filter.recording.reader import read_track_logs

        with step_progress(f"reading {', '.join(path.name for path in logs)}", "s of the log") as progress:
            log = read_track_logs(logs, self.options(), progress=progress)
        if not len(log.tracks):
            raise self._nothing_left(logs, log.losses)
        for line in find_faults(log.tracks).lines():
            logger.warning("%s: %s", ", ".join(map(str, logs)), line)
        return log

    def require_frames(self, n_frames: int, log: Path, losses: Losses) -> None:
        """Check that a part of a log that was asked for holds something; all of it may hold nothing.

        Raises:
            RecordingError: there were no frames, and only a part of the log was asked for.
        """
        if n_frames == 0 and self._asked():
            raise self._nothing_left([log], losses)

    def _asked(self) -> str:
        """The options that choose a part of a log."""
        asked = {"--start ": self.start, "--end ": self.end, "labels=": self.labels, "group=": self.group}
        return "".join(f" {option}{value}" for option, value in asked.items() if value is not None)

    def _nothing_left(self, logs: list[Path], losses: Losses) -> RecordingError:
        from dirprim_filter.recording.errors import RecordingError

        return RecordingError(
            f"{', '.join(map(str, logs))}: expected moving objects{self._asked()}, got none; left out: {losses}; "
            "`dirprim info` lists times, labels and groups"
        )

    def detections(self, log: Path, *, motion: bool = False, live: bool = False) -> DetectionStream | TableDetections:
        """What a log's sensor reported, an instant at a time, as of `stream_detections`."""
        from dirprim_filter.recording.reader import stream_detections

        return stream_detections(log, self.options(), motion=motion, live=live)

    def said(self) -> dict[str, object]:
        """The options as an output's metadata repeats them."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return values | {"time_source": self.time_source.value, "strict": self.strict or None}

    def options(self) -> ReadOptions:
        """The same for the library.

        Raises:
            ValueError: a text that is no time, no origin or no path of a field.
        """
        from dirprim_filter.recording.reader import FieldMapping, Origin, ReadOptions

        return ReadOptions(
            topics=self.topics,
            time_source=self.time_source.value,
            frame=self.frame,
            mapping=FieldMapping.parse(self.fields) if self.fields else None,
            origin=Origin.parse(self.origin) if self.origin else None,
            labels=self.labels,
            group=self.group,
            start_ns=time_ns(self.start),
            end_ns=time_ns(self.end),
            strict=self.strict,
        )


def reads_logs(*own: str) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Decorates a command: in place of its parameter `reading` it has the options of reading, and `--set`.

    Args:
        own: what else `--set` takes, for the help; the command then has a parameter `settings`, texts by name.
    """
    text = f"NAME=VALUE, again for each: {', '.join([*READING, *own])}. See docs/settings.md."
    given_as = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help=text)]

    def decorate(command: Callable[..., Result]) -> Callable[..., Result]:
        hints = get_type_hints(command, include_extras=True)
        named = inspect.Parameter.KEYWORD_ONLY
        taken = [
            parameter.replace(kind=named, annotation=hints[name])
            for name, parameter in inspect.signature(command).parameters.items()
            if name not in ("reading", "settings")
        ]
        defaults = {field.name: field.default for field in fields(Reading)} | {"given": None}
        taken += [
            inspect.Parameter(name, named, default=defaults[name], annotation=of)
            for name, of in (OPTIONS | {"given": given_as}).items()
        ]

        @wraps(command)
        def read(**given: Any) -> Result:
            settings = assignments(given.pop("given") or [])
            reading = Reading.of({name: given.pop(name) for name in OPTIONS}, settings)
            if own:
                return command(reading=reading, settings=settings, **given)
            deal(settings)
            return command(reading=reading, **given)

        read.__signature__ = inspect.Signature(taken, return_annotation=hints["return"])  # type: ignore[attr-defined]
        read.__annotations__ = {parameter.name: parameter.annotation for parameter in taken}
        return read

    return decorate
