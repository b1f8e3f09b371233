"""`dirprim info`: what is in a log, and what is damaged."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from dirprim_filter.cli import losses
from dirprim_filter.cli.options import Logs

if TYPE_CHECKING:
    from pathlib import Path

    from dirprim_filter.recording.summary import LogSummary


def info(
    logs: Logs,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object for each log.")] = False,
) -> int:
    """Tell what logs hold: topics, which of them carry tracks, times, damage.

    Example: dirprim info recordings/roundabout_track.mcap
    """
    from dirprim_filter.recording.reader import inspect

    worst = losses.DONE
    for path in logs:
        summary = inspect(path)
        typer.echo(json.dumps(summary.as_json()) if as_json else _text(path, summary))
        worst = max(worst, losses.exit_code(summary.damage))
    return worst


def _text(path: Path, summary: LogSummary) -> str:
    lines = [f"{path}: {summary.messages} messages{_span(summary)}"]
    rows = [("topic", "schema", "encoding", "messages", "tracks")]
    rows += [
        (
            t.name,
            t.schema or "-",
            t.encoding or "-",
            str(t.messages),
            "-" if t.tracks is None else str(t.tracks),
        )
        for t in summary.topics
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(5)]
    for row in rows:
        texts = [cell.ljust(w) for cell, w in zip(row[:3], widths[:3], strict=True)]
        numbers = [cell.rjust(w) for cell, w in zip(row[3:], widths[3:], strict=True)]
        lines.append("  " + "  ".join(texts + numbers))
    carrying = [t.name for t in summary.topics if t.tracks]
    lines.append(f"  tracks in: {', '.join(carrying)}" if carrying else "  no topic carries tracks")
    lines += [f"  damage: {d.kind} at byte {d.offset}: {d.detail}" for d in summary.damage]
    return "\n".join(lines)


def _span(summary: LogSummary) -> str:
    if summary.start_ns is None or summary.end_ns is None:
        return ""
    return f", {(summary.end_ns - summary.start_ns) * 1e-9:.1f} s from {summary.start_ns} ns"
