"""What we write is what we read: tracks and detections through a file, to the last bit."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.columns import is_held
from dirprim_filter.detections import Detections
from dirprim_filter.recording import read_tracks, write_tracks
from dirprim_filter.tracks import Tracks

COLUMNS = ("track_id", "time_ns", "position", "direction", "speed", "group", "heading")


def crossing(vehicles):
    """1000 instants of some of the vehicles; numbers of many magnitudes and at the edges of intervals."""
    rng = np.random.default_rng(5)
    instant, vehicle = np.nonzero(rng.random((1000, len(vehicles))) < 0.6)
    n = len(instant)
    return Tracks(
        track_id=np.asarray(vehicles)[vehicle],
        time_ns=1_700_000_000_000_000_001 + instant * 33_333_333,
        position=rng.normal(size=(n, 2)) * 10.0 ** rng.uniform(-9, 6, (n, 1)),
        direction=np.where(rng.random(n) < 0.1, np.pi, rng.uniform(-np.pi, np.pi, n)),
        speed=np.where(rng.random(n) < 0.1, 0.0, rng.gamma(2.0, 5.0, n)),
        group=rng.integers(-(10**17), 10**17, n),
        heading=np.where(rng.random(n) < 0.2, np.nan, rng.uniform(-np.pi, np.pi, n)),
    )


@pytest.mark.parametrize("vehicles", [[3, -7, 10**17, 0, 12], ["a", "Ünïcode", "07", "a/b", "-"]])
def test_tracks_read_back_equal(tmp_path, vehicles):
    tracks = crossing(vehicles)
    write_tracks(tracks, tmp_path / "a.mcap", detections=Detections.of(tracks))
    back = read_tracks(tmp_path / "a.mcap")
    for name in COLUMNS:
        assert getattr(back, name).dtype.kind == getattr(tracks, name).dtype.kind
        np.testing.assert_array_equal(getattr(back, name), getattr(tracks, name), err_msg=name)
    write_tracks(replace(tracks, heading=[]), tmp_path / "b.mcap")
    assert not is_held(read_tracks(tmp_path / "b.mcap").heading)
