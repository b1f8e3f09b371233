"""Tracks, detections and summaries out of logs that other software wrote, and what is said of other files."""

import logging
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from mcap_files import json_log, scene, write_protobuf_log

from dirprim_filter.detections import Detections
from dirprim_filter.recording.container import mcap_file as scans
from dirprim_filter.recording.errors import DecodeError, NotMcapError, NoTracksError, RecordingError
from dirprim_filter.recording.losses import INVALID, REPEATED, UNDECODABLE, UNTIMED
from dirprim_filter.recording.reader import (
    FieldMapping,
    read_estimates,
    read_track_logs,
    read_tracks,
    stream_detections,
)
from dirprim_filter.recording.writer import write_tracks
from situations import tracks_of

OSI = Path(__file__).parents[1] / "data" / "indicator_lights.mcap"
STEP_NS = 100_000_000
PATHS = "id=.of[].id,x=.of[].x,y=.of[].y"
FIELDS = FieldMapping.parse(PATHS)


def own_log(path, instants):
    """A log of objects (id, x, y) at each of several instants, in a schema of its own; `FIELDS` finds them."""
    named = [[dict(zip(("id", "x", "y"), one, strict=True)) for one in objects] for objects in instants]
    return json_log(path, "Own", [(k * STEP_NS, {"of": objects}) for k, objects in enumerate(named)])


def circling(n=40, name="7", radius=20.0, start=0):
    """One vehicle on a circle, 10 Hz, as scenes of one object each: (topic, log time, scene)."""
    angle = 0.05 * np.arange(n)
    return [
        ("/markers", start + i * STEP_NS, scene([(name, radius * np.cos(a), radius * np.sin(a))], stamp_s=i))
        for i, a in enumerate(angle)
    ]


def test_bad_rows_and_messages_are_counted_and_cost_no_others(tmp_path, caplog):
    messages = circling(n=10)
    messages[4][2].entities.add(id="8").cubes.add().pose.position.x = float("nan")
    messages[5][2].entities.extend([messages[4][2].entities[0]] * 2)
    messages[6][2].entities.add(id="x" * 1000).cubes.add()
    messages.insert(7, ("/markers", 650_000_000, b"\xff\xff no protobuf"))
    path = write_protobuf_log(tmp_path / "log.mcap", messages)
    with caplog.at_level(logging.WARNING):
        log = read_track_logs(path, time_source="log")
    assert len(log.tracks) == 10
    assert (log.losses.dropped[INVALID], log.losses.dropped[REPEATED], log.losses.dropped[UNDECODABLE]) == (2, 2, 1)
    assert log.losses.dropped.total() == 5
    assert log.losses.damage == []
    assert "log.mcap: left out 1 messages that cannot be decoded, 2 rows" in caplog.text
    with pytest.raises(DecodeError, match=r"log.mcap: topic /markers, message at 650000000 ns"):
        read_tracks(path, strict=True)


@pytest.mark.parametrize(("name", "stamp_ns", "n_rows"), [(0, STEP_NS, 10), (1, 0, 3)], ids=["id 0", "one stamp"])
def test_rows_that_mostly_repeat_name_ids_and_stamps_as_causes(tmp_path, name, stamp_ns, n_rows):
    """Three vehicles, all of id 0, as where an id is not set; or all of the same stamp."""
    sent = [
        (k * STEP_NS, {"t": 10**18 + k * stamp_ns, "of": [{"id": i * name, "x": k + 9 * i, "y": i} for i in range(3)]})
        for k in range(10)
    ]
    path, fields = json_log(tmp_path / "log.mcap", "Own", sent), FieldMapping.parse(f"{PATHS},time=.t")
    stream = stream_detections(path, mapping=fields)
    assert sum(map(len, stream)) == n_rows
    for losses in (stream.losses, read_track_logs(path, mapping=fields).losses):
        assert losses.dropped == {REPEATED: 30 - n_rows}
        assert "`dirprim track --no-ids`" in losses.faults[0]
        assert "--time-source log" in losses.faults[0]


def test_ids_that_vehicles_hand_on_at_each_message_name_none(tmp_path):
    """Six vehicles that drive abreast, 20 m apart: no step is longer than others, so none is a jump."""
    kept, handed_on = (
        own_log(path, [[(f"v{(i + k * shift) % 6}", k, 20 * i) for i in range(6)] for k in range(100)])
        for shift, path in enumerate((tmp_path / "kept.mcap", tmp_path / "handed_on.mcap"))
    )
    np.testing.assert_allclose(read_tracks(kept, mapping=FIELDS).speed, 10.0)
    with pytest.raises(RecordingError, match="to where another id was just before; `dirprim track --no-ids`"):
        read_tracks(handed_on, mapping=FIELDS)


@pytest.mark.parametrize("noise_m", [0.02, 1.0])
def test_ids_that_vehicles_exchange_now_and_then_are_reported(tmp_path, caplog, noise_m):
    """An id is a vehicle's place from west to east: where two are abreast they exchange it, by up to 70 m of jump."""
    noise = np.random.default_rng(0).normal(scale=noise_m, size=(200, 6, 2))
    radius, angle = np.arange(40.0, 22.0, -3.0), np.arange(6.0)
    at = angle + np.arange(200)[:, None] * STEP_NS * 1e-9 * 5.0 / radius
    places = np.stack([radius * np.cos(at), radius * np.sin(at)], axis=-1) + noise
    for ranked, n in ((False, 0), (True, 1)):
        caplog.clear()
        found = [sorted(place.tolist()) if ranked else place.tolist() for place in places]
        sent = [[(f"v{i}", *one) for i, one in enumerate(place)] for place in found]
        read_tracks(own_log(tmp_path / "log.mcap", sent), mapping=FIELDS)
        assert caplog.text.count("dirprim track --no-ids") == n, caplog.text


def test_objects_that_are_named_by_their_places_are_reported(tmp_path, caplog):
    for n in (1, 2):
        caplog.clear()
        poses = [[{"position": {"x": k, "y": 9 * i}} for i in range(n)] for k in range(9)]
        sent = [("/poses", k * STEP_NS, PosesInFrame(frame_id="map", poses=at)) for k, at in enumerate(poses)]
        assert read_tracks(write_protobuf_log(tmp_path / "log.mcap", sent)).n_tracks == n
        assert caplog.text.count("`dirprim track --no-ids`") == n - 1


def test_header_time_is_that_of_the_contents_and_rows_are_put_in_its_order(tmp_path):
    messages = circling(n=10)
    scenes = [update for *_, update in messages]
    for i, k in ((3, 4), (5, 7)):  # a stamp 1 s later than the next, and one 2 s later
        messages[i], messages[k] = (*messages[i][:2], scenes[k]), (*messages[k][:2], scenes[i])
    messages[9][2].entities[0].ClearField("timestamp")
    path = write_protobuf_log(tmp_path / "log.mcap", messages)
    tracks = read_tracks(path, start_ns=2_000_000_000, end_ns=8_000_000_000)
    assert tracks.time_ns.tolist() == [s * 1_000_000_000 for s in range(2, 8)]
    stream = stream_detections(path)
    assert [int(f.time_ns[0]) // 1_000_000_000 for f in stream] == [*range(9)]
    assert dict(stream.losses.dropped) == {UNTIMED: 1}


def test_several_logs_keep_their_vehicles_and_groups_apart(tmp_path):
    (tmp_path / "x").mkdir()
    a = write_protobuf_log(tmp_path / "a.mcap", circling(n=5) + circling(n=5, name="own"))
    b = write_protobuf_log(tmp_path / "b.mcap", circling(n=6))
    same = write_protobuf_log(tmp_path / "x" / "b.mcap", circling(n=7))
    tracks = read_tracks([a, b, same])
    names, counts = np.unique(tracks.track_id, return_counts=True)
    assert dict(zip(names.tolist(), counts.tolist(), strict=True)) == {"a/7": 5, "own": 5, "b-1/7": 6, "b-2/7": 7}
    groups = {name: set(tracks.group[tracks.track_id == name].tolist()) for name in names}
    assert groups == {"a/7": {0}, "own": {0}, "b-1/7": {1}, "b-2/7": {2}}
    with pytest.raises(ValueError, match="at least one log"):
        read_tracks([])


def test_tracks_come_from_our_own_topic_and_detections_from_theirs(tmp_path):
    path = tmp_path / "log.mcap"
    tracks, seen = (tracks_of([[(x, y) for x in range(20)]], track_id=5, speed=10.0) for y in (0.0, 0.7))
    write_tracks(tracks, path, detections=Detections.of(seen))
    assert set(read_tracks(path).position[:, 1]) == {0.0}
    stream = stream_detections(path)
    assert stream.topics == {"/detections"}
    assert {float(frame.position[0, 1]) for frame in stream} == {0.7}
    assert set(read_tracks(path, topics="/detections").position[:, 1]) == {0.7}


def test_of_several_scenes_the_one_with_objects_and_most_messages_is_read(tmp_path, caplog):
    short = [("/short", t, m) for _, t, m in circling(n=5)]
    ours = [("/dirprim/tracks/scene", t, m) for _, t, m in circling(n=90)]
    lanes = [("/lanes", t, scene([])) for t in range(100)]
    for _, _, update in lanes:
        update.entities.add(id="0").lines.add()
    path = write_protobuf_log(tmp_path / "log.mcap", circling(n=30) + short + ours + lanes)
    assert len(read_tracks(path)) == 30
    assert "/markers is read, not /short; --topics chooses" in caplog.text
    assert len(read_tracks(path, topics="/sho.*")) == 5
    assert len(read_tracks(path, topics="/dirprim/tracks/scene")) == 90


def test_fields_that_no_message_has_are_said_to_hold_nothing(tmp_path):
    path = own_log(tmp_path / "log.mcap", [[(1, k, 0)] for k in range(9)])
    with pytest.raises(NoTracksError, match=r"none of 9 messages of /\S+ holds an object with a place"):
        read_tracks(path, mapping=FieldMapping.parse("id=.of[].id,x=.of[].X,y=.of[].y"))


def test_a_log_without_objects_says_what_it_has_and_what_was_looked_for(tmp_path):
    path = write_protobuf_log(tmp_path / "log.mcap", [("/floor", 1, Grid()), ("/lanes", 1, scene([]))])
    with pytest.raises(NoTracksError) as reported:
        read_tracks(path)
    for part in ("log.mcap", "/floor (foxglove.Grid)", "/lanes (foxglove.SceneUpdate)", "--set fields=..."):
        assert part in str(reported.value)
    assert "\n" not in str(reported.value)
    with pytest.raises(NoTracksError, match="/nothing"):
        stream_detections(path, topics="/nothing")
    with pytest.raises(NoTracksError, match="/dirprim/tracks"):
        read_estimates(path)
    with pytest.raises(ValueError, match="regular expression"):
        read_tracks(path, topics="(")


def test_which_of_several_topics_has_most_messages_is_known_without_reading_them(tmp_path, monkeypatch):
    """A log with a Summary section is decompressed once, but for the chunks in which each topic is first met."""
    sent = [("/a" if k % 3 else "/b", k * 10**8, scene([("car" * 60, float(k), 0.0)])) for k in range(300)]
    path = write_protobuf_log(tmp_path / "log.mcap", sent, chunk_size=7000)  # the first one holds both
    opened, read = [], scans.read_contents
    monkeypatch.setattr(scans, "KEPT_BYTES", 0)  # else none is opened twice, however often it is read
    monkeypatch.setattr(scans, "read_contents", lambda file, chunk: opened.append(chunk.offset) or read(file, chunk))
    tracks = read_tracks(path)
    assert len(tracks) == 200
    n_chunks = len(set(opened))
    assert n_chunks > 10
    assert n_chunks <= len(opened) <= n_chunks + 2


def test_few_ids_among_objects_without_are_tracks_and_none_is_an_error(tmp_path):
    sent = [[("a" if k > 7 else "", float(k), 0.0)] for k in range(10)]
    assert read_tracks(own_log(tmp_path / "few.mcap", sent), mapping=FIELDS).track_id.tolist() == ["a", "a"]
    with pytest.raises(RecordingError, match="got 8 detections without ids"):
        read_tracks(own_log(tmp_path / "none.mcap", sent[:8]), mapping=FIELDS)


LONGEST = 600
FILES = {
    "bag_0": (b"SQLite format 3\0", "a ROS 2 bag in SQLite; `dirprim` reads its folder, or a file named .db3"),
    "old.rosbag": (b"#ROSBAG V2.0\n", "a ROS 1 bag; `dirprim` reads a file named .bag"),
    "run.rrd": (b"RRF2\0\0\0\0", "a rerun recording; `dirprim view`"),
    "av2.bin": (b"ARROW1\0\0", "a Feather table; `dirprim convert` without --format makes"),
    "t.bin": (b"PAR1\x15\x04", "a Parquet table; `dirprim convert` without --format makes"),
    "t.gz": (b"\x1f\x8b\x08\x08", "gzip; it does not decompress; `dirprim convert` reads a .csv.gz"),
    "t.dat": (b"time_s,track_id\n", "`dirprim convert` makes logs of tables"),
    "empty.mcap": (b"", "an empty file"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_another_format_says_the_way(tmp_path, name):
    opening, reported = FILES[name]
    (tmp_path / name).write_bytes(opening + bytes(100 * bool(opening)))
    with pytest.raises(NotMcapError, match="expected an MCAP log, got") as caught:
        read_tracks(tmp_path / name)
    assert reported in str(caught.value)
    assert len(str(caught.value).replace(str(tmp_path), "")) < LONGEST
