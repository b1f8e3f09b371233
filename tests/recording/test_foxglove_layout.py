"""The layout names topics, fields and frames that are there, and looks at what is drawn."""

import json
import re

import numpy as np
import pytest
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from test_estimate_log import a_frame, a_map, messages

from dirprim_filter.drawing import shapes
from dirprim_filter.recording import topic_names, writer
from dirprim_filter.recording.errors import OutputExistsError
from dirprim_filter.recording.foxglove.elements import SCENE_FRAME
from dirprim_filter.recording.foxglove.layout import layout, write_layout
from dirprim_filter.recording.schemas import dirprim_pb2

LAYOUT = layout(a_map())
PANELS = LAYOUT["configById"]
WRITTEN = {value for name, value in vars(topic_names).items() if name.isupper()}


def test_the_3d_panel_shows_topics_that_are_written_and_all_that_can_be_drawn(tmp_path):
    with writer.EstimateWriter(tmp_path / "a.mcap", metadata={}, particle_stride=1) as log:
        log.write_map_scene(a_map())
        log.write(a_frame(5))
    shown = PANELS["3D!map"]["topics"]
    assert set(shown) <= WRITTEN
    drawn = {topic_names.MAP_SCENE, topic_names.ESTIMATES_SCENE, topic_names.PARTICLES, topic_names.FORECAST}
    assert drawn <= set(shown)
    assert {name for name, topic in shown.items() if not topic["visible"]} == {topic_names.SMOOTHED_SCENE}
    (cloud,) = messages(tmp_path / "a.mcap", topic_names.PARTICLES)
    assert shown[topic_names.PARTICLES]["colorMode"] == "rgba-fields"
    assert {"red", "green", "blue", "alpha"} <= {field.name for field in PointCloud.FromString(cloud.data).fields}


def test_the_camera_stands_over_the_scene_and_sees_the_busy_part_of_the_map():
    panel = PANELS["3D!map"]
    assert (panel["followTf"], panel["followMode"]) == (SCENE_FRAME, "follow-pose")
    camera = panel["cameraState"]
    assert camera["perspective"] is False
    assert camera["targetOffset"] == [0.0, 0.0, 0.0]
    box = shapes.map_extent(a_map(), share=shapes.BUSY_SHARE)
    assert np.ptp(box, axis=0).max() <= camera["distance"] < 1.2 * np.ptp(box, axis=0).max()


def test_plots_are_of_fields_that_messages_have_and_say_so_to_foxglove_and_to_lichtblick():
    fields = dirprim_pb2.TrackEstimates.DESCRIPTOR.fields_by_name
    plots = [panel for name, panel in PANELS.items() if name.startswith("Plot!")]
    assert len(plots) >= 3
    for panel in plots:
        assert panel["title"] == panel["lichtblickPanelTitle"] != ""
        for path in panel["paths"]:
            topic, field = re.fullmatch(r"([^.]+)\.(\w+)\[:\]", path["value"]).groups()
            assert topic == topic_names.ESTIMATES
            assert field in fields


def test_the_file_is_json_and_is_not_overwritten_by_accident(tmp_path):
    path = tmp_path / "layout.json"
    write_layout(a_map(), path)
    assert json.loads(path.read_text()) == LAYOUT
    with pytest.raises(OutputExistsError):
        write_layout(a_map(), path)
    write_layout(a_map(), path, force=True)
