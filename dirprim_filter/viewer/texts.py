"""What is read beside the map: the legend, with a bar of its colours under the map, and the report about a run."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from itertools import chain

import numpy as np
import rerun as rr

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing.colors import speed_color
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.focus import CROWD, DRAWN_IN_FULL

N_STEPS = 48
TICK_STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""m/s between ticks: the smallest that leaves at most six."""
BAR = (0.3, 0.02)
"""Width and height of the colour bar as shares of the view's; in the southern corner where there are fewer cells."""
CORNER = (0.35, 0.1)
"""Width and height of what the bar and its numbers hide, as shares of the view's."""
LONGEST = 64
"""Characters of a value in a report: longer ones are cut."""

LEGEND = f"""\
**Roses**: how vehicles move in a cell. A petal points and bends in their direction; its area is their probability; its
colour is their mean speed, from violet (0 m/s) to yellow ({{fastest:g}} m/s and more). A violet
disc: standing vehicles.

**White dots**: detections. **White outlines**: true vehicles, where known.

**Large dots, arrows, ellipses**: estimates, where they will be in one second, and the region that holds the vehicle
with 90 % probability. Dark: coasting. **Lines behind**: the last five seconds. With `--smooth`, bold lines with
ellipses: the smoothed estimates.

**Fans, thin lines**: forecast regions of 90 and 50 % probability, and some rollouts.

**Small dots**: particles of the ringed vehicle, with `--particles-out` of all. By direction: amber east, green north,
blue west, magenta south.

**White ring**: the vehicle with the largest innovations, or the one asked for. Its speed and its direction are
plotted: the prior of its place, the cue (its turn signal, else its course of the last second), and the posterior
(Eq. 4).

**Dense traffic**: of more than {CROWD} vehicles only {DRAWN_IN_FULL} have a name, particles, an
ellipse and a fan: those with the largest innovations. The others are small.

Layers are switched on and off in the panel on the left.
"""


def legend(
    primitives: PrimitiveMap, *, extent: FloatArray, fastest: float
) -> Iterator[tuple[str, list[rr.AsComponents]]]:
    """The text, and a bar from slow to fast where it hides the fewest cells that hold data.

    Args:
        primitives: the map.
        extent: (2, 2) metres, the view's south-west and north-east corner.
        fastest: m/s, the speed of the last colour.
    """
    yield "/legend", [rr.TextDocument(LEGEND.format(fastest=fastest), media_type="text/markdown")]
    centers = primitives.tessellation.centers[primitives.n_rows[:-1] > 0]
    share = (centers - extent[0]) / (extent[1] - extent[0])
    low = share[(share[:, 1] >= 0) & (share[:, 1] < CORNER[1]), 0]
    is_east = ((low <= 1) & (low > 1 - CORNER[0])).sum() < ((low >= 0) & (low < CORNER[0])).sum()
    width, height = np.array(BAR) * (extent[1] - extent[0])
    left, bottom = extent[1, 0] - width if is_east else extent[0, 0], extent[0, 1]

    def places(speed: FloatArray, y: float) -> FloatArray:
        return np.stack([left + width * speed / fastest, np.full_like(speed, y), np.zeros_like(speed)], axis=-1)

    speed = np.linspace(0.0, fastest, N_STEPS + 1)
    corner = 2 * np.arange(N_STEPS)[:, None]
    bar = rr.Mesh3D(
        vertex_positions=np.stack([places(speed, bottom), places(speed, bottom + height)], axis=1).reshape(-1, 3),
        triangle_indices=np.concatenate([corner + np.array([0, 2, 1]), corner + np.array([1, 2, 3])]),
        vertex_colors=speed_color(np.repeat(speed, 2), fastest=fastest),
    )
    step = next((step for step in TICK_STEPS if fastest <= 5.0 * step), TICK_STEPS[-1])
    ticks = np.append(np.arange(0.0, fastest - 0.4 * step, step), fastest)
    labels = [*(f"{tick:g}" for tick in ticks[:-1]), f"{fastest:g} m/s"]
    small, grey = rr.Radius.ui_points(1.0), (200, 200, 200)
    yield "/map/legend", [
        bar, rr.Points3D(places(ticks, bottom), colors=grey, radii=small, labels=labels, show_labels=True),
    ]  # fmt: skip


def run_report(made_with: Mapping[str, str], results: Mapping[str, str], *, title: str = "Run") -> str:
    """Markdown: a table of results, and one of the run's metadata.

    Args:
        made_with: the metadata record of a log; values that are JSON objects are listed item by item.
        results: what came out, and its value.
        title: the heading.
    """
    flat = dict(chain.from_iterable(_items(name, value) for name, value in made_with.items()))
    lines = [f"# {title}", ""]
    for head, rows in (("result | value", results), ("made with | ", flat)):
        if rows:
            cells = [(name, of if len(of) <= LONGEST else of[: LONGEST - 1] + "…") for name, of in rows.items()]
            lines += [f"| {head} |", "|---|---|", *(f"| {_cell(a)} | {_cell(b)} |" for a, b in cells), ""]
    return "\n".join(lines)


def _items(name: str, value: str) -> list[tuple[str, str]]:
    try:
        settings = json.loads(value) if value.startswith("{") else None
    except json.JSONDecodeError:
        settings = None
    return [(f"{name}: {key}", str(of)) for key, of in settings.items()] if settings else [(name, value)]


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())
