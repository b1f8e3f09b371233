"""Runs that are .rrd files, shown again: one, or two on one time line, with the prior and without.

Of two each goes under a path of its own into one recording; their maps stand side by side, their curves in the same
plots.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rerun.chunk import RrdReader

from dirprim_filter.arrays import FloatArray
from dirprim_filter.viewer.blueprint import Layout
from dirprim_filter.viewer.curves import curve_names
from dirprim_filter.viewer.sink import BOX_PATH, RerunSink

N_RUNS = 2
BOX_COLUMN = "box"
COLOR_NAMES = ("blue", "orange")


def show_again(run: Path, viewer: RerunSink) -> None:
    """Send what an .rrd holds, and the layout that it had: to another viewer, to browsers.

    Args:
        run: an .rrd file that this project wrote.
        viewer: where to; nothing else has been sent to it.

    Raises:
        ValueError: something else wrote the file.
    """
    sent = _send(run, "", viewer)
    viewer.lay_out(Layout(box=sent.box, tracked=sent.is_tracked))


def show_side_by_side(runs: Sequence[Path], titles: Sequence[str], viewer: RerunSink) -> None:
    """Send two runs, and the layout that compares them.

    Args:
        runs: two .rrd files that this project wrote.
        titles: of each; they differ.
        viewer: where to; nothing else has been sent to it.

    Raises:
        ValueError: not two, titles that are the same, or a file that something else wrote.
    """
    if len(runs) != N_RUNS or len(titles) != N_RUNS or titles[0] == titles[1]:
        raise ValueError(f"runs, titles: expected two runs of different titles, got {list(titles)}")
    roots = tuple(f"/{_as_path(title)}" for title in titles)
    if roots[0] == roots[1]:
        roots = (f"{roots[0]}_1", f"{roots[1]}_2")
    boxes = [_send(path, root, viewer).box for path, root in zip(runs, roots, strict=True)]
    for k, (root, title) in enumerate(zip(roots, titles, strict=True)):
        for path, names in curve_names(title, shade=k):
            viewer.stream.log(root + path, names)
    box = np.stack([np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)])
    named = tuple(f"{title} ({color})" for title, color in zip(titles, COLOR_NAMES, strict=True))
    viewer.lay_out(Layout(box=box, roots=roots, titles=named))


class _Sent(NamedTuple):
    """The box that a run's view is fitted to, (2, 2) metres, and whether there are tracked vehicles in it."""

    box: FloatArray
    is_tracked: bool


def _send(path: Path, root: str, viewer: RerunSink) -> _Sent:
    box: FloatArray | None = None
    is_tracked = False
    for chunk in RrdReader(path).stream():
        if chunk.entity_path.startswith("/__"):  # the recording's own name and start
            continue
        if chunk.entity_path == BOX_PATH:
            values = chunk.to_record_batch().column(BOX_COLUMN).to_pylist()[0]
            box = np.array(values, dtype=np.float64).reshape(2, 2)
        is_tracked |= chunk.entity_path.startswith("/tracks/")
        viewer.stream.send_chunk(chunk.with_entity_path(root + chunk.entity_path))
    if box is None:
        raise ValueError(f"{path}: expected an .rrd that dirprim wrote, got one that says nothing of its view")
    return _Sent(box, is_tracked)


def _as_path(title: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in title) or "run"
