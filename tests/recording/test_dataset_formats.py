"""Data sets in their own forms: a vehicle that drives in the world comes out where it was, however the sensor moved."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import pytest
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from dirprim_filter import read_tracks
from dirprim_filter.cli.convert import Format
from dirprim_filter.cli.main import run
from dirprim_filter.recording.errors import MissingExtraError, TableError
from dirprim_filter.recording.tables import (
    FORMATS,
    read_argoverse,
    read_arrow,
    read_csv,
    read_kitti,
    read_nuscenes,
    read_trajnet,
)
from dirprim_filter.recording.transforms.geodesy import Origin

DONE, FAILED, USAGE, INPUT_LOST = 0, 1, 2, 3
N = 6
STEPS = np.arange(N)
TIMES_NS = 1_700_000_000_123_456_789 + STEPS * 100_000_000
SIZE = (4.5, 1.9, 1.6)
WORLD = np.column_stack([20 + 0.8 * STEPS, 5 + 0.6 * STEPS, np.full(N, 1.2)])
"""Where the vehicle is: 10 m/s on the course (.8, .6)."""
COURSE = np.arctan2(0.6, 0.8)
BODY = Rotation.from_euler("ZYX", [COURSE, -0.05, 0.02])
EGO = Rotation.from_euler("ZYX", np.column_stack([0.3 + 0.1 * STEPS, 0.02 * STEPS, 0.1 - 0.03 * STEPS]))
EGO_PLACE = np.column_stack([1.5 * STEPS, 0.2 * STEPS**2, 0.1 * STEPS])


def assert_is_the_vehicle(table, *, n=N, tilt=1e-6):
    tracks = table.tracks
    assert len(tracks) == n
    np.testing.assert_allclose(tracks.position, WORLD[:n, :2], atol=1e-6)
    np.testing.assert_allclose(tracks.heading, COURSE, atol=tilt)
    np.testing.assert_allclose(tracks.direction, COURSE, atol=1e-3)
    np.testing.assert_allclose(tracks.speed, 10.0, atol=1e-3)
    np.testing.assert_allclose(tracks.size, np.tile(SIZE, (n, 1)))


def columns():
    return {
        "time_ns": TIMES_NS, "track_id": np.repeat(["a", "b"], N // 2), "x_m": WORLD[:, 0].astype(np.float32),
        "y_m": WORLD[:, 1], "heading_rad": pa.array([0.5, None, 1.0, 1.5, 2.0, 2.5]), "group": np.zeros(N, np.int32),
        "length_m": np.full(N, 4.5), "class": pa.array(["car"] * 3 + [None] + ["bus"] * 2).dictionary_encode(),
        "lane": STEPS,
    }  # fmt: skip


WRITERS = {"t.parquet": pa.parquet.write_table, "t.feather": pa.feather.write_feather}


@pytest.mark.parametrize("name", WRITERS)
def test_arrow_tables_read_as_the_csv_of_the_same_columns_does(tmp_path, name):
    made = pa.table(columns())
    WRITERS[name](made, tmp_path / name)
    read = read_arrow(tmp_path / name)
    seconds = [f"{t // 10**9}.{t % 10**9:09d}" for t in TIMES_NS.tolist()]
    texts = made.drop_columns(["time_ns"]).to_pydict() | {"time_s": seconds}
    lines = [",".join("" if one is None else str(one) for one in row) for row in zip(*texts.values(), strict=True)]
    (tmp_path / "t.csv").write_text("\n".join([",".join(texts), *lines]))
    assert read == read_csv(tmp_path / "t.csv")
    assert read.labels == {"a": "car", "b": "bus"}
    assert list(read.unused) == ["lane"]


@pytest.mark.parametrize(
    ("time", "named"),
    [
        (pa.array(TIMES_NS).cast(pa.timestamp("ns", "UTC")), "time_ns"),
        (pa.array(TIMES_NS // 1000).cast(pa.timestamp("us")), "time_ns"),
        (TIMES_NS / 1e9, "time_s"),
    ],
)
def test_times_of_an_arrow_table_are_nanoseconds_timestamps_or_seconds(tmp_path, time, named):
    made = {"stamp" if name == "time_ns" else name: values for name, values in columns().items()} | {"stamp": time}
    pa.parquet.write_table(pa.table(made), tmp_path / "t.parquet")
    read = read_arrow(tmp_path / "t.parquet", columns={named: "stamp"})
    np.testing.assert_allclose(read.tracks.time_ns - TIMES_NS, 0, atol=1000 if named == "time_ns" else 250)


def test_bad_rows_of_an_arrow_table_are_dropped_and_counted(tmp_path):
    made = columns() | {"x_m": pa.array([0.0, None, 2.0, np.inf, 4.0, 5.0]), "time_ns": pa.array([1, 2, None, 4, 5, 6])}
    pa.parquet.write_table(pa.table(made), tmp_path / "t.parquet")
    read = read_arrow(tmp_path / "t.parquet")
    assert read.losses.dropped["a number that is missing, not finite or too large"] == 3


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"x_m": None}, r"expected columns time_ns, track_id, x_m, y_m.* missing: x_m"),
        ({"x_m": ["east"] * N}, r"column x_m: expected numbers, got string"),
        ({"group": [1.5] * N}, r"column group: expected whole numbers, got double"),
        ({"group": pa.array([1, 2, None, 3, 4, 5])}, r"column group: expected whole numbers, got 1 null"),
        ({"track_id": [[1]] * N}, r"column track_id: expected texts or whole numbers, got list"),
        ({"heading_rad": None, "heading_deg": [0.0] * N}, "expected column heading_rad, got heading_deg; multiply by"),
        ({"time_ns": None, "time_s": TIMES_NS}, r"column time_s: expected seconds, got 1\.7e\+18; name whole nano"),
    ],
)
def test_a_wrong_arrow_table_is_told_in_one_line(tmp_path, change, told):
    made = {name: values for name, values in (columns() | change).items() if values is not None}
    pa.parquet.write_table(pa.table(made), tmp_path / "t.parquet")
    with pytest.raises(TableError, match=told) as caught:
        read_arrow(tmp_path / "t.parquet")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("data", [b"PAR1" + bytes(50) + b"PAR1", b"ARROW1\0\0" + bytes(50), b"PAR1", b""])
def test_a_broken_arrow_file_is_told_in_one_line(tmp_path, data):
    (tmp_path / "t.parquet").write_bytes(data)
    with pytest.raises(TableError, match="expected a Parquet, Feather or Arrow file, got") as caught:
        read_arrow(tmp_path / "t.parquet")
    assert "\n" not in str(caught.value)


def test_without_pyarrow_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow.parquet", None)
    with pytest.raises(MissingExtraError, match=r"expected pyarrow.*pip install 'dirprim-filter\[parquet\]'"):
        read_arrow(tmp_path / "t.parquet")


def quaternions(turn):
    """By name, as Argoverse has them."""
    return dict(zip(("qx", "qy", "qz", "qw"), turn.as_quat().T, strict=True))


@pytest.fixture
def argoverse(tmp_path):
    """A log's folder, its poses in no order and more of them than annotations."""
    turn = EGO.inv() * Rotation.concatenate([BODY] * N)
    place = EGO.inv().apply(WORLD - EGO_PLACE)
    boxes = {"timestamp_ns": TIMES_NS, "track_uuid": ["5f3a"] * N, "category": ["REGULAR_VEHICLE"] * N,
             "num_interior_pts": STEPS} | quaternions(turn)  # fmt: skip
    boxes |= {f"{side}_m": np.full(N, metres) for side, metres in zip(("length", "width", "height"), SIZE, strict=True)}
    boxes |= {f"t{axis}_m": place[:, i] for i, axis in enumerate("xyz")}
    poses = (
        {"timestamp_ns": TIMES_NS} | quaternions(EGO) | {f"t{axis}_m": EGO_PLACE[:, i] for i, axis in enumerate("xyz")}
    )
    order = np.array([3, 0, 5, 1, 4, 2])
    poses = {
        name: np.concatenate([values[order], values[:1] + (name == "timestamp_ns")]) for name, values in poses.items()
    }
    folder = tmp_path / "log"
    folder.mkdir()
    pa.feather.write_feather(pa.table(boxes), folder / "annotations.feather")
    pa.feather.write_feather(pa.table(poses), folder / "city_SE3_egovehicle.feather")
    return folder


def test_argoverse_boxes_come_into_the_city(argoverse):
    table = read_argoverse(argoverse)
    assert_is_the_vehicle(table)
    assert table.tracks.time_ns.tolist() == TIMES_NS.tolist()
    assert table.labels == {"5f3a": "REGULAR_VEHICLE"}
    assert table.losses.dropped == {}
    assert read_argoverse(argoverse / "annotations.feather") == table


def test_an_argoverse_box_without_a_pose_is_dropped_and_counted(argoverse):
    poses = pa.feather.read_table(argoverse / "city_SE3_egovehicle.feather")
    kept = poses.filter(pa.compute.not_equal(poses["timestamp_ns"], int(TIMES_NS[-1])))
    pa.feather.write_feather(kept, argoverse / "city_SE3_egovehicle.feather")
    table = read_argoverse(argoverse)
    assert table.losses.dropped == {"without a pose of the vehicle at their time": 1}
    assert_is_the_vehicle(table, n=N - 1)
    pa.feather.write_feather(kept.drop_columns(["qw"]), argoverse / "city_SE3_egovehicle.feather")
    with pytest.raises(TableError, match=r"city_SE3.*expected columns .*missing: qw"):
        read_argoverse(argoverse)


@pytest.fixture
def nuscenes(tmp_path):
    folder = tmp_path / "v1.0-mini"
    folder.mkdir()
    w_first = np.roll(BODY.as_quat(), 1).tolist()
    tables = {
        "category": [{"token": "c", "name": "vehicle.car"}],
        "instance": [{"token": "i", "category_token": "c"}, {"token": "j", "category_token": "c"}],
        "sample": [
            {"token": f"{scene}{k}", "timestamp": int(TIMES_NS[k]) // 1000, "scene_token": scene}
            for scene in ("night", "day") for k in STEPS.tolist()
        ],
        "sample_annotation": [
            {"token": f"a{k}", "sample_token": f"{scene}{k}", "instance_token": name, "translation": WORLD[k].tolist(),
             "size": [SIZE[1], SIZE[0], SIZE[2]], "rotation": w_first}
            for scene, name in (("night", "i"), ("day", "j")) for k in STEPS.tolist()
        ],
    }  # fmt: skip
    for name, records in tables.items():
        (folder / f"{name}.json").write_text(json.dumps(records))
    return folder


def test_nuscenes_scenes_are_groups(nuscenes):
    table = read_nuscenes(nuscenes)
    assert (table.losses.dropped, table.labels) == ({}, {"i": "vehicle.car", "j": "vehicle.car"})
    for group, name in enumerate("ij"):
        one = table.tracks[table.tracks.track_id == name]
        assert one.group.tolist() == [group] * N
        assert one.time_ns.tolist() == (TIMES_NS // 1000 * 1000).tolist()
        assert_is_the_vehicle(type(table)(tracks=one))


@pytest.mark.parametrize(
    ("name", "change", "told"),
    [
        ("sample", lambda of: of[1:], r"v1\.0-mini: expected tables that fit each other, got none for 'night0'"),
        ("sample", lambda of: {"a": of}, r"sample\.json: expected an array of records, got dict"),
        ("category", lambda of: [], r"category\.json: expected an array of records, got list"),
        ("sample_annotation", lambda of: [*of[1:], of[0] | {"size": [1, 2]}], "expected 3 numbers as size of each"),
        ("sample_annotation", lambda of: [of[0] | {"rotation": [0, 1, 2]}], "expected 4 numbers as rotation of each"),
        ("sample_annotation", lambda of: [{**of[0], "translation": ["a", 1, 2]}], "expected 3 numbers as translation"),
    ],
)
def test_wrong_nuscenes_tables_are_told_in_one_line(nuscenes, name, change, told):
    path = nuscenes / f"{name}.json"
    path.write_text(json.dumps(change(json.loads(path.read_text()))))
    with pytest.raises(TableError, match=told) as caught:
        read_nuscenes(nuscenes)
    assert "\n" not in str(caught.value)
    path.write_text("[{")
    with pytest.raises(TableError, match=rf"{name}\.json: expected JSON, got "):
        read_nuscenes(nuscenes)


AXES = Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""x ahead, y left, z up into the camera's x right, y down, z ahead."""
RECT, VELO, IMU = Rotation.from_euler("xyz", [0.01, -0.02, 0.005]), AXES, Rotation.from_euler("z", 0.02)
VELO_PLACE, IMU_PLACE = np.array([0.0, -0.08, -0.27]), np.array([-0.8, 0.3, -0.8])
ORIGIN = Origin(49.01, 8.43)


def label_lines(place, turn):
    """KITTI's labels of boxes: places (n, 3) and forward axes in the camera's frame."""
    forward = turn.apply([1.0, 0.0, 0.0])
    yaw = np.arctan2(-forward[:, 2], forward[:, 0])
    length, width, height = SIZE
    for k in range(N):
        yield f"{k} -1 DontCare -1 -1 -10 0 0 1 1 -1 -1 -1 -1000 -1000 -1000 -10"
        box = f"{height} {width} {length} {' '.join(map(repr, place[k].tolist()))} {yaw[k].item()!r}"
        yield f"{k} 7 Van 0 0 -1.57 1 2 3 4 {box}"


@pytest.fixture
def kitti(tmp_path):
    """Labels with fixes and angles beside; the vehicle drives level, for a label turns about the camera's y alone."""
    for folder in ("label_02", "oxts", "calib"):
        (tmp_path / folder).mkdir()
    level = Rotation.from_euler("z", COURSE)

    def to_camera(points):
        unit = EGO.inv().apply(points)
        return RECT.apply(VELO.apply(IMU.apply(unit) + IMU_PLACE) + VELO_PLACE)

    turn = RECT * VELO * IMU * EGO.inv() * Rotation.concatenate([level] * N)
    labels = tmp_path / "label_02" / "0000.txt"
    labels.write_text("\n".join(label_lines(to_camera(WORLD - EGO_PLACE), turn)) + "\n")
    plane = Transformer.from_pipeline(
        f"+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0={ORIGIN.latitude_deg} "
        f"+lon_0={ORIGIN.longitude_deg} +step +inv +proj=cart +ellps=WGS84 "
        "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    longitude, latitude, height = plane.transform(*EGO_PLACE.T)
    roll_pitch_yaw = EGO.as_euler("xyz")
    (tmp_path / "oxts" / "0000.txt").write_text("".join(
        " ".join(map(repr, [latitude[k].item(), longitude[k].item(), height[k].item(), *roll_pitch_yaw[k].tolist()]))
        + " 0" * 24 + " \n" for k in range(N)
    ))  # fmt: skip
    write_calibration(tmp_path / "calib" / "0000.txt")
    return labels


def write_calibration(path, names=("R_rect", "Tr_velo_cam", "Tr_imu_velo")):
    matrices = (RECT.as_matrix(), np.column_stack([VELO.as_matrix(), VELO_PLACE]),
                np.column_stack([IMU.as_matrix(), IMU_PLACE]))  # fmt: skip
    lines = [f"P{i}: " + "0 " * 12 for i in range(4)]
    lines += [f"{name} {' '.join(map(repr, m.ravel().tolist()))}" for name, m in zip(names, matrices, strict=True)]
    path.write_text("\n".join(lines))


def test_kitti_labels_come_onto_the_ground_by_fixes(kitti):
    table = read_kitti(kitti, origin=ORIGIN)
    assert table.losses.notes == {"of regions marked DontCare": N}
    assert (table.losses.dropped, table.labels) == ({}, {7: "Van"})
    assert table.tracks.time_ns.tolist() == (STEPS * 100_000_000).tolist()
    assert_is_the_vehicle(table, tilt=0.02)  # a label turns about the camera's y alone, which RECT tilts by that
    write_calibration(kitti.parents[1] / "calib" / "0000.txt", ("R0_rect:", "Tr_velo_to_cam:", "Tr_imu_to_velo:"))
    assert read_kitti(kitti, origin=ORIGIN) == table
    first_fix = read_kitti(kitti)
    np.testing.assert_allclose(first_fix.tracks.position, table.tracks.position - EGO_PLACE[0, :2], atol=1e-4)


def test_kitti_labels_come_onto_the_ground_by_poses_of_the_camera(tmp_path):
    for folder in ("label_02", "poses"):
        (tmp_path / folder).mkdir()
    ego = Rotation.from_euler("z", (0.3 + 0.1 * STEPS)[:, None])
    camera = AXES * ego * AXES.inv()  # in the axes of the first camera
    place = AXES.apply(EGO_PLACE)
    labels = tmp_path / "label_02" / "0000.txt"
    seen = camera.inv().apply(AXES.apply(WORLD) - place)
    turn = AXES * ego.inv() * Rotation.concatenate([Rotation.from_euler("z", COURSE)] * N)
    labels.write_text("\n".join(label_lines(seen, turn)))
    matrices = np.concatenate([camera.as_matrix(), place[:, :, None]], axis=2).reshape(N, 12)
    poses = tmp_path / "poses" / "0000.txt"
    poses.write_text("\n".join(" ".join(map(repr, row)) for row in matrices.tolist()))
    assert_is_the_vehicle(read_kitti(labels))
    poses.write_text("\n".join(" ".join(map(repr, row)) for row in matrices[:-1].tolist()))
    short = read_kitti(labels)
    assert short.losses.dropped == {"of a frame without a pose": 1}
    assert_is_the_vehicle(short, n=N - 1)


@pytest.mark.parametrize(
    ("file", "change", "told"),
    [
        (
            "label_02",
            lambda text: text.replace("7 Van 0", "7 Van", 1),
            r"label_02/0000\.txt, line 2: expected 17 cells",
        ),
        (
            "oxts",
            lambda text: text.replace("49.", "north", 1),
            r"oxts/0000\.txt, line 1: expected a number as number 1",
        ),
        ("oxts", lambda _: "", r"oxts/0000\.txt, line 1: expected rows, got none"),
        ("calib", lambda text: text.replace("R_rect", "R"), r"calib/0000\.txt: expected R_rect, Tr_velo_cam and"),
        (
            "calib",
            lambda text: text.replace("R_rect ", "R_rect 1 "),
            r"calib/0000\.txt, line 5: expected 9 or 12 numbers",
        ),
        (
            "calib",
            lambda text: text.replace("R_rect ", "R_rect a "),
            r"calib/0000\.txt, line 5: expected 9 or 12 numbers",
        ),
    ],
)
def test_wrong_kitti_files_are_told_in_one_line(kitti, file, change, told):
    path = kitti.parents[1] / file / "0000.txt"
    path.write_text(change(path.read_text()))
    with pytest.raises(TableError, match=told) as caught:
        read_kitti(kitti)
    assert "\n" not in str(caught.value)


def test_kitti_labels_without_poses_are_refused(kitti):
    (kitti.parents[1] / "oxts" / "0000.txt").unlink()
    with pytest.raises(TableError, match=r"expected the camera's poses as .*oxts.* or .*poses.*, got neither"):
        read_kitti(kitti)


@pytest.mark.parametrize("between", [" ", "\t", "  "])
def test_trajnet_frames_are_those_of_the_video(tmp_path, between):
    path = tmp_path / "zara.txt"
    rows = [(f"{10 * k:.1f}", name, 0.4 * k, y) for k in range(5) for name, y in (("1.0", 0.0), ("2.0", 7.5))]
    path.write_text("\n".join(between.join(map(str, row)) for row in rows))
    table = read_trajnet(path, frames_per_second=25)
    assert table.losses.dropped == {}
    assert table.tracks[table.tracks.track_id == 1].time_ns.tolist() == [k * 400_000_000 for k in range(5)]
    np.testing.assert_allclose(table.tracks.speed, 1.0)
    np.testing.assert_allclose(table.tracks.direction, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "rate", "told"),
    [
        ("0 1 2 3\n10 1 2\n", 25, r"line 2: expected 4 cells, got 3"),
        ("0 1 2 north\n", 25, r"line 1: expected a number as y, got 'north'"),
        ("1e30 1 2 3\n", 25, r"line 1: expected seconds as frame, got 4e\+28"),
        ("", 25, "expected rows, got none"),
        ("0 1 2 3\n", 0, "frames_per_second: expected a positive number"),
    ],
)
def test_a_wrong_trajnet_file_is_told_in_one_line(tmp_path, text, rate, told):
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises((TableError, ValueError), match=told):
        read_trajnet(tmp_path / "t.txt", frames_per_second=rate)


def test_the_command_line_knows_every_format():
    assert [form.value for form in Format] == list(FORMATS)


def test_folders_and_tables_are_recognised_and_the_log_says_what_it_is_of(argoverse, nuscenes, tmp_path, capsys):
    pa.parquet.write_table(pa.table(columns()), tmp_path / "t.parquet")
    for source in (argoverse, nuscenes, argoverse / "annotations.feather", tmp_path / "t.parquet"):
        out = tmp_path / "out.mcap"
        assert run(["convert", str(source), "-o", str(out), "--force"]) == DONE
        assert len(read_tracks(out)) >= N
    assert run(["convert", str(tmp_path), "-o", str(tmp_path / "x.mcap")]) == FAILED
    assert "expected a folder with annotations.feather or sample_annotation.json" in capsys.readouterr().err


def test_options_that_a_format_has_not_are_refused_and_those_that_it_needs_asked_for(tmp_path, kitti, capsys):
    (tmp_path / "t.txt").write_text("0 1 2 3\n10 1 3 3\n")
    out = ["-o", str(tmp_path / "out.mcap"), "--force"]
    assert run(["convert", str(tmp_path / "t.txt"), *out, "--format", "trajnet"]) == FAILED
    assert "expected --frames-per-second, which a table of trajnet does not contain" in capsys.readouterr().err
    assert run(["convert", str(tmp_path / "t.txt"), *out, "--format", "trajnet", "--frames-per-second", "25"]) == DONE
    assert run(["convert", str(kitti), *out, "--format", "kitti", "--origin", "49.01,8.43"]) == DONE
    assert "DontCare" in capsys.readouterr().err
    assert run(["convert", str(kitti), *out, "--format", "kitti", "--metres-per-pixel", "1"]) == USAGE
    assert "it is for sdd" in " ".join(capsys.readouterr().err.split())
