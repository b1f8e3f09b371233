"""The real viewer, without a screen: no view reports an error, and north-east is up and to the right."""

import io
import time
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from rerun.experimental import ViewerClient
from rrd_files import DRIVERS

from dirprim_filter.detections import Detections
from dirprim_filter.drawing.colors import track_color
from dirprim_filter.forecasting import Forecasts
from dirprim_filter.viewer.curves import PLOTS
from dirprim_filter.viewer.process import free_port, viewer_program
from dirprim_filter.viewer.sink import RerunSink
from dirprim_filter.viewer.stream import TIMELINE

pytestmark = pytest.mark.skipif(not DRIVERS, reason="no Vulkan driver: apt-get install mesa-vulkan-drivers")


@pytest.fixture
def viewer():
    client = ViewerClient.spawn(headless=True, port=free_port(), executable_path=viewer_program())
    yield client
    client.quit()


def settled_picture(client):
    """The window once two pictures in a row agree: data arrive lazily."""
    before = None
    for _ in range(40):
        picture = imread(io.BytesIO(client.take_screenshot()))
        if before is not None and picture.shape == before.shape and (picture == before).all():
            return picture
        before = picture
        time.sleep(0.2)
    pytest.fail("the viewer's picture never came to rest")


def place_of(picture, rgb):
    """(right, up) mean place in pixels of what has the colour."""
    row, column = np.nonzero(np.abs(255.0 * picture[..., :3] - rgb).max(axis=-1) < 12)
    assert row.size > 20, "nothing of this colour is to be seen"
    return np.array([column.mean(), -row.mean()])


def shown_at(client, time_ns):
    client.set_time(TIMELINE, timestamp=np.datetime64(time_ns, "ns"), play_state="paused")
    time.sleep(0.5)
    return settled_picture(client)


def map_area(picture):
    """The part of the window where the map is: the plots beside have its colours."""
    return picture[: int(0.95 * len(picture)), : int(0.58 * picture.shape[1])]


def reports_of(client):
    views = client.get_state().views
    assert views
    return [report for view in views for report in view.reports]


def test_a_vehicle_heading_north_east_goes_up_and_right(tmp_path, scene_map, scene_frames, viewer):
    with RerunSink(save=tmp_path / "run.rrd", connect=viewer.url) as sink:
        sink.log_map(scene_map)
        for frame in scene_frames:
            sink.write(frame)
    assert (tmp_path / "run.rrd").exists()
    color = track_color(np.array([7]))[0, :3].astype(float)  # vehicle 8 may share it: it goes the same way
    pictures = [shown_at(viewer, frame.time_ns) for frame in (scene_frames[0], scene_frames[4])]
    places = [place_of(map_area(picture), color) for picture in pictures]
    assert "Map, north up" in {view.name for view in viewer.get_state().views}
    assert reports_of(viewer) == []
    right, up = places[1] - places[0]
    assert right > 5
    assert up > 5


@pytest.mark.slow
def test_every_kind_of_recording_opens_without_a_complaint(tmp_path, scene_map, scene_frames, scene_tracks, viewer):
    first = scene_frames[0]
    with RerunSink(save=tmp_path / "run.rrd") as sink:
        sink.log_map(scene_map)
        sink.log_truth(scene_tracks)
        for frame in scene_frames:
            reported = np.ones(len(frame.estimates))
            sink.write(replace(frame, innovations=reported))
            sink.write_smoothed(frame)
            if frame is first:
                rollouts = np.cumsum(np.ones((2, 20, 8, 2)), axis=2) + first.estimates.position[:, None, None]
                sink.write_forecast(Forecasts(first.time_ns, ["7", "8"], first.estimates.position, rollouts))
        sink.log_run({"command": "test"})
    with RerunSink("dirprim log", save=tmp_path / "log.rrd") as sink:
        sink.log_truth(scene_tracks)
        sink.log_detections(Detections.of(scene_tracks))
    views = {
        "log": {"Map, north up"},
        "run": {"Map, north up", "Events", *(curves.title for curves in PLOTS.values())},
    }  # fmt: skip
    for name, expected in views.items():
        viewer.open(str(tmp_path / f"{name}.rrd"))
        time.sleep(1.0)
        shown_at(viewer, scene_frames[2].time_ns)
        names = {view.name for view in viewer.get_state().views}
        assert expected <= names, name
        assert reports_of(viewer) == [], name
