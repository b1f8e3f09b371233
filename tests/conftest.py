"""Situations that several test modules share."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer

from dirprim_filter import learn_primitives, read_tracks, write_tracks
from dirprim_filter.cli.compiling import quiet_unless_watched, warm_up
from dirprim_filter.detections import Detections
from dirprim_filter.recording.reader import stream_detections
from situations import ring_traffic

ROOT = Path(__file__).parents[1]
SECONDS = {"learn": 20.0, "track": 8.0}
"""Of the recordings that are learned from and tracked, so much is enough to follow what is written of them."""


def pytest_sessionstart(session):
    """Where kernels are not compiled yet, two workers compile different ones first, not both the same."""
    quiet_unless_watched()
    typer.main.get_command = cache(typer.main.get_command)  # thirty commands are put together once
    worker = getattr(session.config, "workerinput", {}).get("workerid", "")
    if any((ROOT / "dirprim_filter" / "filtering" / "__pycache__").glob("*.nbi")):
        return
    if worker == "gw0":
        learn_primitives(ring_traffic(np.random.default_rng(7)), rng=np.random.default_rng(7))
    elif worker == "gw1":
        warm_up()


@pytest.fixture(scope="session")
def ring():
    """Forty vehicles on a ring of 20 m radius."""
    return ring_traffic(np.random.default_rng(7))


@pytest.fixture(scope="session")
def ring_map(ring):
    """What is learned from them."""
    return learn_primitives(ring, tessellation="grid", cell_size=6.0, rng=np.random.default_rng(7))


@pytest.fixture(params=["particles", "kalman"])
def either(request, ring_map):
    """What vehicles are tracked by: the map, or None, which `tracker_of` takes for a Kalman filter."""
    return ring_map if request.param == "particles" else None


@pytest.fixture(scope="session")
def short_recordings(tmp_path_factory):
    """A folder of logs of the recordings' names, cut down: the same commands on them are sooner done."""
    folder = tmp_path_factory.mktemp("recordings")
    for log in (ROOT / "recordings").iterdir():
        seconds = SECONDS.get(log.stem.rpartition("_")[2])
        if seconds is None:
            (folder / log.name).symlink_to(log)
            continue
        until_ns = int(seconds * 1e9)
        seen = (
            [frame for frame in stream_detections(log, topics="/detections") if frame.time_ns[0] < until_ns]
            if ("track" in log.name)
            else []
        )
        tracks = read_tracks(log, end_ns=until_ns)
        write_tracks(tracks, folder / log.name, detections=Detections.concatenate(seen) if seen else None)
    return folder


@pytest.fixture
def beside_recordings(tmp_path, short_recordings, monkeypatch):
    """Where commands of the pages find their recordings."""
    (tmp_path / "recordings").symlink_to(short_recordings)
    monkeypatch.chdir(tmp_path)
