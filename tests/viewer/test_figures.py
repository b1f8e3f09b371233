"""Figures: all petals are there, north is up, files are whole."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection

from dirprim_filter.drawing import shapes
from dirprim_filter.viewer.figures import map_figure, save_figure
from situations import estimates_of, tracks_of


def test_the_map_shows_every_petal_with_north_up_and_equal_scales(scene_map, scene_tracks):
    figure = map_figure(scene_map, tracks=scene_tracks)
    axes, *_, color_bar = figure.axes
    petals, heads = (c for c in axes.collections if isinstance(c, PolyCollection))
    assert len(heads.get_paths()) == len(shapes.petal_heads(shapes.rose_petals(scene_map)))
    assert len(petals.get_paths()) == len(shapes.rose_petals(scene_map).polygon)
    figure.draw_without_rendering()
    origin, east, north = axes.transData.transform([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    assert 0 < east[0] - origin[0] == pytest.approx(north[1] - origin[1])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("east [m]", "north [m]")
    assert color_bar.get_ylabel() == "mean speed [m/s]"
    explained = [text.get_text() for text in figure.legends[0].get_texts()]
    assert explained == ["cells", "petals, where vehicles go", "tracks"]


def test_what_is_asked_for_is_shown_else_the_forecasts_else_the_map(scene_map):
    paths, asked = np.full((2, 3, 2), [30.0, -20.0]), np.array([[0.0, -9.0], [300.0, 9.0]])
    whole, near = map_figure(scene_map).axes[0], map_figure(scene_map, paths=paths).axes[0]
    assert np.mean([near.get_xlim(), near.get_ylim()], axis=1) == pytest.approx([30.0, -20.0])
    assert np.ptp(near.get_xlim()) == np.ptp(near.get_ylim()) < np.ptp(whole.get_xlim())
    assert map_figure(scene_map, paths=paths, extent=asked).axes[0].get_xlim() == (0.0, 300.0)


def test_beside_paths_there_are_polar_plots_of_the_density_along_the_longest(scene_map):
    way = np.linspace([2.0, 5.0], [18.0, 12.0], 30)
    axes, polar, _ = map_figure(scene_map, paths=np.stack([way, way[:1] + 0.1 * (way - way[0])])).axes
    circles, curves = (c for c in polar.collections if isinstance(c, PolyCollection))
    places = [text.get_position() for text in axes.texts]
    np.testing.assert_allclose(places[:: len(places) - 1], way[[0, -1]])
    for place, circle, curve in zip(places, circles.get_paths(), curves.get_paths(), strict=True):
        middle = 0.5 * (circle.vertices.min(axis=0) + circle.vertices.max(axis=0))
        radius = np.hypot(*(curve.vertices[:361] - middle).T)
        log_p = scene_map.direction_log_density(np.tile(place, (361, 1)), np.linspace(-np.pi, np.pi, 361))
        if scene_map.primitive_at(np.array(place)).direction.concentration.max() < 60.0:
            np.testing.assert_allclose(2.0 * np.log(radius / radius.max()), log_p - log_p.max(), atol=1e-6)
        else:  # narrower than is drawn
            assert radius.argmax() == log_p.argmax()


@pytest.mark.parametrize("seconds", [[0, 1, 2, 100, 101, 0, 1], [0, 10, 20, 60, 70, 0, 10]])
def test_a_vehicle_is_one_line_for_each_time_it_is_in_sight(scene_map, seconds):
    """Of a slow sensor too, with a fix each 10 s: the usual interval is no gap, one of 40 s is."""
    time_ns = np.array(seconds) * 1_000_000_000
    tracks = tracks_of(np.arange(14.0).reshape(1, 7, 2), track_id=[1, 1, 1, 1, 1, 2, 2], time_ns=time_ns)
    axes = map_figure(scene_map, tracks=tracks).axes[0]
    ways = [c for c in axes.collections if isinstance(c, LineCollection)][-1]
    assert [len(path.vertices) for path in ways.get_paths()] == [3, 2, 2]


def test_estimates_have_a_panel_of_their_own(scene_map):
    left, right, _ = map_figure(scene_map, estimates=estimates_of(["a", "a"], time_ns=np.array([0, 10**9]))).axes
    assert [len([c for c in of.collections if isinstance(c, PolyCollection)]) for of in (left, right)] == [2, 0]


@pytest.mark.parametrize("name", ["map.png", "map.svg", "map.pdf"])
def test_a_figure_is_whole_and_is_not_overwritten(tmp_path, scene_map, name):
    figure = map_figure(scene_map)
    path = tmp_path / name
    save_figure(figure, path)
    first = path.read_bytes()
    assert first.startswith({"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[name[-3:]])
    with pytest.raises(FileExistsError, match="choose another name or use --force"):
        save_figure(figure, path)
    save_figure(map_figure(scene_map), path, force=True)
    assert path.read_bytes() == first  # no date, no random name
    assert [p.name for p in path.parent.iterdir()] == [name]
