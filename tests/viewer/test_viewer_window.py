"""The real viewer, without a screen: no view reports an error, and north-east is up and to the right."""

import io
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from rerun.experimental import ViewerClient

from dirprim_filter.estimates import TrackedFrame
from dirprim_filter.primitives.primitive_map import PrimitiveMap
from dirprim_filter.viewer.blueprint import TIMELINE
from dirprim_filter.viewer.colors import track_color
from dirprim_filter.viewer.stream import _viewer_program, open_stream

DRIVERS = [icd for folder in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d") for icd in Path(folder).glob("*.json")]
pytestmark = pytest.mark.skipif(not DRIVERS, reason="no Vulkan driver: apt-get install mesa-vulkan-drivers")


@pytest.fixture
def viewer() -> Iterator[ViewerClient]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    client = ViewerClient.spawn(headless=True, port=port, executable_path=_viewer_program())
    yield client
    client.quit()


def settled_picture(client: ViewerClient) -> np.ndarray:
    """The window once two pictures in a row agree: data arrive lazily."""
    before = None
    for _ in range(40):
        picture = imread(io.BytesIO(client.take_screenshot()))
        if before is not None and picture.shape == before.shape and (picture == before).all():
            return picture
        before = picture
        time.sleep(0.2)
    pytest.fail("the viewer's picture never came to rest")


def place_of(picture: np.ndarray, rgb: np.ndarray) -> np.ndarray:
    """(right, up) mean place in pixels of what has the colour."""
    row, column = np.nonzero(np.abs(255.0 * picture[..., :3] - rgb).max(axis=-1) < 12)
    assert row.size > 20, "nothing of this colour is to be seen"
    return np.array([column.mean(), -row.mean()])


def test_a_vehicle_heading_north_east_goes_up_and_right(
    tmp_path: Path, scene_map: PrimitiveMap, scene_frames: list[TrackedFrame], viewer: ViewerClient
) -> None:
    with open_stream(save=tmp_path / "run.rrd", connect=viewer.url) as sink:
        sink.log_map(scene_map)
        for frame in scene_frames:
            sink.write(frame)
    assert (tmp_path / "run.rrd").exists()
    color = track_color(np.array([7]))[0, :3].astype(float)  # vehicle 8 may share it: it goes the same way
    places = []
    for frame in (scene_frames[0], scene_frames[4]):
        viewer.set_time(TIMELINE, timestamp=np.datetime64(frame.time_ns, "ns"), play_state="paused")
        time.sleep(0.5)
        places.append(place_of(settled_picture(viewer), color))
    views = viewer.get_state().views
    assert "Map, north up" in {view.name for view in views}
    assert [report for view in views for report in view.reports] == []
    right, up = places[1] - places[0]
    assert right > 5
    assert up > 5
