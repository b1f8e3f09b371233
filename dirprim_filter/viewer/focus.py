"""Whom to look at: the vehicle asked for, else the one that the filter understands least; and Eq. 4 of it.

Around the circle its place gives the prior, its turn signal the cue.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from dirprim_filter.arrays import FloatArray
from dirprim_filter.columns import is_held
from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.angles import TWO_PI
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.drawing.vehicles import short_name
from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.track_ids import as_texts

KEPT_S = 8.0
"""Seconds for which a vehicle stays in focus: quick changes would make its plots useless."""
BIN_DEG = 5
ANGLES = np.linspace(0.0, TWO_PI, 181)
SHARPEST = 800.0
"""Concentrations are drawn up to this one, a standard deviation of 2 degrees: narrower peaks fall between angles."""
COLORS = {
    "belief": (120, 128, 145), "prior": (230, 159, 0), "cue": (86, 180, 233), "posterior": (255, 255, 255),
}  # fmt: skip
"""By curve."""
GRID_COLOR = (55, 60, 72)
SOUTHWARDS = np.array([1.0, -1.0])
"""Two-dimensional views count y downwards."""


class Look(NamedTuple):
    """The vehicle in one frame.

    Attributes:
        track_id: of the vehicle.
        position: (2,) metres.
        cue: mean direction, radians, and concentration of its turn signal; 0 where it gives none.
        belief: (n_bins,) share of its particles by direction; zeros where there are none.
    """

    track_id: str
    position: FloatArray
    cue: tuple[float, float]
    belief: FloatArray


class Focus:
    """Follows from frame to frame the vehicle of the lowest log evidence.

    Args:
        chosen: id of the vehicle to look at instead.

    Attributes:
        missing: this id, while no frame has had it.
    """

    def __init__(self, chosen: str | None) -> None:
        self._chosen, self._name = chosen, ""
        self.missing = chosen
        self._since_ns = 0

    def see(self, frame: TrackedFrame, *, box: FloatArray) -> Look | None:
        """The vehicle in a frame, None where it is not there; those in the box, (2, 2) metres, come first."""
        self._name = name = self._chosen or self._worst(frame, box)
        if name not in frame.names:
            return None
        self.missing, row = None, frame.names.index(name)
        mine = frame.particles.thinned(1, rows=np.arange(len(frame.names)) == row)
        bins = np.floor(mine.direction % TWO_PI / TWO_PI * (360 // BIN_DEG)).astype(np.int64)
        return Look(
            name, frame.estimates.position[row], _signal(frame, row),
            np.bincount(bins, mine.weight, 360 // BIN_DEG).astype(np.float64),
        )  # fmt: skip

    def _worst(self, frame: TrackedFrame, box: FloatArray) -> str:
        """The one before, for a while, if in view; then of those measured now the one that is least expected."""
        estimates = frame.estimates
        is_out = ((estimates.position < box[0]) | (estimates.position > box[1])).any(axis=1)
        is_known = self._name in frame.names and not is_out[frame.names.index(self._name)]
        measured = np.flatnonzero(estimates.unseen_s == 0)
        if not measured.size or (is_known and frame.time_ns < self._since_ns + KEPT_S * 1e9):
            return self._name
        self._since_ns = frame.time_ns
        return str(frame.names[measured[np.lexsort((estimates.log_evidence[measured], is_out[measured]))[0]]])


def _signal(frame: TrackedFrame, row: int) -> tuple[float, float]:
    """The mean direction and the concentration of the turn signal that a vehicle gives now; 0 of none."""
    seen = frame.detections
    own = np.flatnonzero(as_texts(seen.track_id) == frame.names[row]) if is_held(seen.cue) else np.empty(0, np.int64)
    if not own.size or not np.isfinite(seen.cue[own[0]]).all():
        return 0.0, 0.0
    turn, concentration = seen.cue[own[0]].tolist()
    return float(frame.estimates.direction[row]) + turn, concentration


def polar_curves(looks: Sequence[Look], primitives: PrimitiveMap | None) -> dict[str, FloatArray]:
    """Eq. 4 for one vehicle in each of n frames: prior, cue, posterior and belief as closed lines, (n, k, 2).

    Radii are square roots of densities, so that areas are probabilities; the longest of a frame is 1.
    """
    turn, concentration = np.array([look.cue for look in looks]).T[..., None]
    cue = VonMisesMixture(weight=np.ones_like(turn), mean_direction=turn, concentration=concentration)
    prior = (
        cue if primitives is None else primitives.primitive_at(np.array([look.position for look in looks])).direction
    )
    edge = np.repeat(np.arange(0, 361, BIN_DEG), 2)[1:-1] / 360.0 * TWO_PI
    steps = np.repeat(np.array([look.belief for look in looks]), 2, axis=1) / np.radians(BIN_DEG)
    lines = {"belief": (edge, np.sqrt(steps))}
    for name, mixture in (("prior", prior), ("cue", cue), ("posterior", multiply_mixtures(prior, cue).mixture)):
        weight, mean, sharpness = (
            of[:, None] for of in (mixture.weight, mixture.mean_direction, mixture.concentration.clip(max=SHARPEST))
        )
        drawn = VonMisesMixture(weight=weight, mean_direction=mean, concentration=sharpness)
        lines[name] = (ANGLES, np.exp(0.5 * drawn.log_density(ANGLES)))
    longest = np.max([radius.max(axis=1) for _, radius in lines.values()], axis=0)[:, None, None]
    return {
        name: radius[..., None] / longest * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        for name, (angle, radius) in lines.items()
    }


def polar_columns(
    looks: Sequence[Look], primitives: PrimitiveMap | None
) -> Iterator[tuple[str, rr.ComponentColumnList]]:
    """The curves and the name of one vehicle in each of n frames, by entity."""
    for name, lines in polar_curves(looks, primitives).items():
        yield f"/polar/{name}", rr.LineStrips2D.columns(strips=(SOUTHWARDS * lines).astype(np.float32))
    names = [short_name(look.track_id) for look in looks]
    yield "/polar/vehicle", rr.Points2D.columns(positions=np.tile([-1.1, 1.25], (len(looks), 1)), labels=names)


def polar_styles() -> Iterator[tuple[str, rr.AsComponents]]:
    """What is static of the polar plot: colours of its curves, rings, letters of the winds, and its key."""
    for name, color in COLORS.items():
        width = 2.0 if name == "posterior" else 1.25
        yield f"/polar/{name}", rr.LineStrips2D.from_fields(colors=color, radii=rr.Radius.ui_points(width))
    no_dot = rr.Radius.ui_points(0.0)
    yield "/polar/vehicle", rr.Points2D.from_fields(colors=COLORS["posterior"], radii=no_dot, show_labels=True)
    ring = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)
    winds = {"E": (1.0, 0.0), "N": (0.0, -1.0), "W": (-1.0, 0.0), "S": (0.0, 1.0)}
    lines = [0.5 * ring, ring, *(np.array([(0.0, 0.0), end]) for end in winds.values())]
    yield "/polar/grid", rr.LineStrips2D(lines, colors=GRID_COLOR, radii=rr.Radius.ui_points(0.5))
    places = [*(1.12 * np.array(end) for end in winds.values()), *((-1.1, -1.35 + 0.23 * i) for i in range(4))]
    key = rr.Points2D(
        np.array(places), labels=[*winds, *reversed(COLORS)], radii=no_dot, show_labels=True,
        colors=[*[GRID_COLOR] * 4, *reversed(COLORS.values())],
    )  # fmt: skip
    yield "/polar/key", key
