"""A tracker killed at any moment leaves a file out of which all but the last chunk is recovered."""

import numpy as np
import pytest
from killing import Trackers, trackers

KILLS = 3


@pytest.fixture(scope="module")
def tracking(tmp_path_factory, ring_map):
    with trackers(tmp_path_factory.mktemp("killed"), ring_map) as server:
        yield server


def test_kill_9_costs_no_more_than_the_last_chunk(tracking):
    rng = np.random.default_rng(5)
    kills = [tracking.kill_one(str(kill), rng) for kill in range(KILLS)]
    assert sum(kill.n_recovered > 0 for kill in kills) >= KILLS - 1


def test_the_check_itself_would_notice(tracking, monkeypatch):
    """Negative control: frames that were handed over and are not in the file."""
    real = Trackers._killed
    monkeypatch.setattr(Trackers, "_killed", lambda *given: real(*given) + 2_000_000_000)
    with pytest.raises(AssertionError, match="more than the chunk that was open"):
        tracking.kill_one("control", np.random.default_rng(6))
