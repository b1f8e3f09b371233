"""How a command reads its logs: the options that all of them share, and the reading itself.

A command that reads logs has one parameter `reading`; on the command line it is an option for each of `OPTIONS`, and
`--set` for the other fields of `Reading`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import typer

from dirprim_filter.cli.options import End, Start, Strict, Topics, time_ns
from dirprim_filter.cli.texts import say
from dirprim_filter.recording.name_patterns import is_table

if TYPE_CHECKING:
    from dirprim_filter.origin import Origin
    from dirprim_filter.recording.losses import Losses
    from dirprim_filter.recording.reader import DetectionStream, ReadOptions, TrackResult
    from dirprim_filter.recording.tables import TableDetections

Time = Annotated[
    Literal["log", "publish", "header"],
    typer.Option(help="Time of a message: of logging, publishing, or the stamp in it if there is one."),
]
OPTIONS: dict[str, tuple[Any, Any]] = {
    "topics": (Topics, None), "time_source": (Time, "header"), "start": (Start, None), "end": (End, None),
    "strict": (Strict, False),
}  # fmt: skip
"""Of reading, and their defaults."""
ASKED = {"start": "--start ", "end": "--end ", "labels": "labels=", "group": "group="}
"""What chooses a part of a log, as it is typed."""
OF_TABLES = ("topics", "start", "end", "strict", "origin", "labels", "group", "format")
"""What acts on a table too: it has neither frames, fields nor another time."""
OF_TRUTH = ("time_source", "frame", "origin", "strict")
"""What acts on the truth beside a log, whose topics, fields and times are others."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Which of a log's messages are read, and how: `OPTIONS` and the settings `READING`, where they are given.

    What a log `meets` is a map, or another log, of whose plane it is to be.

    Raises:
        BadParameter: a text is empty, or the group is no number.
    """

    given: dict[str, Any] = field(default_factory=dict)
    meets: str = ""

    def __post_init__(self) -> None:
        for name, given in self.given.items():
            if given == "" or (name == "group" and not str(given).isdecimal()):
                expected = "its number in `dirprim info`" if name == "group" else "a value"
                raise typer.BadParameter(f"{name}: expected {expected}, got {given!r}", param_hint=_typed(name))

    @property
    def group(self) -> int | None:
        """The one that is read; None: all."""
        return int(self.given["group"]) if "group" in self.given else None

    def only(self, *names: str) -> Self:
        """The same with no more than these options."""
        return replace(self, given={name: value for name, value in self.given.items() if name in names})

    def of_truth(self, truth: Path, *more: str) -> Self:
        """The same for the truth beside a log: of `OF_TRUTH`, and of more names, what acts on it."""
        names = {*OF_TRUTH, *more}
        return self.only(*(names.intersection(OF_TABLES) if is_table(truth) else names))

    def on_plane_of(self, other: Path, origin: Origin | None) -> Self:
        """The same for logs that meet another log or a map, whose origin is printed and holds.

        Raises:
            ValueError: another origin is stated, or is that of what they meet already.
        """
        from dirprim_filter.origin import Origin

        stated = self.given.get("origin")
        if stated is None and not self.meets:
            if origin is not None:
                say(f"{other}: origin {origin}, of the logs that it meets too", err=True)
            return replace(self, given=self.given | ({"origin": str(origin)} if origin else {}), meets=str(other))
        expected = Origin.parse(stated) if stated else None
        if not (origin.is_of(expected) if origin else expected is None or not self.meets):
            whose = f"as of {self.meets}" if self.meets else "as --set origin=... states"
            raise ValueError(f"{other}: expected origin {expected}, {whose}, got {origin}")
        return self

    def require_acting(self, *acting: str) -> None:
        """Check that no other options are given: they would be ignored.

        Raises:
            BadParameter: one is.
        """
        for name in self.given:
            if name not in acting:
                raise typer.BadParameter("acts on nothing in these files; leave it out", param_hint=_typed(name))

    def require_acting_on(self, logs: list[Path]) -> None:
        """Check that what is given acts on one of the logs."""
        if all(map(is_table, logs)):
            self.require_acting(*OF_TABLES)
        elif not any(map(is_table, logs)):
            self.require_acting(*self.given.keys() - {"format"})

    def tracks(self, logs: list[Path]) -> TrackResult:
        """The tracks of logs, and what was lost; reports implausible units. On a terminal, a bar for each log.

        Raises:
            RecordingError: as the reader; or nothing is left of what was asked for.
        """
        from dirprim_filter.cli.progress import step_progress
        from dirprim_filter.recording.reader import read_track_logs

        self.require_acting_on(logs)
        with step_progress(f"reading {', '.join(path.name for path in logs)}", "s of the log") as progress:
            log = read_track_logs(logs, self.options(), progress=progress)
        if not len(log.tracks):
            raise self._nothing_left(logs, log.losses)
        return log

    def require_frames(self, n_frames: int, log: Path, losses: Losses) -> None:
        """Check that a part of a log that was asked for holds something; all of it may hold nothing.

        Raises:
            RecordingError: there were no frames, and only a part was asked for, or all rows are left out.
        """
        if n_frames == 0 and (losses.dropped or self.given.keys() & ASKED.keys()):
            raise self._nothing_left([log], losses)

    def _nothing_left(self, logs: list[Path], losses: Losses) -> Exception:
        from dirprim_filter.recording.errors import RecordingError

        asked = "".join(f" {typed}{self.given[name]}" for name, typed in ASKED.items() if name in self.given)
        return RecordingError(
            f"{', '.join(map(str, logs))}: expected moving objects{asked}, got none; left out: {losses}; "
            "`dirprim info` lists times, labels and groups"
        )

    def detections(self, log: Path, *, motion: bool = False, live: bool = False) -> DetectionStream | TableDetections:
        """What a log's sensor reported, an instant at a time, as of `stream_detections`."""
        from dirprim_filter.recording.reader import stream_detections

        self.require_acting_on([log])
        return stream_detections(log, self.options(), motion=motion, live=live)

    def said(self) -> dict[str, object]:
        """The options as an output's metadata repeats them."""
        return {"time_source": "header", **self.given}

    def options(self) -> ReadOptions:
        """The same for the library.

        Raises:
            ValueError: a text that is no time, no origin or no path of a field; or the end is not after the start.
        """
        from dirprim_filter.recording.reader import FieldMapping, Origin, ReadOptions

        given = self.given | {"meets": self.meets, "group": self.group}
        start_ns, end_ns = (time_ns(given.pop(name, None), f"--{name}") for name in ("start", "end"))
        if start_ns is not None and end_ns is not None and type(start_ns) is type(end_ns) and end_ns <= start_ns:
            raise ValueError(f"--end: expected a time after --start {self.given['start']}, got {self.given['end']}")
        if fields := given.pop("fields", None):
            given["mapping"] = FieldMapping.parse(fields)
        if origin := given.get("origin"):
            given["origin"] = Origin.parse(origin)
        return ReadOptions(start_ns=start_ns, end_ns=end_ns, **given)


def _typed(name: str) -> str:
    """An option or a setting of reading, as it is typed."""
    return f"--{name.replace('_', '-')}" if name in OPTIONS else f"--set {name}=..."
