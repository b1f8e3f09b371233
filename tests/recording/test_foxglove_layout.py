"""The layout that the guide gives for Foxglove names topics, fields and frames that are there."""

import json
import re
from pathlib import Path

from dirprim_filter.recording import topic_names
from dirprim_filter.recording.foxglove.elements import SCENE_FRAME
from dirprim_filter.recording.schemas import dirprim_pb2

PANELS = json.loads((Path(__file__).parents[2] / "docs/guides/foxglove_layout.json").read_text())["configById"]
WRITTEN = {value for name, value in vars(topic_names).items() if name.isupper()}


def test_the_3d_panel_stands_over_the_scene_and_shows_topics_that_are_written():
    panel = PANELS["3D!map"]
    assert (panel["followTf"], panel["followMode"]) == (SCENE_FRAME, "follow-pose")
    assert panel["cameraState"]["perspective"] is False
    assert set(panel["topics"]) <= WRITTEN
    drawn = {topic_names.MAP_SCENE, topic_names.ESTIMATES_SCENE, topic_names.PARTICLES, topic_names.FORECAST}
    assert drawn <= {name for name, topic in panel["topics"].items() if topic["visible"]}


def test_plots_are_of_fields_that_messages_have():
    fields = dirprim_pb2.TrackEstimates.DESCRIPTOR.fields_by_name
    for panel in (panel for name, panel in PANELS.items() if name.startswith("Plot!")):
        for path in panel["paths"]:
            topic, field = re.fullmatch(r"([^.]+)\.(\w+)\[:\]", path["value"]).groups()
            assert topic == topic_names.ESTIMATES
            assert field in fields
