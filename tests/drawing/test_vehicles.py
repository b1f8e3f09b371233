"""How vehicles are drawn: colours, of which direction's survive colour-blindness, labels of long ids, and sizes."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest

from dirprim_filter import write_tracks
from dirprim_filter.drawing.colors import OKABE_ITO, direction_color, speed_color, track_color
from dirprim_filter.drawing.vehicles import LONGEST, drawn_sizes, short_name
from dirprim_filter.recording.reader import read_track_logs
from situations import tracks_of

DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)
"""What a viewer without green cones sees of linear RGB (Machado, Oliveira and Fernandes, 2009)."""


def _as_seen_without_green(rgba):
    linear = np.clip((rgba[..., :3] / 255.0) ** 2.2 @ DEUTERANOPIA.T, 0.0, 1.0)
    return 255.0 * linear ** (1 / 2.2)


def test_speed_is_viridis_and_saturates():
    speed = np.linspace(0.0, 20.0, 101)
    expected = 255.0 * mpl.colormaps["viridis"](speed / 20.0)
    assert np.abs(speed_color(speed, fastest=20.0) - expected).max() < 5  # 17 anchors of 256
    assert (speed_color(np.array(99.0), fastest=20.0) == speed_color(np.array(20.0), fastest=20.0)).all()


def test_direction_is_cyclic_without_jumps_and_tells_opposites_apart_also_for_the_colour_blind():
    circle = np.linspace(-np.pi, np.pi, 721)
    color = direction_color(circle).astype(int)
    assert (color[0] == color[-1]).all()
    assert (color == direction_color(circle + 2 * np.pi)).all()
    assert np.abs(np.diff(color, axis=0)).max() <= 4  # half a degree
    circle = np.linspace(-np.pi, np.pi, 72, endpoint=False)
    seen = _as_seen_without_green(direction_color(circle))
    opposite = _as_seen_without_green(direction_color(circle + np.pi))
    assert np.linalg.norm(seen - opposite, axis=-1).min() > 80
    # The test can fail: this red and green look alike.
    red_green = _as_seen_without_green(np.array([[200, 80, 60, 255], [118, 118, 40, 255]]))
    assert np.linalg.norm(red_green[0] - red_green[1]) < 40
    east, north, west, south = direction_color(np.array([0.0, np.pi / 2, np.pi, -np.pi / 2]))[:, :3].astype(int)
    assert north.sum() > south.sum() + 100
    assert east[0] > east[2] + 100
    assert west[2] > west[0] + 50


def test_a_vehicle_keeps_its_colour_whoever_else_is_there():
    alone, together = track_color(np.array([7])), track_color(np.array([3, 7, 9]))
    assert (alone[0] == together[1]).all()
    assert (track_color(np.array(["7"])) == alone).all()  # an id is the same as number and as text
    assert track_color(np.arange(0)).shape == (0, 4)
    names = track_color(np.arange(1000))
    assert len(np.unique(names, axis=0)) == len(OKABE_ITO)


def test_long_ids_are_shortened_and_keep_their_group_and_both_ends():
    uuid = "3f2b8c1e-0d4a-4f6b-9c7d-1a2b3c4d5e6f"
    assert short_name(uuid) == "3f2b…5e6f"
    assert short_name(f"7/{uuid}") == "7/3f2b…5e6f"
    for name in ("17", "7/car", "x" * LONGEST):
        assert short_name(name) == name
    assert len(short_name("x" * (LONGEST + 1))) < LONGEST


@pytest.mark.parametrize("name", ["log.mcap", "log.csv"])
def test_people_are_not_drawn_as_cars_nor_what_has_a_size_by_its_class(tmp_path, name):
    """By the labels of a log or a table; of no label nothing is known."""
    east = np.arange(5.0)[:, None] * [1.0, 0.0]
    tracks = tracks_of(east + np.zeros((4, 1, 2)), track_id=np.array([[1], [2], [3], [4]]), speed=10.0)
    labels = {1: "human.pedestrian.adult", 2: "Bus", 3: "person"}
    if name.endswith("csv"):
        rows = [f"{t / 1e9},{i},{x},{y},{labels.get(i, '')}" for t, i, (x, y) in
                zip(tracks.time_ns, tracks.track_id.tolist(), tracks.position, strict=True)]  # fmt: skip
        (tmp_path / name).write_text("\n".join(["time_s,track_id,x_m,y_m,label", *rows]))
    else:
        write_tracks(tracks, tmp_path / name, labels=labels)
    read = read_track_logs(tmp_path / name)
    assert read.labels == {str(i): label for i, label in labels.items()}
    stated = replace(read.tracks, size=np.where(read.tracks.track_id[:, None] == 3, [2.0, 1.0, 1.0], np.nan))
    drawn = drawn_sizes(stated, read.labels)
    length = {i: drawn.size[drawn.track_id == i][0, 0] for i in (1, 2, 3, 4)}
    assert length == pytest.approx({1: 0.5, 2: 12.0, 3: 2.0, 4: np.nan}, nan_ok=True)
