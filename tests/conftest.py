"""Situations that several test modules share."""

from pathlib import Path

import numpy as np
import pytest

from dirprim_filter import Tracks, learn_primitives

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def real_data():
    """The folder of real data beside the project; tests of it skip where it is absent."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"real data absent: {folder}")
    return folder


def ring_traffic(rng, *, n_vehicles=40, radius=20.0, speed=8.0, n_rows=100, dt_s=0.1):
    """Vehicles that drive counter-clockwise around the origin, at speeds and radii of their own."""
    start = rng.uniform(0, 2 * np.pi, n_vehicles)
    pace = speed * rng.gamma(50.0, 1 / 50.0, n_vehicles)
    r = radius + rng.normal(0, 0.7, n_vehicles)
    t = np.arange(n_rows) * dt_s
    angle = start[:, None] + pace[:, None] / r[:, None] * t
    position = np.stack([r[:, None] * np.cos(angle), r[:, None] * np.sin(angle)], axis=-1)
    return Tracks(
        track_id=np.repeat(np.arange(n_vehicles), n_rows),
        time_ns=np.tile((t * 1e9).round().astype(np.int64), n_vehicles),
        position=position.reshape(-1, 2),
        direction=(angle + np.pi / 2).ravel(),
        speed=np.repeat(pace, n_rows),
    )


@pytest.fixture(scope="session")
def ring():
    """Forty vehicles on a ring of 20 m radius."""
    return ring_traffic(np.random.default_rng(7))


@pytest.fixture(scope="session")
def ring_map(ring):
    """What is learned from them."""
    return learn_primitives(ring, cell_size=6.0, rng=np.random.default_rng(7))
