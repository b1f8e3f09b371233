"""`dirprim track`: what vehicles move by, their map and their signals, and what it says of a log it hardly tracks."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.commands import DONE, INPUT_LOST, dirprim
from dirprim_filter import learn_primitives, load_map, read_estimates, save_map, write_tracks
from dirprim_filter.cli.results import metadata_of
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateList
from dirprim_filter.evaluation.without_map import acceleration_of, background_motion
from dirprim_filter.filtering import ConstantVelocityKalman, GroupTracker
from dirprim_filter.filtering.smoother import Smoother
from dirprim_filter.recording.reader import stream_detections
from dirprim_filter.recording.scan import scan
from dirprim_filter.replay import replay
from situations import junction_traffic, keys, ring_traffic
from test_refining import other_tracker

RUN = "track log.mcap -o out.mcap --noise 0.5 --particles 50 --force"


@pytest.fixture
def motion(said):
    """Runs a command; -> what it says of its motion, the line's beginning taken off."""

    def run(command):
        lines = [line for line in said(command).out.splitlines() if line.startswith("motion: ")]
        assert len(lines) <= 1
        return lines[0].removeprefix("motion: ") if lines else ""

    return run


def test_without_a_map_vehicles_move_as_those_of_the_log_do_anywhere(here, motion):
    assert motion(f"{RUN} --forecast 1") == "as 6 vehicles of the log's first minutes move anywhere"
    found = read_estimates("out.mcap")
    assert np.unique(found.track_id).size == 6
    assert found.effective_sample_size.max() > 1  # of particles
    assert motion(f"{RUN} --map map.mcap") == ""


OF_OWN_TRACKS = "8 m2/s3, fitted to tracks of the log's first minutes, without ids"


@pytest.mark.parametrize(
    ("options", "noise"),
    [
        ("--no-ids --end 2.5", OF_OWN_TRACKS), ("--motion constant-velocity --no-ids --end 2.5", OF_OWN_TRACKS),
        ("--set acceleration_density=0.3", "0.3 m2/s3, as stated"),
        ("--map map.mcap --motion constant-velocity --set acceleration_density=2", "2 m2/s3, as stated"),
    ],
)  # fmt: skip
def test_else_they_go_straight_on_with_a_noise_that_a_line_states(here, motion, options, noise):
    assert motion(f"{RUN} {options}") == f"straight on, but for white acceleration of {noise}"
    assert (read_estimates("out.mcap").effective_sample_size == 1).all()
    assert float(metadata_of(Path("out.mcap"))["acceleration_density"]) == pytest.approx(float(noise.split()[0]))


def test_constant_velocity_is_the_kalman_filter_that_python_and_experiments_use(here, motion):
    said = motion(f"{RUN} --motion constant-velocity --rate 20 --smooth")
    assert "fitted to 6 vehicles of the log's first minutes" in said
    config, seen = FilterConfig(n_particles=50, noise_m=0.5), list(stream_detections("log.mcap"))
    density = acceleration_of(Detections.concatenate(seen), config, rng=np.random.default_rng(0))
    filtered, smoothed = EstimateList(), EstimateList()
    smoother = Smoother(sinks=[smoothed.write])
    tracker = GroupTracker(lambda group: smoother.tracker(
        group, ConstantVelocityKalman(acceleration_density=density, config=config), config=config,
        rng=np.random.default_rng(0),
    ))  # fmt: skip
    with smoother:
        replay(seen, tracker, [filtered, smoother], rate_hz=20.0)
    assert read_estimates("out.mcap") == filtered.all()
    found, expected = read_estimates("out.mcap", smoothed=True), smoothed.all()
    assert keys(found) == keys(expected)
    np.testing.assert_array_equal(found.position, expected.position)
    assert json.loads(metadata_of(Path("out.mcap"))["acceleration_density"]) == density


def test_the_tracks_of_another_tracker_are_refined_by_each(here, motion):
    assert dirprim(f"{RUN} --motion constant-velocity") == DONE
    assert dirprim("export out.mcap -o theirs.csv") == DONE
    for options in ("", "--motion constant-velocity", "--map map.mcap --motion constant-velocity"):
        moved = motion(f"smooth theirs.csv -o refined.mcap --force --particles 50 {options}")
        assert moved.startswith("straight on" if options else "as 6 vehicles")
        assert len(read_estimates("refined.mcap")) == len(read_estimates("out.mcap"))


def test_the_noise_of_a_sensor_that_looks_each_ten_seconds_is_learned_from_as_many_rows_as_it_takes(here, said):
    """Three boats have 93 rows in the first minutes: a thousand show their 20 m, which had been taken for 0.5 m."""
    rng, seconds = np.random.default_rng(0), 10 * np.arange(120)
    lines = [f"{t},{n},{6 * t + rng.normal(0, 20)},{900 * n + rng.normal(0, 20)}" for t in seconds for n in (1, 2, 3)]
    Path("boats.csv").write_text("\n".join(["time_s,track_id,x_m,y_m", *lines]))
    shown = said("track boats.csv -o boats.mcap --particles 50")
    spread = [float(line.split()[1]) for line in shown.out.splitlines() if ".spread_m" in line]
    assert spread == pytest.approx([20.0, 20.0], rel=0.2)
    assert "reinitialised" not in shown.err


def test_python_learns_the_same_motion_of_no_place(few):
    made = [background_motion(of, rng=np.random.default_rng(0)) for of in (few, Detections.of(few))]
    assert [one.tessellation.n_cells for one in made] == [0, 0]
    speed = [one.sample(np.zeros((2000, 2)), rng=np.random.default_rng(1))[1].mean() for one in made]
    np.testing.assert_allclose(speed, few.speed.mean(), rtol=0.1)
    with pytest.raises(ValueError, match="tracks: expected"):
        background_motion(Detections.of(few).without_ids(), rng=np.random.default_rng(0))


def test_a_table_of_tracks_is_refined_and_scored_before_and_after(here, said):
    truth = ring_traffic(np.random.default_rng(3), n_vehicles=4, n_rows=60)
    rows, measured = other_tracker(truth, seed=0)
    write_tracks(truth, "truth.mcap")
    lines = [f"{n},{t},{x},{y}" for n, t, (x, y) in zip(rows.track_id, rows.time_ns, rows.position, strict=True)]
    Path("theirs.csv").write_text("\n".join(["track_id,time_ns,x_m,y_m", *lines]))
    shown = said("smooth theirs.csv --map map.mcap -o out.mcap --particles 200 --truth truth.mcap").out
    assert f"from {measured.sum()} measured rows of {len(rows)}" in shown
    before, after = map(float, next(row for row in shown.splitlines() if "RMSE, m" in row).split()[2:])
    assert after < before
    assert len(read_estimates("out.mcap")) == len(rows)
    assert dirprim("smooth theirs.csv --map map.mcap -o rated.mcap --particles 200 --rate 30") == DONE
    assert len(read_estimates("rated.mcap")) > 2 * len(rows)


SEEN_S, UNTIL_S = 2.2, 5.6
"""The vehicle is seen until it is some metres before the junction; a second one, far behind, goes on being seen."""


@pytest.fixture
def junction(tmp_path, monkeypatch):
    """The working folder, with the map of a junction whose vehicles turn either way or go straight on."""
    monkeypatch.chdir(tmp_path)
    traffic = junction_traffic(np.random.default_rng(0))
    save_map(learn_primitives(traffic, tessellation="grid", cell_size=8.0, rng=np.random.default_rng(0)), "map.mcap")


def write_table(name, signal):
    lines = ["time_s,track_id,x_m,y_m,turn_signal"]
    for t in np.arange(0.0, UNTIL_S, 0.1):
        if t <= SEEN_S:
            lines.append(f"{t:.1f},ahead,{10 * t:.3f},0,{signal if t > 1.0 else ''}")
        lines.append(f"{t:.1f},behind,{-30 + 4 * t:.3f},0,none")
    Path(name).write_text("\n".join(lines) + "\n")


def test_the_signal_of_a_table_moves_the_vehicle_to_its_side(junction):
    north = {}  # metres, the mean place of the unseen vehicle some seconds later
    for signal in ("left", "none", "right", ""):
        write_table("t.csv", signal)
        command = "track t.csv --map map.mcap -o out --noise 0.3 --particles 2000 --set clutter_density=1e-9 --force"
        assert dirprim(command) == DONE
        found = read_estimates("out")
        north[signal] = found.position[(found.track_id == "ahead") & (found.unseen_s > 3.2)][0, 1]
    assert north["left"] > north["none"] + 0.8
    assert north["right"] < north["none"] - 0.8
    assert north["none"] == north[""]


def test_signals_are_read_as_they_stand_and_nothing_else_is_one(tmp_path):
    write_table(tmp_path / "a.csv", "LEFT ")
    assert dirprim("convert", tmp_path / "a.csv", "-o", tmp_path / "a.mcap") == DONE
    seen = list(stream_detections(tmp_path / "a.mcap"))
    signals = {name: {tuple(row) for frame in seen for row in frame.cue[frame.track_id == name] if row[1] > 0}
               for name in ("ahead", "behind")}  # fmt: skip
    assert signals == {"ahead": {(np.pi / 2, 2.5)}, "behind": set()}


MAP = "--map map.mcap -o out"
TRACK = f"{MAP} --noise 0.5 --particles 50 --force"


def test_a_map_of_another_place_is_refused_before_the_work(here, few, said, refused):
    write_tracks(replace(few, position=few.position + 1e5), "far.mcap")
    expected = "map.mcap: expected a map of the log's place, got one with 100.0% of the rows outside: those of far.mcap"
    for command in (f"track far.mcap {TRACK}", "evaluate tracking far.mcap --map map.mcap", f"smooth far.mcap {MAP}"):
        refused(command, f"{expected} lie in x 99")
        assert not Path("out").exists()
    assert ", 100.0% outside the map" in said(f"track far.mcap {TRACK} --set without_map=true").out


@pytest.mark.parametrize("shift", [0.0, 15.0, 35.0])
def test_a_log_mostly_outside_of_the_map_is_asked_about(here, few, capsys, shift):
    """A ring of 20 m, moved: the warning comes with more than half of the rows outside, and only then."""
    moved = replace(few, position=few.position + np.array([shift, 0.0]))
    write_tracks(moved, "moved.mcap")
    outside = float((load_map("map.mcap").tessellation.cell_of(moved.position) < 0).mean())
    assert outside < 1.0
    assert dirprim(f"track moved.mcap {TRACK}") in (DONE, INPUT_LOST)
    shown = capsys.readouterr()
    assert f", {outside:.1%} outside the map" in shown.out
    asked = [line for line in shown.err.splitlines() if "is it the map of this place" in line]
    begins = f"WARNING: map.mcap: {outside:.1%} of the rows outside: those of moved.mcap"
    assert [line.startswith(begins) for line in asked] == [True] * (outside > 0.5)


def test_a_log_most_of_whose_rows_have_no_estimate_is_input_lost(here, said):
    shown = said(f"track log.mcap {TRACK} --no-ids --end 2.5 --set clutter_density=10", code=INPUT_LOST)
    assert "100.0% of 150 rows without an estimate" in shown.out
    assert "most rows have no estimate: is the noise larger" in shown.err


@pytest.mark.parametrize("is_once", [False, True])
def test_ids_that_never_come_again_are_named_where_nothing_is_tracked(here, said, is_once):
    """Nor is motion learned from them."""
    rows = [f"{k / 10},v{v}_{k if is_once else 0},{k},{9 * v}" for k in range(30) for v in range(2)]
    Path("t.csv").write_text("\n".join(["time_s,track_id,x_m,y_m", *rows]))
    for options in ("", "--motion constant-velocity"):
        shown = said(f"track t.csv -o x.mcap --noise 0.5 --force {options}", code=INPUT_LOST if is_once else DONE)
        assert ("no id comes again: `dirprim track --no-ids`" in shown.err) == is_once
        assert ("straight on, but for white acceleration of 1 m2/s3, not learned: " in shown.out) == is_once


@pytest.mark.parametrize("form", ["foxglove", "vision_msgs", "autoware"])
def test_estimates_are_written_in_the_messages_that_are_asked_for(here, form):
    assert dirprim(f"track log.mcap {TRACK} --as {form}") == DONE
    with scan("out") as log:
        schemas = {channel.schema.name.split("/")[0] for channel in log.channels()}
    ours = {"foxglove": "foxglove.SceneUpdate", "vision_msgs": "vision_msgs", "autoware": "autoware_perception_msgs"}
    assert schemas & {*ours.values()} == {ours["foxglove"], ours[form]}
