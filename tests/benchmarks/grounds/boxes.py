"""Detections that are boxes of images, tracked on the ground, and judged as boxes by TrackEval.

A track's box is that of the detection it was given; where it coasts it has none. Noise, acceleration and rates are
measured on training scenes: detections are those of a true vehicle where their boxes overlap by half.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from dirprim_filter import PrimitiveMap, Tracks
from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.evaluation.intervals import difference_of_means, interval
from dirprim_filter.evaluation.rivals import log_evidence
from dirprim_filter.evaluation.settings import Axis, Choice, choose
from dirprim_filter.evaluation.tracking_report import normalised_squared
from dirprim_filter.filtering import BayesFilter, ConstantVelocityKalman, Tracker
from grounds.findings import STRAIGHT, WITH, WITHOUT, Findings

OVERLAP = 0.5
MEDIAN_SQUARED = 1.386
"""Of chi-squared with two degrees."""
COLUMNS = ("hota", "assa", "deta", "mota", "idf1", "switches")


class Boxes(NamedTuple):
    """Rows of boxes, true ones or detected ones.

    Attributes:
        frame: (n,) ascending.
        name: (n,) of the vehicle; 0 where it has none.
        box: (n, 4) left, top, right, bottom, pixels.
        score: (n,).
        place: (n, 2) metres on the ground.
        covariance: (n, 2, 2) square metres.
    """

    frame: IntArray
    name: IntArray
    box: FloatArray
    score: FloatArray
    place: FloatArray
    covariance: FloatArray

    def of(self, rows: AnyArray) -> Boxes:
        """The chosen rows."""
        return Boxes(*(column[rows] for column in self))


class Scene(NamedTuple):
    """A sequence.

    Attributes:
        name: of it.
        seen: what is detected.
        truth: what was there.
        n_frames: of it, from 0.
        frame_s: seconds between frames.
        area: square metres that are seen.
    """

    name: str
    seen: Boxes
    truth: Boxes
    n_frames: int
    frame_s: float
    area: float

    def tracks(self) -> Tracks:
        """Where the true vehicles were, as a user would learn from them."""
        time_ns = np.round(self.truth.frame * self.frame_s * 1e9).astype(np.int64)
        return Tracks.from_positions(track_id=self.truth.name, time_ns=time_ns, position=self.truth.place)

    def above(self, score: float) -> Scene:
        """With the better detections alone."""
        return self._replace(seen=self.seen.of(self.seen.score >= score))

    def named(self) -> Boxes:
        """The detections that are of a true vehicle, by its name."""
        name = np.zeros(self.seen.frame.size, np.int64)
        for mine, own in _frames(self.seen, self.truth):
            overlap = overlaps(self.seen.box[mine], self.truth.box[own])
            a, b = linear_sum_assignment(-overlap)
            near = overlap[a, b] >= OVERLAP
            name[mine[a[near]]] = self.truth.name[own[b[near]]] + 1
        return self.seen._replace(name=name)

    def place_of(self, named: Boxes) -> FloatArray:
        """(n, 2) where the vehicles truly were that detections are of."""
        keys = [self.truth.frame << 32 | self.truth.name + 1, named.frame << 32 | named.name]
        order = np.argsort(keys[0])
        return self.truth.place[order[np.searchsorted(keys[0][order], keys[1])]]


def _frames(one: Boxes, other: Boxes) -> Iterator[tuple[IntArray, IntArray]]:
    for frame in np.intersect1d(one.frame, other.frame):
        yield np.flatnonzero(one.frame == frame), np.flatnonzero(other.frame == frame)


def overlaps(one: FloatArray, other: FloatArray) -> FloatArray:
    """(n, 4), (m, 4) -> (n, m) intersection over union."""
    least, most = (of(one[:, None, part], other[None, :, part]) for of, part in (
        (np.maximum, slice(0, 2)), (np.minimum, slice(2, 4))))  # fmt: skip
    shared = np.prod(np.maximum(most - least, 0.0), axis=-1)
    areas = [np.prod(of[:, 2:] - of[:, :2], axis=1) for of in (one, other)]
    return np.asarray(shared / (areas[0][:, None] + areas[1] - shared))


class Fitted(NamedTuple):
    """What training scenes show of the sensor, and of motion."""

    scale: float
    density: float
    tracking: TrackingConfig
    settings: tuple[Choice, ...]

    @classmethod
    def of(cls, scenes: Sequence[Scene], *, factor: float = 1.0) -> Fitted:
        """The spread by how far detections are from the truth, as errors of boxes last; the acceleration of greatest
        evidence for them, each under its vehicle's name. A factor widens the spread.
        """
        parts, squared, hits, n_true, n_false, n_new, frames, areas = [], [], 0, 0, 0, 0, 0, []
        for number, scene in enumerate(scenes):
            named = scene.named()
            kept = named.of(named.name > 0)
            parts.append(_detections(kept, scene, names=[f"{number}/{name}" for name in kept.name]))
            squared.append(normalised_squared(kept.place - scene.place_of(kept), kept.covariance))
            hits, n_true = hits + kept.frame.size, n_true + scene.truth.frame.size
            n_false += named.frame.size - kept.frame.size
            n_new += np.unique(scene.truth.name).size
            frames += scene.n_frames
            areas.append(scene.area)
        seen, area = Detections.concatenate(parts), float(np.mean(areas))

        scale = factor * float(np.median(np.concatenate(squared)) / MEDIAN_SQUARED)
        noisy = replace(seen, covariance=scale * seen.covariance)

        def evidence(values: tuple[float, ...]) -> float:
            return log_evidence(ConstantVelocityKalman(acceleration_density=values[0]), noisy) / len(seen)

        choices = choose([Axis("density", 1.0)], evidence)
        tracking = TrackingConfig(
            detection_probability=min(hits / n_true, 0.99), clutter_density=max(n_false, 1) / frames / area,
            birth_density=n_new / frames / area, vehicle_density=n_true / frames / area,
        )  # fmt: skip
        return cls(scale, choices[0].chosen, tracking, choices)


def _detections(of: Boxes, scene: Scene, names: Sequence[str] | None = None) -> Detections:
    return Detections(
        track_id=np.array([""] * of.frame.size if names is None else names, np.str_),
        time_ns=np.round(of.frame * scene.frame_s * 1e9).astype(np.int64), position=of.place, covariance=of.covariance,
    )  # fmt: skip


def tracked(scene: Scene, model: PrimitiveMap | BayesFilter, fit: Fitted, *, seed: int, n_particles: int) -> Boxes:
    """The boxes of a tracker, each under its track's name."""
    of = scene.seen
    seen = _detections(of, scene)
    seen = replace(seen, covariance=fit.scale * seen.covariance)
    config = FilterConfig(n_particles=n_particles, interaction="none")
    tracker = Tracker(model, config=config, tracking=fit.tracking, rng=np.random.default_rng(seed))
    name, numbers = np.zeros(of.frame.size, np.int64), dict[str, int]()
    for frame in range(scene.n_frames):
        rows = np.flatnonzero(of.frame == frame)
        found = tracker.step(seen[rows], time_ns=round(frame * scene.frame_s * 1e9))
        found = found[found.unseen_s == 0.0]
        a, b = linear_sum_assignment(((of.place[rows][:, None] - found.position) ** 2).sum(axis=-1))
        for row, track in zip(rows[a], found.track_id[b].tolist(), strict=True):
            name[row] = numbers.setdefault(track, len(numbers) + 1)
    return of._replace(name=name).of(name > 0)


def above_mean(tracks: Boxes, least: float) -> Boxes:
    """The tracks of a mean score above this."""
    _, number = np.unique(tracks.name, return_inverse=True)
    mean = np.bincount(number, tracks.score) / np.maximum(np.bincount(number), 1)
    return tracks.of(mean[number] > least if number.size else np.zeros(0, np.bool_))


def widened(hota_at: Callable[[float], Sequence[float]], own: int | None = None) -> Choice:
    """The factor of the spread of the greatest mean HOTA of constant velocity; of other sequences than one's own."""

    def hota(values: tuple[float, ...]) -> float:
        found = np.asarray(hota_at(values[0]))
        return float((found if own is None or found.size == 1 else np.delete(found, own)).mean())

    return choose([Axis("factor", 1.0, 4.0)], hota, least_gain=0.1)[0]


Write = Callable[[Boxes], Iterable[str]]
"""Lines of a file as the benchmark wants them."""


def trackeval(
    dataset: Callable[[Path, Path], Any], write: Write, results: Mapping[str, Sequence[Boxes]], names: Sequence[str]
) -> dict[str, dict[str, dict[str, float]]]:
    """HOTA, CLEAR MOT and IDF1 of trackers, for each sequence and for all, `COMBINED_SEQ`.

    Args:
        dataset: TrackEval's, of the folder of results and one to write into.
        write: a sequence's file.
        results: of each tracker the boxes of each sequence.
        names: of the sequences.
    """
    from trackeval import Evaluator
    from trackeval.metrics import CLEAR, HOTA, Identity

    quiet = {"PRINT_RESULTS": False, "PRINT_CONFIG": False, "TIME_PROGRESS": False, "OUTPUT_SUMMARY": False,
             "OUTPUT_DETAILED": False, "PLOT_CURVES": False, "LOG_ON_ERROR": None}  # fmt: skip
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        for number, boxes in enumerate(results.values()):
            into = Path(folder) / "results" / str(number) / "data"
            into.mkdir(parents=True)
            for name, of in zip(names, boxes, strict=True):
                (into / f"{name}.txt").write_text("\n".join(write(of)) + "\n")
        made = dataset(Path(folder) / "results", Path(folder))
        metrics = [HOTA(), CLEAR({"PRINT_CONFIG": False}), Identity({"PRINT_CONFIG": False})]
        (found,) = Evaluator(quiet).evaluate([made], metrics)[0].values()
    (kind,) = {key for of in found.values() for sequence in of.values() for key in sequence}
    return {
        method: {name: _figures(of[kind]) for name, of in found[str(number)].items()}
        for number, method in enumerate(results)
    }


def _figures(of: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    hota, clear = of["HOTA"], of["CLEAR"]
    values = [100.0 * float(np.mean(hota[key])) for key in ("HOTA", "AssA", "DetA")]
    values += [100.0 * float(clear["MOTA"]), 100.0 * float(of["Identity"]["IDF1"]), float(clear["IDSW"])]
    return dict(zip(COLUMNS, values, strict=True))


def compared(
    table: Findings, scenes: Sequence[Scene], models: Mapping[str, Callable[[int], Any]],
    fits: Sequence[Fitted], *, n_seeds: int, n_particles: int,
) -> dict[str, list[list[Boxes]]]:  # fmt: skip
    """Each method's runs over all scenes; the constant velocity of the fit beside the models, by scene."""
    table.settings += [choice for fit in fits for choice in fit.settings]

    def run(model: Callable[[int, Fitted], Any], seed: int) -> list[Boxes]:
        return [
            tracked(scene, model(i, fit), fit, seed=seed, n_particles=n_particles)
            for i, (scene, fit) in enumerate(zip(scenes, fits, strict=True))
        ]

    runs = {name: [run(lambda i, _, of=of: of(i), seed) for seed in range(n_seeds)] for name, of in models.items()}
    runs[STRAIGHT] = [run(lambda _, fit: ConstantVelocityKalman(acceleration_density=fit.density), 0)]
    return runs


def add_rows(
    table: Findings, label: str, runs: Mapping[str, Sequence[Sequence[Boxes]]], names: Sequence[str],
    judge: Callable[[Mapping[str, Sequence[Boxes]]], dict[str, dict[str, dict[str, float]]]],
) -> None:  # fmt: skip
    """Rows of methods, means over seeds; gains of the first over others, over sequences, or over seeds of one."""
    found = judge({f"{method}/{seed}": boxes for method, of in runs.items() for seed, boxes in enumerate(of)})
    hota = {}
    for method, of in runs.items():
        figures = [found[f"{method}/{seed}"] for seed in range(len(of))]
        table.rows[f"{method}{label}"] = {
            key: float(np.mean([each["COMBINED_SEQ"][key] for each in figures])) for key in COLUMNS
        }
        hota[method] = np.array([[each[name]["hota"] for name in names] for each in figures])
    first = WITH if WITH in runs else WITHOUT
    for method in [name for name in runs if name != first]:
        a, b = (hota[name].mean(axis=0) if len(names) > 1 else hota[name][:, 0] for name in (first, method))
        b = np.broadcast_to(b, a.shape) if b.size == 1 else b
        one = np.ones(a.size)
        table.gains[f"{first} against {method}{label}, more HOTA"] = interval(
            np.column_stack([a, one, b, one]), difference_of_means
        )
