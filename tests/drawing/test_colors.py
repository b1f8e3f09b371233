"""Colours: viridis is matplotlib's, direction is cyclic and survives colour-blindness."""

import matplotlib as mpl
import numpy as np

from dirprim_filter.drawing.colors import OKABE_ITO, direction_color, speed_color, track_color

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
