"""What is plotted over time: how sure the filter is, how right, and of how many vehicles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import rerun as rr

from dirprim_filter.arrays import FloatArray
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.track_ids import as_texts
from dirprim_filter.tracks import Tracks

Color = tuple[int, int, int]
BLUE, ORANGE, GREY, GREEN = (120, 200, 255), (233, 104, 20), (120, 128, 145), (90, 190, 90)
RUN_COLORS: tuple[Color, Color] = (BLUE, ORANGE)
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
        "NEES, NIS: orange truth, blue innovation, 2 is right", ("NEES (truth)", "NIS (innovation)", "right"),
        (ORANGE, BLUE, GREY), (0.0, 10.0),
    ),
    "/metrics/innovation": Curves("Innovation, m", ("mean", "greatest"), (BLUE, GREY)),
    "/metrics/log_evidence": Curves("Log evidence", ("mean",), (BLUE,)),
    "/metrics/ess": Curves("Effective sample size: mean blue, lowest grey", ("mean", "lowest"), (BLUE, GREY)),
    "/metrics/existence": Curves(
        "Vehicles: reported grey, expected orange, measured blue, of those following the map green",
        ("reported", "expected", "measured", "following the map"), (GREY, ORANGE, BLUE, GREEN),
    ),
}  # fmt: skip
"""By entity."""
RESULTS = {
    "mean NEES (2 is right)": ("/metrics/consistency", 0),
    "mean NIS (2 is right)": ("/metrics/consistency", 1),
    "mean innovation, m": ("/metrics/innovation", 0),
    "mean effective sample size": ("/metrics/ess", 0),
    "vehicles measured in a frame": ("/metrics/existence", 2),
}
"""What the report says: the mean of a curve over all frames."""


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
            red, green, blue = RUN_COLORS[shade]
            colors = [RUN_COLORS[shade], *[(red // 2, green // 2, blue // 2)] * (len(names) - 1)]
        yield path, rr.SeriesLines(names=names, colors=colors, widths=[1.5] * len(names))


class Metrics:
    """The values of the curves, frame by frame, and their means over all frames."""

    def __init__(self) -> None:
        self._order, self._time_ns = np.empty(0, np.int64), np.empty(0, np.int64)
        self._truth: Tracks | None = None
        self._sum: dict[tuple[str, int], tuple[float, int]] = {}

    def compare_to(self, truth: Tracks) -> None:
        """From here on errors are those to these tracks."""
        self._order = np.argsort(truth.time_ns, kind="stable")
        self._truth, self._time_ns = truth, truth.time_ns[self._order]

    def of(self, frame: TrackedFrame) -> Mapping[str, tuple[float, ...]]:
        """The values of one frame, by entity; NaN, a gap in the curve, where there is none."""
        estimates, nis = frame.estimates, np.nan
        is_measured = estimates.unseen_s == 0
        ess = estimates.effective_sample_size if len(frame.particles) else np.empty(0)
        rows: dict[str, tuple[float, ...]] = {
            "/metrics/existence": (
                len(estimates),
                float(estimates.existence.sum()),
                int(is_measured.sum()),
                float(estimates.follows_map[is_measured].sum()),
            ),
            "/metrics/ess": (_mean(ess), float(ess.min()) if ess.size else np.nan),
            "/metrics/log_evidence": (_mean(estimates.log_evidence[is_measured]),),
        }
        if frame.innovations is not None:
            distance, nis = frame.innovations.distance, _mean(frame.innovations.squared)
            known = distance[~np.isnan(distance)]
            rows["/metrics/innovation"] = (_mean(known), float(known.max()) if known.size else np.nan)
        rows["/metrics/consistency"] = (self._nees(frame), nis, RIGHT_SQUARE)
        for path, i in RESULTS.values():
            value = rows[path][i] if path in rows else np.nan
            if not np.isnan(value):
                total, n = self._sum.get((path, i), (0.0, 0))
                self._sum[path, i] = (total + value, n + 1)
        return rows

    def results(self) -> dict[str, str]:
        """What each is, and its mean."""
        means = {name: self._sum[key] for name, key in RESULTS.items() if key in self._sum}
        return {name: f"{total / n:.4g}" for name, (total, n) in means.items()}

    def _nees(self, frame: TrackedFrame) -> float:
        """Mean normalised estimation error squared of the positions of the frame's known vehicles; NaN of none."""
        if self._truth is None:
            return float("nan")
        first, last = np.searchsorted(self._time_ns, [frame.time_ns, frame.time_ns + 1])
        rows = self._order[first:last]
        place = dict(zip(as_texts(self._truth.track_id[rows]).tolist(), self._truth.position[rows], strict=True))
        known = [row for row, name in enumerate(frame.names) if name in place]
        if not known:
            return float("nan")
        error = frame.estimates.position[known] - np.array([place[frame.names[row]] for row in known])
        covariance = frame.estimates.covariance[known] + JITTER * np.eye(2)
        return float(np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]).mean())


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan
