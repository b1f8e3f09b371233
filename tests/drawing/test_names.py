"""Labels of long ids, and how large vehicles are drawn."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter import write_tracks
from dirprim_filter.drawing.vehicles import LONGEST, drawn_sizes, short_name
from dirprim_filter.recording.reader import read_track_logs
from situations import tracks_of


def test_long_ids_are_shortened_and_keep_their_group_and_both_ends():
    uuid = "3f2b8c1e-0d4a-4f6b-9c7d-1a2b3c4d5e6f"
    assert short_name(uuid) == "3f2b…5e6f"
    assert short_name(f"7/{uuid}") == "7/3f2b…5e6f"
    for name in ("17", "7/car", "x" * LONGEST):
        assert short_name(name) == name
    assert len(short_name("x" * (LONGEST + 1))) < LONGEST


@pytest.mark.parametrize("name", ["log.mcap", "log.csv"])
def test_people_are_not_drawn_as_cars_nor_what_has_a_size_by_its_class(tmp_path, name):
    """By the labels of a log or a table; of no label nothing is known."""
    east = np.arange(5.0)[:, None] * [1.0, 0.0]
    tracks = tracks_of(east + np.zeros((4, 1, 2)), track_id=np.array([[1], [2], [3], [4]]),
                       time_ns=100_000_000 * np.arange(5), direction=0.0, speed=10.0)  # fmt: skip
    labels = {1: "human.pedestrian.adult", 2: "Bus", 3: "person"}
    if name.endswith("csv"):
        rows = [f"{t / 1e9},{i},{x},{y},{labels.get(i, '')}" for t, i, (x, y) in
                zip(tracks.time_ns, tracks.track_id.tolist(), tracks.position, strict=True)]  # fmt: skip
        (tmp_path / name).write_text("\n".join(["time_s,track_id,x_m,y_m,label", *rows]))
    else:
        write_tracks(tracks, tmp_path / name, labels=labels)
    read = read_track_logs(tmp_path / name)
    assert read.labels == {str(i): label for i, label in labels.items()}
    stated = replace(read.tracks, size=np.where(read.tracks.track_id[:, None] == 3, [2.0, 1.0, 1.0], np.nan))
    drawn = drawn_sizes(stated, read.labels)
    length = {i: drawn.size[drawn.track_id == i][0, 0] for i in (1, 2, 3, 4)}
    assert length == pytest.approx({1: 0.5, 2: 12.0, 3: 2.0, 4: np.nan}, nan_ok=True)
