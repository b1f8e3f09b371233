"""Figures: all petals are there, north is up, files are whole, nothing global is touched."""

import subprocess
import sys
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.image import imread

from dirprim_filter.drawing import shapes
from dirprim_filter.estimates import Estimates, TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.tracks import Tracks
from dirprim_filter.viewer.figures import demo_figure, map_figure, save_figure

FUTURES = np.cumsum(np.full((6, 5, 2), 2.0), axis=1) + 20.0


def test_the_map_shows_every_petal_with_north_up_and_equal_scales(
    scene_map: PrimitiveMap, scene_tracks: Tracks
) -> None:
    figure = map_figure(scene_map, tracks=scene_tracks)
    axes, color_bar = figure.axes
    (petals,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
    assert len(petals.get_paths()) == len(shapes.rose_petals(scene_map).polygon)
    figure.draw_without_rendering()
    origin, east, north = axes.transData.transform([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    assert east[0] > origin[0]
    assert north[1] > origin[1]
    assert east[0] - origin[0] == pytest.approx(north[1] - origin[1])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("east [m]", "north [m]")
    assert color_bar.get_ylabel() == "mean speed [m/s]"
    explained = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"cells", "tracks", "roots, where petals start"} <= set(explained)


def test_a_vehicle_is_one_line_for_each_time_it_is_in_sight(scene_map: PrimitiveMap) -> None:
    time_ns = np.array([0, 1, 2, 100, 101, 0, 1]) * 1_000_000_000
    tracks = Tracks(
        track_id=np.array([1, 1, 1, 1, 1, 2, 2]), time_ns=time_ns, position=np.arange(14.0).reshape(7, 2),
        direction=np.zeros(7), speed=np.ones(7),
    )  # fmt: skip
    axes = map_figure(scene_map, tracks=tracks).axes[0]
    _cells, ways = [c for c in axes.collections if isinstance(c, LineCollection)]
    assert sorted(len(path.vertices) for path in ways.get_paths()) == [2, 2, 3]


def test_the_demo_shows_the_vehicle_that_is_forecast(
    tmp_path: Path, scene_map: PrimitiveMap, scene_tracks: Tracks, scene_frames: list[TrackedFrame]
) -> None:
    figure = demo_figure(
        scene_map, tracks=scene_tracks, frame=scene_frames[2],
        estimates=Estimates.concatenate([frame.estimates for frame in scene_frames]),
        truth=scene_tracks, forecasts={"8": FUTURES},
    )  # fmt: skip
    assert figure.axes[1].get_title(loc="left") == "(b)  Tracked: vehicle 8 and its rollouts"
    (cloud,) = [c for c in figure.axes[2].collections if type(c) is PathCollection]
    mine = scene_frames[2].particles.vehicle == 1
    assert (cloud.get_offsets() == scene_frames[2].particles.position[mine]).all()
    save_figure(figure, tmp_path / "demo.png")
    picture = imread(tmp_path / "demo.png")
    assert picture.shape[1] > 1500
    assert 0.02 < (picture[..., :3] < 0.9).any(axis=-1).mean() < 0.6  # neither blank nor cluttered


def test_the_demo_needs_neither_truth_nor_forecasts_but_its_vehicle(
    scene_map: PrimitiveMap, scene_tracks: Tracks, scene_frames: list[TrackedFrame]
) -> None:
    estimates = Estimates.concatenate([frame.estimates for frame in scene_frames])
    figure = demo_figure(scene_map, tracks=scene_tracks, frame=scene_frames[2], estimates=estimates)
    assert figure.axes[1].get_title(loc="left") == "(b)  Tracked: vehicle 7 and its rollouts"
    with pytest.raises(ValueError, match="focus: vehicle 99 is not among the frame's 2"):
        demo_figure(scene_map, tracks=scene_tracks, frame=scene_frames[2], estimates=estimates, focus="99")


def test_map_and_tracking_show_the_same_place_and_the_vehicle_well_inside(
    scene_map: PrimitiveMap, scene_tracks: Tracks, scene_frames: list[TrackedFrame]
) -> None:
    far = replace(scene_frames[2].estimates, position=scene_frames[2].estimates.position + 100.0)
    for believed in (scene_frames[2].estimates, far):
        frame = replace(scene_frames[2], estimates=believed)
        learned, tracked, *_ = demo_figure(scene_map, tracks=scene_tracks, frame=frame, estimates=believed).axes
        assert (learned.get_xlim(), learned.get_ylim()) == (tracked.get_xlim(), tracked.get_ylim())
        low, high = np.array([tracked.get_xlim(), tracked.get_ylim()]).T
        assert (believed.position[0] >= low + 0.2 * (high - low)).all()
        assert (believed.position[0] <= high - 0.2 * (high - low)).all()


def test_the_demo_draws_the_way_of_the_last_seconds_alone(
    scene_map: PrimitiveMap, scene_tracks: Tracks, scene_frames: list[TrackedFrame]
) -> None:
    estimates = Estimates.concatenate([frame.estimates for frame in scene_frames])
    long_ago = replace(estimates, time_ns=estimates.time_ns - 20_000_000_000)
    both = Estimates.concatenate([long_ago, estimates])
    tracked = demo_figure(scene_map, tracks=scene_tracks, frame=scene_frames[2], estimates=both).axes[1]
    ways = [c for c in tracked.collections if isinstance(c, LineCollection) and c.get_capstyle() == "round"]
    assert [[len(path.vertices) for path in way.get_paths()] for way in ways] == [[3], [3]]  # up to the frame


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


@pytest.mark.parametrize("name", ["map.xyz", "map", "map.jpg"])
def test_an_unknown_format_is_refused_and_leaves_nothing(tmp_path: Path, scene_map: PrimitiveMap, name: str) -> None:
    with pytest.raises(ValueError, match=r"expected a name that ends in \.png, \.pdf, \.svg"):
        save_figure(map_figure(scene_map), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


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


def test_pyplot_is_never_imported() -> None:
    program = "import sys, dirprim_filter.viewer.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True)
