"""Scenes whose detections are boxes of images, on the ground, and what TrackEval says of tracks of boxes.

Noise and rates are measured on training scenes: detections are those of a true vehicle where their boxes overlap by
half.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import expit
from sklearn.linear_model import LogisticRegression

from dirprim_filter import Tracks
from dirprim_filter.arrays import AnyArray, FloatArray, IntArray
from dirprim_filter.config import TrackingConfig
from dirprim_filter.evaluation.intervals import difference_of_means, paired
from dirprim_filter.evaluation.tracking_report import normalised_squared
from grounds.findings import WITH, WITHOUT, Findings

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
        size: (n, 3) metres, as in `Detections`.
    """

    frame: IntArray
    name: IntArray
    box: FloatArray
    score: FloatArray
    place: FloatArray
    covariance: FloatArray
    size: FloatArray

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

    def until(self, frame: int) -> Scene:
        """The frames before this."""
        seen, truth = (of.of(of.frame < frame) for of in (self.seen, self.truth))
        return self._replace(seen=seen, truth=truth, n_frames=min(frame, self.n_frames))

    def above(self, score: float) -> Scene:
        """With the better detections alone."""
        return self._replace(seen=self.seen.of(self.seen.score >= score))

    def named(self) -> Boxes:
        """The detections that are of a true vehicle, by its name."""
        name = np.zeros(self.seen.frame.size, np.int64)
        shared = partial(overlaps, self.seen.box, self.truth.box)
        for mine, own in alike(self.seen.frame, self.truth.frame, shared, least=OVERLAP):
            name[mine] = self.truth.name[own] + 1
        return self.seen._replace(name=name)

    def place_of(self, named: Boxes) -> FloatArray:
        """(n, 2) where the vehicles truly were that detections are of."""
        keys = [self.truth.frame << 32 | self.truth.name + 1, named.frame << 32 | named.name]
        order = np.argsort(keys[0])
        return self.truth.place[order[np.searchsorted(keys[0][order], keys[1])]]


def alike(
    one: IntArray, other: IntArray, similarity: Callable[[IntArray, IntArray], FloatArray], *, least: float
) -> Iterator[tuple[IntArray, IntArray]]:
    """Of each frame the rows that belong together, each to one at most, as alike as this at least."""
    for frame in np.intersect1d(one, other):
        mine, own = np.flatnonzero(one == frame), np.flatnonzero(other == frame)
        nearness = np.maximum(similarity(mine, own), least)
        a, b = linear_sum_assignment(-nearness)
        near = nearness[a, b] > least
        yield mine[a[near]], own[b[near]]


def overlaps(one: FloatArray, other: FloatArray, mine: IntArray, own: IntArray) -> FloatArray:
    """(n, 4), (m, 4), some rows of each -> intersection over union of these."""
    (left, top, right, bottom), (left_2, top_2, right_2, bottom_2) = one[mine].T[..., None], other[own].T[:, None]
    width = np.maximum(np.minimum(right, right_2) - np.maximum(left, left_2), 0.0)
    shared = width * np.maximum(np.minimum(bottom, bottom_2) - np.maximum(top, top_2), 0.0)
    areas = (right - left) * (bottom - top) + (right_2 - left_2) * (bottom_2 - top_2)
    return np.asarray(shared / (areas - shared))


class Fitted(NamedTuple):
    """What training scenes show.

    Attributes:
        scale: of the stated covariances.
        tracking: rates of detections and vehicles.
        confidence: (n,) scores -> (n,) share of detections that are of a true vehicle, a logistic function of them.
    """

    scale: float
    tracking: TrackingConfig
    confidence: Callable[[FloatArray], FloatArray]

    @classmethod
    def of(cls, scenes: Sequence[Scene]) -> Fitted:
        """The scale by how far detections are from the truth."""
        all_named = [scene.named() for scene in scenes]
        score, is_true = (np.concatenate(of) for of in zip(*((of.score, of.name > 0) for of in all_named), strict=True))
        squared = []
        for scene, named in zip(scenes, all_named, strict=True):
            kept = named.of(named.name > 0)
            squared.append(normalised_squared(kept.place - scene.place_of(kept), kept.covariance))
        hits, n_true = int(is_true.sum()), sum(scene.truth.frame.size for scene in scenes)
        n_new = sum(np.unique(scene.truth.name).size for scene in scenes)
        exposure = sum(scene.n_frames for scene in scenes) * float(np.mean([scene.area for scene in scenes]))
        tracking = TrackingConfig(
            detection_probability=min(hits / n_true, 0.99), clutter_density=max(score.size - hits, 1) / exposure,
            birth_density=n_new / exposure, vehicle_density=n_true / exposure,
        )  # fmt: skip
        score = np.append(score, [score.min(), score.max()])
        fitted = LogisticRegression().fit(score[:, None], np.append(is_true, [False, True]))  # there are both

        def confidence(of: FloatArray) -> FloatArray:
            return np.asarray(expit(fitted.coef_[0, 0] * of + fitted.intercept_[0]))

        return cls(float(np.median(np.concatenate(squared)) / MEDIAN_SQUARED), tracking, confidence)


SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
"""Least mean confidences of a track that are tried."""


def above_mean(tracks: Boxes, confidence: Callable[[FloatArray], FloatArray], least: float) -> Boxes:
    """The tracks of a mean confidence above this: what a detector takes for a vehicle it does so frame after frame."""
    _, number = np.unique(tracks.name, return_inverse=True)
    mean = np.bincount(number, confidence(tracks.score)) / np.maximum(np.bincount(number), 1)
    return tracks.of(mean[number] > least if number.size else np.zeros(0, np.bool_))


def best_share(hota: Mapping[float, float]) -> tuple[float, float]:
    """Of HOTA in percent by least mean confidence the greatest to a tenth, and the least that has it."""
    least = max(hota, key=lambda share: (round(hota[share], 1), -share))
    return hota[least], least


Write = Callable[[Boxes], Iterable[str]]
"""Lines of a file as the benchmark wants them."""


def trackeval(
    dataset: Callable[[Path, Path], Any], write: Write, results: Mapping[str, Sequence[Boxes]], names: Sequence[str],
    *, is_short: bool = False,
) -> dict[str, dict[str, dict[str, float]]]:  # fmt: skip
    """HOTA, CLEAR MOT and IDF1 of trackers, for each sequence and for all, `COMBINED_SEQ`.

    Args:
        dataset: TrackEval's, of the folder of results and one to write into.
        write: a sequence's file.
        results: of each tracker the boxes of each sequence.
        names: of the sequences.
        is_short: HOTA alone.
    """
    from trackeval import Evaluator
    from trackeval.metrics import CLEAR, HOTA, Identity

    quiet = {"PRINT_RESULTS": False, "PRINT_CONFIG": False, "TIME_PROGRESS": False, "OUTPUT_SUMMARY": False,
             "OUTPUT_DETAILED": False, "PLOT_CURVES": False, "LOG_ON_ERROR": None}  # fmt: skip
    with (
        tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings(),
    ):  # fmt: skip
        warnings.simplefilter("ignore", DeprecationWarning)
        for number, boxes in enumerate(results.values()):
            into = Path(folder) / "results" / str(number) / "data"
            into.mkdir(parents=True)
            for name, of in zip(names, boxes, strict=True):
                (into / f"{name}.txt").write_text("".join(f"{line}\n" for line in write(of)))  # of no track it is empty
        made = dataset(Path(folder) / "results", Path(folder))
        metrics = [HOTA(), *([] if is_short else [of({"PRINT_CONFIG": False}) for of in (CLEAR, Identity)])]
        (found,) = Evaluator(quiet).evaluate([made], metrics)[0].values()
    (kind,) = {key for of in found.values() for sequence in of.values() for key in sequence}
    return {
        method: {name: _figures(of[kind]) for name, of in found[str(number)].items()}
        for number, method in enumerate(results)
    }


def _figures(of: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    found = {key.lower(): 100.0 * float(np.mean(of["HOTA"][key])) for key in ("HOTA", "AssA", "DetA")}
    if "CLEAR" in of:
        clear = of["CLEAR"]
        found |= {"mota": 100.0 * float(clear["MOTA"]), "idf1": 100.0 * float(of["Identity"]["IDF1"])}
        found |= {"switches": float(clear["IDSW"])}
    return found


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
        gain = paired(np.arange(a.size), a, b, difference_of_means)
        table.gains[f"{first} against {method}{label}, more HOTA"] = gain
