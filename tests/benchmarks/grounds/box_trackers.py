"""Trackers of boxes: ours, online and smoothed, and the packages', each with settings of its own.

A track's box is that of the detection it was given; where it coasts it has none. Each method chooses its settings by
HOTA where it is not judged: errors of boxes last, so that ours may widen their spread as others may raise the
acceleration.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from peer_scenes import Fold, Part, UnavailableError
from peer_trackers import HALF_DECADE, Settings
from peers import PACKAGES

from dirprim_filter import PrimitiveMap
from dirprim_filter.arrays import FloatArray, IntArray
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.evaluation.settings import Axis, choose
from dirprim_filter.filtering import BayesFilter, ConstantVelocityKalman, Tracker
from dirprim_filter.filtering.smoother import Smoother
from grounds.boxes import Boxes, Fitted, Scene, alike
from grounds.findings import STRAIGHT, Findings

GAIN = 0.1
"""Of HOTA in percent; less is no gain."""
GATE = 25.0
"""Squared distance, in units of the covariance, of a package's track from the detection that it was given."""
MOST_FILLED = 30
"""Frames of a gap that is filled, as UCMCTrack's are."""


def _detections(of: Boxes, scene: Scene, scale: float, **stated: FloatArray) -> Detections:
    return Detections(
        track_id=np.full(of.frame.size, NO_ID), time_ns=np.round(of.frame * scene.frame_s * 1e9).astype(np.int64),
        position=of.place, covariance=scale * of.covariance, **stated,
    )  # fmt: skip


class Given(NamedTuple):
    """What a method is run with: what training scenes show, settings, and a seed."""

    fit: Fitted
    settings: Settings
    seed: int = 0


class Method(NamedTuple):
    """A tracker.

    Attributes:
        run: boxes of a scene, each under its track's name; by the scene's number too.
        axes: the settings.
        n_seeds: of its random numbers.
    """

    run: Callable[[int, Scene, Given], Boxes]
    axes: tuple[Axis, ...]
    n_seeds: int = 1


def ours(
    models: Mapping[str, Callable[[int], PrimitiveMap]], *, n_seeds: int, n_particles: int, with_smoothed: bool = False
) -> dict[str, Method]:  # fmt: skip
    """Our tracker on a map of each scene, and on a Kalman filter of constant velocity; if wanted, each smoothed too."""
    config = FilterConfig(n_particles=n_particles, interaction="none")

    def by_map(of: Callable[[int], PrimitiveMap], i: int, scene: Scene, given: Given, *, smooth: bool) -> Boxes:
        return _tracked(of(i), config, scene, given, smooth=smooth)

    def by_kalman(_: int, scene: Scene, given: Given, *, smooth: bool) -> Boxes:
        kalman = ConstantVelocityKalman(acceleration_density=given.settings["density"])
        return _tracked(kalman, config, scene, given, smooth=smooth)

    factor, found = Axis("factor", 4.0, 4.0), {}
    for label, smooth in (("", False), (", smoothed", True))[: 1 + with_smoothed]:
        for name, of in models.items():
            found[f"{name}{label}"] = Method(partial(by_map, of, smooth=smooth), (factor,), n_seeds)
        axes = factor, Axis("density", 1.0, HALF_DECADE)
        found[f"{STRAIGHT}{label}"] = Method(partial(by_kalman, smooth=smooth), axes)
    return found


def _tracked(
    model: PrimitiveMap | BayesFilter, config: FilterConfig, scene: Scene, given: Given, *, smooth: bool
) -> Boxes:  # fmt: skip
    """Boxes under their tracks' names; smoothed, pieces have one name, and gaps boxes between those at their ends."""
    of, names, smoother = scene.seen, [], Smoother()
    stated = {"size": of.size, "confidence": given.fit.confidence(of.score)}
    seen = _detections(of, scene, given.fit.scale * given.settings["factor"], **stated)
    make = smoother.tracker if smooth else lambda _, *of, **options: Tracker(*of, **options)
    tracker = make(0, model, config=config, tracking=given.fit.tracking, rng=np.random.default_rng(given.seed))
    with smoother:
        for frame in range(scene.n_frames):
            found = tracker.track(seen[of.frame == frame], time_ns=round(frame * scene.frame_s * 1e9))
            names.append(found.assigned)
            if smooth:
                smoother.write(found)
    known = np.concatenate(names)
    for former, later in smoother.joined:
        known[known == later] = former
    tracks = of._replace(name=np.unique(known, return_inverse=True)[1] + 1).of(known != NO_ID)
    return filled(tracks) if smooth else tracks


def filled(tracks: Boxes) -> Boxes:
    """Tracks with a box in each frame of a short gap; of two in a frame the first, as the other was cut off."""
    _, row = np.unique(tracks.name << 32 | tracks.frame, return_index=True)
    own = tracks.of(row)
    gap = np.diff(own.frame) * (np.diff(own.name) == 0) - 1
    n_new = np.where((gap > 0) & (gap < MOST_FILLED), gap, 0)
    start = np.repeat(np.arange(gap.size), n_new)
    step = np.arange(start.size) - np.repeat(np.cumsum(n_new) - n_new, n_new) + 1
    share = (step / (gap[start] + 1))[:, None]
    between = own.of(start)._replace(
        frame=own.frame[start] + step, box=(1.0 - share) * own.box[start] + share * own.box[start + 1]
    )  # fmt: skip
    joined = Boxes(*(np.concatenate(of) for of in zip(own, between, strict=True)))
    return joined.of(np.argsort(joined.frame, kind="stable"))


def packages(scene: Scene, fit: Fitted) -> dict[str, Method]:
    """The first tracker of each package of `peers.py` that is installed; any scene tells which there are."""
    found = {}
    for package in PACKAGES:
        try:
            name, peer = next(iter(package(_fold(scene, fit)).items()))
        except UnavailableError as error:
            logging.getLogger(__name__).warning("left out: %s", error)
            continue
        found[name] = Method(partial(_by_package, package), peer.axes)
    return found


def _fold(scene: Scene, fit: Fitted) -> Fold:
    noise_m = float(np.sqrt(0.5 * fit.scale * np.median(np.trace(scene.seen.covariance, axis1=1, axis2=2))))
    return Fold(judged=(), training=(), traffic=scene.tracks(), noise_m=noise_m, tracking=fit.tracking)


def _by_package(package: Any, _: int, scene: Scene, given: Given) -> Boxes:
    of, fold = scene.seen, _fold(scene, given.fit)
    part = Part(seen=_detections(of, scene, given.fit.scale), truth=fold.traffic)
    rows = next(iter(package(fold).values())).track(part, given.settings).rows
    inverse, name = np.linalg.inv(of.covariance), np.zeros(of.frame.size, np.int64)

    def nearness(mine: IntArray, own: IntArray) -> FloatArray:
        off = of.place[mine, None] - rows.position[own]
        return -np.einsum("dti,dij,dtj->dt", off, inverse[mine], off)

    at = np.round(rows.time_ns * 1e-9 / scene.frame_s).astype(np.int64)
    for mine, own in alike(of.frame, at, nearness, least=-GATE):
        name[mine] = rows.vehicle[own] + 1
    return of._replace(name=name).of(name > 0)


def tuned(
    table: Findings, name: str, axes: Sequence[Axis], hota: Callable[[Settings], float], *, is_smoke: bool
) -> Settings:  # fmt: skip
    """The settings of the greatest HOTA; where all is to be quick, those to begin with."""
    if is_smoke:
        return {axis.name: axis.start for axis in axes}
    names = [axis.name for axis in axes]
    choices = choose(axes, lambda values: hota(dict(zip(names, values, strict=True))), least_gain=GAIN)
    table.settings += [
        of._replace(name=f"{name}: {of.name}") for axis, of in zip(axes, choices, strict=True)
        if axis.least <= of.chosen / axis.factor and of.chosen * axis.factor <= axis.most  # else there is no beyond
    ]  # fmt: skip
    return {of.name: of.chosen for of in choices}
