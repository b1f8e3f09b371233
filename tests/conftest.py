"""Situations that several test modules share."""

from pathlib import Path

import numpy as np
import pytest

from dirprim_filter import learn_primitives
from situations import ring_traffic

ROOT = Path(__file__).parents[1]


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
