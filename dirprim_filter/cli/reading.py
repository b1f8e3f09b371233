"""How a command reads its logs: the options that all of them share, and the reading itself.

A command that is decorated with `reads_logs` has one parameter `reading`; on the command line it is the fields of
`Reading`, an option each.
"""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import StrEnum
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

import typer

from dirprim_filter.cli.options import End, Fields, Group, Start, Strict, Topics, time_ns

if TYPE_CHECKING:
    from dirprim_filter.recording.errors import RecordingError
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.playback import Playback
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Which of a log's messages are read, and how."""

    topics: Topics = None
    time_source: Time = TimeSource.HEADER
    frame: Annotated[
        str | None, typer.Option("--frame", help="Frame of the positions. Default: the root of the log's transforms.")
    ] = None
    fields: Fields = None
    origin: Annotated[
        str | None,
        typer.Option("--origin", help="Latitude,longitude of the origin, for satellite fixes. Default: the first fix."),
    ] = None
    labels: Annotated[
        str | None,
        typer.Option("--labels", help="Classes to read, such as car|truck; `dirprim info` lists them. Default: all."),
    ] = None
    group: Group = None
    start: Start = None
    end: End = None
    strict: Strict = False

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
        """Nothing of what was asked for is an error; nothing of a log of which all was asked for is not.

        Raises:
            RecordingError: there were no frames, and only a part of the log was asked for.
        """
        if n_frames == 0 and self._asked():
            raise self._nothing_left([log], losses)

    def _asked(self) -> str:
        """The options that choose a part of a log."""
        asked = {"--start": self.start, "--end": self.end, "--labels": self.labels, "--group": self.group}
        return "".join(f" {option} {value}" for option, value in asked.items() if value is not None)

    def _nothing_left(self, logs: list[Path], losses: Losses) -> RecordingError:
        from dirprim_filter.recording.errors import RecordingError

        return RecordingError(
            f"{', '.join(map(str, logs))}: expected moving objects{self._asked()}, got none; left out: {losses}; "
            "`dirprim info` lists times, labels and groups"
        )

    def detections(self, log: Path, *, motion: bool) -> DetectionStream | TableDetections:
        """What a log's sensor reported, an instant at a time; `motion`: its directions and speeds were measured."""
        from dirprim_filter.recording.reader import stream_detections

        return stream_detections(log, self.options(), motion=motion)

    def playback(self, log: Path) -> Playback:
        """The frames of a log: what a tracker believed, else the objects."""
        from dirprim_filter.recording.playback import Playback

        return Playback(log, self.options())

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


def reads_logs(command: Callable[..., Result]) -> Callable[..., Result]:
    """The command with an option for each field of `Reading` in place of its parameter `reading`."""
    hints = get_type_hints(command, include_extras=True)
    of_options = get_type_hints(Reading, include_extras=True)
    named = inspect.Parameter.KEYWORD_ONLY
    options = [
        inspect.Parameter(field.name, named, default=field.default, annotation=of_options[field.name])
        for field in fields(Reading)
    ]
    own = [
        parameter.replace(kind=named, annotation=hints[name])
        for name, parameter in inspect.signature(command).parameters.items()
        if name != "reading"
    ]

    @wraps(command)
    def read(**given: Any) -> Result:
        reading = Reading(**{option.name: given.pop(option.name) for option in options})
        return command(reading=reading, **given)

    read.__signature__ = inspect.Signature([*own, *options], return_annotation=hints["return"])  # type: ignore[attr-defined]
    read.__annotations__ = {parameter.name: parameter.annotation for parameter in [*own, *options]}
    return read
