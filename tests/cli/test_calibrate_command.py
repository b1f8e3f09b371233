"""`dirprim calibrate`, the sensor's file, and the sensor that `dirprim track` goes by."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.commands import DONE, dirprim
from dirprim_filter import Detections, learn_primitives, read_estimates, save_map, write_tracks
from dirprim_filter.evaluation.calibration import self_calibration
from dirprim_filter.recording.sensor_file import load_sensor, save_sensor
from evaluation.test_calibration import BIASED, TRUTH
from sensing import sense
from situations import beside

TRACK = "track log.mcap --map map.mcap --particles 20 -o out"
OTHER = "[across]\nspread_m = 1"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with what a sensor reported of traffic, and a map of it; to be read."""
    folder, coarse = tmp_path_factory.mktemp("files"), {"tessellation": "grid", "cell_size": 40.0}
    write_tracks(TRUTH, folder / "log.mcap", detections=sense(TRUTH, BIASED, rng=np.random.default_rng(1)))
    save_map(learn_primitives(TRUTH, rng=np.random.default_rng(0), **coarse), folder / "map.mcap")
    return folder


@pytest.fixture
def rough(monkeypatch):
    """A sensor learned in a few steps: how near it comes is not looked at."""
    monkeypatch.setattr(self_calibration, "MOST_STEPS", 5)


@pytest.mark.slow
def test_a_log_is_calibrated(here, said):
    shown = said("calibrate log.mcap --truth log.mcap -o sensor.toml").out
    assert "latency_s" in shown
    assert "of 15 true vehicles" in shown
    assert load_sensor("sensor.toml").latency_s == pytest.approx(0.3, abs=0.03)


def test_a_sensor_file_reads_as_it_was_written(tmp_path):
    for sensor in (BIASED, replace(BIASED, uncertainty={"along.bias_m": 0.1})):
        save_sensor(sensor, tmp_path / "sensor.toml", force=True)
        assert load_sensor(tmp_path / "sensor.toml") == sensor


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (f"[along]\nspread_m = -0.5\n{OTHER}", "along: spread_m: expected a positive number, got -0.5"),
        (f"colour = 3\n[along]\nspread_m = 1\n{OTHER}", "colour: expected one of along"),
        (f"[along]\nspread_m = 1\nhue = 1\n{OTHER}", "along: hue: expected one of spread_m"),
        (f"latency_s = -1\n[along]\nspread_m = 1\n{OTHER}", "latency_s: expected 0 to 5 seconds"),
        (f"[along]\nspread_m = nan\n{OTHER}", "spread_m: expected a positive number"),
        (f"[along]\nspread_m = 1\nbias_m = inf\n{OTHER}", "along: bias_m: expected a number of metres, got inf"),
        (f"[along]\nspread_m = 1\n{OTHER}\n[uncertainty]\nhue = 1", "uncertainty: hue: expected one of"),
        (f"[along]\nspread_m = 1\n{OTHER}\n[uncertainty]\nlatency_s = -1", "latency_s: expected at least 0, got -1"),
        ("[along]\nspread_m = 1", "across: expected a value, got none"),
        (f'[along]\nspread_m = "1"\n{OTHER}', "along: spread_m: expected a value of type float"),
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


@pytest.mark.usefixtures("rough")
@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--end 2", "sensor, learned from "),
        ("--end 2 --sensor auto", "sensor, learned from "),
        ("--end 2 --noise 1", None),
        ("--end 2 --config own.toml", None),
        ("--end 1 --set fields=stated", None),
        ("--end 0.6", "noise: 0.5 m, unless the log states it: expected at least 8 pieces of track"),
        ("--end 2 --no-ids", "sensor, learned from "),
    ],
)
def test_where_no_noise_is_stated_it_is_learned_from_the_log_which_is_tracked_whole(options, says, here, said):
    Path("own.toml").write_text("[filter]\nn_particles = 20\n")
    if "stated" in options:  # by the log
        seen = sense(TRUTH, BIASED, rng=np.random.default_rng(1))
        stated = replace(seen, covariance=np.tile(np.eye(2), (len(seen), 1, 1)))
        write_tracks(TRUTH, "log.mcap", detections=stated, force=True)
    lines = said(f"{TRACK} {options.removesuffix('--set fields=stated')}").out.splitlines()
    assert lines[0].startswith(says) if says else not lines[0].startswith(("sensor", "noise"))
    if says == "sensor, learned from ":
        assert {line.split()[0] for line in lines if " m" in line} >= {"along.spread_m", "across.spread_m"}
        assert not any(line.startswith(("latency_s", "along.bias_m")) for line in lines)
        assert any(line.startswith("not known: latency_s, along.bias_m, across.bias_m") for line in lines)
        counted = {"detection_probability", "clutter_density", "birth_density"} & {line.split()[0] for line in lines}
        assert len(counted) == 3 * ("--no-ids" in options)
        assert read_estimates("out").time_ns.min() <= TRUTH.time_ns.min() + 500_000_000  # what was learned from too


def test_a_log_is_tracked_by_a_sensor_file(here):
    save_sensor(BIASED, "sensor.toml")
    rmse = []
    for options in ("--noise 1", "--sensor sensor.toml"):
        assert dirprim(f"{TRACK} --force --particles 200 --end 3 {options}") == DONE
        found = read_estimates("out")
        here, there = beside(found, TRUTH)
        away = found.position[here] - TRUTH.position[there]
        rmse.append(np.sqrt((away**2).sum(axis=1).mean()))
    assert rmse[1] < 0.8 * rmse[0]


@pytest.mark.parametrize("states", ["user", "log", "nobody"])
def test_without_ids_misses_and_clutter_are_learned_whoever_states_the_noise(states, here, said, monkeypatch):
    """Thirty false detections a frame; before anything was learned of them, all of them were taken for vehicles."""
    monkeypatch.setattr(self_calibration, "MOST_PIECES", 9)  # noise is learned from fewer than there are
    rng = np.random.default_rng(0)
    seen = sense(TRUTH, replace(BIASED, detection_probability=0.7), rng=rng)
    frames, low, high = np.unique(seen.time_ns), seen.position.min(axis=0), seen.position.max(axis=0)
    false = replace(
        seen[rng.integers(0, len(seen), 30 * frames.size)], time_ns=np.repeat(frames, 30),
        position=rng.uniform(low, high, (30 * frames.size, 2)),
    )  # fmt: skip
    both = Detections.concatenate([seen, false]).without_ids()
    if states == "log":
        both = replace(both, covariance=np.tile(np.eye(2), (len(both), 1, 1)))
    write_tracks(TRUTH[:0], "log.mcap", detections=both, force=True)
    options = "--particles 100" + " --noise 1" * (states == "user")
    shown = said(f"track log.mcap --no-ids --end 2.5 -o out {options}")
    assert shown.out.startswith("sensor, learned from " if states == "nobody" else "scene, learned from ")
    n_true = int(shown.out.partition(" detections without ids, ")[2].split()[0])
    assert n_true == pytest.approx((seen.time_ns - seen.time_ns.min() < 2.5e9).sum(), rel=0.2)
    assert "no estimate" not in shown.err  # though most are of no vehicle
    found = read_estimates("out")
    assert len(np.unique(found.track_id)) < 2 * TRUTH.n_tracks
