"""What is the same in every recording and said once: colours and widths, the curves' names, the polar plot's grid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from dirprim_filter.viewer import marks
from dirprim_filter.viewer.curves import BLUE, ORANGE, PLOTS, Color
from dirprim_filter.viewer.focus import polar_grid

POLAR_COLORS = {
    "belief": (120, 128, 145), "prior": (230, 159, 0), "cue": (86, 180, 233), "posterior": (255, 255, 255),
}  # fmt: skip
RUN_COLORS: tuple[Color, Color] = (BLUE, ORANGE)
GRID_COLOR = (55, 60, 72)
KEY_AT = (-1.3, -1.35)
KEY_STEP = 0.23


def static_scene() -> Iterator[tuple[str, rr.AsComponents]]:
    """Entities and what is static of them."""
    yield from marks.STYLES.items()
    yield from curve_names()
    for name, color in POLAR_COLORS.items():
        width = 2.0 if name == "posterior" else 1.25
        yield f"/polar/{name}", rr.LineStrips2D.from_fields(colors=color, radii=rr.Radius.ui_points(width))
    no_dot = rr.Radius.ui_points(0.0)
    yield "/polar/vehicle", rr.Points2D.from_fields(colors=marks.WHITE, radii=no_dot, show_labels=True)
    lines = list(polar_grid())
    yield (
        "/polar/grid",
        rr.LineStrips2D([line * (1.0, -1.0) for line, _ in lines], colors=GRID_COLOR, radii=rr.Radius.ui_points(0.5)),
    )
    ends = [(1.12 * line[-1] * (1.0, -1.0), letter) for line, letter in lines if letter]
    key = [((KEY_AT[0], KEY_AT[1] + KEY_STEP * i), name) for i, name in enumerate(reversed(POLAR_COLORS))]
    texts = [*ends, *key]
    colors = [GRID_COLOR] * len(ends) + [POLAR_COLORS[name] for _, name in key]
    yield (
        "/polar/key",
        rr.Points2D(
            np.array([place for place, _ in texts]), labels=[text for _, text in texts], colors=colors,
            radii=no_dot, show_labels=True,
        ),
    )  # fmt: skip


def curve_names(label: str = "", *, shade: int | None = None) -> Iterator[tuple[str, rr.SeriesLines]]:
    """Names, colours and widths of all curves.

    Args:
        label: goes before the names, where two runs share a plot.
        shade: which of two runs: all its curves are of one colour, the first the strongest.
    """
    for path, curves in PLOTS.items():
        names = [f"{label} {name}".strip() for name in curves.names]
        colors: list[Color] = list(curves.colors)
        if shade is not None:
            colors = [RUN_COLORS[shade], *[_half(RUN_COLORS[shade])] * (len(names) - 1)]
        yield path, rr.SeriesLines(names=names, colors=colors, widths=[1.5] * len(names))


def _half(color: Color) -> Color:
    return color[0] // 2, color[1] // 2, color[2] // 2
