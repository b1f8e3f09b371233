"""Situations that several test modules share."""

from pathlib import Path

import numpy as np
import pytest

from dirprim_filter import learn_primitives
from dirprim_filter.cli.warm_up import warm_up
from situations import ring_traffic

ROOT = Path(__file__).parents[1]


def pytest_sessionstart(session):
    """Where kernels are not compiled yet, two workers compile different ones first, not both the same."""
    worker = getattr(session.config, "workerinput", {}).get("workerid", "")
    if any((ROOT / "dirprim_filter" / "filtering" / "__pycache__").glob("*.nbi")):
        return
    if worker == "gw0":
        learn_primitives(ring_traffic(np.random.default_rng(7)), rng=np.random.default_rng(7))
    elif worker == "gw1":
        warm_up()


@pytest.fixture(scope="session")
def real_data():
    """The folder of real data beside the project; tests of it skip where it is absent."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"real data absent: {folder}")
    return folder


@pytest.fixture(scope="session")
def ring():
    """Forty vehicles on a ring of 20 m radius."""
    return ring_traffic(np.random.default_rng(7))


@pytest.fixture(scope="session")
def ring_map(ring):
    """What is learned from them."""
    return learn_primitives(ring, tessellation="grid", cell_size=6.0, rng=np.random.default_rng(7))
