"""The judge on neutral ground runs on data of each kind: made here, and laid out as those of others."""

import gzip
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).with_name("benchmarks")))

from grounds.box_trackers import filled
from grounds.boxes import Boxes, above_mean, best_share, overlaps
from grounds.findings import STRAIGHT, WITH, WITHOUT, Asked
from grounds.gps import SOURCES, log_of, windows_of
from grounds.mot import Ground
from grounds.windows import Answer, Window, fitted, marks, straight, textbook
from neutral import GROUNDS, findings

from oracles import filterpy_constant_velocity

DATA = Path(__file__).parents[2] / "shared/data"


def window(*, turn: float = 0.0, gap_s: float = 6.0, cluster: str = "0") -> Window:
    """Seen each second but for a gap, on a circle or straight on at 10 m/s."""
    time_s = np.arange(0.0, 21.0)
    course = turn * time_s
    place = np.cumsum(10.0 * np.column_stack([np.cos(course), np.sin(course)]), axis=0)
    gone = (time_s > 10.0) & (time_s <= 10.0 + gap_s)
    return Window(cluster, time_s[~gone], place[~gone], time_s[gone], place[gone])


def test_who_goes_straight_on_is_where_the_textbook_and_the_line_expect_it():
    windows = [window(), window(gap_s=3.0)]
    answers = [straight(windows), *(textbook(windows, 0.1, 0.5, smooth=smooth) for smooth in (False, True))]
    for answer in answers:
        assert marks(windows, answer).error.max() < 0.1
    assert (answers[2].covariance[:, 0, 0] < answers[1].covariance[:, 0, 0]).all()  # what comes later is known too


def test_a_smoother_of_the_textbook_is_filterpys():
    of, density, noise = window(turn=0.1), 0.5, 2.0
    time_s = np.arange(0.0, 21.0)
    gone, place = np.isin(time_s, of.hidden_s), np.full((21, 2), np.nan)
    place[~gone] = of.place
    given = {"density": density, "noise_m": noise, "first_speed_std": 10.0}
    mean, covariance = filterpy_constant_velocity(place, time_s, **given)[1]
    answer = textbook([of], density, noise, smooth=True)
    np.testing.assert_allclose(answer.mean, mean[gone, :2], rtol=1e-6)
    np.testing.assert_allclose(answer.covariance, covariance[gone, :2, :2], rtol=1e-5)


def test_silence_is_charged_with_the_last_place():
    windows = [window(gap_s=3.0)]
    silent = Answer(np.full((3, 2), np.nan), np.full((3, 2, 2), np.nan), np.full((3, 2, 2), np.nan))
    found = marks(windows, silent)
    np.testing.assert_allclose(found.error, [10.0, 20.0, 30.0])
    np.testing.assert_allclose(found.energy, found.error)
    assert not found.is_answered.any()


def test_a_rivals_settings_lie_inside_what_was_tried():
    for choice in fitted([window(turn=turn) for turn in (0.0, 0.1, -0.2)], smooth=True, density=1.0, noise_m=1.0):
        assert choice.low < choice.chosen < choice.high


ROTATION = np.array([[1, 0, 0], [0, -np.sin(0.4), -np.cos(0.4)], [0, np.cos(0.4), -np.sin(0.4)]])
INNER, SHIFT_M = np.array([[1000.0, 0, 960], [0, 1000.0, 540], [0, 0, 1]]), -ROTATION @ [[0.0], [0.0], [6.0]]
CAMERA = INNER @ np.hstack([ROTATION, SHIFT_M])
"""(3, 4) of a camera 6 m above the ground, that looks north and down."""


def boxes_at(place: np.ndarray) -> np.ndarray:
    """(n, 2) metres -> (n, 4) left, top, width, height of people there."""
    ends = [np.column_stack([place, np.full(len(place), height), np.ones(len(place))]) for height in (0.0, 1.7)]
    feet, head = (of @ CAMERA.T for of in ends)
    feet, head = feet[:, :2] / feet[:, 2:], head[:, :2] / head[:, 2:]
    height = feet[:, 1] - head[:, 1]
    return np.column_stack([feet[:, 0] - 0.2 * height, head[:, 1], 0.4 * height, height])


def test_a_gap_of_a_smoothed_track_has_boxes_between_those_at_its_ends_and_a_long_one_none():
    frame, name = np.array([0, 0, 1, 4, 4, 4, 40]), np.array([1, 2, 1, 1, 2, 2, 1])
    box = np.column_stack([10.0 * frame + name, *np.zeros((3, 7))])
    tracks = Boxes(frame, name, box, np.ones(7), box[:, :2], np.zeros((7, 2, 2)), np.zeros((7, 3)))
    found = filled(tracks)
    np.testing.assert_array_equal(found.frame[found.name == 1], [0, 1, 2, 3, 4, 40])
    np.testing.assert_array_equal(found.frame[found.name == 2], [0, 1, 2, 3, 4])
    np.testing.assert_allclose(found.box[:, 0], 10.0 * found.frame + found.name)


def test_pixels_come_back_to_the_ground_with_the_spread_of_the_mapping():
    rng = np.random.default_rng(0)
    place = rng.uniform([-8.0, 10.0], [8.0, 30.0], (40, 2))
    box = boxes_at(place)
    corners = np.column_stack([box[:, :2], box[:, :2] + box[:, 2:]])
    ground = Ground(np.linalg.inv(CAMERA[:, [0, 1, 3]]))
    found, covariance = ground.feet(corners)
    np.testing.assert_allclose(found, place, atol=1e-6)
    np.testing.assert_allclose(Ground.fitted(corners, place).feet(corners)[0], place, atol=1e-3)
    side = np.clip(0.05 * box[0, 2:], 2.0, [13.0, 10.0])
    moved = corners[0] + rng.standard_normal((20_000, 2))[:, [0, 1, 0, 1]] * side[[0, 1, 0, 1]]
    drawn = np.cov(ground.feet(np.column_stack([moved[:, 0], np.zeros(20_000), moved[:, 2], moved[:, 3]]))[0].T)
    assert drawn[0, 0] == pytest.approx(covariance[0, 0, 0], rel=0.2)
    assert drawn[1, 1] == pytest.approx(covariance[0, 1, 1], rel=0.2)


def test_tracks_are_kept_by_their_mean_confidence_and_the_least_that_is_best_is_chosen():
    box, score = np.zeros((4, 4)), np.array([1.0, 3.0, 3.0, 3.0])
    rows = Boxes(np.arange(4), np.array([1, 1, 2, 2]), box, score, box[:, :2], box[:, :2], box[:, :3])
    assert above_mean(rows, np.asarray, 2.5).name.tolist() == [2, 2]
    assert above_mean(rows, lambda score: 0.2 * score, 0.5).name.tolist() == [2, 2]
    assert best_share({0.0: 50.0, 0.1: 51.02, 0.2: 51.04, 0.3: 40.0}) == (51.02, 0.1)  # to a tenth they are the same
    one, others = np.array([[0.0, 0, 2, 2]]), np.array([[1.0, 0, 3, 2], [5, 5, 6, 6]])
    assert overlaps(one, others, np.array([0]), np.array([0, 1])).tolist() == [[1 / 3, 0.0]]


def streets(folder: Path) -> None:
    """Tables of trips along a road with a bend: GeoLife's, by users that are several groups each, and Chicago's."""
    rng, lines = np.random.default_rng(0), ["time_s,track_id,x_m,y_m,group"]
    for trip in range(48):
        along = np.cumsum(rng.uniform(7.0, 11.0, 60))
        place = np.where(along[:, None] < 300.0, [[1.0, 0.0]], [[0.0, 1.0]]).cumsum(axis=0) * 9.0
        for t, (x, y) in enumerate(place + rng.normal(0.0, 1.0, place.shape)):
            lines.append(f"{2 * t},v{trip},{x:.2f},{y:.2f},{trip}")
    for name in ("geolife", "chicago_bus"):
        (folder / name).mkdir()
    (folder / "geolife/train.csv.gz").write_bytes(gzip.compress("\n".join(lines).encode()))
    (folder / "chicago_bus/trips.csv").write_text("\n".join(line.rpartition(",")[0] for line in lines))


def drives(folder: Path) -> None:
    """KITTI's files: cars ahead of a camera that moves on, and detections of two of four sequences."""
    root = folder / "kitti_tracking"
    for name in ("label", "pose", "det"):
        (root / name).mkdir(parents=True)
    rng = np.random.default_rng(0)
    for number in range(4):
        name, labels, detections, poses = f"{number:04d}", [], [], []
        for frame in range(15):
            poses.append(f"1 0 0 0 0 1 0 0 0 0 1 {frame:.1f}")
            for car, x in enumerate((-4.0, 0.0, 4.0)):
                z = 12.0 + 6.0 * car + 0.3 * frame * (car - 1)
                u, size = 600.0 + 700.0 * x / z, 1100.0 / z
                box = [u - size, 180.0, u + size, 180.0 + size]
                sides = " ".join(f"{side:.2f}" for side in box)
                labels.append(f"{frame} {car} Car 0 0 -1.5 {sides} 1.5 1.6 4 {x} 1.6 {z:.3f} -1.57")
                noisy = (np.array([x, 1.6, z]) + rng.normal(0.0, 0.1, 3)).tolist()
                values = [frame, 2, *box, 8.0, 1.5, 1.6, 4.0, *noisy, -1.57, -1.5]
                detections.append(",".join(f"{value:.4f}" for value in values))
        (root / f"label/{name}.txt").write_text("\n".join(labels) + "\n")
        (root / f"pose/{name}.txt").write_text("\n".join(poses) + "\n")
        if number < 2:
            (root / f"det/{name}.txt").write_text("\n".join(detections) + "\n")


def crowds(folder: Path) -> None:
    """MOT17's and PETS09's files: people before a fixed camera."""
    mot, pets = folder / "mot17/MOT17-99", folder / "mot15/PETS09-S9"
    rng = np.random.default_rng(0)
    truth, placed, seen = [], [], []
    for frame in range(1, 61):
        place = np.array([[-6.0 + 0.06 * frame, 12.0], [0.0, 14.0 + 0.05 * frame], [6.0 - 0.06 * frame, 20.0]])
        for who, (box, (x, y)) in enumerate(zip(boxes_at(place), place, strict=True), start=1):
            sides = ",".join(f"{side:.2f}" for side in box)
            truth.append(f"{frame},{who},{sides},1,1,1")
            placed.append(f"{frame},{who},{sides},1,{x:.4f},{y:.4f},0")
            noisy = ",".join(f"{side:.2f}" for side in box + rng.normal(0.0, 1.0, 4))
            seen.append(f"{frame},-1,{noisy},0.9,-1,-1,-1")
    for root, rows, name in ((mot, truth, "det_yolox_x_ablation.txt"), (pets, placed, "det_frcnn_sort.txt")):
        root.mkdir(parents=True)
        (root / "gt.txt").write_text("\n".join(rows) + "\n")
        (root / name).write_text("\n".join(seen) + "\n")
    half = [f"{int(row.partition(',')[0]) - 30},{row.partition(',')[2]}" for row in truth[90:]]
    (mot / "gt_val_half.txt").write_text("\n".join(half) + "\n")
    (mot / "seqinfo.ini").write_text("[Sequence]\nname=MOT17-99\nframeRate=10\nseqLength=60\n")
    parts = {"RotationMatrices": ROTATION, "TranslationVectors": 1000.0 * SHIFT_M.T, "IntrinsicMatrix": INNER}
    lines = {name: [" ".join(map(str, row)) for row in part] for name, part in parts.items()}
    (mot / "cam_para.txt").write_text("\n\n".join("\n".join([name, *rows]) for name, rows in lines.items()))


def test_gaps_in_trips_that_no_map_has_seen(tmp_path):
    streets(tmp_path)
    log = log_of(SOURCES["geolife"], tmp_path)
    train, test = (set(log.of(rows).trip.tolist()) for rows in (~log.is_held_out, log.is_held_out))
    assert not train & test
    assert len(test) == 12
    for of in windows_of(log, 10.0, most=50):
        assert of.time_s[of.last_seen] < of.hidden_s[0] <= of.hidden_s[-1] < of.time_s[of.last_seen + 1]
    tables = findings("chicago_bus", Asked(tmp_path, 1, is_smoke=True))
    assert len(tables) == 2  # online and smoothed
    for table in tables:
        assert {WITH, WITHOUT, STRAIGHT} <= set(table.rows)
        assert table.rows[STRAIGHT]["answered"] == 1.0


@pytest.mark.parametrize(("name", "make"), [("kitti", drives), ("mot17", crowds), ("pets09", crowds)])
def test_cars_and_people_that_are_always_seen_keep_their_tracks(tmp_path, name, make):
    pytest.importorskip("trackeval", reason="the extra `test` is not installed")
    make(tmp_path)
    (table,) = findings(name, Asked(tmp_path, 1, is_smoke=True))
    for method in (WITHOUT, STRAIGHT):
        rows = [of for row, of in table.rows.items() if row.startswith(method)]
        assert rows
        for of in rows:
            assert of["switches"] <= 1
            assert of["hota"] > 60.0


def test_what_is_absent_is_skipped_with_a_reason(tmp_path, capsys):
    for name in GROUNDS:
        assert findings(name, Asked(tmp_path)) == []
    assert f"kitti: skipped, {tmp_path / 'kitti_tracking'} is absent" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mot17", "pets09", "town"])  # others take half a minute each
def test_slices_of_real_data(name):
    if not (DATA / GROUNDS[name][0]).is_dir():
        pytest.skip(f"no ../shared/data/{GROUNDS[name][0]}")
    tables = findings(name, Asked(DATA, 1, is_smoke=True))
    assert tables
    assert all(table.rows for table in tables)
