"""What a turn signal adds to what is usual at a place: Eq. 4, sampled by rejection, and in closed form (Fig. 8)."""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.special import logsumexp

from dirprim_filter.arrays import FloatArray
from dirprim_filter.distributions import VonMisesMixture, von_mises
from dirprim_filter.distributions.angles import difference
from dirprim_filter.distributions.product import (
    kernel_density,
    multiply_mixtures,
    propose,
    sample_by_rejection,
)
from dirprim_filter.evaluation.turn_signal import clearest_choice
from dirprim_filter.primitives.cues import Cue
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.figures.page import (
    LARGE,
    add_axes,
    add_polar_axes,
    dress_directions,
    dress_polar,
    panels_above_key,
)
from dirprim_filter.viewer.figures.place import Circle, Place, moving_rows
from dirprim_filter.viewer.layers import FOCUS_COLOR, INK, OTHER_COLOR
from tessellation.anchors import anchors

CUE_COLOR = "#E69F00"
LONG_DASHES = (0, (5, 2))
REJECTED_COLOR = "0.6"
N_PROPOSALS = 600
"""Points of the rejection picture."""
N_ACCEPTED = 100
"""Samples under the kernel density, as in the paper."""
PROPOSAL_CONCENTRATIONS = np.geomspace(0.05, 5000.0, 60)
BREADTH = 0.5
"""The proposal's concentration, as a share of the best: a broad one, of which some are rejected."""
SLACK = 0.02
"""k is greater by this share than the least that would do on the points of the circle."""
KERNEL_CONCENTRATIONS = np.geomspace(2.0, 5000.0, 60)


class Signal(NamedTuple):
    """A vehicle at a place, with a turn signal."""

    place: Place
    heading: float
    cue: VonMisesMixture
    posterior: VonMisesMixture

    @classmethod
    def given(cls, primitives: PrimitiveMap, cue: Cue, position: npt.ArrayLike | None, heading: float | None) -> Self:
        """A cue at a position (2,) on a heading; what is left out is taken where going on and turning are usual.

        Without turns, it is the place where directions differ most, and the most frequent heading.

        Raises:
            ValueError: no cell covers the position, or the map has none.
        """
        turn = float(np.asarray(cue.turn)[0])
        rows = moving_rows(primitives)
        if position is None and rows.any():
            choice = clearest_choice(primitives.direction.mean_direction[:-1], rows, turn)
            position = anchors(primitives.tessellation)[choice.place] if choice.weight > 0 else None
        place = Place.at(primitives, position)
        if heading is None:
            mean, here = place.direction.mean_direction, rows[place.cell]
            choice = clearest_choice(mean[None], here[None], turn)
            heading = choice.heading if choice.weight > 0 else float(mean[np.argmax(here)])
        belief = cue.belief(heading)
        return cls(place, heading, belief, multiply_mixtures(place.direction, belief).mixture)

    def proposal(self, circle: Circle) -> VonMisesMixture:
        """A broad von Mises around the posterior's mean direction: half as concentrated as that of the least k."""
        toward = self.posterior.weight * von_mises.mean_resultant_length(self.posterior.concentration)
        east = (toward * np.cos(self.posterior.mean_direction)).sum()
        north = (toward * np.sin(self.posterior.mean_direction)).sum()
        tried = [_one(np.arctan2(north, east), concentration) for concentration in PROPOSAL_CONCENTRATIONS]
        best = min(tried, key=lambda proposal: self.log_envelope(proposal, circle))
        return _one(best.mean_direction[0], BREADTH * best.concentration[0])

    def log_envelope(self, proposal: VonMisesMixture, circle: Circle) -> float:
        """The log of a k for which k times the proposal is nowhere below the posterior."""
        log_ratio = self.posterior.log_density(circle.theta) - proposal.log_density(circle.theta)
        return float(log_ratio.max() + np.log1p(SLACK))


def rejection_figure(
    primitives: PrimitiveMap,
    *,
    cue: Cue,
    position: npt.ArrayLike | None = None,
    heading: float | None = None,
    rng: np.random.Generator,
) -> Figure:
    """How the paper samples the product of prior and cue: points under k times a proposal, kept if under the target.

    The target is the product divided by its integral, so that k is the mean number of proposals for a sample.

    Args:
        primitives: the map.
        cue: the turn signal.
        position: (2,) metres; left out, where going on and turning are both most usual.
        heading: radians; left out, of the mode for which that holds at the place.
        rng: what is drawn from.

    Raises:
        ValueError: no cell covers the position.
    """
    signal = Signal.given(primitives, cue, position, heading)
    circle = Circle.around(signal.posterior)
    proposal = signal.proposal(circle)
    log_k = signal.log_envelope(proposal, circle)
    points = propose(signal.posterior.log_density, proposal, log_envelope=log_k, n=N_PROPOSALS, rng=rng)
    dot: dict[str, Any] = {"marker": "o", "linewidth": 0, "markersize": 4}
    n_accepted = int(points.accepted.sum())
    key = [
        Line2D([], [], color=FOCUS_COLOR, linewidth=1.4, label="target: prior × cue, divided by its integral"),
        Line2D([], [], color=INK, linewidth=1.2, linestyle=LONG_DASHES, label=f"k × proposal, k = {np.exp(log_k):.3g}"),
        Line2D([], [], color=FOCUS_COLOR, markeredgewidth=0, label=f"accepted: {n_accepted} of {N_PROPOSALS}", **dot),
        Line2D([], [], color="none", markeredgecolor=REJECTED_COLOR, label="rejected: above the target", **dot),
    ]
    figure, bottom = panels_above_key(width=8.6, height=2.6, key=key, n_columns=2)
    axes = add_axes(figure, (0.65, bottom, 4.6, 2.6))
    target = np.exp(signal.posterior.log_density(circle.theta))
    top = np.exp(log_k + proposal.log_density(circle.theta))
    axes.fill_between(circle.degrees, target, color=FOCUS_COLOR, alpha=0.2, linewidth=0)
    axes.plot(circle.degrees, target, color=FOCUS_COLOR, linewidth=1.4)
    axes.plot(circle.degrees, top, color=INK, linewidth=1.2, linestyle=LONG_DASHES)
    x, y = circle.degrees_of(points.direction), np.exp(points.log_height)
    rejected: dict[str, Any] = {"facecolors": "none", "edgecolors": REJECTED_COLOR, "linewidths": 0.6}
    axes.scatter(x[~points.accepted], y[~points.accepted], s=9, zorder=2, **rejected)
    axes.scatter(x[points.accepted], y[points.accepted], s=10, color=FOCUS_COLOR, linewidths=0, zorder=3)
    axes.set(ylabel="density [1/rad]", ylim=(0.0, 1.05 * top.max()))
    dress_directions(axes, start=circle.start)
    axes.set_title("(a)  Rejection sampling of prior × cue", loc="left", fontsize=LARGE)
    _add_vehicle(figure, signal, box=(6.1, bottom, 2.3, 2.45), letter="b")
    return figure


def product_figure(
    primitives: PrimitiveMap,
    *,
    cue: Cue,
    position: npt.ArrayLike | None = None,
    heading: float | None = None,
    rng: np.random.Generator,
) -> Figure:
    """The paper's Fig. 8: prior, cue, and their product in closed form, with the kernel density of its samples.

    Args:
        primitives: the map.
        cue: the turn signal.
        position: (2,) metres; left out, where going on and turning are both most usual.
        heading: radians; left out, of the mode for which that holds at the place.
        rng: what the samples are drawn from.

    Raises:
        ValueError: no cell covers the position.
    """
    signal = Signal.given(primitives, cue, position, heading)
    circle = Circle.around(signal.place.direction, signal.posterior)
    proposal = signal.proposal(circle)
    accepted = sample_by_rejection(
        signal.posterior.log_density, proposal, log_envelope=signal.log_envelope(proposal, circle),
        n_samples=N_ACCEPTED, rng=rng,
    )  # fmt: skip
    kernels = kernel_density(accepted.direction, concentration=kernel_concentration(accepted.direction))
    curves: list[tuple[str, VonMisesMixture, dict[str, Any]]] = [
        ("prior p₀: usual at the place", signal.place.direction, {"color": OTHER_COLOR, "linewidth": 1.2}),
        ("cue pₜ: the turn signal", signal.cue, {"color": CUE_COLOR, "linewidth": 1.6, "linestyle": LONG_DASHES}),
        ("posterior p* ∝ p₀ pₜ", signal.posterior, {"color": FOCUS_COLOR, "linewidth": 1.6}),
        (f"kernel density of {N_ACCEPTED} accepted samples", kernels,
         {"color": INK, "linewidth": 1.2, "linestyle": (0, (1, 1))}),
    ]  # fmt: skip
    key = [Line2D([], [], label=name, **style) for name, _, style in curves]
    key.append(Line2D([], [], color=INK, marker="|", linewidth=0, markersize=6, label="accepted samples"))
    figure, bottom = panels_above_key(width=11.6, height=2.6, key=key, n_columns=3)
    line = add_axes(figure, (0.65, bottom, 4.5, 2.6))
    polar = add_polar_axes(figure, (5.75, bottom, 2.45, 2.45))
    densest = 0.0
    for _, mixture, style in curves:
        density = np.exp(mixture.log_density(circle.theta))
        densest = max(densest, float(density.max()))
        line.plot(circle.degrees, density, **style)
        polar.plot(circle.theta, np.sqrt(density), **style)
    _draw_rug(line, circle.degrees_of(accepted.direction))
    line.set(ylabel="density [1/rad]", ylim=(0.0, 1.06 * densest))
    dress_directions(line, start=circle.start)
    dress_polar(polar, densest=densest, free=circle.start)
    line.set_title(f"(a)  Prior, cue and their product at {signal.place.title}", loc="left", fontsize=LARGE)
    polar.set_title("(b)  Around the circle", loc="left", fontsize=LARGE, x=-0.15, y=1.1)
    _add_vehicle(figure, signal, box=(9.15, bottom, 2.3, 2.45), letter="c")
    return figure


def kernel_concentration(sample: FloatArray) -> float:
    """Of the kernels on directions (n,): what gives each the greatest likelihood under the kernels of the others."""
    turn = difference(sample[:, None], sample)
    of_others = np.where(np.eye(sample.size, dtype=np.bool_), -np.inf, 0.0)
    likelihood = [
        logsumexp(of_others + von_mises.log_density(turn, np.zeros(()), k), axis=1).sum() for k in KERNEL_CONCENTRATIONS
    ]
    return float(KERNEL_CONCENTRATIONS[np.argmax(likelihood)])


def _one(mean: FloatArray, concentration: FloatArray) -> VonMisesMixture:
    """A single von Mises, () each."""
    return VonMisesMixture(
        weight=np.ones(1), mean_direction=np.reshape(mean, 1), concentration=np.reshape(concentration, 1)
    )


def _draw_rug(axes: Axes, degrees: FloatArray) -> None:
    axes.plot(degrees, np.full(degrees.shape, 0.015), "|", color=INK, markersize=6, markeredgewidth=0.6,
              transform=axes.get_xaxis_transform(), zorder=3)  # fmt: skip


def _add_vehicle(figure: Figure, signal: Signal, *, box: tuple[float, float, float, float], letter: str) -> None:
    """The place, the vehicle's way to it and where its signal points."""
    axes = add_axes(figure, box)
    signal.place.draw(axes)
    length = 0.3 * float(np.ptp(axes.get_xlim()))
    here = signal.place.position
    ahead = length * np.array([np.cos(signal.heading), np.sin(signal.heading)])
    turn = float(signal.cue.mean_direction[0])
    aside = length * np.array([np.cos(turn), np.sin(turn)])
    for start, end, color in ((here - ahead, here, INK), (here, here + aside, CUE_COLOR)):
        arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 3}
        axes.annotate("", tuple(end), tuple(start), arrowprops=arrow, zorder=10)
    axes.set_title(f"({letter})  Heading {np.rad2deg(signal.heading):+.0f}°, signal", loc="left", fontsize=LARGE)
