"""`dirprim convert`: tables as people have them become logs; what is not used is named, what is lost ends with 3."""

import gzip
import json
import math
from pathlib import Path

import pytest

from cli.commands import DONE, INPUT_LOST, USAGE, dirprim
from dirprim_filter import read_estimates, read_tracks
from dirprim_filter.detections import NO_ID
from dirprim_filter.recording.reader import stream_detections


def test_a_survey_becomes_a_log_with_labels(here, said):
    """A semicolon table of other names, compressed."""
    rows = [f"{name};{k};{east},5;{k};{what};7" for name, east, what in (("a", 3, "car"), ("b", 9, "bus"))
            for k in (0, 1)]  # fmt: skip
    table = "\n".join(["Id;t;Easting;Northing;class;Lane", *rows]).encode()
    Path("survey.csv.gz").write_bytes(gzip.compress(table))
    shown = said("convert survey.csv.gz -o s.mcap --columns track_id=Id,time_s=t,x_m=Easting,y_m=Northing")
    assert (shown.out, shown.err) == ("s.mcap: 2 tracks, 4 rows\n", "WARNING: survey.csv.gz: columns not used: Lane\n")
    assert read_tracks("s.mcap").position.tolist() == [[3.5, 0.0], [9.5, 0.0], [3.5, 1.0], [9.5, 1.0]]
    assert set(read_tracks("s.mcap", labels="car").track_id) == {"a"}
    assert "labels in /objects: bus 2, car 2" in said("info s.mcap").out


@pytest.mark.parametrize(
    ("columns", "row", "why"),
    [
        ("lat,lon", "113.5,22.{}", "both swapped"),
        ("lat,lon", "52000000{},13000000", "degrees times 1e7"),
        ("x_m,y_m,speed_mps", "{},0,-5", "with a negative speed"),
    ],
)  # fmt: skip
def test_a_table_of_which_nothing_is_good_becomes_no_log(here, refused, columns, row, why):
    Path("t.csv").write_text("\n".join([f"time_s,track_id,{columns}", *(f"{k},a,{row.format(k)}" for k in range(9))]))
    error = refused("convert t.csv -o t.mcap", why)
    assert error.startswith("error: t.csv: expected rows that are good, got none; left out: 9 rows ")
    assert not Path("t.mcap").exists()


def test_a_row_alone_in_time_is_reported_and_is_no_loss(here, said):
    Path("t.csv").write_text("time_s,track_id,x_m,y_m\n0,a,0,0\n1,a,1,0\n90,b,5,5\n")
    shown = said("convert t.csv -o t.mcap")
    assert shown.out == "t.mcap: 1 track, 2 rows\n"
    assert shown.err == "WARNING: t.csv: 1 rows alone in time, so that no velocity can be derived\n"


def test_detections_of_several_sensors_become_topics_that_tracking_reads(here, said):
    """Groups start at the same time; radar and lidar have no ids."""
    rows = [f"{group},{k},{sensor},{k},{group}"
            for group in (2, 3) for k in range(5) for sensor in ("radar", "lidar", "radar")]  # fmt: skip
    Path("t.csv").write_text("\n".join(["group,time_s,sensor,x_m,y_m", *rows]))
    assert said("convert t.csv -o t.mcap").out == "t.mcap: 20 detections of radar\nt.mcap: 10 detections of lidar\n"
    stream = stream_detections("t.mcap")
    frames = list(stream)
    assert stream.topics == {"/detections/radar", "/detections/lidar"}
    assert all(sorted(frame.group.tolist()) == [2] * 3 + [3] * 3 for frame in frames)
    assert len(frames) == 5
    assert set(frames[0].track_id.tolist()) == {NO_ID}
    assert sum(map(len, stream_detections("t.mcap", topics="/detections/radar", group=2))) == 10
    assert stream.losses.dropped == {}
    for asked in ({"topics": "/detections/radar"}, {"group": 2}, {"start_ns": 10**9 + 1}):
        of_log, of_table = (stream_detections(f"t.{name}", **asked) for name in ("mcap", "csv"))
        assert list(map(len, of_table)) == list(map(len, of_log)) != list(map(len, frames))
        assert of_table.topics == of_log.topics


def test_a_table_goes_where_a_log_does(here, said):
    """The same detections as a csv and as the log of it: tracked alike, and scored against a truth in a table."""
    rows = [(k / 10, 12 * math.cos(k / 15), 12 * math.sin(k / 15)) for k in range(20)]
    Path("seen.csv").write_text("\n".join(["time_s,sensor,x_m,y_m", *(f"{t},radar,{x},{y}" for t, x, y in rows)]))
    Path("truth.csv").write_text("\n".join(["time_s,track_id,x_m,y_m", *(f"{t},a,{x},{y}" for t, x, y in rows)]))
    assert dirprim("convert seen.csv -o seen.mcap") == DONE
    for source in ("csv", "mcap"):
        options = f"--map map.mcap --no-ids --noise 0.5 --particles 50 -o {source}.out"
        assert dirprim(f"track seen.{source} {options}") == DONE
    assert read_estimates("csv.out") == read_estimates("mcap.out")
    assert json.loads(said("score csv.out --truth truth.csv --json").out)["scores"][0]["report"]["rmse"] < 1.0


FCD = "<fcd-export>{}</fcd-export>"
STEP = '<timestep time="{}"><vehicle id="a" x="{}" y="0" angle="90" speed="5"/></timestep>'


@pytest.mark.parametrize(
    ("name", "text", "form"),
    [
        ("zara.txt", "\n".join(f"{10 * k} 1 {2 * k} 0.0" for k in range(40)), "trajnet,frames_per_second=25"),
        ("annotations.txt", "\n".join(f'1 {40 * k} 0 {40 * k} 0 {12 * k} 0 0 0 "Cart"' for k in range(40)),
         "sdd,metres_per_pixel=0.05"),
        ("east.tsv", "t\tId\tE\ty_m\n" + "\n".join(f"{0.4 * k:.1f}\t1\t{2 * k}\t0" for k in range(40)),
         "csv,time_s=t,track_id=Id,x_m=E"),
        ("fcd.xml", FCD.format("".join(STEP.format(round(0.4 * k, 1), 2 * k) for k in range(40))), ""),
    ],
)  # fmt: skip
def test_a_data_set_goes_where_a_log_does(here, said, refused, *, name, text, form):
    """It is named by its file's end or by one setting, the same for all commands and for Python."""
    Path(name).write_text(text)
    stated = f"--set format={form}" if form else ""
    tracks = read_tracks(name, format=form or None)
    assert tracks.position[:, 0].tolist() == [2.0 * k for k in range(40)]
    assert tracks.time_ns.tolist() == [400_000_000 * k for k in range(40)]
    assert json.loads(said(f"info {name} --json {stated}").out)["messages"] == 40
    assert dirprim(f"learn {name} -o new.mcap --tessellation grid --cell-size 8 {stated}") == DONE
    assert dirprim(f"track {name} --map new.mcap -o out.mcap --particles 20 {stated}") == DONE
    assert len(read_estimates("out.mcap")) >= 39
    assert dirprim(f"store add fleet {name} {stated}") == DONE
    assert dirprim(f"view {name} --save out.rrd {stated}") == DONE
    if form:
        assert dirprim(f"learn log.mcap -o x --set format={form}") == USAGE
        refused(f"info {name}", name)
        assert refused(f"info {name} --set format={form.replace('=', '=x')}", "").startswith("error: ")


def test_info_says_of_a_table_what_it_says_of_its_log(here, said):
    """Rows, vehicles, span, labels, and speeds of km/h; and which columns are used, and the row that is not."""
    rows = [f"{k},{name},{k * 10},{north},36,car,2" for north, name in enumerate("abc") for k in range(30)]
    Path("t.csv").write_text("\n".join(["time_s,track_id,x_m,y_m,speed_mps,label,lane", *rows]))
    assert dirprim("convert t.csv -o t.mcap") == DONE
    table, log = (json.loads(said(f"info {name} --json --topics /objects").out) for name in ("t.csv", "t.mcap"))
    assert (table["topics"][0]["tracks"], table["messages"]) == (3, 90)
    assert log["faults"] == []  # of derived speeds
    assert "are they in km/h in place of m/s" in table["faults"][0]
    assert all(table[name] == log[name] for name in ("start_ns", "end_ns", "damage", "labels", "groups"))
    Path("t.csv").write_text(Path("t.csv").read_text() + "\n,a,0,0,36,car,2")
    shown = said("info t.csv", code=INPUT_LOST).out
    assert shown.startswith("t.csv: 90 rows, 29.0 s from 0 ns\n  columns: time_s, track_id, x_m, y_m, ")
    assert "label; not used: lane\n" in shown
    assert "left out 1 rows with a number that is missing" in shown
