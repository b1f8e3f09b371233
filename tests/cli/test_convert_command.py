"""`dirprim convert`: tables as people have them become logs; what is not used is named, what is lost ends with 3."""

import gzip
import json
import math

import pytest

from dirprim_filter import read_estimates, read_tracks, save_map
from dirprim_filter.cli.main import run
from dirprim_filter.detections import NO_ID
from dirprim_filter.recording.reader import stream_detections

DONE, USAGE, INPUT_LOST = 0, 2, 3


def convert(*arguments):
    return run(["convert", *map(str, arguments)])


@pytest.fixture
def survey(tmp_path):
    """A semicolon table of other names, compressed."""
    rows = [
        f"{name};{k};{east},5;{k};{what};7" for name, east, what in (("a", 3, "car"), ("b", 9, "bus")) for k in (0, 1)
    ]
    path = tmp_path / "survey.csv.gz"
    path.write_bytes(gzip.compress("\n".join(["Id;t;Easting;Northing;class;Lane", *rows]).encode()))
    return path


def test_a_survey_becomes_a_log_with_labels(survey, tmp_path, capsys):
    log = tmp_path / "log.mcap"
    names = "track_id=Id,time_s=t,x_m=Easting,y_m=Northing"
    assert convert(survey, "-o", log, "--columns", names) == DONE
    said = capsys.readouterr()
    assert said.out == f"{log}: 2 tracks, 4 rows\n"
    assert said.err == f"{survey}: columns not used: Lane\n"
    assert read_tracks(log).position.tolist() == [[3.5, 0.0], [9.5, 0.0], [3.5, 1.0], [9.5, 1.0]]
    assert set(read_tracks(log, labels="car").track_id) == {"a"}
    assert run(["info", str(log)]) == DONE
    assert "labels in /objects: bus 2, car 2" in capsys.readouterr().out


def test_a_mapping_is_for_csv(survey, tmp_path, capsys):
    options = ("--format", "sumo-fcd", "--columns", "x_m=x")
    assert convert(survey, "-o", tmp_path / "log.mcap", *options) == USAGE
    assert "it is for csv" in " ".join(capsys.readouterr().err.split())


def test_a_row_alone_in_time_is_reported_and_is_a_loss(tmp_path, capsys):
    table, log = tmp_path / "t.csv", tmp_path / "log.mcap"
    table.write_text("time_s,track_id,x_m,y_m\n0,a,0,0\n1,a,1,0\n90,b,5,5\n")
    assert convert(table, "-o", log) == INPUT_LOST
    said = capsys.readouterr()
    assert said.out == f"{log}: 1 track, 2 rows\n"
    assert f"\n{table}: dropped 1 row: alone in time, so that no velocity can be derived\n" in said.err
    with table.open("a") as more:
        more.write("91,a,nan,0\n")
    assert convert(table, "-o", log, "--force") == INPUT_LOST


def test_detections_of_several_sensors_become_topics_that_tracking_reads(tmp_path, capsys):
    """Groups start at the same time; radar and lidar have no ids."""
    table, log = tmp_path / "t.csv", tmp_path / "log.mcap"
    rows = [
        f"{group},{k},{sensor},{k},{group}"
        for group in (2, 3)
        for k in range(5)
        for sensor in ("radar", "lidar", "radar")
    ]
    table.write_text("\n".join(["group,time_s,sensor,x_m,y_m", *rows]))
    assert convert(table, "-o", log) == DONE
    assert capsys.readouterr().out == f"{log}: 20 detections of radar\n{log}: 10 detections of lidar\n"
    stream = stream_detections(log)
    frames = list(stream)
    assert stream.topics == {"/detections/radar", "/detections/lidar"}
    assert [len(frame) for frame in frames] == [6] * 5
    assert all(sorted(frame.group.tolist()) == [2] * 3 + [3] * 3 for frame in frames)
    assert set(frames[0].track_id.tolist()) == {NO_ID}
    assert sum(map(len, stream_detections(log, topics="/detections/radar", group=2))) == 10
    assert stream.losses.dropped == {}


def test_a_time_before_the_epoch_names_the_file_and_the_way_out(tmp_path, capsys):
    table = tmp_path / "t.csv"
    table.write_text("time_s,track_id,x_m,y_m\n-5,a,0,0\n-4,a,1,0\n")
    assert convert(table, "-o", tmp_path / "log.mcap") == 1
    said = capsys.readouterr().err
    assert f"{tmp_path / 'log.mcap'}: expected times from 0 ns on" in said
    assert "shift all times of the input by as many seconds" in said


@pytest.mark.parametrize("options", [("--noise", "0"), ("--noise", "-1"), ("--forecast", "-3")])
def test_a_number_out_of_range_is_named_as_its_option(options, tmp_path, capsys):
    (tmp_path / "m").touch()
    (tmp_path / "l").touch()
    given = ("track", tmp_path / "l", "--map", tmp_path / "m", "-o", tmp_path / "o", *options)
    assert run([*map(str, given)]) == USAGE
    assert f"Invalid value for '{options[0]}'" in capsys.readouterr().err


def test_a_table_goes_where_a_log_does(ring_map, tmp_path, capsys):
    """The same detections as a csv and as the log of it: tracked alike, and scored against a truth in a table."""
    save_map(ring_map, tmp_path / "map.mcap")
    seen, truth = tmp_path / "seen.csv", tmp_path / "truth.csv"
    rows = [(k / 10, 12 * math.cos(k / 15), 12 * math.sin(k / 15)) for k in range(40)]
    seen.write_text("\n".join(["time_s,sensor,x_m,y_m", *(f"{t},radar,{x},{y}" for t, x, y in rows)]))
    truth.write_text("\n".join(["time_s,track_id,x_m,y_m", *(f"{t},a,{x},{y}" for t, x, y in rows)]))
    assert convert(seen, "-o", tmp_path / "seen.mcap") == DONE
    outputs = []
    for source in (seen, tmp_path / "seen.mcap"):
        out = source.with_name(f"{source.name}.tracked")
        options = ("--map", tmp_path / "map.mcap", "--no-ids", "--particles", "200", "-o", out)
        assert run(["track", str(source), *map(str, options)]) == DONE
        outputs.append(read_estimates(out))
    assert outputs[0] == outputs[1]
    assert len(outputs[0]) > 0
    capsys.readouterr()
    assert run(["score", str(out), "--truth", str(truth), "--json"]) == DONE
    assert json.loads(capsys.readouterr().out)["scores"][0]["report"]["rmse"] < 1.0
