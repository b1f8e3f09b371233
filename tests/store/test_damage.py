"""What is damaged or crafted in a store is found, named, and left out, and the rest goes on."""

import hashlib
import io
import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from streets import GRID, bytes_of, damage, logs_of, store_of, street

from dirprim_filter.store import Store, learn_from_store
from dirprim_filter.store.forgetting import forget, merge
from dirprim_filter.store.rows import SCHEMA, Rows
from dirprim_filter.store.store import DamagedFileError

N_FLIPS = 400


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A store of three logs."""
    folder = tmp_path_factory.mktemp("store")
    return store_of(folder / "store", *logs_of(folder, a=street(1), b=street(2), c=street(3)).values())


def test_no_flipped_bit_goes_unseen(store):
    (file,) = store.contents().recordings()[0].files
    whole, rng = store.get(file.path), np.random.default_rng(0)
    for _ in range(N_FLIPS):
        damage(store, file, rng)
        with pytest.raises(DamagedFileError, match=f"{file.log} is damaged in the store"):
            store.read(file)
        store.put(file.path, whole)
    assert store.read(file).digest == file.recording


def test_a_damaged_recording_is_named_and_left_out(tmp_path):
    path = logs_of(tmp_path, a=street(1), b=street(2), c=street(3))
    hurt, whole = store_of(tmp_path / "hurt", *path.values()), store_of(tmp_path / "whole", path["a"], path["c"])
    (file,) = hurt.contents().entries[path["b"]].files
    data = hurt.get(file.path)
    damage(hurt, file, np.random.default_rng(1))
    found = learn_from_store(hurt, **GRID)
    (line,) = found.damaged
    assert path["b"] in line
    assert bytes_of(found.primitive_map, tmp_path) == bytes_of(learn_from_store(whole, **GRID).primitive_map, tmp_path)
    with pytest.raises(DamagedFileError):
        merge(whole, hurt)
    hurt.put(file.path, data)  # what was learned without it is not taken for what is learned from all
    assert not learn_from_store(hurt, **GRID).damaged
    damage(hurt, file, np.random.default_rng(1))
    forget(hurt, [path["b"]])
    assert not learn_from_store(hurt, **GRID).damaged


def crafted(table):
    file = io.BytesIO()
    pq.write_table(table, file)
    return file.getvalue()


def changed(column, value):
    """A table with another number in the fifth row of a column."""
    rows = Rows.of(street(1))
    numbers = np.array(getattr(rows, column))
    numbers[5] = value
    return pa.table([pa.array(getattr(replace(rows, **{column: numbers}), f.name), f.type) for f in SCHEMA], SCHEMA)


@pytest.mark.parametrize(
    "data",
    [
        b"", b"PAR1", b"no Parquet at all" * 9,
        crafted(pa.table({"track": [1]})),
        crafted(changed("track", 7)), crafted(changed("track", -1)), crafted(changed("t_ms", 0)),
        crafted(changed("t_ms", 2**62)), crafted(changed("course_qdeg", 721)), crafted(changed("speed_dm_s", -1)),
        crafted(changed("weight", np.nan)), crafted(changed("weight", 0.0)), crafted(changed("weight", np.inf)),
        crafted(changed("group", -3)),
        crafted(changed("track", 0).set_column(3, "x_cm", pa.array(["here"] * len(Rows.of(street(1)))))),
        crafted(changed("track", 0).set_column(3, "x_cm", pa.array([None] * len(Rows.of(street(1))), pa.int32()))),
        crafted(changed("track", 0).set_column(3, "x_cm", pa.array([0.5] * len(Rows.of(street(1)))))),
    ],
    ids=range(17),
)  # fmt: skip
def test_crafted_rows_are_refused(tmp_path, data):
    path = logs_of(tmp_path, a=street(1), b=street(2))
    store = store_of(tmp_path / "store", path["a"])
    before = bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path)
    with pytest.raises(ValueError, match="expected"):
        Rows.from_parquet(data)
    (file,) = store.contents().entries[path["a"]].files
    name = f"rows/{'0' * 32}-{hashlib.sha256(data).hexdigest()}.parquet"
    store.put(name, data)
    store.commit(lambda _: ([file._replace(path=name, log="evil", recording="f" * 64, added="9")], []))
    found = learn_from_store(store, **GRID)
    assert len(found.damaged) == 1
    assert "evil is damaged in the store" in found.damaged[0]
    assert bytes_of(found.primitive_map, tmp_path) == before


@pytest.mark.parametrize(
    "change",
    [
        {"path": "../../etc/passwd"}, {"path": "rows/a.parquet"}, {"path": "https://evil.example/rows/x"},
        {"block": "../x"}, {"recording": "../x"}, {"recording": ""},
    ],
    ids=str,
)  # fmt: skip
def test_crafted_entries_stop_nobody(tmp_path, change):
    store = store_of(tmp_path / "store", *logs_of(tmp_path, a=street(1)).values())
    (entry,) = store.contents().entries.values()
    before = bytes_of(learn_from_store(store, **GRID).primitive_map, tmp_path)
    valid = {"log": "evil", "path": f"rows/{'0' * 32}-{entry.files[0].digest}.parquet"}
    store.commit(lambda _: ([entry.files[0]._replace(**(valid | change))], []))
    contents = store.contents()
    assert list(contents.entries) == [entry.log]
    assert "no file of a store" in contents.damaged[0]
    found = learn_from_store(store, **GRID)
    assert found.damaged == contents.damaged
    assert bytes_of(found.primitive_map, tmp_path) == before


def test_a_file_that_is_gone_though_it_counts_is_damage(tmp_path):
    path = logs_of(tmp_path, a=street(1), b=street(2))
    store = store_of(tmp_path / "store", *path.values())
    (file,) = store.contents().entries[path["b"]].files
    (tmp_path / "store" / file.path).unlink()
    found = learn_from_store(store, **GRID)
    assert path["b"] in found.damaged[0]


@pytest.mark.parametrize("said", ["", "no JSON", json.dumps({"format": 9}), json.dumps([1]), json.dumps({"format": 5})])
def test_a_table_that_is_no_store_is_said(tmp_path, said):
    deltalake = pytest.importorskip("deltalake")
    schema = deltalake.Schema.from_arrow(pa.schema([("x", pa.int32())]))
    deltalake.DeltaTable.create(str(tmp_path / "table"), schema, description=said)
    with pytest.raises(Exception, match="expected a store, got"):
        Store.open(tmp_path / "table")
