"""Data sets in their own forms: a vehicle that drives in the world comes out where it was, however the sensor moved."""

import json
import runpy
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import pytest
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.tables import read_as, read_named, read_sdd, read_sumo_fcd, read_trajnet

ROOT = Path(__file__).parents[2]
DATA = ROOT / "../shared/data/death_circle"
N = 6
STEPS = np.arange(N)
TIMES_NS = 1_700_000_000_123_456_000 + STEPS * 100_000_000
SIZE = (4.5, 1.9, 1.6)
WORLD = np.column_stack([20 + 0.8 * STEPS, 5 + 0.6 * STEPS, np.full(N, 1.2)])
"""Where the vehicle is: 10 m/s on the course (.8, .6)."""
COURSE = np.arctan2(0.6, 0.8)
BODY = Rotation.concatenate([Rotation.from_euler("ZYX", [COURSE, -0.05, 0.02])] * N)
EGO = Rotation.from_euler("ZYX", np.column_stack([0.3 + 0.1 * STEPS, 0.02 * STEPS, 0.1 - 0.03 * STEPS]))
EGO_PLACE = np.column_stack([1.5 * STEPS, 0.2 * STEPS**2, 0.1 * STEPS])


def argoverse2(folder):
    """Its poses in no order and more of them than boxes."""

    def of(turn, place):
        turns = dict(zip(("qx", "qy", "qz", "qw"), turn.as_quat().T, strict=True))
        return {"timestamp_ns": TIMES_NS} | turns | {f"t{axis}_m": place[:, i] for i, axis in enumerate("xyz")}

    sizes = {f"{side}_m": np.full(N, metres) for side, metres in zip(("length", "width", "height"), SIZE, strict=True)}
    boxes = of(EGO.inv() * BODY, EGO.inv().apply(WORLD - EGO_PLACE)) | sizes
    boxes |= {"track_uuid": ["5f3a"] * N, "category": ["REGULAR_VEHICLE"] * N}
    poses = pa.table(of(EGO, EGO_PLACE)).take([3, 0, 5, 1, 4, 2])
    extra = pa.table({**poses.slice(0, 1).to_pydict(), "timestamp_ns": [int(TIMES_NS[0]) + 1]})
    lone = pa.table({**pa.table(boxes).slice(0, 1).to_pydict(), "timestamp_ns": [int(TIMES_NS[0]) + 2]})
    pa.feather.write_feather(pa.concat_tables([lone, pa.table(boxes)]), folder / "annotations.feather")
    pa.feather.write_feather(pa.concat_tables([poses, extra]), folder / "city_SE3_egovehicle.feather")
    return folder


def nuscenes(folder):
    w_first = np.roll(BODY[0].as_quat(), 1).tolist()
    tables = {
        "category": [{"token": "c", "name": "vehicle.car"}],
        "instance": [{"token": "i", "category_token": "c"}],
        "sample": [{"token": f"s{k}", "timestamp": int(TIMES_NS[k]) // 1000, "scene_token": "n"} for k in range(N)],
        "sample_annotation": [
            {"sample_token": f"s{k}", "instance_token": "i", "translation": WORLD[k].tolist(),
             "size": [SIZE[1], SIZE[0], SIZE[2]], "rotation": w_first} for k in range(N)
        ],
    }  # fmt: skip
    for name, records in tables.items():
        (folder / f"{name}.json").write_text(json.dumps(records))
    return folder


AXES = Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""x ahead, y left, z up into the camera's x right, y down, z ahead."""
RECT, VELO, IMU = Rotation.from_euler("xyz", [0.01, -0.02, 0.005]), AXES, Rotation.from_euler("z", 0.02)
VELO_PLACE, IMU_PLACE = np.array([0.0, -0.08, -0.27]), np.array([-0.8, 0.3, -0.8])


def kitti(folder):
    """Labels with fixes and angles beside; the vehicle drives level, for a label turns about the camera's y alone."""
    for name in ("label_02", "oxts", "calib"):
        (folder / name).mkdir()
    unit = EGO.inv().apply(WORLD - EGO_PLACE)
    place = RECT.apply(VELO.apply(IMU.apply(unit) + IMU_PLACE) + VELO_PLACE).tolist()
    forward = (RECT * VELO * IMU * EGO.inv() * Rotation.from_euler("z", COURSE)).apply([1.0, 0.0, 0.0])
    yaw = np.arctan2(-forward[:, 2], forward[:, 0]).tolist()
    box = " ".join(map(str, reversed(SIZE)))
    (folder / "label_02" / "0000.txt").write_text("".join(
        f"{k} -1 DontCare -1 -1 -10 0 0 1 1 -1 -1 -1 -1000 -1000 -1000 -10\n"
        f"{k} 7 Van 0 0 -1.57 1 2 3 4 {box} {' '.join(map(repr, place[k]))} {yaw[k]!r}\n" for k in range(N)
    ))  # fmt: skip
    back = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0=49.01 +lon_0=8.43 +step +inv +proj=cart "
        "+ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    fixes = np.column_stack(
        [*np.array(back.transform(*EGO_PLACE.T))[[1, 0, 2]], EGO.as_euler("xyz"), np.zeros((N, 24))]
    )
    np.savetxt(folder / "oxts" / "0000.txt", fixes, fmt="%.17g")
    matrices = {"R_rect": RECT.as_matrix(), "Tr_velo_cam": np.column_stack([VELO.as_matrix(), VELO_PLACE]),
                "Tr_imu_velo:": np.column_stack([IMU.as_matrix(), IMU_PLACE])}  # fmt: skip
    (folder / "calib" / "0000.txt").write_text("".join(
        f"{name} {' '.join(map(repr, matrix.ravel().tolist()))}\n" for name, matrix in matrices.items()
    ))  # fmt: skip
    return folder / "label_02" / "0000.txt"


@pytest.mark.parametrize(
    ("made", "label", "start_ns", "tilt"),
    [(argoverse2, "REGULAR_VEHICLE", TIMES_NS[0], 1e-6), (nuscenes, "vehicle.car", TIMES_NS[0], 1e-6),
     (kitti, "Van", 0, 0.02)],  # a label turns about the camera's y alone, which RECT tilts by that
)  # fmt: skip
def test_an_example_brings_a_data_set_into_a_table(tmp_path, made, label, start_ns, tilt):
    source = made(tmp_path)
    table = runpy.run_path(str(ROOT / f"docs/examples/{made.__name__}.py"))[made.__name__](source)
    pa.parquet.write_table(table, tmp_path / "out.parquet")
    read = read_named(tmp_path / "out.parquet")
    tracks = read.tracks
    assert (read.losses.dropped, set(read.labels.values()), list(read.unused)) == ({}, {label}, [])
    assert tracks.time_ns.tolist() == (start_ns + STEPS * 100_000_000).tolist()
    np.testing.assert_allclose(tracks.position, WORLD[:, :2], atol=1e-6)
    np.testing.assert_allclose(tracks.heading, COURSE, atol=tilt)
    np.testing.assert_allclose(tracks.direction, COURSE, atol=1e-3)
    np.testing.assert_allclose(tracks.speed, 10.0, atol=1e-3)
    np.testing.assert_allclose(tracks.size, np.tile(SIZE, (N, 1)))


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
    with pytest.raises(ValueError, match="frames_per_second: expected a positive number"):
        read_trajnet(path, frames_per_second=0)


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
    left_out = read.losses.dropped + read.losses.notes  # a box that is there once is a note
    assert len(read.tracks) + left_out.total() == n_rows
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


def test_sumo_vehicles_turn_from_compass_to_direction(tmp_path):
    path = tmp_path / "fcd.xml"
    path.write_text(FCD)
    read = read_sumo_fcd(path)
    assert read.losses.dropped == {"of persons and containers": 1}
    assert read.tracks.track_id.tolist() == ["a.0", "a.0", "b"]
    assert read.tracks.time_ns.tolist() == [100_000_000, 200_000_000, 200_000_000]
    assert read.tracks.position.tolist() == [[1.5, -2.5], [1.8, -2.5], [7.0, 8.0]]
    np.testing.assert_allclose(read.tracks.heading, [0.0, np.pi / 2, -3 * np.pi / 4], atol=1e-12)
    np.testing.assert_allclose(read.tracks.direction, [0, 0, -3 * np.pi / 4], atol=1e-12)  # who is alone has yaw
    assert read.tracks.speed.tolist() == [3.0, 3.5, 0.0]
    path.write_text(FCD.replace(' speed="3.50"', ""))
    read = read_sumo_fcd(path)
    np.testing.assert_allclose(read.tracks.speed, 3.0)
    assert read.losses.notes["rows alone in time, so that no velocity can be derived"] == 1


OF = {"trajnet": "trajnet,frames_per_second=25", "fcd": "sumo-fcd", "sdd": "sdd,metres_per_pixel=0.1"}


@pytest.mark.parametrize(
    ("form", "text", "message"),
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
def test_a_wrong_file_is_one_line(tmp_path, form, text, message):
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises(TableError, match=message) as caught:
        read_as(tmp_path / "t.txt", OF[form])
    assert "\n" not in str(caught.value)
