"""The page that figures are drawn on: sizes, axes with units, and the file at the end."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from dirprim_filter.arrays import FloatArray
from dirprim_filter.partial_file import OutputExistsError, PartialFile

DOTS_PER_INCH = 200
SMALL, NORMAL, LARGE = 8, 9, 10
"""Points: numbers at ticks and keys, labels, titles."""
FAINT = "0.6"
"""Of frames and ticks."""


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


def add_axes(figure: Figure, box: tuple[float, float, float, float]) -> Axes:
    """Axes at (left, bottom, width, height) in inches."""
    return figure.add_axes(_share(figure, box))


def add_polar_axes(figure: Figure, box: tuple[float, float, float, float]) -> PolarAxes:
    """Polar axes at (left, bottom, width, height) in inches; east to the right, counter-clockwise, as on the map."""
    axes = figure.add_axes(_share(figure, box), projection="polar")
    if not isinstance(axes, PolarAxes):
        raise TypeError(f"projection: expected polar axes, got {type(axes).__name__}")
    return axes


def _share(figure: Figure, box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    width, height = figure.get_size_inches()
    return box[0] / width, box[1] / height, box[2] / width, box[3] / height


def dress_map(axes: Axes, box: FloatArray) -> None:
    """A map's axes: east and north in metres, of one scale, over a box of (2, 2) corners."""
    axes.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal", xlabel="east [m]", ylabel="north [m]")
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_locator(MaxNLocator(6))
    dress(axes)


def dress(axes: Axes) -> None:
    """Frame, ticks and labels of every panel."""
    axes.tick_params(color=FAINT, labelsize=SMALL)
    axes.spines[:].set_color(FAINT)
    axes.xaxis.label.set_fontsize(NORMAL)
    axes.yaxis.label.set_fontsize(NORMAL)


def open_frame(axes: Axes) -> None:
    """Only the lower and the left side of the frame: for curves."""
    dress(axes)
    axes.spines[["top", "right"]].set_visible(False)


def dress_polar(axes: PolarAxes, *, densest: float, free: float) -> None:
    """A polar axis of densities up to `densest`, 1/rad, of which **areas** are to scale: r is the density's root.

    Args:
        axes: east to the right, counter-clockwise, as on the map.
        densest: 1/rad, the greatest density drawn.
        free: radians, a direction with room for the numbers along r.
    """
    rings = [tick for tick in MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(0.0, densest) if 0.0 < tick <= densest]
    axes.set_rgrids(np.sqrt(rings), [f"{ring:g}" for ring in rings], angle=np.rad2deg(free), fontsize=SMALL - 1)
    axes.set_rmax(1.04 * np.sqrt(densest))
    axes.set_thetagrids(np.arange(0, 360, 45), ["E", "45°", "N", "135°", "W", "-135°", "S", "-45°"], fontsize=SMALL)
    axes.tick_params(pad=0)
    axes.grid(color=FAINT, linewidth=0.4)
    axes.spines[:].set_color(FAINT)
    axes.set_xlabel("density [1/rad], areas to scale", fontsize=NORMAL, labelpad=4)


def dress_color_bar(bar: Colorbar, label: str) -> None:
    """A colour bar with its quantity and unit."""
    bar.set_label(label, fontsize=NORMAL)
    bar.ax.tick_params(labelsize=SMALL, color=FAINT)
    bar.outline.set_visible(False)


def mark_close_up(axes: Axes, close_up: Axes, letter: str) -> None:
    """A frame around what another panel shows closer."""
    west, east = close_up.get_xlim()
    south, north = close_up.get_ylim()
    frame = Rectangle((west, south), east - west, north - south, fill=False, color="0.15", linewidth=0.8, zorder=11)
    axes.add_patch(frame)
    axes.annotate(
        f"({letter})", (east, north), (3, 3), textcoords="offset points", fontsize=SMALL, va="center", zorder=11
    )
