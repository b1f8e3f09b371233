"""`dirprim calibrate`, the sensor file, and JSON detections: measured, written, read again, and refused in one line."""

import json
from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter import learn_primitives, read_estimates, read_tracks, save_map, write_tracks
from dirprim_filter.cli.main import run
from dirprim_filter.evaluation.calibration import self_calibration
from dirprim_filter.recording.sensor_file import load_sensor, save_sensor
from dirprim_filter.recording.transforms.geodesy import Origin, on_plane
from dirprim_filter.simulation.sensor import sense
from evaluation.test_calibration import BIASED, TRUTH

DONE, FAILED, USAGE, LOST = 0, 1, 2, 3
FIELDS = "time_s=.timestamp,id=.objs[].id,latitude=.objs[].lat,longitude=.objs[].lon,label=.objs[].classType"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("calibrate") / "log.mcap"
    write_tracks(TRUTH, path, detections=sense(TRUTH, BIASED, rng=np.random.default_rng(1)))
    return path


@pytest.fixture(scope="module")
def where(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "map.mcap"
    save_map(learn_primitives(TRUTH, tessellation="grid", cell_size=40.0, rng=np.random.default_rng(0)), path)
    return path


@pytest.fixture
def rough(monkeypatch):
    """A sensor learned in a few steps: how near it comes is not looked at."""
    monkeypatch.setattr(self_calibration, "MOST_STEPS", 5)


def test_a_log_is_calibrated(log, tmp_path, capsys):
    sensor = tmp_path / "sensor.toml"
    assert run(["calibrate", str(log), "--truth", str(log), "-o", str(sensor)]) == DONE
    said = capsys.readouterr().out
    assert "latency_s" in said
    assert "of 15 true vehicles" in said
    assert load_sensor(sensor).latency_s == pytest.approx(0.3, abs=0.03)


def test_a_sensor_file_reads_as_it_was_written(tmp_path):
    path = tmp_path / "sensor.toml"
    save_sensor(BIASED, path)
    assert load_sensor(path) == BIASED


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[along]\nspread_m = -0.5\n[across]\nspread_m = 1", "along: spread_m: expected a positive number of metres"),
        ("colour = 3\n[along]\nspread_m = 1\n[across]\nspread_m = 1", "colour: expected one of along"),
        ("[along]\nspread_m = 1\nhue = 1\n[across]\nspread_m = 1", "along: hue: expected one of spread_m"),
        ("latency_s = -1\n[along]\nspread_m = 1\n[across]\nspread_m = 1", "latency_s: expected 0 to 5 seconds"),
        ("[along]\nspread_m = nan\n[across]\nspread_m = 1", "spread_m: expected a positive number"),
        ("[along]\nspread_m = 1", "across: expected a table with spread_m"),
        ('[along]\nspread_m = "1"\n[across]\nspread_m = 1', "along: spread_m: expected a number"),
        ("[along", "sensor.toml"),
    ],
)
def test_a_bad_sensor_file_is_one_line(text, says, tmp_path):
    path = tmp_path / "sensor.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"sensor\.toml") as error:
        load_sensor(path)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def frame(k):
    objects = [{"id": "7", "classType": "2", "lat": 42.3 + 1e-6 * k, "lon": -83.7}]
    return {"timestamp": 1688680146.5 + 0.1 * k, "objs": objects}


@pytest.mark.parametrize("lines", [False, True], ids=["array", "lines"])
def test_json_frames_become_a_log(lines, tmp_path):
    pytest.importorskip("pyproj")
    source, out = tmp_path / "dets.json", tmp_path / "dets.mcap"
    frames = [frame(k) for k in range(3)] + [{"timestamp": 1688680147.0, "objs": []}]
    source.write_text("\n".join(map(json.dumps, frames)) if lines else json.dumps(frames))
    options = ["--format", "json", "--fields", FIELDS, "--origin", "42.3,-83.7"]
    assert run(["convert", str(source), "-o", str(out), *options]) == DONE
    tracks = read_tracks(out, labels="2")
    assert tracks.track_id.tolist() == [7, 7, 7]
    assert tracks.time_ns[0] == 1688680146_500000000
    north = on_plane(Origin(42.3, -83.7), np.array([[-83.7, 42.3 + 2e-6, 0.0]]))[0, :2]
    np.testing.assert_allclose(tracks.position[2], north, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "fields", "says"),
    [
        ("{nonsense", FIELDS, "line 1: expected JSON"),
        ("[]", FIELDS, "expected objects at"),
        (json.dumps([frame(0)]), FIELDS.replace("time_s=.timestamp,", ""), "expected time= or time_s="),
        (json.dumps([frame(0)]), FIELDS.replace("latitude=.objs[].lat,", ""), "expected x= and y= at least, or"),
    ],
)
def test_what_is_no_such_json_is_one_line(text, fields, says, tmp_path, capsys):
    source = tmp_path / "dets.json"
    source.write_text(text)
    options = ["--format", "json", "--fields", fields]
    assert run(["convert", str(source), "-o", str(tmp_path / "o.mcap"), *options]) == FAILED
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1


@pytest.mark.usefixtures("rough")
def test_a_log_tells_of_its_own_sensor_what_can_be_seen(log, where, tmp_path, capsys):
    out = tmp_path / "out.mcap"
    command = ["track", str(log), "--map", str(where), "--particles", "50", "--end", "2"]
    assert run([*command, "-o", str(out), "--sensor", "auto"]) == DONE
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("sensor, learned from ")
    assert said[0].endswith("pieces of track")
    assert {line.split()[0] for line in said if " m" in line} >= {"along.spread_m", "across.spread_m"}
    assert not any(line.startswith(("latency_s", "along.bias_m")) for line in said)
    assert any(line.startswith("not known: latency_s, along.bias_m, across.bias_m") for line in said)
    assert len(read_estimates(out)) > 100


@pytest.mark.usefixtures("rough")
@pytest.mark.parametrize(
    "case",
    [
        (["--end", "2"], "sensor, learned from "),
        (["--end", "2", "--noise", "1"], None),
        (["--end", "2", "--config", "knobs.toml"], None),
        (["--end", "0.6"], "noise: 0.5 m, unless the log states it: expected at least 8 pieces of track"),
        (["--end", "0.6", "--no-ids"], "noise: 0.5 m, unless the log states it: without ids"),
    ],
)
def test_where_no_noise_is_stated_it_is_learned_from_the_log(case, log, where, tmp_path, capsys):
    knobs = tmp_path / "knobs.toml"
    knobs.write_text("[filter]\nn_particles = 20\n")
    options, says = [str(knobs) if option == knobs.name else option for option in case[0]], case[1]
    command = ["track", str(log), "--map", str(where), "--particles", "20", "-o", str(tmp_path / "out.mcap")]
    assert run([*command, *options]) == DONE
    said = capsys.readouterr().out
    assert said.startswith(says) if says else not said.startswith(("sensor", "noise"))


def test_a_damaged_log_whose_noise_is_learned_warns_once(log, where, tmp_path, capfd):
    torn = bytearray(log.read_bytes())
    torn[len(torn) // 2 : len(torn) // 2 + 500] = bytes(500)
    (tmp_path / "torn.mcap").write_bytes(torn)
    command = ["track", str(tmp_path / "torn.mcap"), "--map", str(where), "--particles", "20"]
    assert run([*command, "-o", str(tmp_path / "out.mcap")]) == LOST
    assert capfd.readouterr().err.count("damaged, the rest is read") == 1


def test_noise_that_the_log_states_is_not_learned(where, tmp_path, capsys):
    seen = sense(TRUTH, BIASED, rng=np.random.default_rng(1))
    stated = replace(seen, covariance=np.tile(np.eye(2), (len(seen), 1, 1)))
    write_tracks(TRUTH, tmp_path / "log.mcap", detections=stated)
    command = ["track", str(tmp_path / "log.mcap"), "--map", str(where), "--particles", "20", "--end", "1"]
    assert run([*command, "-o", str(tmp_path / "out.mcap")]) == DONE
    assert not capsys.readouterr().out.startswith(("sensor", "noise"))


def test_a_log_is_tracked_by_a_sensor_file(log, where, tmp_path, capsys):
    sensor = tmp_path / "sensor.toml"
    save_sensor(BIASED, sensor)
    command = ["track", str(log), "--map", str(where), "--particles", "200", "--end", "3"]
    assert run([*command, "-o", str(tmp_path / "plain.mcap")]) == DONE
    assert run([*command, "-o", str(tmp_path / "sensed.mcap"), "--sensor", str(sensor)]) == DONE
    truth = {(str(n), t): x for n, t, x in zip(TRUTH.track_id, TRUTH.time_ns.tolist(), TRUTH.position, strict=True)}
    rmse = []
    for name in ("plain", "sensed"):
        reported = read_estimates(tmp_path / f"{name}.mcap")
        keys = zip(reported.track_id.tolist(), reported.time_ns.tolist(), strict=True)
        away = np.array([reported.position[i] - truth[key] for i, key in enumerate(keys) if key in truth])
        rmse.append(np.sqrt((away**2).sum(axis=1).mean()))
    assert rmse[1] < 0.8 * rmse[0]
    capsys.readouterr()
    assert run([*command, "-o", str(tmp_path / "both.mcap"), "--sensor", str(sensor), "--noise", "1"]) == USAGE
    assert run([*command, "-o", str(tmp_path / "absent.mcap"), "--sensor", "absent.toml"]) == USAGE
    assert run([*command, "-o", str(tmp_path / "nameless.mcap"), "--sensor", "auto", "--no-ids"]) == USAGE
    short = ["--end", "0.6"]
    capsys.readouterr()
    assert run([*command, "-o", str(tmp_path / "short.mcap"), "--sensor", "auto", *short]) == FAILED
    assert "--sensor auto: expected at least 8 pieces of track" in capsys.readouterr().err
    sensor.write_text("latency_s = -1\n[along]\nspread_m = 1\n[across]\nspread_m = 1\n")
    assert run([*command, "-o", str(tmp_path / "bad.mcap"), "--sensor", str(sensor)]) == FAILED
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"error: {sensor}: latency_s: expected 0 to 5 seconds")
