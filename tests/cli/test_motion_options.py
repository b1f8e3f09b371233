"""What vehicles move by: a map, what a log shows of its vehicles anywhere, or constant velocity."""

import json
from pathlib import Path

import numpy as np
import pytest

from cli.commands import DONE, FAILED, USAGE, dirprim
from dirprim_filter import read_estimates
from dirprim_filter.cli.results import metadata_of
from dirprim_filter.config import FilterConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import EstimateList
from dirprim_filter.evaluation.without_map import acceleration_of, background_motion
from dirprim_filter.filtering import ConstantVelocityKalman, GroupTracker
from dirprim_filter.filtering.smoothing.smoother import Smoother
from dirprim_filter.recording.reader import stream_detections
from dirprim_filter.replay import replay
from situations import keys

RUN = "track log.mcap -o out.mcap --noise 0.5 --particles 50 --force"


def motion_line(capsys):
    """What the command says of its motion, the line's beginning taken off."""
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("motion: ")]
    assert len(lines) <= 1
    return lines[0].removeprefix("motion: ") if lines else ""


def test_without_a_map_vehicles_move_as_those_of_the_log_do_anywhere(here, capsys):
    assert dirprim(f"{RUN} --forecast 1") == DONE
    assert motion_line(capsys) == "as 6 vehicles of the log's first minutes move anywhere"
    found = read_estimates("out.mcap")
    assert np.unique(found.track_id).size == 6
    assert found.effective_sample_size.max() > 1  # of particles
    assert dirprim(f"{RUN} --map map.mcap") == DONE
    assert motion_line(capsys) == ""


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--no-ids", "straight on, but for white acceleration of 1 m2/s3, not learned: --no-ids"),
        ("--set acceleration_density=0.3", "straight on, but for white acceleration of 0.3 m2/s3, as stated"),
        ("--motion constant-velocity --no-ids",
         "straight on, but for white acceleration of 1 m2/s3, not learned: --no-ids"),
        ("--map map.mcap --motion constant-velocity --set acceleration_density=2",
         "straight on, but for white acceleration of 2 m2/s3, as stated"),
    ],
)  # fmt: skip
def test_else_they_go_straight_on_with_a_noise_that_a_line_states(here, capsys, options, said):
    assert dirprim(f"{RUN} {options}") == DONE
    assert motion_line(capsys) == said
    assert (read_estimates("out.mcap").effective_sample_size == 1).all()
    assert str(float(metadata_of(Path("out.mcap"))["acceleration_density"])) in f"{said} 1.0 2.0"


def test_constant_velocity_is_the_kalman_filter_that_python_and_experiments_use(here, capsys):
    assert dirprim(f"{RUN} --motion constant-velocity --rate 20 --smooth") == DONE
    assert "fitted to 6 vehicles of the log's first minutes" in motion_line(capsys)
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


def test_the_tracks_of_another_tracker_are_refined_by_each(here, capsys):
    assert dirprim(f"{RUN} --motion constant-velocity") == DONE
    assert dirprim("export out.mcap -o theirs.csv") == DONE
    for options in ("", "--motion constant-velocity", "--map map.mcap --motion constant-velocity"):
        capsys.readouterr()
        assert dirprim(f"smooth theirs.csv -o refined.mcap --force --particles 50 {options}") == DONE
        assert motion_line(capsys).startswith("straight on" if options else "as 6 vehicles")
        assert len(read_estimates("refined.mcap")) == len(read_estimates("out.mcap"))


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        ("--set without_map=true", USAGE, "without_map is of a map"),
        ("--set motion=true", USAGE, "motion: expected one of"),
        ("--motion constant-velocity --set measured_motion=true", USAGE, "constant velocity takes positions alone"),
        ("--motion constant-velocity --forecast 3", USAGE, "leave out --motion"),
        ("--map map.mcap --set acceleration_density=2", USAGE, "a map says how vehicles accelerate"),
        ("--set acceleration_density=-1", USAGE, "acceleration_density: expected 0 to"),
        ("--no-ids --forecast 3", FAILED, "--forecast needs --map, or a log from which motion can be learned"),
    ],
)
def test_what_does_not_go_together_is_refused(here, capsys, options, code, said):
    assert dirprim(f"{RUN} {options}") == code
    assert said in " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert not Path("out.mcap").exists()


def test_a_log_whose_ids_never_come_again_says_so(here, capsys):
    lines = [f"{0.1 * k},{k},{k},0" for k in range(30)]
    Path("once.csv").write_text("\n".join(["time_s,track_id,x_m,y_m", *lines]))
    assert dirprim("track once.csv -o once.mcap --noise 0.5 --force") in (DONE, 3)
    assert motion_line(capsys).startswith("straight on, but for white acceleration of 1 m2/s3, not learned: ")


def test_python_learns_the_same_motion_of_no_place(few):
    made = [background_motion(of, rng=np.random.default_rng(0)) for of in (few, Detections.of(few))]
    assert [one.tessellation.n_cells for one in made] == [0, 0]
    speed = [one.sample(np.zeros((2000, 2)), rng=np.random.default_rng(1))[1].mean() for one in made]
    np.testing.assert_allclose(speed, few.speed.mean(), rtol=0.1)
    with pytest.raises(ValueError, match="tracks: expected"):
        background_motion(Detections.of(few).without_ids(), rng=np.random.default_rng(0))
