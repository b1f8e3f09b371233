"""What `dirprim track` says of a log that it hardly tracks, and of a map of another place."""

from dataclasses import replace

import pytest

from cli.commands import DONE, FAILED, INPUT_LOST, dirprim
from dirprim_filter import write_tracks
from dirprim_filter.recording.scan import scan

TRACK = "--map map.mcap -o out --noise 0.5 --particles 50 --force"


def test_a_map_of_another_place_is_said_by_track_and_refused_by_evaluate(here, few, capsys):
    write_tracks(replace(few, position=few.position + 1e5), "far.mcap")
    for log, share in (("log.mcap", "0.0%"), ("far.mcap", "100.0%")):
        assert dirprim(f"track {log} {TRACK}") == DONE
        assert f", {share} outside the map" in capsys.readouterr().out
    assert dirprim("evaluate tracking far.mcap --map map.mcap") == FAILED
    assert "map.mcap: expected a map of the log's place, got one with 100.0% of the rows outside" in (
        " ".join(capsys.readouterr().err.split())
    )


def test_a_log_most_of_whose_rows_have_no_estimate_is_input_lost(here, capsys):
    assert dirprim(f"track log.mcap {TRACK} --no-ids --set clutter_density=10") == INPUT_LOST
    said = capsys.readouterr()
    assert "100.0% of 600 rows without an estimate" in said.out
    assert "most rows have no estimate" in said.err


@pytest.mark.parametrize("form", ["foxglove", "vision_msgs", "autoware"])
def test_estimates_are_written_in_the_messages_that_are_asked_for(here, form):
    assert dirprim(f"track log.mcap {TRACK} --as {form}") == DONE
    with scan("out") as log:
        schemas = {channel.schema.name.split("/")[0] for channel in log.channels()}
    ours = {"foxglove": "foxglove.SceneUpdate", "vision_msgs": "vision_msgs", "autoware": "autoware_perception_msgs"}
    assert schemas & {*ours.values()} == {ours["foxglove"], ours[form]}
