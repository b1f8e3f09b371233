"""KITTI tracking: cars about a driving car, PointRCNN's detections, on the ground of the first camera.

Sequences with detections are judged; the others say how cars move, apart from places: no road is driven twice. Noise
and rates are measured on the other judged sequences, for there alone are detections; there each method chooses its
settings, and the least mean confidence of a track, by HOTA.

Source: Geiger, Lenz and Urtasun, 2012; Weng et al., AB3DMOT, 2020 (detections); Luiten et al., HOTA, 2021.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from peer_trackers import Settings

from dirprim_filter import Tracks
from dirprim_filter.arrays import AnyArray, FloatArray
from grounds.box_trackers import Given, ours, packages, tuned
from grounds.boxes import COLUMNS, SHARES, Boxes, Fitted, Scene, above_mean, add_rows, best_share, trackeval
from grounds.findings import WITHOUT, Asked, Findings, learned

FRAME_S = 0.1
AREA = 4000.0
"""Square metres: a field of 90 degrees, 70 m deep."""
DETECTED_M = 0.3
"""Deviation of a detection to begin with, each axis."""
TRAINING_FRAMES = 120
"""Of each sequence, by which settings of others are chosen."""
PUBLISHED_CUT = 2.5
"""Mean score of a track, which is no confidence."""
AB3DMOT = {
    "five sequences": (76.4, 79.2, 73.8, 82.1, 88.0, 11), "eleven sequences": (75.0, 76.6, 73.7, 84.7, 87.7, 15),
}  # fmt: skip
"""Run again on the same detections, tracks of a mean score above 2.5, TrackEval."""


def lifted(place: FloatArray, frame: AnyArray, pose: FloatArray) -> FloatArray:
    """(n, 3) in the axes of each frame's camera -> (n, 2) forwards and to the left of the first camera."""
    world = np.einsum("nij,nj->ni", pose[frame, :, :3], place) + pose[frame, :, 3]
    return np.column_stack([world[:, 2], -world[:, 0]])


def truth_of(data: Path, name: str) -> Boxes:
    """Labelled cars: frame, track + 1, box, score, place."""
    lines = [line.split() for line in (data / f"label/{name}.txt").read_text().splitlines()]
    rows = [[line[0], int(line[1]) + 1, *line[6:10], 1, *line[10:16]] for line in lines if line[2] == "Car"]
    return _boxes(np.array(rows, np.float64).reshape(-1, 13), data, name)


def _boxes(rows: FloatArray, data: Path, name: str) -> Boxes:
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    pose = np.loadtxt(data / f"pose/{name}.txt", ndmin=2).reshape(-1, 3, 4)
    (frame, track), place = rows[:, :2].T.astype(np.int64), rows[:, 10:]
    covariance = np.tile(DETECTED_M**2 * np.eye(2), (frame.size, 1, 1))
    return Boxes(frame, track, rows[:, 2:6], rows[:, 6], lifted(place, frame, pose), covariance, rows[:, [9, 8, 7]])


def scene_of(data: Path, name: str) -> Scene:
    """A sequence with detections."""
    rows = np.loadtxt(data / f"det/{name}.txt", delimiter=",", ndmin=2)
    seen = _boxes(rows[:, :13], data, name)
    n_frames = len(np.loadtxt(data / f"pose/{name}.txt", ndmin=2))
    return Scene(name, seen, truth_of(data, name), n_frames, FRAME_S, AREA)


def traffic_of(data: Path, names: Iterable[str]) -> Tracks:
    """Labelled cars of sequences, each a group."""
    every = ((name, truth_of(data, name)) for name in names)
    parts = [Scene(name, of, of, 0, FRAME_S, AREA).tracks() for name, of in every if of.frame.size]
    return Tracks.concatenate([replace(part, group=np.full(len(part), i)) for i, part in enumerate(parts)])


def lines_of(boxes: Boxes) -> Iterable[str]:
    """As KITTI's results."""
    for frame, name, box, score in zip(boxes.frame, boxes.name, boxes.box, boxes.score, strict=True):
        sides = " ".join(f"{side:.4f}" for side in box)
        yield f"{frame} {name} Car -1 -1 -10 {sides} -1 -1 -1 -1000 -1000 -1000 -10 {score:.4f}"


def dataset(data: Path, scenes: Sequence[Scene], results: Path, folder: Path) -> Any:
    """TrackEval's."""
    from trackeval.datasets import Kitti2DBox

    (folder / "label_02").mkdir()
    for scene in scenes:
        lines = (data / f"label/{scene.name}.txt").read_text().splitlines(keepends=True)
        kept = [line for line in lines if int(line.split()[0]) < scene.n_frames]
        (folder / f"label_02/{scene.name}.txt").write_text("".join(kept))
    rows = "".join(f"{scene.name} empty 000000 {scene.n_frames:06d}\n" for scene in scenes)
    (folder / "evaluate_tracking.seqmap.training").write_text(rows)
    return Kitti2DBox({
        "GT_FOLDER": str(folder), "TRACKERS_FOLDER": str(results), "CLASSES_TO_EVAL": ["car"], "PRINT_CONFIG": False,
    })  # fmt: skip


def cut(tracks: Boxes, fit: Fitted, least: float) -> Boxes:
    """Those of a mean confidence above this, or above AB3DMOT's mean score."""
    return above_mean(tracks, np.asarray if least == PUBLISHED_CUT else fit.confidence, least)


def of_kitti(asked: Asked) -> list[Findings]:
    """The sequences with detections together."""
    data = asked.data / "kitti_tracking"
    names = sorted(path.stem for path in (data / "det").glob("*.txt"))
    others = sorted({path.stem for path in (data / "label").glob("*.txt")} - set(names))
    if asked.is_smoke:
        names, others = names[:2], others[:2]
    scenes = [scene_of(data, name) for name in names]
    background = learned(traffic_of(data, others), asked, "kitti", quick_m=20.0).without_places()
    training = [scene.until(TRAINING_FRAMES) for scene in scenes]
    judge, judge_training = (
        partial(trackeval, partial(dataset, data, of), lines_of, names=names) for of in (scenes, training)
    )
    fits = [Fitted.of([scene for scene in scenes if scene is not own] or scenes) for own in scenes]
    alone = ours({WITHOUT: lambda _: background}, n_seeds=asked.n_seeds, n_particles=100 if asked.is_smoke else 1000)
    methods = alone | ({} if asked.is_smoke else packages(scenes[0], fits[0]))
    table = Findings(f"kitti: {len(scenes)} sequences ({' '.join(names)}), PointRCNN, {asked.n_seeds} seeds")

    @cache
    def hota(name: str, settings: tuple[tuple[str, float], ...]) -> dict[float, list[float]]:
        """Of each sequence, by the least mean confidence of a track."""
        boxes = [methods[name].run(i, of, Given(fits[i], dict(settings))) for i, of in enumerate(training)]
        cuts = (*SHARES, PUBLISHED_CUT)
        found = judge_training({str(of): [*map(cut, boxes, fits, repeat(of))] for of in cuts}, is_short=True)
        return {least: [found[str(least)][of.name]["hota"] for of in scenes] for least in cuts}

    def of_others(name: str, shares: Sequence[float], own: int, settings: Settings) -> tuple[float, float]:
        """The greatest mean HOTA of other sequences than one's own, and its least mean confidence."""
        found = hota(name, tuple(settings.items()))
        kept = [i for i in range(len(scenes)) if i != own] or [own]
        return best_share({least: float(np.mean([found[least][i] for i in kept])) for least in shares})

    for label, shares in (
        (", all tracks", SHARES[:1]), (", mean score above 2.5", (PUBLISHED_CUT,)),
        (", mean confidence by the other sequences", SHARES),
    ):  # fmt: skip
        runs: dict[str, list[list[Boxes]]] = {}
        for name, method in methods.items():
            if name not in alone and shares is not SHARES:
                continue
            chosen = []
            for i in range(len(scenes)):
                greatest = partial(of_others, name, shares, i)
                settings = tuned(
                    table, f"{name}{label}", method.axes, lambda of, by=greatest: by(of)[0], is_smoke=asked.is_smoke
                )
                chosen.append((settings, greatest(settings)[1]))
            runs[name] = [
                [
                    cut(method.run(i, scenes[i], Given(fits[i], of, seed)), fits[i], least)
                    for i, (of, least) in enumerate(chosen)
                ]
                for seed in range(method.n_seeds)
            ]
        add_rows(table, label, runs, names, judge)
    for which, figures in AB3DMOT.items():
        table.rows[f"AB3DMOT, {which} (run again, mean score above 2.5)"] = dict(zip(COLUMNS, figures, strict=True))
    table.rows["AB3DMOT, eleven sequences (published, 3D IoU .25)"] = {"samota": 93.34, "mota": 86.47}
    return [table]
