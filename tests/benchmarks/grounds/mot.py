"""Pedestrians by fixed cameras: MOT17 by its cameras' parameters, PETS09 by a homography fitted to its truth.

The first half of a sequence makes the map; by its last 150 frames each method chooses its settings, and the least
confidence of a detection, by 75 who takes .1 s a frame; the second half is judged.
A box stands where the middle of its lower side meets the ground; its covariance there is that of the pixels, carried
by the mapping's derivative.

Source: Yi et al., UCMCTrack: Multi-Object Tracking with Uniform Camera Motion Compensation, 2024 (the formula, and the
spread of pixels); Dendorfer et al., MOTChallenge, 2021; Zhang et al., ByteTrack, 2022 (detections).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from peer_trackers import Settings
from scipy.optimize import least_squares

from dirprim_filter.arrays import FloatArray
from dirprim_filter.evaluation.settings import Axis
from grounds.box_trackers import Given, Method, ours, packages, tuned
from grounds.boxes import COLUMNS, Boxes, Fitted, Scene, add_rows, trackeval
from grounds.findings import WITH, WITHOUT, Asked, Findings, learned

CONFIDENCE = Axis("confidence", 0.5, 1.2, most=0.95)
TRAINING_FRAMES, FEWER_FRAMES = 150, 75
TUNED_BY = 3
"""Seeds, of methods that draw, by which settings are chosen: those of one differ by more than most settings do."""
SLOW = {("mot17", "Stone Soup GNN")}
FAR_M = 100.0
"""Beyond is the horizon, or the wrong side of it."""
UCMC = {
    "UCMCTrack, 02 04 09 (run again, its settings)": (72.4, 76.6, 68.6, np.nan, 84.6, 170),
    "UCMCTrack, 04 (run again, its settings)": (79.8, np.nan, np.nan, np.nan, np.nan, np.nan),
    "norfair, 02 04 09 (boxes, untuned)": (69.7, 71.5, np.nan, np.nan, 80.3, 153),
    "norfair, 04 (boxes, untuned)": (78.0, np.nan, np.nan, np.nan, np.nan, np.nan),
}
"""Measured on second halves, detections of .5 and more, TrackEval."""


class Ground(NamedTuple):
    """From pixels to metres: (u, v, 1) times this matrix, over its third."""

    matrix: FloatArray

    def feet(self, box: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n, 4) -> (n, 2) metres and (n, 2, 2) their covariance."""
        width, height = (box[:, 2:] - box[:, :2]).T
        pixel = np.column_stack([0.5 * (box[:, 0] + box[:, 2]), box[:, 3], np.ones(len(box))])
        on = pixel @ self.matrix.T
        place = on[:, :2] / on[:, 2:]
        slope = (self.matrix[None, :2, :2] - place[:, :, None] * self.matrix[None, 2:, :2]) / on[:, 2, None, None]
        spread = np.column_stack([np.clip(0.05 * width, 2.0, 13.0), np.clip(0.05 * height, 2.0, 10.0)])
        scaled = slope * spread[:, None]
        return place, scaled @ scaled.swapaxes(1, 2)

    @classmethod
    def of_camera(cls, path: Path) -> Ground:
        """By rotation, translation in millimetres, and intrinsics."""
        numbers = [line.split() for line in path.read_text().splitlines()]
        rows = np.array([row for row in numbers if len(row) == 3 and not row[0][0].isalpha()], np.float64)
        rotation, shift, inner = rows[:3], rows[3] / 1000.0, rows[4:7]
        return cls(np.linalg.inv(inner @ np.column_stack([rotation[:, :2], shift])))

    @classmethod
    def fitted(cls, box: FloatArray, place: FloatArray) -> Ground:
        """To feet whose place is known, by the direct linear transformation, then by least squares in metres."""
        u, v = 0.5 * (box[:, 0] + box[:, 2]), box[:, 3]
        zero, one, (x, y) = np.zeros_like(u), np.ones_like(u), place.T
        rows = np.concatenate([
            np.column_stack([u, v, one, zero, zero, zero, -x * u, -x * v]),
            np.column_stack([zero, zero, zero, u, v, one, -y * u, -y * v]),
        ])  # fmt: skip
        start = np.linalg.lstsq(rows, np.concatenate([x, y]), rcond=None)[0]

        def off(values: FloatArray) -> FloatArray:
            return np.asarray((cls(np.append(values, 1.0).reshape(3, 3)).feet(box)[0] - place).ravel())

        found = least_squares(off, start, x_scale=np.abs(start) + 1e-9, loss="soft_l1")
        return cls(np.append(found.x, 1.0).reshape(3, 3))


class Camera(NamedTuple):
    """A sequence of a fixed camera.

    Attributes:
        name: of it.
        truth: its rows as the benchmark has them, frames from 1.
        seen: of the detector.
        ground: where pixels are.
        half: the last frame of the first half.
        n_frames: of all.
        frame_s: seconds between frames.
    """

    name: str
    truth: FloatArray
    seen: FloatArray
    ground: Ground
    half: int
    n_frames: int
    frame_s: float

    @property
    def parts(self) -> tuple[tuple[int, int], ...]:
        """First and last frames of what is learned from, what is judged, and what settings are chosen by."""
        chosen_by = ((max(self.half - n, 0) + 1, self.half) for n in (TRAINING_FRAMES, FEWER_FRAMES))
        return (1, self.half), (self.half + 1, self.n_frames), *chosen_by

    def part(self, number: int) -> Scene:
        """One of them, frames from 0."""
        first, last = self.parts[number]
        truth = self.truth[self.truth[:, 6] > 0]
        truth = truth[truth[:, 7] == 1] if self.name.startswith("MOT17") else truth
        of_truth, seen = (self._boxes(rows, first, last) for rows in (truth, self.seen))
        area = float(np.prod(np.ptp(of_truth.place, axis=0)))
        return Scene(self.name, seen, of_truth, last - first + 1, self.frame_s, area)

    def _boxes(self, rows: FloatArray, first: int, last: int) -> Boxes:
        rows = rows[(rows[:, 0] >= first) & (rows[:, 0] <= last)]
        rows = rows[np.lexsort((-rows[:, 6], rows[:, 0]))]
        box = np.column_stack([rows[:, 2:4], rows[:, 2:4] + rows[:, 4:6]])
        place, covariance = self.ground.feet(box)
        near = (np.linalg.eigvalsh(covariance)[:, 1] < FAR_M) & (np.hypot(*place.T) < FAR_M)
        frame = rows[:, 0].astype(np.int64) - first
        name = rows[:, 1].astype(np.int64)
        left, right = (self.ground.feet(box[:, [side, 1, side, 3]])[0] for side in (0, 2))
        width = np.hypot(*(right - left).T)  # a body is as long as it is wide; those on the horizon are left out
        size = np.column_stack([width, width, np.full(width.size, np.nan)])
        return Boxes(frame, name, box, rows[:, 6], place, covariance, size).of(near)

    def lines(self, number: int) -> str:
        """The truth of one of them, as the benchmark has it, frames from 1."""
        first, last = self.parts[number]
        rows = self.truth[(self.truth[:, 0] >= first) & (self.truth[:, 0] <= last)].copy()
        rows[:, 0] -= first - 1
        return "\n".join(",".join(f"{value:g}" for value in row) for row in rows) + "\n"


def of_mot17(folder: Path) -> Camera:
    """One with its camera's parameters."""
    info = dict(line.split("=", 1) for line in (folder / "seqinfo.ini").read_text().splitlines() if "=" in line)
    truth, seen = (np.loadtxt(folder / name, delimiter=",", ndmin=2) for name in ("gt.txt", "det_yolox_x_ablation.txt"))
    n_frames = int(info["seqLength"])
    half = n_frames - int(np.loadtxt(folder / "gt_val_half.txt", delimiter=",", ndmin=2)[:, 0].max())
    frame_s = 1.0 / float(info["frameRate"])
    return Camera(folder.name, truth, seen, Ground.of_camera(folder / "cam_para.txt"), half, n_frames, frame_s)


def of_pets(folder: Path) -> Camera:
    """One whose truth has places: those of the first half make the homography."""
    truth, seen = (np.loadtxt(folder / name, delimiter=",", ndmin=2) for name in ("gt.txt", "det_frcnn_sort.txt"))
    n_frames = int(truth[:, 0].max())
    known = truth[truth[:, 0] <= n_frames // 2]
    ground = Ground.fitted(np.column_stack([known[:, 2:4], known[:, 2:4] + known[:, 4:6]]), known[:, 7:9])
    return Camera(folder.name, truth, seen, ground, n_frames // 2, n_frames, 1.0 / 7.0)


KINDS = {"mot17": ("mot17", "MOT17", of_mot17), "pets09": ("mot15", "MOT15", of_pets)}


def dataset(benchmark: str, cameras: Sequence[Camera], part: int, results: Path, folder: Path) -> Any:
    """TrackEval's, of one part of each camera's."""
    from trackeval.datasets import MotChallenge2DBox

    for of in cameras:
        (folder / f"{of.name}.txt").write_text(of.lines(part))
    return MotChallenge2DBox({
        "GT_FOLDER": str(folder), "TRACKERS_FOLDER": str(results), "BENCHMARK": benchmark, "SKIP_SPLIT_FOL": True,
        "GT_LOC_FORMAT": "{gt_folder}/{seq}.txt", "PRINT_CONFIG": False,
        "SEQ_INFO": {of.name: of.parts[part][1] - of.parts[part][0] + 1 for of in cameras},
    })  # fmt: skip


def lines_of(boxes: Boxes) -> Iterable[str]:
    """As MOTChallenge's results."""
    for frame, name, box, score in zip(boxes.frame, boxes.name, boxes.box, boxes.score, strict=True):
        left, top, right, bottom = box
        yield f"{frame + 1},{name},{left:.2f},{top:.2f},{right - left:.2f},{bottom - top:.2f},{score:.3f},-1,-1,-1"


def of_mot(kind: str, asked: Asked) -> list[Findings]:
    """All sequences of a folder."""
    place, benchmark, read = KINDS[kind]
    folders = sorted(path.parent for path in (asked.data / place).glob("*/gt.txt"))
    sequences = [read(folder) for folder in folders]
    if asked.is_smoke:
        sequences = [of._replace(half=min(of.half, 60), n_frames=min(of.n_frames, 120)) for of in sequences]
    learned_from, judged, *training = ([of.part(part) for of in sequences] for part in range(4))
    maps = [learned(scene.tracks(), asked, f"{kind}_{scene.name}", quick_m=2.0) for scene in learned_from]
    names = [of.name for of in sequences]
    judges = [
        partial(trackeval, partial(dataset, benchmark, sequences, part), lines_of, names=names) for part in range(4)
    ]
    models = {WITH: lambda i: maps[i], WITHOUT: lambda i: maps[i].without_places()}
    methods = ours(models, n_seeds=asked.n_seeds, n_particles=100 if asked.is_smoke else 1000, with_smoothed=True)
    methods |= {} if asked.is_smoke else packages(judged[0], Fitted.of(learned_from[:1]))
    table = Findings(f"{kind}: second halves of {' '.join(names)}, {asked.n_seeds} seeds")

    @cache
    def fits(least: float) -> list[Fitted]:
        return [Fitted.of([scene.above(least)]) for scene in learned_from]

    def boxes(method: Method, scenes: Sequence[Scene], settings: Settings, seed: int) -> list[Boxes]:
        least = settings["confidence"]
        given = [Given(fit, settings, seed) for fit in fits(least)]
        return [method.run(i, of.above(least), given[i]) for i, of in enumerate(scenes)]

    def hota(method: Method, which: int, settings: Settings) -> float:
        seeds = range(min(method.n_seeds, TUNED_BY))
        runs = {str(seed): boxes(method, training[which], settings, seed) for seed in seeds}
        found = judges[2 + which](runs, is_short=True).values()
        return float(np.mean([of[name]["hota"] for of in found for name in names]))

    runs = {}
    for name, method in methods.items():
        axes = (CONFIDENCE, *method.axes)
        settings = tuned(table, name, axes, partial(hota, method, (kind, name) in SLOW), is_smoke=asked.is_smoke)
        runs[name] = [boxes(method, judged, settings, seed) for seed in range(method.n_seeds)]
    add_rows(table, "", runs, names, judges[1])
    if kind == "mot17":
        table.rows |= {name: dict(zip(COLUMNS, figures, strict=True)) for name, figures in UCMC.items()}
    return [table]
