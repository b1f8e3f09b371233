"""What is plotted over time: how sure the filter is, how right, and of how many vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from dirprim_filter.arrays import FloatArray
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

Color = tuple[int, int, int]
BLUE, ORANGE, GREY, GREEN = (120, 200, 255), (233, 104, 20), (120, 128, 145), (0, 190, 140)
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
    "/focus/speed": Curves(
        "Speed, m/s: blue estimate, orange prior with its 90 %",
        ("estimate", "less its deviation", "plus its deviation", "prior 5 %", "prior 50 %", "prior 95 %"),
        (BLUE, (70, 120, 160), (70, 120, 160), GREY, ORANGE, GREY),
    ),
    "/metrics/consistency": Curves(
        "NEES, NIS: orange truth, blue innovation, 2 is right",
        ("NEES (truth)", "NIS (innovation)", "right"),
        (ORANGE, BLUE, GREY),
        (0.0, 10.0),
    ),
    "/metrics/innovation": Curves("Innovation, m", ("mean", "greatest"), (BLUE, GREY)),
    "/metrics/log_evidence": Curves("Log evidence", ("mean",), (BLUE,)),
    "/metrics/ess": Curves("Effective sample size: mean blue, lowest grey", ("mean", "lowest"), (BLUE, GREY)),
    "/metrics/existence": Curves(
        "Vehicles: reported grey, expected orange, measured blue", ("reported", "expected", "measured"),
        (GREY, ORANGE, BLUE),
    ),
}  # fmt: skip
"""By entity."""


def metrics(frame: TrackedFrame, nees: float) -> Mapping[str, tuple[float, ...]]:
    """The values of one frame, by entity; NaN, a gap in the curve, where there is none.

    Args:
        frame: what is believed.
        nees: of its vehicles, on average; NaN without a truth.
    """
    believed = frame.estimates
    n_measured = int((believed.unseen_s == 0).sum())
    rows: dict[str, tuple[float, ...]] = {
        "/metrics/existence": (len(believed), float(believed.existence.sum()), n_measured)
    }
    has_samples = len(frame.particles) > 0
    ess = believed.effective_sample_size if has_samples else np.empty(0)
    rows["/metrics/ess"] = (_mean(ess), float(ess.min()) if ess.size else np.nan)
    rows["/metrics/log_evidence"] = (_mean(believed.log_evidence[believed.unseen_s == 0]),)
    if frame.innovations is None:
        rows["/metrics/consistency"] = (nees, np.nan, RIGHT_SQUARE)
    else:
        distance = frame.innovations.distance
        known = distance[~np.isnan(distance)]
        rows["/metrics/innovation"] = (_mean(known), float(known.max()) if known.size else np.nan)
        rows["/metrics/consistency"] = (nees, _mean(frame.innovations.squared), RIGHT_SQUARE)
    return rows


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan


class Tally:
    """The means of the curves over all frames: the table of results."""

    def __init__(self) -> None:
        self._sum: dict[tuple[str, int], tuple[float, int]] = {}

    def add(self, values: Mapping[str, tuple[float, ...]]) -> None:
        """Count one frame's values."""
        for path, row in values.items():
            for i, value in enumerate(row):
                if not np.isnan(value):
                    total, n = self._sum.get((path, i), (0.0, 0))
                    self._sum[path, i] = (total + value, n + 1)

    def results(self) -> dict[str, str]:
        """What each is, and its mean."""
        shown = {
            "mean NEES (2 is right)": ("/metrics/consistency", 0),
            "mean NIS (2 is right)": ("/metrics/consistency", 1),
            "mean innovation, m": ("/metrics/innovation", 0),
            "mean effective sample size": ("/metrics/ess", 0),
            "vehicles measured in a frame": ("/metrics/existence", 2),
        }
        means = {name: self._sum[key] for name, key in shown.items() if key in self._sum}
        return {name: f"{total / n:.4g}" for name, (total, n) in means.items()}


class Truth:
    """True tracks, by time, to hold estimates against."""

    def __init__(self, tracks: Tracks) -> None:
        self._order = np.argsort(tracks.time_ns, kind="stable")
        self._tracks, self._time_ns = tracks, tracks.time_ns[self._order]

    def nees(self, frame: TrackedFrame) -> float:
        """Mean normalised estimation error squared of the positions of the frame's known vehicles; NaN of none."""
        first, last = np.searchsorted(self._time_ns, [frame.time_ns, frame.time_ns + 1])
        rows = self._order[first:last]
        place = dict(zip(as_texts(self._tracks.track_id[rows]).tolist(), self._tracks.position[rows], strict=True))
        names = frame.names
        known = np.array([row for row, name in enumerate(names) if name in place], dtype=np.int64)
        if known.size == 0:
            return float("nan")
        error = frame.estimates.position[known] - np.array([place[names[row]] for row in known])
        covariance = frame.estimates.covariance[known] + JITTER * np.eye(2)
        squared = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
        return float(squared.mean())
