"""Streets, their logs, and stores of them."""

import hashlib

import numpy as np

from dirprim_filter import Tracks, save_map, write_tracks
from dirprim_filter.store import add_logs, find_logs, learn_from_store
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.rows import StoredRows
from dirprim_filter.store.store import Store

GRID = {"tessellation": "grid", "cell_size": 64.0}
"""Fast to learn."""


def street(seed, *, north=0.0, start=-60.0, length=120.0, n_vehicles=5, back=0.4, day=0):
    """Vehicles that drive to the east, and some of them back; each comes five seconds after the one before."""
    rng = np.random.default_rng(seed)
    speed, turned = rng.uniform(9.0, 11.0, n_vehicles), rng.random(n_vehicles) < back
    t = np.arange(0.0, length / 9.0, 0.2)
    way = speed[:, None] * t
    east = np.where(turned[:, None], start + length - way, start + way)
    side = np.where(turned, 4.0, 0.0) + rng.normal(0.0, 0.3, n_vehicles) + north
    seen, shape = way < length, way.shape
    time_s = t + 5.0 * np.arange(n_vehicles)[:, None]
    return Tracks(
        track_id=np.broadcast_to(np.arange(n_vehicles)[:, None], shape)[seen],
        time_ns=(np.round(time_s * 10) * 1e8).astype(np.int64)[seen] + day * 86_400 * 10**9,
        position=np.column_stack([east[seen], np.broadcast_to(side[:, None], shape)[seen]]),
        direction=np.broadcast_to(np.where(turned, np.pi, 0.0)[:, None], shape)[seen],
        speed=np.broadcast_to(speed[:, None], shape)[seen],
    )


def logs_of(folder, **tracks):
    """Logs by their names; -> their paths, as a store calls them."""
    for name, of in tracks.items():
        write_tracks(of, folder / f"{name}.mcap", force=True)
    return {name: str(folder / f"{name}.mcap") for name in tracks}


def store_of(path, *logs):
    """A store of logs."""
    added = add_logs(path, find_logs(logs))
    assert not [receipt.error for receipt in added.receipts if receipt.error]
    return added.store


def rows_stored(path, **rows):
    """A store of rows, or of tracks, without logs: sooner made."""
    store = Store.create(path, StoreConfig(), "map")
    for name, each in rows.items():
        files = store.write(
            each if isinstance(each, StoredRows) else StoredRows.of(each), log=name, mark="0", status="whole"
        )
        store.commit(lambda _, files=files: (files, []))
    return store


def map_bytes(store, folder, **options):
    """A hash of the file that the map of a store is saved in."""
    path = folder / "bytes.mcap"
    save_map(learn_from_store(store, **(GRID | options)).primitive_map, path, force=True)
    return hashlib.sha256(path.read_bytes()).hexdigest()


def damage(store, file, rng):
    """Flip a bit of a file of a store."""
    data = bytearray(store.get(file.path))
    at = int(rng.integers(len(data)))
    data[at] ^= 1 << int(rng.integers(8))
    store.put(file.path, bytes(data))
