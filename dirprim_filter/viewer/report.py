"""The text panel about a run: what it was made with, and what came out."""

from __future__ import annotations

import json
from collections.abc import Mapping

LONGEST = 64
"""Characters of a value: longer values, such as configurations, are split by parameter."""


def run_report(made_with: Mapping[str, str], results: Mapping[str, str], *, title: str = "Run") -> str:
    """Markdown: a table of results, and one of the run's metadata.

    Args:
        made_with: the metadata record of a log; values that are JSON objects are listed item by item.
        results: what came out, and its value.
        title: the heading.
    """
    lines = [f"# {title}", ""]
    if results:
        lines += _table("result", "value", list(results.items()))
    flat: list[tuple[str, str]] = []
    for name, value in made_with.items():
        settings = _object(value)
        flat += (
            [(name, value)] if settings is None else [(f"{name}: {setting}", str(v)) for setting, v in settings.items()]
        )
    return "\n".join([*lines, *(_table("made with", "", flat) if flat else [])])


def _object(value: str) -> dict[str, object] | None:
    if not value.startswith("{"):
        return None
    try:
        settings = json.loads(value)
    except json.JSONDecodeError:
        return None
    return settings if isinstance(settings, dict) else None


def _table(head: str, of: str, rows: list[tuple[str, str]]) -> list[str]:
    cells = [(name, value if len(value) <= LONGEST else value[: LONGEST - 1] + "…") for name, value in rows]
    body = [f"| {_escaped(name)} | {_escaped(value)} |" for name, value in cells]
    return [f"| {head} | {of} |", "|---|---|", *body, ""]


def _escaped(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())
