"""What is damaged or crafted in a store is found, named, and left out, and the rest goes on."""

import hashlib
import io
import json
from pathlib import Path
from shutil import copytree

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from streets import GRID, damage, map_bytes, rows_stored, street

from dirprim_filter.store import Store, learn_from_store
from dirprim_filter.store.forgetting import forget, merge
from dirprim_filter.store.rows import SCHEMA, StoredRows
from dirprim_filter.store.store import DamagedFileError

N_FLIPS = 400
ROWS = StoredRows.of(street(1))


def test_no_flipped_bit_goes_unseen(tmp_path):
    store, rng = rows_stored(tmp_path / "store", a=street(1)), np.random.default_rng(0)
    (file,) = store.contents().entries["a"].files
    whole = store.get(file.path)
    for _ in range(N_FLIPS):
        damage(store, file, rng)
        with pytest.raises(DamagedFileError, match="a is damaged in the store"):
            store.read(file)
        store.put(file.path, whole)
    assert store.read(file).digest == file.recording


@pytest.mark.parametrize("gone", [False, True])
def test_a_damaged_recording_is_named_and_left_out(tmp_path, gone):
    hurt = rows_stored(tmp_path / "hurt", a=street(1), b=street(2), c=street(3))
    whole = rows_stored(tmp_path / "whole", a=street(1), c=street(3))
    (file,) = hurt.contents().entries["b"].files
    data = hurt.get(file.path)
    if gone:
        (tmp_path / "hurt" / file.path).unlink()
    else:
        damage(hurt, file, np.random.default_rng(1))
    (line,) = learn_from_store(hurt, **GRID).damaged
    assert ": b is damaged in the store" in line
    assert map_bytes(hurt, tmp_path) == map_bytes(whole, tmp_path)
    with pytest.raises(DamagedFileError):
        merge(whole, hurt)
    hurt.put(file.path, data)  # what was learned without it is not taken for what is learned from all
    assert not learn_from_store(hurt, **GRID).damaged
    damage(hurt, file, np.random.default_rng(1))
    forget(hurt, ["b"])
    assert not learn_from_store(hurt, **GRID).damaged


def crafted(column="track", value=0, kind=None):
    """A file with another number in the fifth row of a column, or another column in its place."""
    numbers = {f.name: np.array(getattr(ROWS, f.name)) for f in SCHEMA}
    numbers[column][5] = value
    table = pa.table([pa.array(numbers[f.name], f.type) for f in SCHEMA], SCHEMA)
    if kind is not None:
        table = table.set_column(SCHEMA.names.index("x_cm"), "x_cm", kind)
    file = io.BytesIO()
    pq.write_table(table, file)
    return file.getvalue()


CRAFTED = [
    b"", b"PAR1", b"no Parquet at all" * 9, crafted("track", 7), crafted("track", -1), crafted("t_ms", 0),
    crafted("t_ms", 2**62), crafted("course_qdeg", 721), crafted("speed_dm_s", -1), crafted("group", -3),
    crafted("weight", np.nan), crafted("weight", 0.0), crafted("weight", np.inf),
    crafted(kind=pa.array(["here"] * len(ROWS))), crafted(kind=pa.array([None] * len(ROWS), pa.int32())),
    crafted(kind=pa.array([0.5] * len(ROWS))),
    {"path": "../../etc/passwd"}, {"path": "rows/a.parquet"}, {"path": "https://evil.example/rows/x"},
    {"block": "../x"}, {"recording": "../x"}, {"recording": ""},
]  # fmt: skip
"""StoredRows of a file, and what an entry says of a sound one."""


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A store whose map is learned, in a folder with the map's file."""
    store = rows_stored(tmp_path_factory.mktemp("sound") / "store", a=ROWS)
    map_bytes(store, Path(store.path).parent)
    return Path(store.path)


@pytest.mark.parametrize("what", CRAFTED, ids=range(len(CRAFTED)))
def test_crafted_rows_and_entries_are_refused_and_stop_nobody(sound, tmp_path, what):
    store = Store.open(copytree(sound, tmp_path / "store"))
    (file,) = store.contents().entries["a"].files
    evil = file._replace(log="evil", path=f"rows/{'0' * 32}-{file.digest}.parquet", recording="f" * 64, added="9")
    if isinstance(what, dict):
        evil = evil._replace(**what)
    else:
        with pytest.raises(ValueError, match="expected"):
            StoredRows.from_parquet(what)
        evil = evil._replace(path=f"rows/{'0' * 32}-{hashlib.sha256(what).hexdigest()}.parquet")
        store.put(evil.path, what)
    store.commit(lambda _: ([evil], []))
    (line,) = learn_from_store(store, **GRID).damaged
    assert ("no file of a store" if isinstance(what, dict) else "evil is damaged in the store") in line
    assert map_bytes(store, tmp_path) == hashlib.sha256(sound.with_name("bytes.mcap").read_bytes()).hexdigest()


@pytest.mark.parametrize("said", ["", "no JSON", json.dumps({"format": 9}), json.dumps([1]), json.dumps({"format": 6})])
def test_a_table_that_is_no_store_is_said(tmp_path, said):
    deltalake = pytest.importorskip("deltalake")
    schema = deltalake.Schema.from_arrow(pa.schema([("x", pa.int32())]))
    deltalake.DeltaTable.create(str(tmp_path / "table"), schema, description=said)
    with pytest.raises(Exception, match="expected a store, got"):
        Store.open(tmp_path / "table")
