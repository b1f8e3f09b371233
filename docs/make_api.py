"""Writes `api.md`, the reference of the public names, from their docstrings: `python docs/make_api.py`.

A test holds the page current. Docstrings are in Google style; their sections become lists.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

PAGE = Path(__file__).with_name("api.md")
PACKAGES = ("dirprim_filter", "tessellation", "dirprim_filter.filtering")
"""Of these, the names that they hand on."""
MODULES = (
    "dirprim_filter.config", "dirprim_filter.detections", "dirprim_filter.estimates", "dirprim_filter.replay",
    "dirprim_filter.forecasting", "dirprim_filter.distributions.gamma", "dirprim_filter.distributions.von_mises",
    "dirprim_filter.distributions.von_mises_mixture", "dirprim_filter.distributions.product",
    "dirprim_filter.primitives.cues", "dirprim_filter.primitives.motion", "dirprim_filter.primitives.primitive_map",
    "dirprim_filter.primitives.transitions",
    "dirprim_filter.recording.container.log", "dirprim_filter.recording.reader", "dirprim_filter.recording.writer",
    "dirprim_filter.recording.schemas.field_mapping", "dirprim_filter.recording.container.recovery",
    "dirprim_filter.evaluation.splits", "dirprim_filter.evaluation.density", "dirprim_filter.evaluation.cues",
    "dirprim_filter.evaluation.experiment", "dirprim_filter.evaluation.tracking",
    "dirprim_filter.evaluation.scoring",
    "dirprim_filter.evaluation.scores", "dirprim_filter.evaluation.tracked_rows",
    "dirprim_filter.evaluation.tracking_report", "dirprim_filter.recording.tables.estimate_table",
    "dirprim_filter.recording.tables.tracked_table",
    "dirprim_filter.evaluation.metrics.comparison", "dirprim_filter.evaluation.metrics.hota",
    "dirprim_filter.evaluation.metrics.clear_mot", "dirprim_filter.evaluation.metrics.identity",
    "dirprim_filter.evaluation.metrics.gospa", "dirprim_filter.evaluation.metrics.trajectory_gospa",
    "dirprim_filter.evaluation.forecasting", "dirprim_filter.evaluation.forecast_cases",
    "dirprim_filter.evaluation.forecast_methods", "dirprim_filter.simulation.sensor", "dirprim_filter.viewer.stream",
    "dirprim_filter.viewer.sink", "dirprim_filter.viewer.figures",
)  # fmt: skip
"""Of these, what they define."""
SECTION = re.compile(r"^(Args|Attributes|Returns|Raises|Yields):$")
ENTRY = re.compile(r"^(\*{0,2}\w[\w.]*): (.*)$")


def page() -> str:
    """The whole page."""
    lines = [
        "# API reference",
        "",
        "Built from the docstrings by `python docs/make_api.py`; do not edit. Conventions are in",
        "[conventions](conventions.md). What is not here may change without a word.",
    ]
    told: set[int] = set()
    for name in (*PACKAGES, *MODULES):
        module = import_module(name)
        things = [(public, thing) for public, thing in _public(module, name) if id(thing) not in told]
        told |= {id(thing) for _, thing in things}
        if things:
            lines += ["", f"## `{name}`", "", (inspect.getdoc(module) or "").splitlines()[0]]
        for public, thing in things:
            lines += _told(public, thing)
    return re.sub("\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def _public(module: ModuleType, name: str) -> Iterator[tuple[str, object]]:
    handed_on = name in PACKAGES or "__all__" in vars(module)
    names = getattr(module, "__all__", None) or [public for public in vars(module) if not public.startswith("_")]
    for public in sorted(names):
        thing = getattr(module, public)
        if not (inspect.isclass(thing) or inspect.isfunction(thing)):
            continue
        ours = thing.__module__.split(".")[0] in ("dirprim_filter", "tessellation")
        if ours and (handed_on or thing.__module__ == name):
            yield public, thing


def _told(name: str, thing: object, *, depth: str = "###") -> Iterator[str]:
    yield from ("", f"{depth} `{name}{_signature(thing)}`", "")
    yield from _markdown(inspect.getdoc(thing) or "")
    if not inspect.isclass(thing):
        return
    for public, found in vars(thing).items():
        member = found.__func__ if isinstance(found, classmethod | staticmethod) else found
        if public.startswith("_") or not (getattr(member, "__doc__", None) or "").strip():
            continue
        if inspect.isfunction(member):
            yield from _told(f"{name}.{public}", member, depth="####")
        elif isinstance(member, property):
            yield from ("", f"#### `{name}.{public}`", "", *_markdown(inspect.getdoc(member) or ""))


def _signature(thing: object) -> str:
    if inspect.isclass(thing) and thing.__init__ in (object.__init__, Exception.__init__):
        return ""
    try:
        signature = inspect.signature(thing)
    except (TypeError, ValueError):
        return ""
    named = [p.replace(annotation=p.empty, default=_plain(p.default)) for p in signature.parameters.values()]
    shown = [p for i, p in enumerate(named) if not (i == 0 and p.name in ("self", "cls"))]
    return str(signature.replace(parameters=shown, return_annotation=signature.empty)).replace("Ellipsis", "...")


def _plain(default: object) -> object:
    """A default that reads the same on every machine: what is no plain value is only said to be there."""
    of_many = default if isinstance(default, tuple) else (default,)
    plain = all(one is inspect.Parameter.empty or isinstance(one, int | float | str | None) for one in of_many)
    return default if plain else ...


def _markdown(doc: str) -> Iterator[str]:
    """A docstring: its text, and its sections as lists."""
    in_section, entry = False, ""
    for line in [*doc.splitlines(), ""]:
        text = line.strip()
        if entry and (not text or ENTRY.match(text) or not line.startswith(" ")):
            yield entry
            entry = ""
        if SECTION.match(line):
            in_section = True
            yield from (f"**{text[:-1]}**", "")
        elif in_section and line.startswith(" "):
            found = ENTRY.match(text) if len(line) - len(line.lstrip()) == 4 else None
            entry = f"- `{found[1]}`: {found[2]}" if found else f"{entry} {text}" if entry else f"- {text}"
        else:
            in_section = in_section and not text
            yield line


if __name__ == "__main__":
    PAGE.write_text(page())
