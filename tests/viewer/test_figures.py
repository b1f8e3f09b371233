"""Figures: all petals are there, north is up, files are whole, nothing global is touched."""

import subprocess
import sys
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from dirprim_filter.drawing import shapes
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.charts import tracking_chart
from dirprim_filter.viewer.figures import map_figure, place_figure, save_figure
from dirprim_filter.viewer.figures.page import INK
from dirprim_filter.viewer.figures.place import place_at
from tessellation import GridTessellation


def test_the_map_shows_every_petal_with_north_up_and_equal_scales(
    scene_map: PrimitiveMap, scene_tracks: Tracks
) -> None:
    figure = map_figure(scene_map, tracks=scene_tracks)
    axes, *_, color_bar = figure.axes
    (petals,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
    assert len(petals.get_paths()) == len(shapes.rose_petals(scene_map).polygon)
    figure.draw_without_rendering()
    origin, east, north = axes.transData.transform([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    assert 0 < east[0] - origin[0] == pytest.approx(north[1] - origin[1])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("east [m]", "north [m]")
    assert color_bar.get_ylabel() == "mean speed [m/s]"
    explained = [text.get_text() for text in figure.legends[0].get_texts()]
    assert explained == ["cells", "roots, where petals start", "tracks"]


def test_a_long_road_gets_a_close_up_of_its_busy_part(scene_map: PrimitiveMap) -> None:
    road = np.column_stack([np.arange(0.0, 300.0, 5.0), np.zeros(60)])
    cells, n = GridTessellation.covering(road, cell_size=5.0), 60
    mixture, speed = scene_map.direction, scene_map.speed
    long = replace(
        scene_map, tessellation=cells,
        direction=replace(mixture, **{f: np.repeat(getattr(mixture, f)[:1], n + 1, axis=0)
                                      for f in ("weight", "mean_direction", "concentration")}),
        speed=replace(speed, shape=np.repeat(speed.shape[:1], n + 1, axis=0),
                      rate=np.repeat(speed.rate[:1], n + 1, axis=0)),
        n_rows=np.append(np.where(np.abs(np.arange(n) - 30) < 3, 100, 1), 700),
        bend=np.empty(0), gain=np.empty(0),
    )  # fmt: skip
    whole, close_up, _ = map_figure(long).axes
    west, east = close_up.get_xlim()
    assert 100 < west < 150 < east < 200
    assert np.ptp(whole.get_xlim()) > 290
    (frame,) = whole.patches
    assert (frame.get_x(), frame.get_width()) == (west, east - west)
    assert len(map_figure(long, extent=np.array([[0.0, -9.0], [300.0, 9.0]])).axes) == 2  # asked for: no close-up


def test_a_vehicle_is_one_line_for_each_time_it_is_in_sight(scene_map: PrimitiveMap) -> None:
    time_ns = np.array([0, 1, 2, 100, 101, 0, 1]) * 1_000_000_000
    tracks = Tracks(
        track_id=np.array([1, 1, 1, 1, 1, 2, 2]), time_ns=time_ns, position=np.arange(14.0).reshape(7, 2),
        direction=np.zeros(7), speed=np.ones(7),
    )  # fmt: skip
    axes = map_figure(scene_map, tracks=tracks).axes[0]
    ways = [c for c in axes.collections if isinstance(c, LineCollection)][-1]
    assert sorted(len(path.vertices) for path in ways.get_paths()) == [2, 2, 3]


@pytest.mark.parametrize("name", ["map.png", "map.svg", "map.pdf"])
def test_a_figure_is_whole_and_is_not_overwritten(tmp_path: Path, scene_map: PrimitiveMap, name: str) -> None:
    figure = map_figure(scene_map)
    path = tmp_path / "figures" / name
    save_figure(figure, path)
    first = path.read_bytes()
    assert first.startswith({"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[name[-3:]])
    with pytest.raises(FileExistsError, match="choose another name or use --force"):
        save_figure(figure, path)
    save_figure(map_figure(scene_map), path, force=True)
    assert path.read_bytes() == first  # no date, no random name
    assert [p.name for p in path.parent.iterdir()] == [name]


def test_a_figure_that_cannot_be_drawn_leaves_what_was_there(
    tmp_path: Path, scene_map: PrimitiveMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    figure = map_figure(scene_map)
    save_figure(figure, tmp_path / "map.png")
    before = (tmp_path / "map.png").read_bytes()

    def half(part: BytesIO, **_: object) -> None:
        part.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(figure, "savefig", half)
    with pytest.raises(OSError, match="disk full"):
        save_figure(figure, tmp_path / "map.png", force=True)
    assert (tmp_path / "map.png").read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["map.png"]


SHARP_CELL, JUNCTION, OUTSIDE = (5.0, 5.0), (15.0, 15.0), (500.0, -3.0)


def lines_of(axes: Axes, color: str = INK) -> tuple[np.ndarray, np.ndarray]:
    """The longest line of a colour, x ascending."""
    line = max((line for line in axes.lines if line.get_color() == color), key=lambda line: len(line.get_xdata()))
    x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    return x, y


@pytest.mark.parametrize("position", [SHARP_CELL, JUNCTION])
def test_drawn_areas_of_directions_are_probabilities(scene_map: PrimitiveMap, position: tuple) -> None:
    theta, radius = lines_of(place_figure(scene_map, position=position).axes[0])
    assert np.trapezoid(radius**2, theta) == pytest.approx(1.0, abs=1e-3)


def test_the_drawn_density_of_speed_is_the_share_that_moves(scene_map: PrimitiveMap) -> None:
    speed = replace(scene_map.speed, rate=np.where(np.arange(3) == 1, 100.0, scene_map.speed.rate))  # mode 2 stands
    figure = place_figure(replace(scene_map, speed=speed), position=JUNCTION)
    x, density = lines_of(figure.axes[1])
    assert np.trapezoid(density, x) == pytest.approx(0.7, abs=0.02)  # past four standard deviations
    assert figure.axes[1].get_xlabel() == "speed [m/s]; standing, not drawn: 30.0%"
    assert [text.get_text() for text in figure.legends[0].get_texts()][1:] == ["60.0%: +17°, 8.0 ± 4.0 m/s"]


def test_the_posterior_moves_towards_the_signal(scene_map: PrimitiveMap) -> None:
    means = {}
    for name, cue in (("left", TURN_LEFT), ("right", TURN_RIGHT)):
        theta, radius = lines_of(place_figure(scene_map, position=JUNCTION, heading=1.2, cue=cue).axes[0], "#D55E00")
        assert np.trapezoid(radius**2, theta) == pytest.approx(1.0, abs=1e-3)
        means[name] = np.angle((radius**2 * np.gradient(theta) * np.exp(1j * theta)).sum())
    assert means["left"] > means["right"] + 0.3


def test_the_place_left_out_is_where_most_goes_different_ways(scene_map: PrimitiveMap) -> None:
    assert place_at(scene_map, None, None).cell == 1
    one_way = replace(scene_map, n_rows=np.array([10_000, 0, 0, 10_000]))
    assert place_at(one_way, None, None).cell == 0
    nothing = replace(scene_map, n_rows=np.zeros(4, np.int64))
    for of, position, said in (
        (scene_map, OUTSIDE, r"expected a place in a cell, got \(500, -3\) m, outside of all 3"),
        (nothing, None, "expected a cell that holds data"),
        (scene_map.without_places(), None, "expected a cell that holds data"),
        (scene_map, (np.nan, 0.0), "finite"),
    ):
        with pytest.raises(ValueError, match=said):
            place_figure(of, position=position)


def test_a_key_covers_no_data_and_rows_are_a_histogram(scene_map: PrimitiveMap, scene_tracks: Tracks) -> None:
    figure = place_figure(scene_map, position=SHARP_CELL, tracks=scene_tracks, cue=TURN_LEFT)
    figure.draw_without_rendering()
    key = figure.legends[0].get_window_extent()
    assert figure.bbox.contains(key.x0, key.y0)
    assert not any(key.overlaps(axes.get_tightbbox()) for axes in figure.axes)
    assert figure.legends[0].get_texts()[-1].get_text() == "the cell's 5 rows"
    (bars,) = figure.axes[1].patches
    heights, edges, _ = bars.get_data()
    assert (heights * np.diff(edges)).sum() == pytest.approx(1.0)


def test_a_chart_has_a_bar_for_each_figure_and_none_for_what_was_not_measured() -> None:
    """No gaps, so nothing in them: an empty bar without a number, and no warning."""
    reported = {"prior": 0.5, "place-free": 2.0}
    methods = [
        SimpleNamespace(
            name=name, mean=lambda figure, v=v: float("nan") if "hidden" in figure else v, std=lambda _: float("nan")
        )
        for name, v in reported.items()
    ]
    figure = tracking_chart(SimpleNamespace(methods=methods))
    figure.draw_without_rendering()
    rmse, *_, switches = figure.axes
    assert [text.get_text() for text in rmse.get_yticklabels()] == list(reported)
    widths = [bar.get_width() for bar in rmse.patches]
    assert widths[:4] == 2 * list(reported.values())  # of all, and of those in sight
    assert np.isnan(widths[4:]).all()
    assert {text.get_text() for text in rmse.texts} == {"0.50", "2.00", ""}
    assert switches.get_xlim()[0] == 0.0


def test_pyplot_is_never_imported() -> None:
    program = "import sys, dirprim_filter.viewer.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True)
