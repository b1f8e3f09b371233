"""What is plotted over time: how sure the filter is, how right, and of how many vehicles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import rerun as rr

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import gaussian
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

Color = tuple[int, int, int]
BLUE, ORANGE, GREY, GREEN = (120, 200, 255), (233, 104, 20), (120, 128, 145), (90, 190, 90)
RIGHT_SQUARE = 2.0
"""Mean of a squared error of the plane that is normalised by its true covariance."""
JITTER = 1e-12


class Curves(NamedTuple):
    """The curves that share a plot."""

    title: str
    names: tuple[str, ...]
    colors: tuple[Color, ...]
    range: tuple[float, float] | None = None


PLOTS: Mapping[str, Curves] = {
    "/metrics/consistency": Curves(
        "NEES, NIS: orange truth, blue innovation, 2 is right", ("NEES (truth)", "NIS (innovation)", "right"),
        (ORANGE, BLUE, GREY), (0.0, 10.0),
    ),
    "/metrics/ess": Curves("Effective sample size: mean blue, lowest grey", ("mean", "lowest"), (BLUE, GREY)),
    "/metrics/existence": Curves(
        "Vehicles: reported grey, expected orange, measured blue, of those following the map green",
        ("reported", "expected", "measured", "following the map"), (GREY, ORANGE, BLUE, GREEN),
    ),
}  # fmt: skip
"""By entity."""


def curve_styles() -> Iterator[tuple[str, rr.SeriesLines]]:
    """Names, colours and widths of all curves."""
    for path, curves in PLOTS.items():
        widths = [1.5] * len(curves.names)
        yield path, rr.SeriesLines(names=list(curves.names), colors=list(curves.colors), widths=widths)


def frame_metrics(frame: TrackedFrame, truth: Tracks | None) -> Mapping[str, tuple[float, ...]]:
    """The values of one frame's curves, by entity; NaN, a gap in the curve, where there is none."""
    estimates = frame.estimates
    is_measured = estimates.unseen_s == 0
    following = float(estimates.follows_map[is_measured].sum())
    ess = estimates.effective_sample_size
    nis = np.nan if frame.innovations is None else _mean(frame.innovations)
    return {
        "/metrics/existence": (len(estimates), float(estimates.existence.sum()), int(is_measured.sum()), following),
        "/metrics/ess": (_mean(ess), float(ess.min(initial=np.inf)) if ess.size else np.nan),
        "/metrics/consistency": (_nees(frame, truth), nis, RIGHT_SQUARE),
    }


def _nees(frame: TrackedFrame, truth: Tracks | None) -> float:
    """Mean normalised estimation error squared of the positions of the frame's known vehicles; NaN of none."""
    if truth is None:
        return float("nan")
    now = truth[slice(*np.searchsorted(truth.time_ns, [frame.time_ns, frame.time_ns + 1]))]
    place = dict(zip(as_texts(now.track_id).tolist(), now.position, strict=True))
    known = [row for row, name in enumerate(frame.names) if name in place]
    if not known:
        return float("nan")
    error = frame.estimates.position[known] - np.array([place[frame.names[row]] for row in known])
    covariance = frame.estimates.covariance[known] + JITTER * np.eye(2)
    return float(gaussian.squared_distance(error, covariance).mean())


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan
