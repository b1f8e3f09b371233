"""`dirprim info`: what is in a log, and what is damaged."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import exit_codes
from dirprim_filter.cli.options import Logs
from dirprim_filter.cli.reading import Reading
from dirprim_filter.cli.texts import columns as in_columns
from dirprim_filter.cli.texts import counted, say

if TYPE_CHECKING:
    from dirprim_filter.recording.container.source import Files
    from dirprim_filter.recording.summary import LogSummary

logger = logging.getLogger(__name__)

LABELS_SHOWN = 12
"""Of a topic, to people; to machines all."""
TOPICS_SHOWN = 4
"""Of those that are not read for one reason."""


def info(
    logs: Logs,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object for each log.")] = False,
    check: Annotated[bool, typer.Option("--check", help="Read every chunk of a long log too.")] = False,
    *,
    reading: Reading,
) -> int:
    """Say what is in logs: topics, tracks, times, damage.

    Columns in implausible units are named too, and those of a table that are not used. If a log of more than 32 MiB has
    an index, only the index is read, unless --check or an option of reading other than --topics is given.

    Example: dirprim info recordings/roundabout_track.mcap
    """
    from dirprim_filter.recording.container.source import log_files
    from dirprim_filter.recording.name_patterns import is_table
    from dirprim_filter.recording.summary import summarise_by_index

    by_index = not check and reading.given.keys() <= {"topics"}
    reading.require_acting_on(logs)
    worst = exit_codes.DONE
    for path in logs:
        more: dict[str, list[str]] = {}
        if is_table(path):  # whose rows are what a log's messages are
            from dirprim_filter.recording.tables import read_table, summary_of

            table = read_table(path, reading.options())
            summary, faults = summary_of(table), [*table.losses.remarks]
            faults += [f"left out {table.losses}"] if table.losses.dropped else []
            more = {"columns": list(table.used), "unused": list(table.unused)}
            code = exit_codes.of_losses(table.losses)
        else:
            files = log_files(path)
            indexed = summarise_by_index(files, topics=reading.given.get("topics")) if by_index else None
            summary, faults = (indexed, []) if indexed else _whole(path, files, reading)
            is_lost = summary.damage or any(topic.undecodable for topic in summary.topics)
            code = exit_codes.INPUT_LOST if is_lost else exit_codes.DONE
        if as_json:
            typer.echo(json.dumps(summary.as_json() | more | {"faults": faults}))
        else:
            what = counted(summary.messages, "row" if more else "message")
            say(f"{path}: {what}{_span(summary)}", *_lines(summary, faults, **more))
        worst = max(worst, code)
    return worst


def _whole(path: Path, files: Files, reading: Reading) -> tuple[LogSummary, list[str]]:
    """What a log holds, and the faults of the tracks that `dirprim learn` would read."""
    from dirprim_filter.recording.container.log import Log
    from dirprim_filter.recording.errors import MissingTransformError, RecordingError
    from dirprim_filter.recording.inspection import inspect
    from dirprim_filter.recording.plausibility import ImplausibleError
    from dirprim_filter.recording.reader import read_track_logs

    with Log(path, files=files) as log:
        summary = inspect(log, reading.options())
        if all(topic.tracks is None for topic in summary.topics):
            return summary, []
        try:
            return summary, read_track_logs(log, reading.options(), strict=False).losses.faults
        except (ImplausibleError, MissingTransformError) as error:
            return summary, [str(error)]
        except RecordingError as error:  # `learn` would say so too: detections alone
            logger.info("%s: not looked for faults of tracks: %s", path, error)
            return summary, []


def _lines(log: LogSummary, faults: list[str], columns: Sequence[str] = (), unused: Sequence[str] = ()) -> list[str]:
    """What there is, of a table with its columns."""
    lines = [f"columns: {', '.join(columns)}{'; not used: ' * bool(unused)}{', '.join(unused)}"] * bool(columns)
    if not log.is_checked:
        lines.append("by the log's index alone; its chunks were not checked, and tracks not counted: --check does both")
    rows = [
        [t.name, t.schema or "-", t.encoding or "-", str(t.messages), "-" if t.tracks is None else str(t.tracks)]
        for t in log.topics
    ]
    lines += in_columns([["topic", "schema", "encoding", "rows" if columns else "messages", "tracks"], *rows], n_left=3)
    if log.is_checked and not columns:
        carrying = ", ".join(t.name for t in log.topics if t.tracks)
        seen = ", ".join(f"{t.name} ({t.detections})" for t in log.topics if t.detections)
        lines += [f"tracks in: {carrying}" if carrying else "no topic carries tracks"] * bool(carrying or not seen)
        lines += [f"detections without ids in: {seen}, for `dirprim track`"] * bool(seen)
    lines += _unread(log)
    lines += [f"labels in {topic}: {_counts(counts)}" for topic, counts in log.labels.items()]
    lines += [
        f"groups in {topic}: {len(counts)}, from {min(counts)} to {max(counts)}; --set group=NUMBER takes one of them"
        for topic, counts in log.groups.items()
    ]
    lines += [f"attachments: {', '.join(log.attachments)}"] * bool(log.attachments)
    lines += [f"faults: {line}" for line in faults]
    lines += [f"damage: {damage}" for damage in log.damage]
    return [f"  {line}" for line in lines]


def _unread(summary: LogSummary) -> list[str]:
    """A line for each reason why messages or topics are not read."""
    lines, topics = [], dict[str, list[str]]()
    for topic in summary.topics:
        if topic.undecodable:
            lines.append(f"not read: {topic.undecodable} of {topic.messages} messages of {topic.name}: {topic.why}")
        elif topic.why:
            topics.setdefault(topic.why, []).append(topic.name)
    for why, names in topics.items():
        more = f" and {len(names) - TOPICS_SHOWN} more" * (len(names) > TOPICS_SHOWN)
        lines.append(f"not read: {', '.join(names[:TOPICS_SHOWN])}{more}: {why}")
    return lines


def _counts(counts: Mapping[str, int]) -> str:
    most = sorted(counts.items(), key=lambda item: -item[1])
    shown = [f"{label or 'none'} {n}" for label, n in most[:LABELS_SHOWN]]
    return ", ".join(shown) + (f" and {len(most) - LABELS_SHOWN} more" if len(most) > LABELS_SHOWN else "")


def _span(summary: LogSummary) -> str:
    start_ns, end_ns = summary.start_ns, summary.end_ns
    if start_ns is None or end_ns is None:
        return ""
    is_date = 10**17 < start_ns < 10**19  # since 1973; other clocks count from the start of the machine or log
    date = f" ({datetime.fromtimestamp(start_ns // 10**9, UTC):%Y-%m-%d %H:%M:%S} UTC)" if is_date else ""
    return f", {(end_ns - start_ns) * 1e-9:.1f} s from {start_ns} ns{date}"
