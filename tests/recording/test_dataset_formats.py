"""Data sets in their own forms: a vehicle that drives in the world comes out where it was, however the sensor moved."""

import json
from pathlib import Path

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
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.tables import (
    FORMATS,
    read_argoverse,
    read_kitti,
    read_nuscenes,
    read_sdd,
    read_sumo_fcd,
    read_trajnet,
)
from dirprim_filter.recording.transforms.geodesy import Origin

DATA = Path(__file__).parents[2] / "../shared/data/death_circle"
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
        ("oxts", lambda _: "", r"oxts/0000\.txt: expected rows, got none"),
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


SDD = """\
0 10 20 30 60 0 0 0 0 "Cart"
0 20 20 40 60 15 0 0 1 "Cart"
0 30 20 50 60 30 0 1 1 "Cart"
0 30 20 50 60 45 1 0 1 "Cart"
1 0 0 2 4 0 0 0 0 "Biker"
1 0 -60 2 -56 30 0 0 0 "Biker"
"""


def test_sdd_boxes_become_centres_with_north_up(tmp_path):
    (tmp_path / "annotations.txt").write_text(SDD)
    read = read_sdd(tmp_path / "annotations.txt", metres_per_pixel=0.1)
    assert (read.losses.dropped, read.labels) == ({"marked as lost": 1}, {0: "Cart", 1: "Biker"})
    cart, biker = (read.tracks[read.tracks.track_id == name] for name in (0, 1))
    np.testing.assert_allclose(cart.position, [[2, -4], [3, -4], [4, -4]])
    assert cart.time_ns.tolist() == [0, 500_000_000, 1_000_000_000]
    for one, speed, direction in ((cart, 2.0, 0.0), (biker, 6.0, np.pi / 2)):  # up in the image
        np.testing.assert_allclose(one.speed, speed)
        np.testing.assert_allclose(one.direction, direction)


@pytest.mark.skipif(not DATA.exists(), reason=f"real data are not at {DATA}")
@pytest.mark.parametrize(("video", "scale", "n_rows"), [("video2", 0.03948, 15_085), ("video4", 0.03898, 29_380)])
def test_real_annotations_are_all_accounted_for(video, scale, n_rows):
    read = read_sdd(DATA / video / "annotations.txt", metres_per_pixel=scale)
    assert len(read.tracks) + sum(read.losses.dropped.values()) == n_rows
    assert (read.tracks.speed > 25.0).mean() < 0.005  # some boxes jump when a lost track is found again
    assert np.ptp(read.tracks.position, axis=0).max() < 100.0


FCD = """\
<?xml version="1.0" encoding="UTF-8"?>
<!-- generated by SUMO -->
<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">
    <timestep time="0.10">
        <vehicle id="a.0" x="1.5" y="-2.5" angle="90.00" speed="3.00" pos="5.1" lane="1_0" slope="0.0"/>
        <person id="p" x="0" y="0" angle="0" speed="1"/>
    </timestep>
    <timestep time="0.20">
        <vehicle id="a.0" x="1.8" y="-2.5" angle="0.00" speed="3.50" pos="5.4" lane="1_0" slope="0.0"/>
        <vehicle id="b" x="7" y="8" angle="225.00" speed="0" pos="5.4" lane="1_0" slope="0.0"/>
    </timestep>
</fcd-export>
"""


def fcd(tmp_path, text):
    (tmp_path / "fcd.xml").write_text(text)
    return tmp_path / "fcd.xml"


def test_sumo_vehicles_turn_from_compass_to_direction(tmp_path):
    read = read_sumo_fcd(fcd(tmp_path, FCD))
    assert read.losses.dropped == {"persons and containers": 1}
    assert read.tracks.track_id.tolist() == ["a.0", "a.0", "b"]
    assert read.tracks.time_ns.tolist() == [100_000_000, 200_000_000, 200_000_000]
    assert read.tracks.position.tolist() == [[1.5, -2.5], [1.8, -2.5], [7.0, 8.0]]
    np.testing.assert_allclose(read.tracks.heading, [0.0, np.pi / 2, -3 * np.pi / 4], atol=1e-12)
    np.testing.assert_allclose(read.tracks.direction, [0, 0, -3 * np.pi / 4], atol=1e-12)  # who is alone has yaw
    assert read.tracks.speed.tolist() == [3.0, 3.5, 0.0]
    read = read_sumo_fcd(fcd(tmp_path, FCD.replace(' speed="3.50"', "")))
    np.testing.assert_allclose(read.tracks.speed, 3.0)
    assert read.losses.dropped["alone in time, so that no velocity can be derived"] == 1


OF = {"trajnet": lambda path: read_trajnet(path, frames_per_second=25), "fcd": read_sumo_fcd,
      "sdd": lambda path: read_sdd(path, metres_per_pixel=0.1)}  # fmt: skip


@pytest.mark.parametrize(
    ("form", "text", "told"),
    [
        ("trajnet", "0 1 2 3\n10 1 2\n", r"line 2: expected 4 cells, got 3"),
        ("trajnet", "0 1 2 north\n", r"line 1: expected a number as y, got 'north'"),
        ("trajnet", "1e30 1 2 3\n", r"line|row 1: expected seconds as frame, got 4e\+28"),
        ("trajnet", "", "expected rows, got none"),
        ("sdd", SDD[: SDD.index("\n") + 1] + "1 2 3\n", r"line 2: expected 10 cells, got 3"),
        ("sdd", SDD.replace("10", "ten", 1), r"line 1: expected a number as xmin, got 'ten'"),
        ("fcd", "", "no element found"),
        ("fcd", FCD[:300], r"expected well-formed xml"),
        ("fcd", FCD.replace("<fcd", "<!DOCTYPE a [<!ENTITY b 'c'>]>\n<fcd"), "line 3: expected no DOCTYPE"),
        ("fcd", "<net><edge/></net>", "expected an fcd-export, got <net>"),
        ("fcd", "<fcd-export><timestep time='0'/></fcd-export>", "expected vehicles"),
        ("fcd", '<fcd-export><vehicle id="a" x="0" y="0"/></fcd-export>', "expected vehicles in time steps, got one"),
        ("fcd", FCD.replace('x="7"', 'x="seven"'), "line 10: expected a number as x, got 'seven'"),
        ("fcd", FCD.replace('x="7"', ""), "line 10: expected x of a vehicle"),
        *(
            ("fcd", FCD.replace('"0.20"', f'"{time}"'), f"line 9: expected seconds as time, got '{time}'")
            for time in ("later", "snan_", "1e30", "1e999999999")
        ),
    ],
)  # fmt: skip
def test_a_wrong_file_is_told_in_one_line(tmp_path, form, text, told):
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises(TableError, match=told) as caught:
        OF[form](tmp_path / "t.txt")
    assert "\n" not in str(caught.value)


def test_scales_that_are_none_are_refused(tmp_path):
    with pytest.raises(ValueError, match="frames_per_second: expected a positive number"):
        read_trajnet(fcd(tmp_path, "0 1 2 3\n"), frames_per_second=0)
    with pytest.raises(ValueError, match="metres_per_pixel"):
        read_sdd(tmp_path / "fcd.xml", metres_per_pixel=0.0)


def test_the_command_line_knows_every_format():
    assert [form.value for form in Format] == list(FORMATS)


def test_folders_and_tables_are_recognised_and_the_log_says_what_it_is_of(argoverse, nuscenes, tmp_path, capsys):
    columns = {"time_ns": TIMES_NS, "track_id": ["a"] * N, "x_m": STEPS * 1.0, "y_m": STEPS * 1.0}
    pa.parquet.write_table(pa.table(columns), tmp_path / "t.parquet")
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
