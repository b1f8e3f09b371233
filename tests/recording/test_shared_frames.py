"""Frames of several logs, and transforms that contradict each other: joined, or reported in one line, never guessed."""

import numpy as np
import pytest
from ros_messages import array, header, point, quaternion, ros_transform, tf, write_ros2_log
from ros_messages import ros2_log_in_order as log
from test_ros2_schemas import START_NS, STEP_NS, carla

from dirprim_filter.cli.main import run
from dirprim_filter.recording.errors import MissingTransformError
from dirprim_filter.recording.reader import read_track_logs, read_tracks, stream_detections
from dirprim_filter.store import add_logs, find_logs

N = 20
SPEED = 12.0


def placed(time_ns, parent, child, place, *, stamp=None, **given):
    return tf(time_ns, ros_transform(time_ns if stamp is None else stamp, parent, child, (*place, 0.0)), **given)


def moving(times=range(N), parent="map", child="base_link", off=(0.0, 0.0)):
    """A vehicle's frame, that drives east."""
    return [placed(START_NS + int(k * STEP_NS), parent, child, (off[0] + 1.2 * k, off[1])) for k in times]


def parked(times=range(N), frame="base_link", ahead=0.0):
    """A car that stands at (50, 3) of the map, in the axes of the vehicle, or of a sensor ahead in it."""
    cars = []
    for k in times:
        place = point(50.0 - ahead - SPEED * 0.1 * k, 3.0, 0)
        one = carla(0, 0) | {"header": header(0, ""), "pose": {"position": place, "orientation": quaternion(0, 0, 0)}}
        cars.append(array(START_NS + k * STEP_NS, frame, [one]))
    return cars


MOUNTED = placed(START_NS, "base_link", "lidar", (2.0, 0.0), topic="/tf_static")


def stands(tracks, n=N):
    np.testing.assert_allclose(tracks.position, np.broadcast_to([50.0, 3.0], (n, 2)), atol=1e-6)


def splits(tmp_path, first=range(N // 2), second=range(N // 2, N), every=1):
    return (
        log(tmp_path / "bag_0.mcap", MOUNTED, *moving(first[::every]), *parked(first, "lidar", 2.0)),
        log(tmp_path / "bag_1.mcap", *moving(second[every - 1 :: every]), *parked(second, "lidar", 2.0)),
    )


def test_splits_that_are_given_one_by_one_share_their_transforms(tmp_path, caplog):
    bags = splits(tmp_path)
    for order in (bags, bags[::-1]):
        caplog.clear()
        stands(read_tracks(order))
        assert caplog.text.count("bag_1.mcap: frame 'lidar' is placed in 'base_link' by the other logs") == 1
    stands(read_track_logs(bags[1], beside=bags).tracks, N // 2)
    with pytest.raises(MissingTransformError, match=r"'lidar' to frame 'map'.*'base_link' in 'map'"):
        read_tracks(bags[1])
    with pytest.raises(MissingTransformError, match="'lidar' to frame 'map'"):
        list(stream_detections(bags[1]))


def test_a_store_reads_each_split_with_the_transforms_of_its_recording(tmp_path):
    splits(tmp_path)
    (tmp_path / "bag_2.mcap").write_text("no log")  # beside the second, whose transforms it cannot hold
    log(tmp_path / "other.mcap", *parked(frame="lidar"), *moving())
    added = add_logs(tmp_path / "store", find_logs([str(tmp_path / "*.mcap")]))
    assert [receipt.n_rows > 0 for receipt in added.receipts] == [True, True, False, False]
    _, line = added.failures
    assert "other.mcap: expected a transform from frame 'lidar' to frame 'map'" in line


def test_transforms_around_the_boundary_of_splits_are_interpolated(tmp_path):
    """At one transform in half a second; alone, the second split cannot place what comes before its first."""
    bags = splits(tmp_path, every=5)
    alone = read_track_logs(bags[0])
    assert alone.losses.dropped.total() > 0
    both = read_track_logs(bags)
    assert both.losses.dropped.total() < alone.losses.dropped.total() + 1
    stands(both.tracks, len(both.tracks))


def test_logs_that_place_a_sensor_differently_lend_it_to_none(tmp_path):
    bags = splits(tmp_path)
    other = placed(START_NS, "base_link", "lidar", (2.5, 0.0), topic="/tf_static")
    third = log(tmp_path / "van.mcap", other, *moving(), *parked(range(N), "lidar", 2.5))
    with pytest.raises(MissingTransformError, match=r"bag_1\.mcap.*'lidar' to frame 'map'"):
        read_tracks([bags[0], third, bags[1]])


def test_logs_in_frames_that_nothing_joins_are_not_merged(tmp_path):
    one = log(tmp_path / "one.mcap", *parked(frame="map"))
    two = log(tmp_path / "two.mcap", *parked(frame="lidar"))
    for order, frames in (((one, two), "'lidar' to frame 'map'"), ((two, one), "'map' to frame 'lidar'")):
        with pytest.raises(MissingTransformError, match=frames):
            read_tracks(order)
    unnamed = log(tmp_path / "unnamed.mcap", *parked(frame=""))
    assert read_tracks([one, unnamed]).n_tracks == 2


CONTRADICTIONS = {
    " are each other's parent: 'map' is taken for the root": [
        placed(START_NS + k * STEP_NS, "base_link", "map", (-SPEED * 0.1 * k, 0.0)) for k in range(N)
    ],
    "static and others over time": [placed(START_NS, "map", "base_link", (7.0, 7.0), topic="/tf_static")],
    "several parents, ": moving(parent="odom", off=(9.0, 9.0)),
    "with and without a leading slash": [placed(START_NS, "/map", "/far", (7.0, 7.0))],
    "jumps back and forth": moving(np.arange(N) + 1e-6, off=(0.0, 30.0)),  # by two nodes
}


@pytest.mark.parametrize("reported", CONTRADICTIONS)
def test_transforms_that_contradict_each_other_are_reported(tmp_path, caplog, reported):
    """The frame that moves counts, in the one that is known to stand; what was chosen is said once."""
    tracks = read_tracks(log(tmp_path / "log.mcap", *CONTRADICTIONS[reported], *moving(), *parked()))
    assert caplog.text.count(reported) == 1
    if "jumps" not in reported:  # between places that are both stated
        stands(tracks)
        assert len(caplog.records) == 1


def test_translations_and_times_of_any_size_draw_no_warning_of_numpys(tmp_path):
    far = [placed(START_NS + k * STEP_NS, "map", "base_link", ((-1) ** k * 1e308, 0.0)) for k in range(N)]
    assert not len(read_tracks(log(tmp_path / "log.mcap", *far, *parked())))


@pytest.mark.parametrize(("late_s", "n_reported"), [(0, 0), (2, 0), (5, 1), (-5, 1)])
def test_transforms_by_another_clock_are_reported(tmp_path, caplog, late_s, n_reported):
    times, late_ns = range(300), late_s * 10**9
    driven = [placed(at, "map", "base_link", (0.0, 1.2 * k), stamp=at - late_ns)
              for k, at in ((k, START_NS + k * STEP_NS) for k in times)]  # fmt: skip
    tracks = read_tracks(log(tmp_path / "log.mcap", *driven, MOUNTED, *parked(times, "lidar", 2.0)))
    assert len(tracks) >= 249
    ahead, behind = ("/objects", "transforms of 'base_link'")[:: np.sign(late_s) or 1]
    said = f"times of {ahead} are 5 s ahead of those of {behind}: are they of another clock, one simulated? objects are"
    assert caplog.text.count(said) == n_reported
    assert caplog.text.count("s ahead of") == n_reported


def test_log_times_of_a_conversion_say_nothing_of_transforms(tmp_path, caplog):
    sent = [*moving(range(300)), *parked(range(300))]
    read_tracks(write_ros2_log(tmp_path / "log.mcap", [(topic, START_NS, *of) for topic, _, *of in sent]))
    assert "ahead of" not in caplog.text


def test_a_missing_transform_says_what_there_is(tmp_path):
    clocks = [placed(START_NS + k, "map", "base_link", (k, 0.0), stamp=400 * 10**9 + k * STEP_NS) for k in range(N)]
    path = log(tmp_path / "clocks.mcap", *clocks, *parked())
    with pytest.raises(MissingTransformError, match=r"known from 400000000000 to .* do the clocks differ"):
        read_tracks(path)
    loop = [placed(START_NS + k * STEP_NS, *of, (k, 0.0)) for k in range(N) for of in (("a", "b"), ("b", "a"))]
    for others in (moving(), []):  # without them the log names no frame of the ground
        path = log(tmp_path / "loop.mcap", *loop, *others, *parked(frame="b"))
        with pytest.raises(MissingTransformError, match=r"[ab] and [ab] are each other's parent"):
            read_tracks(path)
        assert len(read_tracks(path, frame="b")) == N


def test_a_frame_without_a_name_is_reported_where_there_are_transforms(tmp_path, caplog):
    path = log(tmp_path / "log.mcap", *moving(), *parked(frame=""))
    read_tracks(path)
    assert caplog.text.count("the frame of objects has no name") == 1
    assert "though the log places 'base_link' in 'map'" in caplog.text
    caplog.clear()
    read_tracks(path, frame="map")
    read_tracks(log(tmp_path / "none.mcap", *parked(frame="")))
    assert not caplog.records


def test_a_frame_whose_transforms_end_while_it_stands_is_reported(tmp_path, caplog):
    still = [placed(START_NS + k * STEP_NS, "map", "base_link", (1.0, 0.0)) for k in range(3)]
    for more, n_reported in ((range(20), 0), (range(40), 1)):
        caplog.clear()
        read_tracks(log(tmp_path / "log.mcap", *still, *parked(more)))
        assert caplog.text.count("frame 'base_link' is taken to stand in 'map'") == n_reported
    caplog.clear()
    read_tracks(log(tmp_path / "log.mcap", *moving(range(3)), *parked(range(40))))  # one that does not stand
    assert "no transform" in caplog.text
    assert "taken to stand" not in caplog.text


def test_info_says_which_transform_is_missing(tmp_path, capsys):
    path = log(tmp_path / "log.mcap", *moving(), *parked(frame="lidar"))
    assert run(["info", str(path)]) == 0
    assert f"faults: {path}: expected a transform from frame 'lidar' to frame 'map'" in capsys.readouterr().out
