"""What is plotted over time: of each vehicle how wrong and how sure the filter is, and of all how many they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import rerun as rr

from dirprim_filter.arrays import FloatArray
from dirprim_filter.drawing.colors import track_color
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.viewer.matching import Matched

Color = tuple[int, int, int]
BLUE, ORANGE, GREY, GREEN, WHITE = (120, 200, 255), (233, 104, 20), (120, 128, 145), (90, 190, 90), (255, 255, 255)
RIGHT_SQUARE = 2.0
"""Mean of a squared error of the plane that is normalised by its true covariance."""


class Curves(NamedTuple):
    """A plot: the curves of all vehicles together, by name; of `each` vehicle there may be one more beside."""

    title: str
    names: tuple[str, ...]
    colors: tuple[Color, ...]
    range: tuple[float, float] | None = None
    of_truth: bool = False


PLOTS: Mapping[str, Curves] = {
    "/error": Curves("Position error of each vehicle [m]", ("mean",), (WHITE,), of_truth=True),
    "/innovation": Curves("Innovation of each track, squared and normalised: 2 is right", ("mean", "right"),
                          (WHITE, GREY), (0.0, 12.0)),
    "/nees": Curves("NEES of each vehicle: 2 is right", ("mean", "right"), (WHITE, GREY), (0.0, 12.0), of_truth=True),
    "/existence": Curves("Probability that each track exists", (), ()),
    "/vehicles": Curves("Number of vehicles", ("reported", "expected", "measured", "following the map", "true"),
                        (GREY, ORANGE, BLUE, GREEN, WHITE)),
    "/samples": Curves("Effective sample size [particles]", ("mean", "lowest"), (BLUE, GREY)),
}  # fmt: skip
"""By entity; two of a kind share a place."""
ALL = "all"
"""Ends the entity of the curves of all vehicles."""


def styles() -> Iterator[tuple[str, rr.SeriesLines]]:
    """Names, colours and widths of the curves of all vehicles."""
    for path, of in PLOTS.items():
        if of.names:
            lines = rr.SeriesLines(names=list(of.names), colors=list(of.colors), widths=[1.5] * len(of.names))
            yield f"{path}/{ALL}", lines


def style(name: str) -> rr.SeriesLines:
    """Of a vehicle's curve, in its colour."""
    return rr.SeriesLines(names=name, colors=track_color([name])[0], widths=1.0)


def of_all(frame: TrackedFrame, matched: Matched | None) -> Mapping[str, tuple[float, ...]]:
    """The values of one frame's curves of all vehicles, by entity; NaN, a gap in the curve, where there is none."""
    estimates = frame.estimates
    is_measured, ess = estimates.unseen_s == 0, estimates.effective_sample_size
    error, nees, n_true = np.empty(0), np.empty(0), np.nan
    if matched is not None:
        error, nees, n_true = matched.error, matched.nees, float(len(matched.names))
    return {
        "/error": (_mean(error),), "/nees": (_mean(nees), RIGHT_SQUARE),
        "/innovation": (_mean(innovations(frame)), RIGHT_SQUARE),
        "/vehicles": (
            len(estimates), float(estimates.existence.sum()), int(is_measured.sum()),
            float(estimates.follows_map[is_measured].sum()), n_true,
        ),
        "/samples": (_mean(ess), float(ess.min()) if ess.size else np.nan),
    }  # fmt: skip


def innovations(frame: TrackedFrame) -> FloatArray:
    """(n,) of the frame's vehicles; NaN where unknown."""
    return np.full(len(frame.estimates), np.nan) if frame.innovations is None else frame.innovations


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan
