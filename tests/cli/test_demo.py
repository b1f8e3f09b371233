"""`dirprim demo`: what it writes opens everywhere; in the blind scene tracks last where nothing is detected."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dirprim_filter import read_estimates
from dirprim_filter.cli.demo import departure_rate, in_ring, with_blind_ring
from dirprim_filter.detections import Detections
from recording.mcap_files import stock

OUTPUTS = {"map.mcap", "tracks.mcap", "tracks.rrd", "demo.png"}
WAYS = ("with the map", "without the map", "constant velocity")


@pytest.fixture
def short(short_recordings, monkeypatch):
    monkeypatch.setattr("dirprim_filter.cli.demo.recordings_folder", lambda: short_recordings)


def test_the_ring_is_between_two_squares_and_its_detections_and_all_ids_are_gone():
    position = np.array([[0, 0], [24.9, 0], [25, 0], [0, -45], [45, 45], [45.1, 0], [-30, 10], [-30, 60]], np.float64)
    assert in_ring(position).tolist() == [False, False, True, True, True, False, True, False]
    seen = Detections(track_id=np.arange(8).astype(str), time_ns=np.arange(8), position=position)
    left = with_blind_ring(seen)
    assert left.time_ns.tolist() == [0, 1, 5, 7]
    assert set(left.track_id) == {""}


def test_vehicles_leave_once_each_in_the_time_that_they_are_watched(ring):
    two = ring[ring.track_id < 2]
    watched_s = sum(np.ptp(two.time_ns[two.track_id == i]) * 1e-9 for i in range(2))
    assert departure_rate(two) == pytest.approx(2 / watched_s)


@pytest.mark.slow
@pytest.mark.usefixtures("short")
def test_the_demo_opens_everywhere(here, said, refused):
    """With the stock reader and its CRCs, with rerun's importer, and by rerun's own check."""
    table = said("demo").out
    assert all(f"\n{way}  " in table for way in WAYS)
    assert {path.name for path in Path("demo").iterdir()} == OUTPUTS
    rerun = Path(sys.executable).with_name("rerun")
    for name in ("map", "tracks"):
        assert stock(Path(f"demo/{name}.mcap"))
        convert = [rerun, "mcap", "convert", f"demo/{name}.mcap", "-o", f"{name}.rrd"]
        subprocess.run(convert, check=True, capture_output=True)
    for recording in ("demo/tracks.rrd", "map.rrd", "tracks.rrd"):
        subprocess.run([rerun, "rrd", "verify", recording], check=True, capture_output=True)
    refused("demo", "use --force")  # nothing is overwritten


@pytest.mark.slow
@pytest.mark.usefixtures("short")
def test_the_demo_of_the_blind_scene(tmp_path, said):
    table = said("demo --scene blind -o", tmp_path / "demo").out
    assert all(words in table for words in ("HOTA", "identity switches", *WAYS))
    assert {path.name for path in (tmp_path / "demo").iterdir()} == OUTPUTS
    found = read_estimates(tmp_path / "demo" / "tracks.mcap")
    assert found.unseen_s[in_ring(found.position)].max() > 1.0  # they last where nothing is detected
