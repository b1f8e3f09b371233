"""Tables to tracks: what is good is kept exactly, what is bad is counted or reported in one line."""

import csv
import gzip
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from dirprim_filter.detections import NO_ID
from dirprim_filter.estimates import Estimates
from dirprim_filter.recording.errors import TableError
from dirprim_filter.recording.tables import delimited, read_csv, read_sdd, read_sumo_fcd, sumo_fcd
from dirprim_filter.recording.tables.estimate_table import write_estimates
from dirprim_filter.recording.tables.named_columns import parse_columns

DATA = Path(__file__).parents[2] / "../shared/data"
real_data = pytest.mark.skipif(not DATA.exists(), reason=f"real data are not at {DATA}")

HEADER = "time_s,track_id,x_m,y_m,heading_rad,speed_mps"


def table(tmp_path, text, name="table.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_columns_are_found_by_name_in_any_order(tmp_path):
    header = "speed_mps,lane,y_m,time_s,course_rad,group,x_m,track_id,heading_rad"
    text = f"{header}\n5,L1,2,0.1,-0.5,3,1,a,1.5\n6,L1,4,0.2,0.25,3,2,a,\n"
    read = read_csv(table(tmp_path, text))
    tracks = read.tracks
    assert read.unused == ["lane"]
    assert tracks.track_id.tolist() == ["a", "a"]
    assert tracks.time_ns.tolist() == [100_000_000, 200_000_000]
    assert tracks.position.tolist() == [[1.0, 2.0], [2.0, 4.0]]
    assert tracks.direction.tolist() == [-0.5, 0.25]  # kept as it is, whatever the positions say
    np.testing.assert_array_equal(tracks.heading, [1.5, np.nan])
    assert tracks.speed.tolist() == [5.0, 6.0]
    assert tracks.group.tolist() == [3, 3]
    assert (read.losses.dropped, read.losses.notes) == ({}, {})


@pytest.mark.parametrize("start", ["0", "1700000000", "-1700000000", "999998", "1000000", "8999999000"])
def test_tenths_of_a_second_are_exact_at_any_epoch(tmp_path, start):
    rows = [f"{Decimal(start) + Decimal(i) / 10},1,{i},0,0,1" for i in range(40)]
    tracks = read_csv(table(tmp_path, "\n".join([HEADER, *rows]))).tracks
    assert tracks.time_ns.tolist() == [int(start) * 10**9 + i * 10**8 for i in range(40)]


def test_times_in_nanoseconds_are_exact(tmp_path):
    rows = ["1700000000.123456789,1,0,0,0,1", "1.7000000011234567891e9,1,1,0,0,1", "0.000000001,1,2,0,0,1"]
    tracks = read_csv(table(tmp_path, "\n".join([HEADER, *rows]))).tracks
    assert tracks.time_ns.tolist() == [1, 1_700_000_000_123_456_789, 1_700_000_001_123_456_789]


def test_bad_rows_are_dropped_and_counted_and_good_ones_kept(tmp_path, monkeypatch):
    rows = [
        "0.0,a,0,0,0,1",
        "0.2,a,2,0,0,1",
        "0.1,a,1,0,0,1",
        "0.1,a,9,9,0,1",
        "0.3,a,nan,0,0,1",
        "0.4,a,,0,0,1",
        ",a,4,0,0,1",
        "",
        "0.5,a,5,0,0,inf",
        "0.6,a,6,0,0,-1",
        "0.7,a,1e308,0,,",
        "0.8,a,-1e308,0,,",
        "0.1,b,7,0,0,1",
    ]
    for block_rows in (delimited.BLOCK_ROWS, 2):
        monkeypatch.setattr(delimited, "BLOCK_ROWS", block_rows)
        read = read_csv(table(tmp_path, "\n".join([HEADER, *rows])))
        assert read.losses.dropped == {
            "a number that is missing, not finite or too large": 6,
            "negative speed": 1,
            "a second row of a vehicle at one time": 1,
        }
        assert list(read.losses.notes.values()) == [1]
        assert len(read.tracks) + sum(read.losses.dropped.values()) == len([r for r in rows if r])
        assert read.tracks.position[:, 0].tolist() == [0.0, 1.0, 7.0, 2.0]


def test_an_id_in_two_groups_is_two_vehicles(tmp_path):
    rows = ["0.0,7,1,0,0,1,1", "0.0,7,2,0,0,1,2", "0.1,8,3,0,0,1,2"]
    read = read_csv(table(tmp_path, "\n".join([f"{HEADER},group", *rows])))
    assert read.tracks.track_id.tolist() == ["1/7", "2/7", "2/8"]
    assert list(read.losses.notes.values()) == [1]
    apart = read_csv(table(tmp_path, "\n".join([f"{HEADER},group", rows[0], rows[2]])))
    assert apart.tracks.track_id.tolist() == [7, 8]
    assert apart.losses.notes == {}


def test_motion_is_differenced_where_the_table_has_none(tmp_path):
    rows = [f"{0.1 * i:.1f},v,{3 * 0.1 * i:.4f},{4 * 0.1 * i:.4f}" for i in range(20)]
    read = read_csv(table(tmp_path, "\n".join(["time_s,track_id,x_m,y_m", *rows, "90,v,0,0"])))
    np.testing.assert_allclose(read.tracks.speed, 5.0, rtol=1e-9)
    np.testing.assert_allclose(read.tracks.direction, np.arctan2(4, 3), rtol=1e-9)
    assert read.losses.dropped == {"alone in time, so that no velocity can be derived": 1}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected columns time_s, x_m, y_m"),
        ("time_s;track_id;x_m;y_m\n", "rows after the header"),
        ("time_s|track_id|x_m|y_m\n", "with commas, semicolons or tabs between them, got time_s|track_id|x_m|y_m;"),
        ("time_s,track_id,x_m\n0,1,2\n", r"line 1: expected columns.*missing: y_m"),
        (f"{HEADER}\n", "rows after the header"),
        ("time_ms,track_id,x_m,y_m\n", r"column time_s, got time_ms; divide by 1e3, and name it time_s"),
        ("time_s,track_id,x_ft,y_ft\n", r"column x_m, got x_ft; multiply by 0\.3048"),
        ("time_s,track_id,x,y\n", r"column x_m, got x; convert it where the unit differs, and name it x_m"),
        (
            "time_s,track_id,x_m,y_m,heading_deg,speed_mps\n",
            "column heading_rad, got heading_deg; multiply by pi/180",
        ),
        (
            "time_s,track_id,x_m,y_m,heading_rad,speed_kmh\n",
            r"column speed_mps, got speed_kmh; divide by 3\.6",
        ),
        ("time_s,track_id,x_m,y_m,x_m\n", "one column x_m, got 2"),
        ("time_s,track_id,x_m,y_m,class,class\n", "one column class, got 2"),
        ("Time,Id,x_m,y_m,class\n", "time_s, track_id, x_m, y_m, got Time, Id, x_m, y_m, class; name"),
        (f"{HEADER}\n0,1,2,3,0,1\n0,1,2,fast,0,1\n", r"line 3: expected a number as y_m, got 'fast'"),
        (f"{HEADER}\n\n\n0,1,2,3,0,1\nsoon,1,2,3,0,1\n", r"line 5: expected a number as time_s, got 'soon'"),
        (f"{HEADER}\n0,1,2,3,0\n", r"line 2: expected 6 cells, got 5"),
        (f'{HEADER}\n0,"1\n', "unexpected end of data"),
        (
            f"{HEADER}\n1700000000000,1,2,3,0,1\n",
            r"line 2: expected seconds as time_s, got 1\.7e\+12; divide by 1e3",
        ),
        (f"{HEADER},group\n0,1,2,3,0,1,red\n", "a whole number as group, got 'red'"),
        (f"{HEADER},group\n0,1,2,3,0,1,{2**70}\n", "a whole number as group"),
    ],
)
def test_a_wrong_table_is_reported_in_one_line(tmp_path, text, message):
    with pytest.raises(TableError, match=message) as caught:
        read_csv(table(tmp_path, text))
    assert "table.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_text_that_is_not_utf8_is_reported(tmp_path):
    (tmp_path / "a.csv").write_bytes(f"{HEADER}\n0,M\xfcller,2,3,0,1\n".encode("latin-1"))
    with pytest.raises(TableError, match="UTF-8"):
        read_csv(tmp_path / "a.csv")


def test_a_byte_order_mark_is_no_part_of_the_name(tmp_path):
    (tmp_path / "a.csv").write_text(f"{HEADER}\n0,1,2,3,0,1\n", encoding="utf-8-sig")
    assert len(read_csv(tmp_path / "a.csv").tracks) == 1


@pytest.mark.parametrize("column", ["heading_rad", "course_rad"])
def test_degrees_in_a_column_of_radians_are_refused(tmp_path, column):
    text = f"time_s,track_id,x_m,y_m,{column},speed_mps\n0,1,2,3,,1\n1,1,2,3,270,1\n"
    with pytest.raises(
        TableError, match=f"column {column}: expected radians, of one turn, got 270; multiply by pi/180"
    ):
        read_csv(table(tmp_path, text))
    assert len(read_csv(table(tmp_path, text.replace("270", "6.2832"))).tracks) == 2


UNLABELLED = """\
group,time_s,sensor,x_m,y_m,own_x_m
2,1.0,radar,-609.376,-159.392,1
2,1.0,radar,-352.215,86.0,1
2,1.5,lidar,-352.0,86.5,1
3,1.0,radar,5.0,6.0,1
"""


def test_a_table_without_ids_is_detections_by_sensor_and_none_is_lost(tmp_path):
    read = read_csv(table(tmp_path, UNLABELLED))
    assert len(read.tracks) == 0
    assert read.unused == ["own_x_m"]
    assert (read.losses.dropped, read.losses.notes) == ({}, {})
    radar, lidar = read.detections["radar"], read.detections["lidar"]
    assert list(read.detections) == ["radar", "lidar"]
    assert radar.position.tolist() == [[-609.376, -159.392], [-352.215, 86.0], [5.0, 6.0]]
    assert radar.time_ns.tolist() == [10**9] * 3
    assert (radar.group.tolist(), lidar.group.tolist()) == ([2, 2, 3], [2])
    assert set(radar.track_id.tolist()) == {NO_ID}


@pytest.mark.parametrize("name", ["id", "Vehicle_ID", "trackid", "object id", "track"])
def test_a_column_that_may_be_the_ids_is_not_passed_over(tmp_path, name):
    with pytest.raises(TableError, match="track_id"):
        read_csv(table(tmp_path, f"time_s,x_m,y_m,{name}\n0,1,2,3\n"))


def test_empty_ids_are_no_vehicle(tmp_path):
    """Two vehicles of one row each beside a track: the empty id would be one that jumps."""
    rows = ["0,a,0,0", "0,,50,0", "1,a,1,0", "1, ,-50,0"]
    read = read_csv(table(tmp_path, "\n".join(["time_s,track_id,x_m,y_m", *rows])))
    assert read.tracks.track_id.tolist() == ["a", "a"]
    assert read.detections[""].track_id.tolist() == ["a", NO_ID, "a", NO_ID]
    assert read.losses.dropped == {}


def test_an_id_each_is_a_table_of_detections(tmp_path):
    """A radar that numbers its rows: each would be alone in time, and left out."""
    read = read_csv(table(tmp_path, "\n".join(["time_s,track_id,x_m,y_m", *(f"{k},{k},{k},0" for k in range(9))])))
    assert (len(read.tracks), len(read.detections[""]), read.losses.dropped) == (0, 9, {})


@pytest.mark.parametrize("cell", ["1_000", "1_0.5", "True"])
@pytest.mark.parametrize("column", range(4))
def test_what_is_a_number_in_python_alone_is_none(tmp_path, cell, column):
    cells = ["0", "1", "2", "3"]
    cells[column] = cell
    with pytest.raises(TableError, match=f"got '{cell}'"):
        read_csv(table(tmp_path, f"time_s,x_m,y_m,group\n{','.join(cells)}\n"))


SDD = """\
0 10 20 30 60 0 0 0 0 "Cart"
0 20 20 40 60 15 0 0 1 "Cart"
0 30 20 50 60 30 0 1 1 "Cart"
0 30 20 50 60 45 1 0 1 "Cart"
1 0 0 2 4 0 0 0 0 "Biker"
1 0 -60 2 -56 30 0 0 0 "Biker"
"""


def test_sdd_boxes_become_centres_with_north_up(tmp_path):
    read = read_sdd(table(tmp_path, SDD, "annotations.txt"), metres_per_pixel=0.1)
    assert read.losses.dropped == {"marked as lost": 1}
    cart = read.tracks[read.tracks.track_id == 0]
    np.testing.assert_allclose(cart.position, [[2, -4], [3, -4], [4, -4]])
    assert cart.time_ns.tolist() == [0, 500_000_000, 1_000_000_000]
    np.testing.assert_allclose(cart.speed, 2.0)
    np.testing.assert_allclose(cart.direction, 0.0)
    biker = read.tracks[read.tracks.track_id == 1]
    np.testing.assert_allclose(biker.direction, np.pi / 2)  # up in the image
    np.testing.assert_allclose(biker.speed, 6.0)


def test_sdd_keeps_the_labels_asked_for(tmp_path):
    path = table(tmp_path, SDD, "annotations.txt")
    read = read_sdd(path, metres_per_pixel=0.1, frames_per_second=15.0, labels=["Biker"])
    assert read.losses.dropped == {"marked as lost": 1, "of another label": 3}
    assert set(read.tracks.track_id) == {1}
    assert read.tracks.time_ns.tolist() == [0, 2_000_000_000]


def test_sdd_errors_are_reported(tmp_path):
    with pytest.raises(TableError, match=r"line 2: expected 10 cells, got 3"):
        read_sdd(table(tmp_path, SDD[: SDD.index("\n") + 1] + "1 2 3\n"), metres_per_pixel=0.1)
    with pytest.raises(TableError, match=r"line 1: expected a number as xmin, got 'ten'"):
        read_sdd(table(tmp_path, SDD.replace("10", "ten", 1)), metres_per_pixel=0.1)
    with pytest.raises(ValueError, match="metres_per_pixel"):
        read_sdd(table(tmp_path, SDD), metres_per_pixel=0.0)


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


def test_sumo_vehicles_turn_from_compass_to_direction(tmp_path, monkeypatch):
    for block_rows in (sumo_fcd.BLOCK_ROWS, 1):
        monkeypatch.setattr(sumo_fcd, "BLOCK_ROWS", block_rows)
        read = read_sumo_fcd(table(tmp_path, FCD, "fcd.xml"))
        assert read.losses.dropped == {"persons and containers": 1}
        assert read.tracks.track_id.tolist() == ["a.0", "a.0", "b"]
        assert read.tracks.time_ns.tolist() == [100_000_000, 200_000_000, 200_000_000]
        assert read.tracks.position.tolist() == [[1.5, -2.5], [1.8, -2.5], [7.0, 8.0]]
        np.testing.assert_allclose(read.tracks.heading, [0.0, np.pi / 2, -3 * np.pi / 4], atol=1e-12)
        np.testing.assert_allclose(
            read.tracks.direction, [0.0, 0.0, -3 * np.pi / 4], atol=1e-12
        )  # who is alone has yaw
        assert read.tracks.speed.tolist() == [3.0, 3.5, 0.0]


def test_sumo_without_speeds_is_differenced(tmp_path):
    text = FCD.replace(' speed="3.50"', "")
    read = read_sumo_fcd(table(tmp_path, text, "fcd.xml"))
    np.testing.assert_allclose(read.tracks.speed, 3.0)
    assert read.losses.dropped["alone in time, so that no velocity can be derived"] == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no element found"),
        (FCD[:300], r"expected well-formed xml"),
        (
            FCD.replace("<fcd-export", "<!DOCTYPE a [<!ENTITY b 'c'>]>\n<fcd-export"),
            "line 3: expected no DOCTYPE",
        ),
        ("<net><edge/></net>", "expected an fcd-export, got <net>"),
        ("<fcd-export><timestep time='0'/></fcd-export>", "expected vehicles"),
        (FCD.replace('"0.20"', '"later"'), "line 8: expected seconds as time, got 'later'"),
        *(
            (FCD.replace('"0.20"', f'"{time}"'), f"line 8: expected seconds as time, got '{time}'")
            for time in ("nan", "-nan", "snan", "inf", "-Infinity", "1e30", "1e999999999", "")
        ),
        ('<fcd-export><vehicle id="a" x="0" y="0"/></fcd-export>', "expected vehicles in time steps, got one before"),
        (FCD.replace('x="7"', 'x="seven"'), "line 10: expected a number as x, got 'seven'"),
        (FCD.replace('x="7"', ""), "line 10: expected x of a vehicle"),
    ],
)
def test_a_wrong_fcd_is_reported_in_one_line(tmp_path, text, message):
    with pytest.raises(TableError, match=message) as caught:
        read_sumo_fcd(table(tmp_path, text, "fcd.xml"))
    assert "\n" not in str(caught.value)


@real_data
@pytest.mark.parametrize(
    ("name", "n_rows", "n_tracks"),
    [
        ("lankershim/lankershim.csv", 60_567, 1091),
        ("town03/roundabout.csv", 64_201, 567),
        ("town03/intersection.csv", 48_887, 398),
    ],
)
def test_real_csv_comes_whole_and_on_the_tenth(name, n_rows, n_tracks):
    read = read_csv(DATA / name)
    assert (len(read.tracks), read.tracks.n_tracks, read.losses.dropped) == (n_rows, n_tracks, {})
    assert (read.tracks.time_ns % 100_000_000 == 0).all()
    with (DATA / name).open() as file:
        slow = sorted(
            (round(float(r["time_s"]) * 10), int(r["track_id"]), float(r["x_m"]), float(r["speed_mps"]))
            for r in csv.DictReader(file)
        )
    fast = sorted(
        zip(
            (read.tracks.time_ns // 100_000_000).tolist(),
            read.tracks.track_id.tolist(),
            read.tracks.position[:, 0].tolist(),
            read.tracks.speed.tolist(),
            strict=True,
        )
    )
    assert fast == slow


@real_data
@pytest.mark.parametrize(("video", "scale", "n_rows"), [("video2", 0.03948, 15_085), ("video4", 0.03898, 29_380)])
def test_real_annotations_are_all_accounted_for(video, scale, n_rows):
    read = read_sdd(DATA / "death_circle" / video / "annotations.txt", metres_per_pixel=scale)
    assert len(read.tracks) + sum(read.losses.dropped.values()) == n_rows
    assert (read.tracks.speed > 25.0).mean() < 0.005  # some boxes jump when a lost track is found again
    assert np.ptp(read.tracks.position, axis=0).max() < 100.0


def test_a_vehicle_of_which_a_speed_is_missing_gets_its_motion_from_positions(tmp_path):
    rows = [f"{0.1 * k:.1f},{name},{k},0,{course},{speed}" for k in range(4) for name, course, speed in (
        ("reported", 1.5, 3), ("part", 1.5, "" if k == 2 else 3), ("none", "", ""))]  # fmt: skip
    read = read_csv(table(tmp_path, "\n".join([HEADER.replace("heading", "course"), *rows])))
    assert read.losses.dropped == {}
    motion = {name: read.tracks[read.tracks.track_id == name] for name in ("reported", "part", "none")}
    assert [len(own) for own in motion.values()] == [4, 4, 4]
    np.testing.assert_array_equal(motion["reported"].direction, 1.5)
    np.testing.assert_array_equal(motion["reported"].speed, 3.0)
    for name in ("part", "none"):  # a metre each 0.1 s to the east
        np.testing.assert_allclose(motion[name].direction, 0.0, atol=1e-12)
        np.testing.assert_allclose(motion[name].speed, 10.0)
    (reported,) = read.losses.notes.values()
    assert reported == 3


PLAIN = f"{HEADER},label\n0,a,1.5,-2,0.25,3,car\n0.5,a,2.5,-2,0.25,3,car\n0,b,7,8,,,truck\n0.5,b,8,8,,,\n"


@pytest.mark.parametrize(
    "form",
    [
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", ";").replace(".", ","),
        lambda text: text.replace(",", "\t"),
        lambda text: "\n" + text.replace("label", "class").replace(",", ", "),
    ],
    ids=["semicolons", "semicolons and decimal commas", "tabs", "spaces and a class"],
)
@pytest.mark.parametrize("compressed", [False, True])
def test_a_table_reads_the_same_whatever_stands_between_its_cells(tmp_path, form, compressed):
    wanted = read_csv(table(tmp_path, PLAIN))
    path = table(tmp_path, form(PLAIN), "other.csv")
    if compressed:
        path = tmp_path / "other.csv.gz"
        path.write_bytes(gzip.compress(form(PLAIN).encode()))
    read = read_csv(path)
    assert read == wanted
    assert read.labels == {"a": "car", "b": "truck"}


def test_a_cut_gzip_file_is_reported(tmp_path):
    whole = gzip.compress((f"{HEADER}\n" + "".join(f"{i},a,{i},{i * i},0,1\n" for i in range(500))).encode())
    (tmp_path / "cut.csv.gz").write_bytes(whole[:-40])
    with pytest.raises(TableError, match=r"cut\.csv\.gz.*expected a whole gzip file"):
        read_csv(tmp_path / "cut.csv.gz")


def test_a_vehicle_has_the_label_of_most_of_its_rows_and_the_others_are_counted(tmp_path):
    rows = [f"{i},a,{i},0,0,1,{label}" for i, label in enumerate(["car", "van", "van", "", "bus"])]
    read = read_csv(table(tmp_path, "\n".join([f"{HEADER},category", *rows])))
    assert read.labels == {"a": "van"}
    assert list(read.losses.notes.values()) == [2]


def test_columns_of_other_names_are_mapped_and_what_is_not_used_is_named(tmp_path):
    text = "Id,Easting,Northing,t,x_m,Lane\na,1,2,0,99,5\na,2,2,1,99,5\n"
    columns = {"track_id": "Id", "x_m": "Easting", "y_m": "Northing", "time_s": "t"}
    read = read_csv(table(tmp_path, text), columns=columns)
    assert read.tracks.position.tolist() == [[1.0, 2.0], [2.0, 2.0]]
    assert read.unused == ["(x_m)", "Lane"]
    with pytest.raises(TableError, match="expected column East, got Id, Easting"):
        read_csv(table(tmp_path, text), columns=columns | {"x_m": "East"})
    with pytest.raises(TableError, match=r"--columns time_s=NAME"):
        read_csv(table(tmp_path, text), columns={"track_id": "Id", "x_m": "Easting", "y_m": "Northing"})


@pytest.mark.parametrize("text", ["x=Easting", "x_m", "x_m=", "x_m=a,x_m=b", ""])
def test_a_mapping_that_is_none_is_reported(text):
    with pytest.raises(ValueError, match=r"columns: expected NAME=COLUMN, each of time_s, .*, got "):
        parse_columns(text)


def test_ids_that_a_spreadsheet_would_run_are_exported_as_text_and_read_back(tmp_path):
    names = ["=cmd|' /C calc'!A0", "+a", "-3", "@x", "'quoted", "a=b", "-", "\tb"]
    n = len(names)
    estimates = Estimates(
        track_id=np.array(names), time_ns=np.zeros(n, np.int64), position=np.zeros((n, 2)),
        covariance=np.tile(np.eye(2), (n, 1, 1)), direction=np.zeros(n), direction_resultant=np.ones(n),
        speed=np.ones(n), speed_std=np.ones(n), effective_sample_size=np.ones(n), log_evidence=np.zeros(n),
    )  # fmt: skip
    write_estimates(estimates, tmp_path / "out.csv")
    with (tmp_path / "out.csv").open(newline="") as file:
        cells = [row[1] for row in csv.reader(file)][1:]
    assert [cell for cell in cells if cell[0] in "=+-@\t"] == ["-3"]  # a number is no formula
    assert read_csv(tmp_path / "out.csv").tracks.track_id.tolist() == names
