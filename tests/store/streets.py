"""Two streets far apart, and stores of logs of them."""

import numpy as np

from dirprim_filter import Tracks, save_map
from dirprim_filter.store import Store
from dirprim_filter.store.adding import add_logs
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.log_files import find_logs
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.table import read_summary

FAR_M = 1000.0
"""Between two streets: more than any tile reaches."""

MIDDLE_M = 50.0
"""Of a tile, about."""


def street(seed, *, north, n_vehicles=6):
    """Vehicles that drive 300 m to the east, across the borders of tiles, in one of two lanes and some of them back."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 30.01, 0.2)
    back = rng.random(n_vehicles) < 0.4
    speed = rng.uniform(8.0, 10.0, n_vehicles)
    way = speed[:, None] * t
    east = np.where(back[:, None], 240.0 - way, way - 60.0)
    side = np.where(back, 4.0, 0.0) + rng.normal(0.0, 0.3, n_vehicles)
    return Tracks(
        track_id=1000 * seed + np.repeat(np.arange(n_vehicles), t.size),
        time_ns=np.tile((t * 1e9).astype(np.int64), n_vehicles),
        position=np.column_stack([east.ravel(), np.repeat(MIDDLE_M + north + side, t.size)]),
        direction=np.repeat(np.where(back, np.pi, 0.0), t.size),
        speed=np.repeat(speed, t.size),
    )


def add(store, folder, *names):
    """Logs of a folder, by their names."""
    added = add_logs(store, find_logs([str(folder / f"{name}.mcap") for name in names]))
    assert not [receipt.error for receipt in added.receipts if receipt.error]


def store_of(path, folder, *names):
    """A new store of them."""
    store = Store.create(path, StoreConfig())
    add(store, folder, *names)
    return store


def summed(store):
    """What a store holds, as one summary."""
    return Summary.total([read_summary(store.recording(rows)) for rows in store.rows()])


def bytes_of(primitive_map, path):
    """Of the file that a map is saved in."""
    save_map(primitive_map, path, force=True)
    return path.read_bytes()
