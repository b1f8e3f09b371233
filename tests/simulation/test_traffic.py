"""Traffic that SUMO drives through the scenes: on the right side, and the same from the same seed."""

import importlib.util
import shutil
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from dirprim_filter.distributions.angles import difference
from dirprim_filter.simulation import traffic
from dirprim_filter.simulation.traffic import DRIVERS, FOLDER, SCENES, SimulationError, simulate

needs_sumo = pytest.mark.skipif(
    importlib.util.find_spec("sumo") is None, reason='needs Eclipse SUMO: pip install "dirprim-filter[sim]"'
)

DURATION_S = 60.0
RING_RADIUS = 20.0


def attributes(path, tag):
    return [of.attrib for of in ET.parse(path).iter(tag)]  # noqa: S314  the project's own


@pytest.fixture(scope="module")
def observed():
    return {scene: simulate(scene, duration_s=DURATION_S, seed=5) for scene in SCENES}


def motion(tracks):
    """Rows (but each vehicle's last), and the displacement to the vehicle's next row, 0.1 s later."""
    order = np.lexsort((tracks.time_ns, tracks.track_id))
    same = np.diff(tracks.track_id[order]) == 0
    rows, following = order[:-1][same], order[1:][same]
    assert (tracks.time_ns[following] - tracks.time_ns[rows] == 100_000_000).all(), "a vehicle left and came back"
    return rows, following, tracks.position[following] - tracks.position[rows]


@needs_sumo
@pytest.mark.parametrize("scene", SCENES)
def test_direction_and_speed_are_those_of_the_displacements(observed, scene):
    tracks = observed[scene]
    rows, following, moved = motion(tracks)
    step = np.hypot(*moved.T)
    speed = (tracks.speed[rows] + tracks.speed[following]) / 2
    assert np.median(np.abs(step / 0.1 - speed)) < 0.1
    assert np.quantile(np.abs(step / 0.1 - speed), 0.99) < 2.0
    assert step.max() < 4.5, "a vehicle jumped"
    course, direction = np.arctan2(*moved[step > 0.2].T[::-1]), tracks.direction[following][step > 0.2]
    off = np.abs(difference(course, direction))
    assert np.median(off) < np.radians(1.0)
    assert np.quantile(off, 0.99) < np.radians(15.0)
    # The compass read as a mathematical angle would be wrong nearly everywhere.
    compass = np.pi / 2 - direction
    assert np.median(np.abs(difference(course, compass))) > np.radians(20.0)


@needs_sumo
def test_position_is_the_centre_of_the_vehicle(observed):
    """A vehicle that enters has its rear on the end of the road, so its centre is half a length inside."""
    tracks = observed["highway"]
    _, first = np.unique(tracks.track_id, return_index=True)  # rows are in order of time
    entered = first[(tracks.time_ns[first] > 0) & (np.abs(tracks.position[first, 0]) > 150)]
    inside = 200.0 - np.abs(tracks.position[entered, 0])
    on_road = np.abs(np.sin(tracks.direction[entered])) < 0.01  # the ramp is not parallel to x
    usual = float(np.median([float(of["length"]) for of in attributes(DRIVERS, "vType")]))
    assert on_road.sum() > 10
    assert np.median(inside[on_road]) == pytest.approx(usual / 2, abs=0.2)


@needs_sumo
def test_roundabout_is_driven_counter_clockwise(observed):
    tracks = observed["roundabout"]
    x, y = tracks.position.T
    radius = np.hypot(x, y)
    on_ring = (np.abs(radius - RING_RADIUS) < 2.0) & (tracks.speed > 1.0)
    tangent = np.arctan2(y, x) + np.pi / 2
    assert on_ring.sum() > 500
    assert np.abs(difference(tracks.direction, tangent))[on_ring].max() < np.radians(60.0)
    assert radius.min() > RING_RADIUS - 2.5, "no vehicle drives over the central island"
    for quarter in range(4):
        assert (on_ring & (np.floor((np.arctan2(y, x) + np.pi) / (np.pi / 2)) == quarter)).any()


@needs_sumo
@pytest.mark.parametrize("scene", ["roundabout", "intersection"])
def test_traffic_keeps_to_the_right_on_every_arm(observed, scene):
    tracks = observed[scene]
    x, y = tracks.position.T
    for arm in range(4):
        cosine, sine = np.cos(arm * np.pi / 2), np.sin(arm * np.pi / 2)
        left, far = cosine * y - sine * x, cosine * x + sine * y > 60.0
        outward = np.cos(tracks.direction - arm * np.pi / 2) > 0
        assert left[far & outward].max() < -0.5, "outbound vehicles have the middle of the road on their left"
        assert left[far & ~outward].min() > 0.5


@needs_sumo
def test_the_same_seed_gives_the_same_tracks_and_a_lower_rate_a_subset(observed):
    again = simulate("roundabout", duration_s=DURATION_S, seed=5)
    for name in ("track_id", "time_ns", "position", "direction", "speed"):
        np.testing.assert_array_equal(getattr(again, name), getattr(observed["roundabout"], name))
    other = simulate("roundabout", duration_s=DURATION_S, seed=6)
    assert len(other) != len(again) or not np.allclose(other.position, again.position)
    thin = simulate("roundabout", duration_s=DURATION_S, seed=5, rate_hz=2.0)
    full = observed["roundabout"]
    kept = full[full.time_ns % 500_000_000 == 0]
    np.testing.assert_array_equal(thin.time_ns, kept.time_ns)
    np.testing.assert_array_equal(thin.position, kept.position)
    assert thin.n_tracks <= full.n_tracks


@needs_sumo
def test_demand_makes_traffic_that_queues(observed):
    usual, dense = observed["intersection"], simulate("intersection", duration_s=20.0, seed=5, demand=2.2)
    at_once = [np.unique(tracks.time_ns, return_counts=True)[1] for tracks in (usual, dense)]
    assert at_once[0].max() < 30 <= at_once[1].max() <= 80
    x = dense.position[:, 0]
    queue = (dense.speed < 0.3) & (np.abs(x) > 15) & (dense.time_ns == dense.time_ns.max())
    assert queue.sum() > 8


@needs_sumo
def test_failure_of_sumo_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setattr(traffic, "FOLDER", shutil.copytree(FOLDER, tmp_path / "scenes"))
    (tmp_path / "scenes/drive.sumocfg").write_text('<configuration><no-such-option value="1" /></configuration>')
    with pytest.raises(SimulationError, match=r"^sumo failed with status \d+: .+") as caught:
        simulate("roundabout", duration_s=1.0, seed=1)
    assert "\n" not in str(caught.value)


def test_without_sumo_the_error_names_the_way_out(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(SimulationError, match=r'pip install "dirprim-filter\[sim\]"'):
        simulate("roundabout", duration_s=1.0, seed=1)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("scene", ["moon"]), ("duration_s", [0.0, float("inf")]), ("seed", [-1]), ("demand", [0.0, float("inf")]),
        ("rate_hz", [3.0, 20.0, 0.0, float("nan")]),
    ],
)  # fmt: skip
def test_arguments_out_of_range_are_named(name, values):
    for value in values:
        with pytest.raises(ValueError, match=name) as caught:
            simulate(**({"scene": "roundabout", "duration_s": 10.0, "seed": 1} | {name: value}))
        assert name != "scene" or f"expected one of {', '.join(SCENES)}, got 'moon'" in str(caught.value)


@pytest.mark.parametrize("scene", SCENES)
def test_roads_connections_and_flows_name_what_exists(scene):
    files = sorted((FOLDER / scene).glob("*.xml"))
    named = {
        tag: [of for path in files for of in attributes(path, tag)] for tag in ("node", "edge", "connection", "flow")
    }
    nodes, edges = ([of["id"] for of in named[tag]] for tag in ("node", "edge"))
    assert len(set(nodes)) == len(nodes)
    assert len(set(edges)) == len(edges)
    assert {of[end] for of in named["edge"] for end in ("from", "to")} == set(nodes)
    assert {of[end] for tag in ("flow", "connection") for of in named[tag] for end in ("from", "to")} <= set(edges)
    assert {of["type"] for of in named["flow"]} == {"drivers"}
