"""The layout that ships names topics, fields and panels that are there."""

import json
import re
from pathlib import Path

from dirprim_filter.recording import scene, writer
from dirprim_filter.recording.schemas import dirprim_pb2

LAYOUT = json.loads((Path(__file__).parents[2] / "recordings" / "foxglove_layout.json").read_text())
WRITTEN = {value for name, value in vars(writer).items() if name.endswith("_TOPIC")}


def panels_in(tree: object) -> list[str]:
    return [tree] if isinstance(tree, str) else panels_in(tree["first"]) + panels_in(tree["second"])


def test_every_panel_is_laid_out_once():
    assert sorted(panels_in(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


def test_the_3d_panel_shows_topics_that_are_written_and_all_that_can_be_drawn():
    panel = LAYOUT["configById"]["3D!map"]
    assert set(panel["topics"]) <= WRITTEN
    assert {writer.MAP_SCENE_TOPIC, writer.ESTIMATES_SCENE_TOPIC, writer.PARTICLES_TOPIC, writer.FORECAST_TOPIC} <= set(
        panel["topics"]
    )
    assert panel["followTf"] == scene.MAP_FRAME
    assert panel["topics"][writer.PARTICLES_TOPIC]["colorField"] in (scene._PARTICLE.names or ())


def test_plots_are_of_fields_that_messages_have():
    fields = dirprim_pb2.TrackEstimates.DESCRIPTOR.fields_by_name
    values = [p["value"] for panel in LAYOUT["configById"].values() for p in panel.get("paths", [])]
    assert values
    for value in values:
        topic, field = re.fullmatch(r"([^.]+)\.(\w+)\[:\]", value).groups()
        assert topic == writer.ESTIMATES_TOPIC
        assert field in fields
