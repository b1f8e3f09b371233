"""What is read beside the map: the legend, the report about a run, and what happened to tracks."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping

from dirprim_filter.estimates import TrackedFrame

LONGEST = 64
"""Characters of a value in a report: longer ones are cut."""
COASTS, ANEW, MEASURED = "coasts", "reinitialised: its belief did not explain its measurements", "measured again"

LEGEND = """\
**Roses**: how vehicles move in a cell. A petal points and bends in their direction; its area is their share of those
that move; its colour is their mean speed, from violet (0 m/s) by green ({half:g} m/s) to yellow ({fastest:g} m/s and
more). A violet disc: the share of those that stand.

**White dots**: detections. **White outlines**: true vehicles, where known.

**Large dots, arrows, ellipses**: estimates, where they will be in one second, and the region that holds the vehicle
with 90 % probability. Dark: coasting. **Small dots behind**: the last five seconds. With `--smooth`, bold dots with
ellipses: the smoothed estimates.

**Fans, thin lines**: forecast regions of 90 and 50 % probability, and some rollouts.

**Particles**: of the ringed vehicle, with `--set particles_out=N` of all. By direction: amber east, green north,
blue west, magenta south.

**White ring**: the vehicle that was least expected, or the one asked for. Its direction is plotted: the prior of its
place, the cue (its turn signal, a circle without one), the posterior (Eq. 4), and its particles.

Layers are switched on and off in the panel on the left.
"""


def legend(fastest: float) -> str:
    """Markdown; `fastest` is the speed of the last colour, m/s."""
    return LEGEND.format(half=0.6 * fastest, fastest=fastest)


def run_report(made_with: Mapping[str, str], results: Mapping[str, str]) -> str:
    """Markdown: a table of results, and one of the run's metadata.

    Args:
        made_with: the metadata record of a log; values that are JSON objects are listed item by item.
        results: what came out, and its value.
    """
    flat = [item for name, value in made_with.items() for item in _items(name, value)]
    lines = ["# Run", ""]
    for head, rows in (("result | value", list(results.items())), ("made with | ", flat)):
        if rows:
            lines += [f"| {head} |", "|---|---|", *(f"| {_cell(name)} | {_cell(value)} |" for name, value in rows), ""]
    return "\n".join(lines)


def _items(name: str, value: str) -> Iterator[tuple[str, str]]:
    try:
        settings = json.loads(value)
    except json.JSONDecodeError:
        settings = None
    if isinstance(settings, dict):
        yield from ((f"{name}: {key}", str(of)) for key, of in settings.items())
    else:
        yield name, value


def _cell(text: str) -> str:
    short = text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
    return " ".join(short.replace("|", "\\|").split())


class Events:
    """Compares each frame with the one before."""

    def __init__(self) -> None:
        self._coasting: dict[str, bool] = {}

    def of(self, frame: TrackedFrame) -> list[tuple[str, str]]:
        """Level and text of what has changed."""
        now = dict(zip(frame.names, frame.estimates.is_coasting.tolist(), strict=True))
        before, self._coasting = self._coasting, now
        found = [("INFO", f"{name} ended") for name in before if name not in now]
        found += [("INFO", f"{name} initialised") for name in now if name not in before]
        found += [
            ("INFO", f"{name} {COASTS if coasts else MEASURED}")
            for name, coasts in now.items()
            if coasts != before.get(name, False)
        ]
        return found + [("WARN", f"{name} {ANEW}") for name in frame.reinitialised if name in now]
