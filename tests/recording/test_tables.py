"""Tables to tracks: what is good is kept exactly, what is bad is counted or reported in one line."""

import csv
import gzip
from dataclasses import replace
from datetime import datetime
from decimal import Decimal
from importlib.util import find_spec
from re import escape as re_escape

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import pytest
from mcap_files import DATA, detections
from pyproj import Geod

from dirprim_filter import read_tracks
from dirprim_filter.columns import NO_COVARIANCE
from dirprim_filter.detections import NO_ID, Detections
from dirprim_filter.recording.container import budget
from dirprim_filter.recording.errors import RecordingError, TableError
from dirprim_filter.recording.estimate_tables import EXACT_NS, read_tracked_rows, write_estimates
from dirprim_filter.recording.losses import ALONE, FAR
from dirprim_filter.recording.name_patterns import named_values
from dirprim_filter.recording.reader import read_track_logs
from dirprim_filter.recording.tables import read_named, summary_of
from dirprim_filter.recording.tables.files import cells_of
from dirprim_filter.recording.tables.named_columns import COLUMNS
from dirprim_filter.recording.tables.table import MINUS_ONE
from situations import estimates_of, tracks_of

HEADER = "time_s,track_id,x_m,y_m,heading_rad,speed_mps"
PLACES = "time_s,track_id,x_m,y_m"
MISSING = "with a number that is missing, not finite or too large"


def table(tmp_path, text, name="table.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def read(tmp_path, header, rows):
    return read_named(table(tmp_path, "\n".join([header, *rows])))


def abreast(*names, n=20):
    """Rows of vehicles that drive to the east side by side, a metre at each time."""
    return [f"{0.1 * k:.1f},{name},{k},{20 * i}" for k in range(n) for i, name in enumerate(names)]


def test_columns_are_found_by_name_in_any_order(tmp_path):
    header = "speed_mps,lane,y_m,time_s,course_rad,group,x_m,track_id,heading_rad"
    found = read(tmp_path, header, ["5,L1,2,0.1,-0.5,3,+1,a,1.5", "6,L1,4,0.2,0.25,3,2,a,"])
    tracks = found.tracks
    assert found.unused == ["lane"]
    assert (tracks.track_id.tolist(), tracks.time_ns.tolist()) == (["a", "a"], [100_000_000, 200_000_000])
    assert tracks.position.tolist() == [[1.0, 2.0], [2.0, 4.0]]
    assert tracks.direction.tolist() == [-0.5, 0.25]  # kept as it is, whatever the positions say
    np.testing.assert_array_equal(tracks.heading, [1.5, np.nan])
    assert (tracks.speed.tolist(), tracks.group.tolist()) == ([5.0, 6.0], [3, 3])
    assert (found.losses.dropped, found.losses.notes) == ({}, {})


TIMES = {
    "1.7000000001234567891e9": 1_700_000_000_123_456_789,
    "2023-11-14T22:13:20.123456789Z": 1_700_000_000_123_456_789,
    "2023-11-15 00:13:20.5+02:00": 1_700_000_000_500_000_000,
    "2023-11-14T22:13:20": 1_700_000_000_000_000_000,
    "1969-12-31T23:59:59.25Z": -750_000_000,
}


def test_times_are_exact_to_the_nanosecond_in_seconds_at_any_epoch_and_as_iso_times(tmp_path):
    for start in (0, 1_700_000_000, -1_700_000_000, 999_998, 8_999_999_000):
        rows = [f"{Decimal(start) + Decimal(i) / 10},1,{i},0,0,1" for i in range(40)]
        assert read(tmp_path, HEADER, rows).tracks.time_ns.tolist() == [start * 10**9 + i * 10**8 for i in range(40)]
    for cell, time_ns in TIMES.items():
        for name in ("time_s", *["timestamp"] * ("T" in cell or " " in cell)):
            tracks = read(tmp_path, HEADER.replace("time_s", name), [f"{cell},1,2,0,0,1"]).tracks
            assert tracks.time_ns.tolist() == [time_ns], cell


def test_bad_rows_are_dropped_and_counted_and_good_ones_kept(tmp_path):
    rows = [
        "0.0,a,0,0,0,1", "0.2,a,2,0,0,1", "0.1,a,1,0,0,1", "0.1,a,9,9,0,1", "0.3,a,nan,0,0,1", "0.4,a,,0,0,1",
        ",a,4,0,0,1", "", "0.5,a,5,0,0,inf", "0.6,a,6,0,0,-1", "0.7,a,1e308,0,,", "0.8,a,-1e308,0,,", "0.1,b,7,0,0,1",
    ]  # fmt: skip
    found = read(tmp_path, HEADER, rows)
    repeated = "that repeat a vehicle and a time"
    assert found.losses.dropped == {MISSING: 6, "with a negative speed": 1, repeated: 1}
    assert list(found.losses.notes.values()) == [1]
    assert found.tracks.position[:4, 0].tolist() == [0.0, 1.0, 7.0, 2.0]


def test_groups_are_of_several_columns_and_an_id_in_two_is_two_vehicles(tmp_path):
    rows = ["0.0,7,1,0,0,1,1", "0.0,7,2,0,0,1,2", "0.1,8,3,0,0,1,2"]
    found = read(tmp_path, f"{HEADER},group", rows)
    assert found.tracks.track_id.tolist() == ["1/7", "2/7", "2/8"]
    assert list(found.losses.notes.values()) == [1]
    apart = read(tmp_path, f"{HEADER},group", [rows[0], rows[2]])
    assert (apart.tracks.track_id.tolist(), apart.losses.notes) == ([7, 8], {})
    rows = [f"{t},v,{t},0,{site},{day}" for site in ("north", "south") for day in (1, 2) for t in (0, 1)]
    path = table(tmp_path, "\n".join([f"{PLACES},site,day", *rows]))
    for group, groups in (("site+day", [0, 1, 2, 3]), ("day", [1, 2])):
        found = read_named(path, columns={"group": group})
        assert np.unique(found.tracks.group).tolist() == groups
        assert found.unused == (["site"] if group == "day" else [])
    with pytest.raises(TableError, match="expected column week"):
        read_named(path, columns={"group": "site+week"})


@pytest.mark.parametrize("names", ["latitude_deg,longitude_deg", "lat,lon"])
def test_latitudes_and_longitudes_come_onto_a_plane(tmp_path, names):
    """An ellipsoid's own geodesics measure the way, in metres and from north."""
    rows = [f"{t},v,{48 + 1e-4 * t},{11 + 2e-4 * t}" for t in range(3)] + ["3,v,91,11"]
    found = read(tmp_path, f"time_s,track_id,{names}", rows)
    azimuth, _, metres = Geod(ellps="WGS84").inv(11, 48, 11.0002, 48.0001)
    east, north = found.tracks.position[1] - found.tracks.position[0]
    np.testing.assert_allclose(np.hypot(east, north), metres, atol=1e-3)
    np.testing.assert_allclose(np.degrees(np.arctan2(east, north)), azimuth, atol=1e-3)
    assert found.losses.dropped == {FAR: 1}
    other = table(tmp_path, "\n".join([f"time_s,track_id,{names}", *rows[1:]]), "b.csv")
    there = read_tracks([tmp_path / "table.csv", other])
    for row in there[there.track_id == "b/v"].position:  # of the second table on the plane of the first
        assert np.abs(there[there.track_id == "table/v"].position - row).sum(axis=1).min() < 1e-6


@pytest.mark.parametrize(("rows_of_ship", "n_seen"), [(4, 9), (1, 5)])
def test_who_comes_too_seldom_for_a_course_is_tracked_beside_the_others(tmp_path, rows_of_ship, n_seen):
    """Half of a harbour's ships had been left out of what is tracked; one row alone makes no vehicle to follow."""
    rows = [f"{20 * k},tug,{k},0" for k in range(5)] + [f"{300 * k + 1},ship,{k},9" for k in range(rows_of_ship)]
    path = table(tmp_path, "\n".join([PLACES, *rows]))
    seen = detections(path)
    assert len(seen) == n_seen
    assert np.unique(seen.track_id).size == 1 + (n_seen > 5)
    assert set(read_tracks(path).track_id) == {"tug"}


COVARIANCE = "covariance_xx_m2,covariance_xy_m2,covariance_yy_m2"


@pytest.mark.parametrize(("columns", "values"), [("turn_signal", "left"), ("confidence", "0.9"), (COVARIANCE, "9,0,4")])
def test_what_tracks_do_not_hold_is_tracked_with_and_ids_are_taken_apart(tmp_path, columns, values):
    rows = [f"{0.1 * k:.1f},7,{k + 500 * (k >= 20)},0,{values}" for k in range(40)]
    path = table(tmp_path, "\n".join([f"{PLACES},{columns}", *rows]))
    seen = detections(path)
    assert summary_of(read_named(path)).messages == 40  # and not as many tracks' rows too
    assert (len(seen), set(seen.track_id)) == (40, {"7", "7~1"})
    assert np.isfinite([seen.cue[:, 0], seen.confidence, seen.covariance[:, 0, 0]]).sum() == 40
    if columns == COVARIANCE:
        assert (seen.covariance == np.diag([9.0, 4.0])).all()


def test_motion_that_a_vehicle_has_not_in_all_rows_is_that_of_its_positions(tmp_path):
    rows = [f"{0.1 * k:.1f},{name},{k},0,{course},{speed}" for k in range(4) for name, course, speed in (
        ("reported", 1.5, 3), ("part", 1.5, "" if k == 2 else 3), ("none", "", ""))]  # fmt: skip
    found = read(tmp_path, HEADER.replace("heading", "course"), [*rows, "90,none,0,0,,"])
    assert not found.losses.dropped
    assert found.losses.notes["rows alone in time, so that no velocity can be derived"] == 1
    assert list(found.losses.notes.values()) == [3, 1]
    for name, direction, speed in (("reported", 1.5, 3.0), ("part", 0.0, 10.0), ("none", 0.0, 10.0)):
        motion = found.tracks[found.tracks.track_id == name]  # a metre each 0.1 s to the east
        np.testing.assert_allclose(motion.direction, [direction] * 4, atol=1e-12)
        np.testing.assert_allclose(motion.speed, [speed] * 4)


WRONG = [
    ("", "expected columns time_s, x_m, y_m"),
    ("time_s;track_id;x_m;y_m\n", "expected rows, got none"),
    ("time_s|track_id|x_m|y_m\n", "with commas, semicolons or tabs between them, got time_s|track_id|x_m|y_m;"),
    ("time_s,track_id,x_m\n0,1,2\n", r"line 1: expected columns.*missing: y_m"),
    ("time_ms,track_id,x_m,y_m\n", r"column time_s, got time_ms; divide by 1e3, and name it time_s"),
    ("time_s,track_id,x_ft,y_ft\n", r"column x_m, got x_ft; multiply by 0\.3048"),
    ("time_s,track_id,x,y\n", r"column x_m, got x; convert it where the unit differs, and name it x_m"),
    (f"{PLACES},heading_deg\n", "column heading_rad, got heading_deg; multiply by pi/180"),
    (f"{PLACES},speed_kmh\n", r"column speed_mps, got speed_kmh; divide by 3\.6"),
    (f"{PLACES},x_m\n", "one column x_m, got 2"),
    (f"{PLACES},class,class\n", "one column class, got 2"),
    ("Time,Id,x_m,y_m,class\n", "time_s, track_id, x_m, y_m, got Time, Id, x_m, y_m, class; name"),
    *((f"time_s,x_m,y_m,{name}\n0,1,2,3\n", "track_id") for name in ("id", "Vehicle_ID", "trackid", "object id")),
    ("time,track_id,x_m,y_m\n12.5,1,2,3\n", "line 2: expected an ISO time as time, got '12.5'; name seconds time_s"),
    ("time,track_id,x_m,y_m\n9999-01-01T00:00:00,1,2,3\n", "line 2: expected an ISO time as time, got '9999"),
    (f"{HEADER}\n0,1,2,3,0,1\n0,1,2,fast,0,1\n", r"line 3: expected a number as y_m, got 'fast'"),
    (f"{HEADER}\n\n\n0,1,2,3,0,1\nsoon,1,2,3,0,1\n", r"line 5: expected seconds as time_s, got 'soon'"),
    (f"{HEADER}\n\n0,1,2,3,0\n", r"line 3: expected 6 cells, got 5"),
    (f'{HEADER}\n0,"1\n', "line 2: expected 6 cells, got 2"),
    (f'{PLACES},label\n0,a,1,2,"car\n1,a,1,2,car\n', "expected quotes in pairs, got one that is not closed"),
    (f"{PLACES}\n0,{'a' * 3_000_000},1,2\n", "expected rows of cells, got"),
    *((f"{PLACES},label\n0,{a},1,2,{b}\n", f"at most 256 characters, none of them NUL, as {name}, got 90000")
      for a, b, name in (("a" * 90_000, "", "track_id"), ("a", "b" * 90_000, "label"))),
    (f"{HEADER}\n1700000000000,1,2,3,0,1\n", r"line 2: expected seconds as time_s, got '1700000000000'; divide by 1e3"),
    (f"{HEADER},group\n0,1,2,3,0,1,red\n", "a whole number as group, got 'red'"),
    (f"{HEADER},group\n0,1,2,3,0,1,{2**70}\n", "a whole number as group"),
    *((f"{PLACES},confidence\n0,a,1,2,0.5\n0,a,1,2,{wrong}\n", f"line 3: expected a probability, 0 to 1, as .*{wrong}")
      for wrong in ("1.5", "-0.1", "87", "inf")),
    *((f"{PLACES},{name}_rad\n0,1,2,3,\n1,1,2,3,270\n", f"line 3: expected radians, of one turn, as {name}_rad, got 27")
      for name in ("heading", "course")),
    *((f"time_s,x_m,y_m,group\n{'1,' * column}{cell}{',1' * (3 - column)}\n", f"line 2:.*got '{cell}'")
      for cell in ("1_000", "True") for column in range(4)),
]  # fmt: skip


def test_rows_of_no_vehicle_are_detections(tmp_path):
    """The empty id would be one that jumps; a radar that numbers its rows has each alone in time."""
    found = read(tmp_path, PLACES, ["0,a,0,0", "0,,50,0", "1,a,1,0", "1, ,-50,0"])
    assert (found.tracks.track_id.tolist(), found.losses.dropped) == (["a", "a"], {})
    assert found.detections[""].track_id.tolist() == ["a", NO_ID, "a", NO_ID]
    read_losses = read_track_logs(tmp_path / "table.csv").losses  # of which the tracks alone are read
    assert read_losses.notes[ALONE] == 2
    found = read(tmp_path, PLACES, [f"{k},{k},{k},0" for k in range(9)])
    assert (len(found.tracks), len(found.detections[""]), found.losses.dropped) == (0, 9, {})


@pytest.mark.skipif(not DATA.exists(), reason=f"real data are not at {DATA}")
def test_real_csv_comes_whole_and_on_the_tenth():
    path = DATA / "lankershim/lankershim.csv"
    found = read_named(path)
    assert (len(found.tracks), found.tracks.n_tracks, found.losses.dropped) == (60_567, 1091, {})
    with path.open() as file:
        slow = sorted(
            (round(float(r["time_s"]) * 10), int(r["track_id"]), float(r["x_m"]), float(r["speed_mps"]))
            for r in csv.DictReader(file)
        )
    columns = (found.tracks.time_ns / 1e8, found.tracks.track_id, found.tracks.position[:, 0], found.tracks.speed)
    assert sorted(zip(*(column.tolist() for column in columns), strict=True)) == slow


PLAIN = f"{HEADER},label\n0,a,1.5,-2,0.25,3,car\n0.5,a,2.5,-2,0.25,3,car\n0,b,7,8,,,truck\n0.5,b,8,8,,,\n"


FORMS = {
    "a byte order mark": "\ufeff" + PLAIN,
    "semicolons": PLAIN.replace(",", ";"),
    "semicolons and decimal commas": PLAIN.replace(",", ";").replace(".", ","),
    "tabs": PLAIN.replace(",", "\t"),
    "sep=;": "sep=;\r\n" + PLAIN.replace(",", ";"),
    "spaces, a class, other line ends": "\n" + PLAIN.replace("label", "class").replace(",", ", ").replace("\n", "\r\n"),
}


def test_a_table_reads_the_same_whatever_stands_between_its_cells(tmp_path):
    wanted = read_named(table(tmp_path, PLAIN))
    for form, text in FORMS.items():
        (tmp_path / "other.csv.gz").write_bytes(gzip.compress(text.encode()))
        for path in (table(tmp_path, text, "other.csv"), tmp_path / "other.csv.gz"):
            assert read_named(path) == wanted, form
            assert read_tracks(path) == wanted.tracks, form
            assert set(read_tracks(path, labels="car").track_id) == {"a"}
    assert wanted.labels == {"a": "car", "b": "truck"}
    rows = [f"{i},a,{i},0,0,1,{label}" for i, label in enumerate(["car", "van", "van", "", "bus"])]
    found = read(tmp_path, f"{HEADER},category", rows)
    assert (found.labels, list(found.losses.notes.values())) == ({"a": "van"}, [2])  # of most of its rows


def test_columns_of_other_names_are_mapped_and_what_is_not_used_is_named(tmp_path):
    path = table(tmp_path, "Id,Easting,North_s,t,x_m,Lane\na,1,2,0,99,5\na,2,2,1,99,5\n")
    columns = {"track_id": "Id", "x_m": "Easting", "y_m": "North_s", "time_s": "t"}  # smoothed, and not seconds
    found = read_named(path, columns=columns)
    assert (found.tracks.position.tolist(), found.unused) == ([[1.0, 2.0], [2.0, 2.0]], ["x_m", "Lane"])
    assert read_named(path, columns=columns | {"x_m": "x_m", "Easting": "", "Lane": ""}).unused == []
    for wrong, why in (
        (columns | {"x_m": "East"}, "expected column East, got Id, Easting"),
        (columns | {"Breadth": ""}, "expected column Breadth, got Id, Easting"),
        ({"track_id": "Id", "x_m": "Easting", "y_m": "North_s"}, "--set format=csv,time_s=NAME"),
    ):
        with pytest.raises(TableError, match=why):
            read_named(path, columns=wrong)
    turned = table(tmp_path, PLACES + ",heading,speed_mps\n0,a,1,2,90,1\n1,a,2,2,90,1\n", "turned.csv")
    with pytest.raises(TableError, match=r"name it heading_rad; or leave it out by --set format=csv,heading=$"):
        read_tracks(turned)
    assert read_tracks(turned, format="csv,heading=").speed.tolist() == [1.0, 1.0]
    for wrong in ("x=Easting", "x_m", "x_m=", "x_m=a,x_m=b", ""):
        with pytest.raises(ValueError, match=r"columns: expected NAME=VALUE, each of time_s, .*, got "):
            named_values(wrong, COLUMNS, of="columns")


def test_ids_that_a_spreadsheet_would_run_are_exported_as_text_and_read_back(tmp_path):
    names = ["=cmd|' /C calc'!A0", "+a", "-3", "@x", "'quoted", "a=b", "-", "\tb"]
    write_estimates(estimates_of(names), tmp_path / "out.csv")
    with (tmp_path / "out.csv").open(newline="") as file:
        cells = [row[1] for row in csv.reader(file)][1:]
    assert [cell for cell in cells if cell[0] in "=+-@\t"] == ["-3"]  # a number is no formula
    assert read_named(tmp_path / "out.csv").tracks.track_id.tolist() == names


N = 6
TIMES_NS = 1_700_000_000_123_456_789 + np.arange(N) * 100_000_000
WRITERS = {"t.parquet": pa.parquet.write_table, "t.feather": pa.feather.write_feather}


def columns(**changes):
    made = {
        "time_ns": TIMES_NS, "track_id": np.repeat(["a", "b"], N // 2), "x_m": np.arange(N, dtype=np.float32),
        "y_m": 0.6 * np.arange(N), "heading_rad": pa.array([0.5, None, 1.0, 1.5, 2.0, 2.5]),
        "group": np.zeros(N, np.int32), "length_m": np.full(N, 4.5), "lane": np.arange(N),
        "class": pa.array(["car"] * 3 + [None] + ["bus"] * 2).dictionary_encode(),
    }  # fmt: skip
    return pa.table({name: values for name, values in (made | changes).items() if values is not None})


@pytest.mark.parametrize("name", WRITERS)
def test_arrow_tables_read_as_the_csv_of_the_same_columns_does(tmp_path, name):
    made = columns()
    WRITERS[name](made, tmp_path / name)
    found = read_named(tmp_path / name)
    texts = made.to_pydict()
    rows = [",".join("" if one is None else str(one) for one in row) for row in zip(*texts.values(), strict=True)]
    assert found == read(tmp_path, ",".join(texts), rows)
    assert read_tracks(tmp_path / name) == found.tracks
    assert (found.labels, list(found.unused)) == ({"a": "car", "b": "bus"}, ["lane"])


@pytest.mark.parametrize(
    ("time", "named", "within_ns"),
    [
        (pa.array(TIMES_NS).cast(pa.timestamp("ns", "UTC")), "time_ns", 0),
        (pa.array(TIMES_NS // 1000).cast(pa.timestamp("us")), "time", 1000),
        (TIMES_NS / 1e9, "time_s", 250),
        ([datetime.fromtimestamp(t / 1e9).astimezone().isoformat() for t in TIMES_NS.tolist()], "time", 1000),
    ],
)
def test_times_of_an_arrow_table_are_nanoseconds_timestamps_texts_or_seconds(tmp_path, time, named, within_ns):
    pa.parquet.write_table(columns(time_ns=None, stamp=time), tmp_path / "t.parquet")
    found = read_named(tmp_path / "t.parquet", columns={named: "stamp"})
    np.testing.assert_allclose(found.tracks.time_ns - TIMES_NS, 0, atol=within_ns)


def test_bad_rows_of_an_arrow_table_are_dropped_and_counted(tmp_path):
    bad = {"x_m": pa.array([0.0, None, 2.0, np.inf, 4.0, 5.0]), "time_ns": pa.array([1, 2, None, 4, 5, 6])}
    pa.parquet.write_table(columns(**bad), tmp_path / "t.parquet")
    assert read_track_logs(tmp_path / "t.parquet").losses.dropped[MISSING] == 3
    with pytest.raises(RecordingError, match=r"t\.parquet: expected a table of which all is read, left out 3 rows"):
        read_tracks(tmp_path / "t.parquet", strict=True)


def of_offsets_beyond_its_texts():
    ids = pa.StringArray.from_buffers(2, pa.py_buffer(np.array([0, 2**31 - 2, 2], np.int32)), pa.py_buffer(b"ab"))
    sink = pa.BufferOutputStream()
    table = pa.table({"time_s": [0.0, 1.0], "track_id": ids, "x_m": [0.0, 1.0], "y_m": [0.0, 1.0]})
    pa.feather.write_feather(table, sink, compression="uncompressed")
    return sink.getvalue().to_pybytes()


def of_names_that_are_no_text():
    sink = pa.BufferOutputStream()
    pa.parquet.write_table(pa.table({"time_s": [0.0], "some_name": [1]}), sink, store_schema=False)
    return sink.getvalue().to_pybytes().replace(b"some_name", b"some\xecname")


WRONG_ARROW = [
    ({"x_m": None}, r"expected columns time_ns, track_id, x_m, y_m.* missing: x_m"),
    ({"x_m": ["east"] * N}, r"row 1: expected a number as x_m, got 'east'"),
    ({"x_m": [True] * N}, r"column x_m: expected numbers, got bool"),
    ({"group": [1.5] * N}, r"column group: expected whole numbers, got double"),
    ({"group": pa.array([1, 2, None, 3, 4, 5])}, r"row 3: expected a whole number as group, got nothing"),
    ({"track_id": [[1]] * N}, r"column track_id: expected texts or numbers, got list"),
    ({"track_id": [2.0**60] * N}, "expected texts or whole numbers as track_id"),
    ({"heading_rad": None, "heading_deg": [0.0] * N}, "expected column heading_rad, got heading_deg; multiply by"),
    ({"time_ns": None, "time_s": TIMES_NS}, r"row 1: expected seconds as time_s, got 1\.7e\+18; name whole nano"),
    ({"time_ns": pa.array(TIMES_NS).cast(pa.timestamp("us"))}, "column time_ns: expected times until"),
    *((data, "expected a Parquet, Feather or Arrow file, got") for data in (
        b"PAR1" + bytes(50) + b"PAR1", b"ARROW1\0\0" + bytes(50), b"PAR1", b"", of_offsets_beyond_its_texts(),
        of_names_that_are_no_text())),
]  # fmt: skip
WRONG_BYTES = [
    *((opening + bytes(100), r"expected a table of text, got an? [^;]*; .*`")
      for opening in (b"SQLite format 3\0", b"\x89MCAP0\r\n")),
    (f"{HEADER}\n0,M\xfcller,2,3,0,1\n".encode("latin-1"), r"line 2: expected UTF-8 text"),
]  # fmt: skip
CUT = gzip.compress("\n".join([PLACES, *abreast(*range(9), n=99)]).encode())[:-40]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [(name, *one) for name, wrong in (("t.csv", WRONG + WRONG_BYTES), ("t.parquet", WRONG_ARROW)) for one in wrong]
    + [("t.csv.gz", CUT, "expected a whole gzip file")],
)
def test_a_wrong_table_is_reported_in_one_line(tmp_path, name, content, message):
    if isinstance(content, dict):
        pa.parquet.write_table(columns(**content), tmp_path / name)
    else:
        (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(TableError, match=message) as caught:
        read_named(tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_values_are_tables_that_read_back(tmp_path, ring):
    few = ring[ring.track_id < 3]
    known = replace(few, size=np.tile([4.0, 2.0, 1.5], (len(few), 1)), heading=few.direction)
    for sent in (few, known):
        made = sent.to_arrow()
        assert ("heading_rad" in made.column_names) == (sent is known)
        pa.parquet.write_table(made, tmp_path / "t.parquet")
        assert read_tracks(tmp_path / "t.parquet") == sent
        if find_spec("pandas"):
            assert sent.to_pandas().shape == (len(sent), made.num_columns)
    seen = Detections(track_id=few.track_id, time_ns=few.time_ns, position=few.position,
                      covariance=np.tile([[2.0, 0.5], [0.5, 3.0]], (len(few), 1, 1)))  # fmt: skip
    made = seen.to_arrow()
    assert [made[f"covariance_{name}_m2"][0].as_py() for name in ("xx", "xy", "yy")] == [2.0, 0.5, 3.0]
    pa.parquet.write_table(made.drop_columns(["track_id"]), tmp_path / "t.parquet")
    np.testing.assert_array_equal(detections(tmp_path / "t.parquet").covariance, seen.covariance)
    assert {"time_ns", "track_id", "x_m", "course_rad"} <= set(estimates_of(["a"]).to_arrow().column_names)


def test_what_is_no_covariance_is_reported_and_unknown(tmp_path):
    header = "time_s,x_m,y_m,covariance_xx_m2,covariance_xy_m2,covariance_yy_m2"
    stated = {"4,1,2": False, "0,0,0": False, ",,": False, "-1,0,0": False, "1e15,0,1e15": False, "4,0,-1": True,
              "1,5,1": True, "4,,4": True, "4,0,0": True, "1e300,0,1e300": True}  # fmt: skip
    found = read(tmp_path, header, [f"{k},{9 * k},0,{cells}" for k, cells in enumerate(stated)])
    assert found.losses.notes[NO_COVARIANCE] == sum(stated.values())
    known = np.isfinite(found.detections[""].covariance[:, 0, 0])
    assert np.flatnonzero(known).tolist() == [0, 4]
    found = read(tmp_path, "time_s,x_m,y_m,covariance_xx_m2,covariance_yy_m2", ["0,0,0,4,4", "1,9,0,4,4"])
    assert found.unused == ["covariance_xx_m2", "covariance_yy_m2"]


def test_exported_times_are_decimals_from_which_each_nanosecond_comes_back(tmp_path):
    late, truth = 1_700_000_000_000_000_001, tracks_of(np.zeros((1, 1, 2)))
    for first_ns, cell in ((0, "0"), (EXACT_NS - 2, "4503599.627370494"), (late, "1700000000.000000001")):
        time_ns, path = first_ns + np.arange(3), tmp_path / f"{first_ns}.csv"
        write_estimates(estimates_of(["a"] * 3, time_ns=time_ns), path)
        assert path.read_text().splitlines()[1].startswith(f"{cell},")
        assert read_tracked_rows(path, truth=truth).time_ns.tolist() == time_ns.tolist()
    iso = table(tmp_path, "time,track_id,x_m,y_m\n1970-01-01T00:00:05Z,a,1,2")
    assert read_tracked_rows(iso, truth=truth).time_ns.tolist() == [5 * 10**9]


@pytest.mark.parametrize("none", ["", "nan", "None", "NULL", "N/A", "<NA>", "-1"])
def test_ids_that_stand_for_none_are_those_of_detections(tmp_path, none):
    (seen,) = read(tmp_path, PLACES, abreast("1", none, none)).detections.values()
    assert sorted(seen.track_id) == [""] * 40 + ["1"] * 20


def test_ids_of_minus_one_beside_whole_numbers_are_honest_and_noted(tmp_path):
    found = read(tmp_path, PLACES, abreast("0", "-1", "5"))
    assert (found.tracks.n_tracks, found.losses.notes) == (3, {MINUS_ONE: 20})


def test_ids_that_became_floats_are_whole_again_and_inexact_or_like_ones_are_refused(tmp_path):
    (seen,) = read(tmp_path, PLACES, abreast("1.0", "2.0", "")).detections.values()
    assert sorted({*seen.track_id}) == ["", "1", "2"]
    pa.parquet.write_table(columns(track_id=[1.0, 2.0] * (N // 2)), tmp_path / "t.parquet")
    assert {*read_named(tmp_path / "t.parquet").tracks.track_id.tolist()} == {1, 2}
    for other in ("a\0", "a "):
        with pytest.raises(RecordingError, match=r"NUL|more than spaces"):
            read(tmp_path, PLACES, abreast("a", other))


@pytest.mark.parametrize(("ours", "theirs"), [
    ("time_s", "timestamp_ms"), ("time_ns", "timestampMs"), ("time_ns", "Time [us]"), ("x_m", "pos_cm"),
    ("x_m", "x_ft"), ("speed_mps", "v_kmh"), ("speed_mps", "sog_kn"), ("course_rad", "cog_deg"),
    ("latitude_deg", "lat_rad"), ("time_s", "frame"), ("time_s", "Frame_ID"), ("time_s", "frameNumber"),
])  # fmt: skip
def test_a_renamed_column_whose_name_states_another_unit_is_refused(tmp_path, ours, theirs):
    names = ["time_s", "track_id", "x_m", "y_m", theirs]
    path = table(tmp_path, "\n".join([",".join(names), *(f"{k},a,{k},{k},{k}" for k in range(3))]))
    with pytest.raises(RecordingError, match=rf"expected column {ours}, got {re_escape(theirs)}"):
        read_named(path, columns={ours: theirs})


def test_a_column_of_absurd_speeds_is_refused_and_single_ones_are_derived(tmp_path):
    header, rows = f"{PLACES},course_rad,speed_mps", abreast("a", "b", n=30)
    with pytest.raises(RecordingError, match=r"expected speeds in m/s, got 1e\+300"):
        read(tmp_path, header, [f"{row},1.5,1e300" for row in rows])
    found = read(tmp_path, header, [f"{row},1.5,{'1e300' if k == 7 else 10}" for k, row in enumerate(rows)])
    np.testing.assert_allclose(found.tracks.speed, 10.0)
    assert "1 speeds above 1000 m/s are not used" in found.losses.faults


LONG = "x" * 50_000
PACKED = [
    ("t.csv.gz", lambda: gzip.compress(b"time_s,x_m,y_m\n") + 32 * gzip.compress(b"1,1,1\n" * (1 << 20))),
    ("t.parquet", lambda: pa.table(dict.fromkeys("abcdefghi", pa.array(np.zeros(10**6))))),
    ("t.feather", lambda: pa.table({"label": pa.DictionaryArray.from_arrays(np.zeros(2000, np.int32), [LONG])})),
    ("t.parquet", lambda: pa.table({"label": [LONG] * 2000})),
]


@pytest.mark.parametrize(("name", "make"), PACKED)
def test_a_small_file_that_becomes_much_is_refused_before_it_does(tmp_path, name, make):
    """Each would take some 100 MB, as could be any number; of refusing it no more than the budget is taken."""
    path, content = tmp_path / name, make()
    WRITERS.get(name, lambda data, to: to.write_bytes(data))(content, path)
    del content
    assert path.stat().st_size < budget.SMALL_BYTES // budget.MOST_TIMES
    before = pa.total_allocated_bytes()
    with pytest.raises(TableError, match=r"expected at most 64 MiB in memory of so small a file"):
        cells_of(path)
    assert pa.total_allocated_bytes() - before < budget.SMALL_BYTES


@pytest.mark.parametrize(
    ("second", "is_said"),
    [
        ({}, True), ({"late_s": 0.037, "noise_m": 0.1, "n_others": 3}, True), ({"noise_m": 1.0}, True),
        ({"aside_m": 1.5}, False),  # another beside it
        ({"behind_s": 2.0}, False),  # or behind it
        ({"aside_m": 0.3, "noise_m": 0.05, "n_others": 25}, False),  # two of a crowd
    ],
)  # fmt: skip
def test_one_vehicle_under_two_names_is_asked_about(tmp_path, caplog, second, is_said):
    of = {"late_s": 0.0, "behind_s": 0.0, "aside_m": 0.0, "noise_m": 0.0, "n_others": 0} | second
    seen_s, rows = 0.1 * np.arange(100), []

    def report(name, at_s, x, y):
        rows.extend(f"{t:.3f},{name},{a:.3f},{b:.3f}" for t, a, b in zip(at_s, x, y, strict=True))

    for i in range(of["n_others"]):
        report(i, seen_s, 9.0 * seen_s, np.full(100, 90.0 + 4.0 * i))
    off, late_s = 50.0 + of["noise_m"] * np.random.default_rng(0).standard_normal((4, 100)), seen_s + of["late_s"]
    report("a", seen_s, off[0] + 9.0 * seen_s, off[1])
    report("b", late_s, off[2] + 9.0 * (late_s - of["behind_s"]), off[3] + of["aside_m"])
    read_tracks(table(tmp_path, "\n".join([PLACES, *rows])))
    assert ("a and b are in one place whenever both are there" in caplog.text) == is_said
    assert len(caplog.messages) == is_said
