"""Figures of one place: densities integrate to one and peak where the modes are, samples lie where they belong."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.projections.polar import PolarAxes

from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.drawing.colors import direction_color
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures import direction_figure, product_figure, rejection_figure, speed_figure
from dirprim_filter.viewer.figures.place import Circle, Place
from dirprim_filter.viewer.figures.product import kernel_concentration
from dirprim_filter.viewer.layers import INK

SHARP_CELL, JUNCTION = (5.0, 5.0), (15.0, 15.0)


def seed(n: int = 0) -> np.random.Generator:
    return np.random.default_rng(n)


def figures_of(primitives: PrimitiveMap) -> list[Figure]:
    return [
        direction_figure(primitives),
        speed_figure(primitives),
        rejection_figure(primitives, cue=TURN_RIGHT, rng=seed()),
        product_figure(primitives, cue=TURN_RIGHT, rng=seed()),
    ]


def curve(axes: Axes, color: str = INK) -> tuple[np.ndarray, np.ndarray]:
    """The longest line of a colour."""
    lines = [line for line in axes.lines if line.get_color() == color]
    longest: Line2D = max(lines, key=lambda line: len(np.asarray(line.get_xdata())))
    return np.asarray(longest.get_xdata()), np.asarray(longest.get_ydata())


@pytest.mark.parametrize("position", [SHARP_CELL, JUNCTION])
def test_the_drawn_density_of_direction_integrates_to_one(scene_map: PrimitiveMap, position: tuple) -> None:
    line, polar, _ = direction_figure(scene_map, position=position).axes
    degrees, density = curve(line)
    assert degrees[-1] - degrees[0] == pytest.approx(360.0)
    assert np.trapezoid(density, np.deg2rad(degrees)) == pytest.approx(1.0, abs=1e-4)
    theta, radius = curve(polar)
    assert 0.5 * np.trapezoid(2.0 * radius**2, theta) == pytest.approx(1.0, abs=1e-4)  # areas are to scale


def test_on_a_coarse_circle_a_sharp_mode_would_not() -> None:
    mixture = VonMisesMixture(weight=[1.0], mean_direction=[0.1], concentration=[1e6])
    coarse = np.linspace(-np.pi, np.pi, 721)
    assert abs(np.trapezoid(np.exp(mixture.log_density(coarse)), coarse) - 1.0) > 0.1
    fine = Circle.around(mixture).theta
    assert np.trapezoid(np.exp(mixture.log_density(fine)), fine) == pytest.approx(1.0, abs=1e-4)


def test_both_curves_peak_at_the_mode_and_the_circle_is_cut_elsewhere(scene_map: PrimitiveMap) -> None:
    line, polar, _ = direction_figure(scene_map, position=SHARP_CELL).axes
    degrees, density = curve(line)
    assert degrees[np.argmax(density)] % 360 == pytest.approx(90.0, abs=0.1)
    theta, radius = curve(polar)
    assert theta[np.argmax(radius)] % (2 * np.pi) == pytest.approx(np.pi / 2, abs=0.002)
    assert np.abs((np.array(line.get_xlim()) % 360) - 90.0).min() >= 45.0
    assert isinstance(polar, PolarAxes)
    assert polar.get_theta_offset() == 0.0  # east to the right, as on the map
    assert polar.get_theta_direction() == 1


def test_modes_are_reported_with_weight_direction_and_colour(scene_map: PrimitiveMap) -> None:
    modes = Place.at(scene_map, JUNCTION).modes()
    assert [mode.weight for mode in modes] == [0.6, 0.3]
    assert [mode.degrees for mode in modes] == ["+17°", "+115°"]
    assert modes[0].color == "#" + bytes(direction_color(np.array(0.3))[:3]).hex()
    assert modes[0].dashes != modes[1].dashes
    reported = [text.get_text() for text in direction_figure(scene_map, position=JUNCTION).legends[0].get_texts()]
    assert reported[1:3] == ["mode 1: 60.0%, +17°, concentration 8", "mode 2: 30.0%, +115°, concentration 0.5"]
    assert reported[3] == "standing, and the place-free primitive: 10.0%"


def test_a_bend_turns_what_is_drawn(scene_map: PrimitiveMap) -> None:
    bend = np.zeros((4, 3, 2))
    bend[0, 0, 0] = 0.1
    curved = replace(scene_map, bend=bend)
    line = direction_figure(curved, position=(7.0, 5.0)).axes[0]  # 2 m east of the centre: 0.2 rad
    degrees, density = curve(line)
    assert degrees[np.argmax(density)] % 360 == pytest.approx(90.0 + np.rad2deg(0.2), abs=0.2)


def test_rows_of_the_cell_are_a_histogram_that_integrates_to_one(scene_map: PrimitiveMap, scene_tracks: Tracks) -> None:
    line = direction_figure(scene_map, position=SHARP_CELL, tracks=scene_tracks).axes[0]
    (bars,) = line.patches
    heights, edges, _ = bars.get_data()
    assert (heights * np.diff(np.deg2rad(edges))).sum() == pytest.approx(1.0)
    filled = edges[:-1][heights > 0] % 360
    assert filled.tolist() == [45.0]  # all of them drive to the north-east
    reported = [text.get_text() for text in line.figure.legends[0].get_texts()]
    assert reported[-1] == "the cell's 5 rows of moving vehicles"


def test_the_drawn_density_of_speed_is_the_share_that_moves(scene_map: PrimitiveMap) -> None:
    speed = replace(scene_map.speed, rate=np.where(np.arange(3) == 1, 100.0, scene_map.speed.rate))  # mode 2 stands
    axes = speed_figure(replace(scene_map, speed=speed), position=JUNCTION).axes[0]
    x, density = curve(axes)
    beyond = 0.02  # of a gamma of shape 4, past four standard deviations
    assert np.trapezoid(density, x) == pytest.approx(0.7, abs=beyond)
    reported = [text.get_text() for text in axes.figure.legends[0].get_texts()]
    assert reported[1:] == ["mode 1: 60.0%, +17°, 8.0 ± 4.0 m/s", "place-free: 10.0%; standing, not drawn: 30.0%"]


def test_rejected_points_lie_above_the_target_and_accepted_ones_below(scene_map: PrimitiveMap) -> None:
    heading = 2.0
    axes = rejection_figure(scene_map, cue=TURN_RIGHT, position=JUNCTION, heading=heading, rng=seed(3)).axes[0]
    rejected, accepted = [c for c in axes.collections if type(c) is PathCollection]
    prior = scene_map.primitive_at(np.array(JUNCTION)).direction
    posterior = multiply_mixtures(prior, TURN_RIGHT.belief(heading)).mixture
    for points, sign in ((rejected, 1.0), (accepted, -1.0)):
        degrees, height = np.asarray(points.get_offsets()).T
        assert len(height) > 50
        assert (sign * (height - np.exp(posterior.log_density(np.deg2rad(degrees)))) >= 0).all()
    degrees, target = curve(axes, "#D55E00")
    _, top = curve(axes)
    assert (top >= target).all()
    assert np.trapezoid(target, np.deg2rad(degrees)) == pytest.approx(1.0, abs=1e-4)
    # Of n points 1 / k are accepted: 5 standard deviations, a false alarm in two million.
    k = np.trapezoid(top, np.deg2rad(degrees))
    n = len(rejected.get_offsets()) + len(accepted.get_offsets())
    share = len(accepted.get_offsets()) / n
    assert share == pytest.approx(1 / k, abs=5 * np.sqrt((1 - 1 / k) / k / n))


def test_the_product_moves_towards_the_signal(scene_map: PrimitiveMap) -> None:
    options = {"position": JUNCTION, "heading": 1.2, "rng": seed()}
    means = {}
    for name, cue in (("left", TURN_LEFT), ("right", TURN_RIGHT)):
        degrees, density = curve(product_figure(scene_map, cue=cue, **options).axes[0], "#D55E00")
        assert np.trapezoid(density, np.deg2rad(degrees)) == pytest.approx(1.0, abs=1e-3)
        means[name] = np.angle((density * np.gradient(degrees) * np.exp(1j * np.deg2rad(degrees))).sum())
    assert means["left"] > means["right"] + 0.3


def test_kernels_are_sharper_where_samples_are() -> None:
    narrow, wide = (kernel_concentration(seed(1).normal(0.0, std, 100)) for std in (0.02, 0.5))
    assert narrow > 20 * wide


def test_the_place_left_out_is_where_most_goes_different_ways(scene_map: PrimitiveMap) -> None:
    assert Place.at(scene_map, None).cell == 1
    one_way = replace(scene_map, n_rows=np.array([10_000, 0, 0, 10_000]))
    assert Place.at(one_way, None).cell == 0


def test_a_place_outside_and_an_empty_map_are_reported(scene_map: PrimitiveMap) -> None:
    with pytest.raises(ValueError, match=r"expected a place in a cell, got \(500, -3\) m, outside of all 3 cells"):
        direction_figure(scene_map, position=(500.0, -3.0))
    for nothing in (scene_map.without_places(), replace(scene_map, n_rows=np.zeros(4, np.int64))):
        with pytest.raises(ValueError, match="expected a cell that holds data"):
            product_figure(nothing, cue=TURN_LEFT, rng=seed())
    with pytest.raises(ValueError, match="finite"):
        speed_figure(scene_map, position=(np.nan, 0.0))


def test_all_axes_have_units_and_the_key_covers_no_data(scene_map: PrimitiveMap) -> None:
    for figure in figures_of(scene_map):
        figure.draw_without_rendering()
        key = figure.legends[0].get_window_extent()
        assert figure.bbox.contains(key.x0, key.y0)
        assert figure.bbox.contains(key.x1, key.y1)
        for axes in figure.axes:
            labels = [axes.get_xlabel()] + ([] if isinstance(axes, PolarAxes) else [axes.get_ylabel()])
            assert all(label.endswith("]") or "[1/rad]" in label for label in labels)
            assert not key.overlaps(axes.get_tightbbox())
    assert {axes.get_aspect() for axes in figures_of(scene_map)[0].axes[2:]} == {1.0}
