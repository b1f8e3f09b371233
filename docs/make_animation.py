"""Makes the animation of README from the recordings that ship: `python docs/make_animation.py`, in the root.

`recordings/blind.gif`: the intersection, without ids, and without detections in a ring about it; tracked with the map
and by constant velocity. Each track has a colour of its own; where a vehicle gets another track, a ring shows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from dirprim_filter import Estimates, Tracker, learn_primitives, read_tracks
from dirprim_filter.arrays import AnyArray, IntArray
from dirprim_filter.cli.demo import FAR_M, NEAR_M, departure_rate, with_blind_ring
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.metrics.clear_mot import clear_mot
from dirprim_filter.evaluation.metrics.comparison import Comparison
from dirprim_filter.evaluation.tracked_rows import TrackedRows
from dirprim_filter.evaluation.without_map import fitted_acceleration
from dirprim_filter.filtering import ConstantVelocityKalman
from dirprim_filter.filtering.protocols import BayesFilter
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.recording.reader import stream_detections
from dirprim_filter.tracks import Tracks

RECORDINGS = Path("recordings")
FROM_S, TO_S, STEP_S, SHOWN_MS = 38.0, 57.0, 0.2, 100
"""What is shown, of the log's seconds; each picture for so long."""
REACH_M, TRAIL_S, FLASH_S = 62.0, 2.5, 1.6
N_COLORS, N_FITTED = 128, 10
PALETTE = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]
"""Of Okabe and Ito (2008)."""


def tracked(model: PrimitiveMap | BayesFilter, tracking: TrackingConfig) -> Estimates:
    """What a tracker makes of the detections outside of the ring."""
    tracker = Tracker(model, tracking=tracking, rng=np.random.default_rng(0))
    frames = map(with_blind_ring, stream_detections(RECORDINGS / "intersection_track.mcap"))
    return Estimates.concatenate([tracker.step(frame) for frame in frames if len(frame)])


class Side(NamedTuple):
    """One way of tracking: what it is called, what it found, which track follows each true row, and its colours."""

    title: str
    found: Estimates
    follower: AnyArray
    color: Mapping[str, str]


def followers(found: Estimates, truth: Tracks) -> AnyArray:
    """(n,) str, the track that follows each row of the truth, as CLEAR MOT matches them; empty where none does."""
    matched = clear_mot(Comparison.of(truth, TrackedRows.of(found))).matches
    names = found.track_id.astype(np.str_)
    of_row = np.full(len(truth), "", names.dtype)
    of_row[matched.row] = names[matched.column]
    return of_row


def changes_of(truth: Tracks, follower: AnyArray) -> IntArray:
    """(c,) rows of the truth at which a vehicle is followed by another track than when it was last followed."""
    rows = np.flatnonzero(follower != "")
    order = rows[np.lexsort((truth.time_ns[rows], truth.vehicle[rows]))]
    same = truth.vehicle[order[1:]] == truth.vehicle[order[:-1]]
    return np.asarray(order[1:][same & (follower[order[1:]] != follower[order[:-1]])])


def colors_of(truth: Tracks, follower: AnyArray) -> dict[str, str]:
    """Of each track that follows a vehicle a colour: another one than those of others that follow the same."""
    color: dict[str, str] = {}
    rivals: dict[str, set[str]] = {}
    for vehicle in range(truth.n_tracks):
        own = set(follower[truth.vehicle == vehicle].tolist()) - {""}
        for name in own:
            rivals.setdefault(name, set()).update(own - {name})
    for number, name in enumerate(dict.fromkeys(follower[follower != ""].tolist())):
        taken = {color.get(other) for other in rivals[name]}
        turned = PALETTE[number % len(PALETTE) :] + PALETTE[: number % len(PALETTE)]
        color[name] = next((shade for shade in turned if shade not in taken), turned[0])
    return color


def draw(axes: Axes, side: Side, truth: Tracks, learned: PrimitiveMap, at_s: float) -> None:
    """One side at one instant."""
    title, found, follower, color = side
    for half, shade in ((FAR_M, "0.86"), (NEAR_M, "white")):
        axes.add_patch(Rectangle((-half, -half), 2 * half, 2 * half, facecolor=shade, linewidth=0))
    axes.plot(*learned.tessellation.centers.T, ".", color="0.7", markersize=1.5)
    now = np.abs(truth.time_ns * 1e-9 - at_s) < 1e-3
    axes.plot(*truth.position[now].T, "s", markersize=6, markerfacecolor="none", markeredgecolor="0.25")
    age_s = at_s - found.time_ns * 1e-9
    names = found.track_id.astype(np.str_)
    for name in np.unique(names[np.abs(age_s) < 1e-3]).tolist():
        trail = (names == name) & (age_s > -1e-3) & (age_s < TRAIL_S)
        shade = color.get(name, "0.6")
        axes.plot(*found.position[trail].T, color=shade, linewidth=2.2, solid_capstyle="round")
        axes.plot(*found.position[trail & (age_s < 1e-3)].T, "o", color=shade, markersize=4)
    changed = changes_of(truth, follower)
    past_s = at_s - truth.time_ns[changed] * 1e-9
    for row in changed[(past_s >= 0) & (past_s < FLASH_S)].tolist():
        own = now & (truth.vehicle == truth.vehicle[row])
        axes.plot(*truth.position[own].T, "o", markersize=17, mfc="none", mec="#c00000", mew=2)
    so_far = int((past_s >= 0).sum())
    axes.set(xlim=(-REACH_M, REACH_M), ylim=(-REACH_M, REACH_M), aspect="equal", xticks=[], yticks=[])
    axes.set_title(f"{title}: {so_far or 'no'} change{'s' * (so_far != 1)} of track", fontsize=11)


def main() -> None:
    """Track both ways, draw, and write the animation."""
    tracks = read_tracks(RECORDINGS / "intersection_learn.mcap")
    truth = read_tracks(RECORDINGS / "intersection_track.mcap", topics="/objects")
    learned, config = learn_primitives(tracks, rng=np.random.default_rng(0)), FilterConfig()
    rng = np.random.default_rng(0)
    some = tracks[np.isin(tracks.vehicle, rng.permutation(tracks.n_tracks)[:N_FITTED])]
    noisy = some.position + config.noise_m * rng.standard_normal(some.position.shape)
    noise = fitted_acceleration(replace(Detections.of(some), position=noisy), tracks, config).chosen
    rival = ConstantVelocityKalman(acceleration_density=noise, config=config)
    ways = {
        "With the map": tracked(learned, TrackingConfig()),
        "Constant velocity": tracked(rival, replace(TrackingConfig(), departure_rate=departure_rate(tracks))),
    }
    sides = []
    for title, found in ways.items():
        follower = followers(found, truth)
        sides.append(Side(title, found, follower, colors_of(truth, follower)))
    pictures = []
    for at_s in np.arange(FROM_S, TO_S, STEP_S).round(3):
        figure = Figure(figsize=(8.0, 4.35), dpi=100)
        canvas = FigureCanvasAgg(figure)
        for i, side in enumerate(sides):
            axes = figure.add_axes((0.01 + 0.5 * i, 0.06, 0.48, 0.87))
            draw(axes, side, truth, learned, float(at_s))
        text = f"{at_s:.1f} s.  Grey: no detections.  Square: a vehicle.  Colour: its track.  Red ring: a new track."
        figure.text(0.5, 0.015, text, ha="center", fontsize=9)
        canvas.draw()  # type: ignore[no-untyped-call]
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))  # type: ignore[no-untyped-call]
    some_of_all = np.concatenate([np.asarray(picture) for picture in pictures[:: len(pictures) // 6]])
    palette = Image.fromarray(some_of_all).quantize(N_COLORS, method=Image.Quantize.FASTOCTREE)
    first, *more = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures)
    first.save(RECORDINGS / "blind.gif", save_all=True, append_images=more, duration=SHOWN_MS, loop=0, optimize=True)


if __name__ == "__main__":
    main()
