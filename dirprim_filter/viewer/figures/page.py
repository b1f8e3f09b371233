"""The page that figures are drawn on: sizes, axes with units, and the file at the end."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from dirprim_filter.arrays import FloatArray
from dirprim_filter.partial_file import OutputExistsError, PartialFile

DOTS_PER_INCH = 200
SMALL, NORMAL, LARGE = 8, 9, 10
"""Points: numbers at ticks and keys, labels, titles."""
PAD = 0.1
"""Inches around all that is drawn."""
FAINT, INK = "0.6", "0.15"
"""Of frames and ticks; of what is drawn."""
FOCUS_COLOR = "#D55E00"
"""Of Okabe and Ito (2008): what a figure is about."""


def new_figure(width: float, height: float) -> Figure:
    """A page of so many inches, on which matplotlib finds room for all that is around the axes."""
    layout = ConstrainedLayoutEngine(w_pad=PAD, h_pad=PAD)
    return Figure(figsize=(width, height), dpi=DOTS_PER_INCH, layout=layout)


def save_figure(figure: Figure, path: Path, *, dpi: float | None = None, force: bool = False) -> None:
    """Write a figure in the format of the path's suffix; under a temporary name until it is whole.

    The same figure gives the same bytes: no dates, no random names. Text stays text: TrueType in PDF, as publishers
    ask for, and fonts by name in SVG.

    Args:
        figure: the figure.
        path: .png, .pdf or .svg.
        dpi: dots per inch of bitmaps. Default: the figure's, 200.
        force: replace an existing file.

    Raises:
        OutputExistsError: the file exists and `force` is not given.
        ValueError: the suffix is no format that matplotlib writes.
        OSError: the file cannot be written.
    """
    if path.exists() and not force:
        raise OutputExistsError(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    drawn = BytesIO()
    undated = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}.get(path.suffix.lower())
    with mpl.rc_context({"svg.hashsalt": "dirprim", "svg.fonttype": "none", "pdf.fonttype": 42}):
        figure.savefig(drawn, dpi=dpi or "figure", metadata=undated, format=path.suffix[1:].lower())
    with PartialFile(path, force=force) as file:
        file.write(drawn.getvalue())


def dress(axes: Axes, title: str = "", *, is_open: bool = False) -> None:
    """Frame, ticks, labels and title of every panel; an open frame, for curves, has the lower and the left side."""
    axes.tick_params(color=FAINT, labelsize=SMALL)
    axes.spines[:].set_color(FAINT)
    axes.xaxis.label.set_fontsize(NORMAL)
    axes.yaxis.label.set_fontsize(NORMAL)
    axes.set_title(title, loc="left", fontsize=LARGE)
    if is_open:
        axes.spines[["top", "right"]].set_visible(False)


def dress_map(axes: Axes, box: FloatArray, title: str = "") -> None:
    """A map's axes: east and north in metres, of one scale, over a box of (2, 2) corners."""
    axes.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal", xlabel="east [m]", ylabel="north [m]")
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(6))
    dress(axes, title)


def color_bar(figure: Figure, colors: ScalarMappable, panels: Sequence[Axes], label: str) -> None:
    """Beside the panels, with its quantity and unit."""
    bar = figure.colorbar(colors, ax=panels, extend="max", shrink=0.6, aspect=25)
    bar.set_label(label, fontsize=NORMAL)
    bar.ax.tick_params(labelsize=SMALL, color=FAINT)
    bar.outline.set_visible(False)


def mark_close_up(axes: Axes, box: FloatArray, letter: str) -> None:
    """A frame around what another panel shows closer."""
    frame = Rectangle(box[0], *np.ptp(box, axis=0), fill=False, color="0.15", linewidth=0.8, zorder=11)
    axes.add_patch(frame)
    axes.annotate(
        f"({letter})", tuple(box[1]), (3, 3), textcoords="offset points", fontsize=SMALL, va="center", zorder=11
    )
