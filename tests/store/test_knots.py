"""Knots of ways: what they give back, how few they are, what is refused, and that older archives are read."""

import io
from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.recording.errors import RecordingError
from dirprim_filter.store import knots as knots_module
from dirprim_filter.store import table
from dirprim_filter.store.compacting import compacted
from dirprim_filter.store.config import StoreConfig
from dirprim_filter.store.knots import MOST_STEPS, WITHIN, Knots
from dirprim_filter.store.manifest import Entry
from dirprim_filter.store.pseudo_tracks import pseudo_tracks
from dirprim_filter.store.steps import HERE, TICK_NS, WHEN
from dirprim_filter.store.store import Store
from dirprim_filter.store.summary import Summary
from dirprim_filter.store.tiles import tiles_of
from dirprim_filter.tracks import Tracks
from situations import ring_traffic

ROWS = "5" * 64


def driven(n=40, seed=0):
    """Vehicles that come, stop, and drive off around a corner, each at its own pace; a few never move."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 40.0, 0.1)
    tracks = []
    for i in range(n):
        top, stops_s = rng.uniform(5.0, 14.0), rng.uniform(3.0, 20.0)
        speed = top * np.clip(np.where(t < 10, 1 - t / 10, (t - 10 - stops_s) / 8), 0.0, 1.0) * (i % 8 > 0)
        along = np.cumsum(speed) * 0.1
        turned = np.clip((along - 60.0) / 15.0, 0.0, np.pi / 2)
        step = speed[:, None] * 0.1 * np.column_stack([np.cos(turned), np.sin(turned)])
        tracks.append((np.cumsum(step, axis=0) + np.array([0.0, rng.normal(0.0, 0.3)]), turned, speed))
    return Tracks(
        track_id=np.repeat(np.arange(n), t.size), time_ns=np.tile((t * 1e9).round().astype(np.int64), n),
        position=np.concatenate([each[0] for each in tracks]), direction=np.concatenate([each[1] for each in tracks]),
        speed=np.concatenate([each[2] for each in tracks]),
    )  # fmt: skip


@pytest.fixture(scope="module")
def summary():
    return Summary.of(driven())


@pytest.fixture(scope="module")
def knots(summary):
    return Knots.of(summary.steps, summary.lattice)


def given_back(knots, lattice, step_s):
    """All steps of ways, as a spline between each pair of knots says: (n, 4), slow and obvious."""
    position, direction, speed = lattice.motion(knots.state, knots.parts + 0.5)
    found = []
    for a in range(len(knots.apart)):
        found.append([*position[a], direction[a], speed[a]])
        for k in range(1, knots.apart[a]):
            u, lasts = k / knots.apart[a], knots.apart[a] * step_s
            by = [(1 + 2 * u) * (1 - u) ** 2, u * (1 - u) ** 2 * lasts, u * u * (3 - 2 * u), u * u * (u - 1) * lasts]
            velocity = [speed[i] * np.array([np.cos(direction[i]), np.sin(direction[i])]) for i in (a, a + 1)]
            at = by[0] * position[a] + by[1] * velocity[0] + by[2] * position[a + 1] + by[3] * velocity[1]
            turn = np.angle(np.exp(1j * (direction[a + 1] - direction[a])))
            found.append([*at, direction[a] + u * turn, (1 - u) * speed[a] + u * speed[a + 1]])
    return np.array(found)


def worst(knots, summary):
    """By how much a step is off at most: metres, radians, m/s. What bins round off is beside the tolerance."""
    ways, kind = pseudo_tracks(summary.steps, summary.lattice)
    step_s = summary.steps.key[kind[0], WHEN] % 64 * TICK_NS * 1e-9
    found = given_back(knots, summary.lattice, step_s)
    assert len(found) == len(ways)
    turned = np.angle(np.exp(1j * (found[:, 2] - ways.direction)))
    off = np.linalg.norm(found[:, :2] - ways.position, axis=1)
    return np.array([off.max(), np.abs(turned).max(), np.abs(found[:, 3] - ways.speed).max()])


def half_of(knots):
    """Without every other knot that no way begins or ends with."""
    ends = np.append(knots.begins[1:], True)
    kept = knots.begins | ends | (np.arange(ends.size) % 2 == 0)
    number = np.append(0, np.cumsum(knots.apart)[:-1])[kept]
    return Knots(*(column[kept] for column in knots[:4]), np.append(np.diff(number), 1))


def test_every_step_is_given_back_nearly_as_it_was(summary, knots):
    part = np.array([2**0.5 / 64, np.pi / 18 / 64, 2.0 / 64])
    assert (worst(knots, summary) <= np.array(WITHIN) + part).all()
    assert (worst(half_of(knots), summary) > np.array(WITHIN) + part).any()


def test_they_are_few_and_take_few_bytes(summary, knots):
    steps = summary.steps.value[:, 0].sum()
    assert knots.apart.sum() == steps
    assert len(knots.apart) < steps / 4
    whole, few = io.BytesIO(), io.BytesIO()
    table.write_summary(summary, whole)
    table.write_knots(knots, summary, few)
    assert few.tell() < whole.tell() / 2


def test_who_stands_takes_a_knot_each_so_many_steps():
    made = driven()
    standing = Summary.of(made[made.track_id == 0])
    found = Knots.of(standing.steps, standing.lattice)
    assert len(found.apart) == -(-found.apart.sum() // MOST_STEPS) + 1


def test_as_many_steps_begin_and_last_in_each_hour_as_before(summary, knots):
    again = replace(summary, steps=knots.steps(summary.lattice))
    assert again.whens == summary.whens
    assert again.digest != summary.digest
    for name in ("steps", "passed"):
        assert getattr(again, name).value[:, 0].sum() == getattr(summary, name).value[:, 0].sum()
    assert (
        pseudo_tracks(again.steps, summary.lattice)[0].n_tracks
        == pseudo_tracks(summary.steps, summary.lattice)[0].n_tracks
    )


def test_where_no_step_may_be_left_out_nothing_changes(monkeypatch):
    alone = Summary.of(ring_traffic(np.random.default_rng(0), n_vehicles=3, n_rows=30))
    assert (alone.steps.value[:, 0] == 1).all()
    assert Knots.of(alone.steps, alone.lattice).steps(alone.lattice) != alone.steps
    monkeypatch.setattr(knots_module, "WITHIN", (-1.0, -1.0, -1.0))
    assert Knots.of(alone.steps, alone.lattice).steps(alone.lattice) == alone.steps


def test_of_logs_of_two_rates_each_keeps_its_own():
    made = driven(n=4)
    slow = made[np.arange(len(made)) % 5 == 0]
    two = Summary.of(made) + Summary.of(replace(slow, time_ns=slow.time_ns + 10**13))
    again = replace(two, steps=Knots.of(two.steps, two.lattice).steps(two.lattice))
    assert len(set((two.whens.key[:, 0] % 64).tolist())) == 2
    assert again.whens == two.whens


def test_what_was_written_is_read(summary, knots, tmp_path):
    with (tmp_path / "some").open("wb") as file:
        table.write_knots(knots, summary, file)
    again = replace(summary, steps=knots.steps(summary.lattice))
    assert table.read_summary(tmp_path / "some") == again
    assert table.read_counts(tmp_path / "some", summary.lattice).whens == again.whens
    nothing = Summary.none()
    with (tmp_path / "none").open("wb") as file:
        table.write_knots(Knots.of(nothing.steps, nothing.lattice), nothing, file)
    assert table.read_summary(tmp_path / "none") == nothing


@pytest.mark.parametrize(
    "wrong", ["no steps", "far apart", "many", "goes on", "beyond", "first", "other hour", "no length"]
)
def test_knots_of_no_ways_are_refused(summary, knots, tmp_path, monkeypatch, wrong):
    begins, when, state, parts, apart = (column.copy() for column in knots)
    if wrong == "no steps":
        apart[0] = 0
    elif wrong == "far apart":
        apart[0] = MOST_STEPS + 1
    elif wrong == "many":
        monkeypatch.setattr(table, "MOST_ROWS", int(apart.sum()) - 1)
    elif wrong == "goes on":
        apart[-1] = 2
    elif wrong == "beyond":
        parts[3, 1] = 32
    elif wrong == "first":
        begins[0] = False
    elif wrong == "other hour":
        when[1:] += 64 * 5
    else:
        when -= when % 64
    with (tmp_path / "wrong").open("wb") as file:
        table.write_knots(Knots(begins, when, state, parts, apart), summary, file)
    with pytest.raises(RecordingError, match="wrong: expected statistics of a recording, version 2 or 3, got steps"):
        table.read_summary(tmp_path / "wrong")


def test_archives_of_all_steps_are_still_read(tmp_path, monkeypatch, summary):
    def of_all_steps(store, archive, knots, total):
        store.write_recording(archive.name, total)
        store.folder.write({archive.file: archive.to_json()})

    store = Store.create(tmp_path / "store", StoreConfig())
    store.write_recording(ROWS, summary)
    tiles = tiles_of(summary.steps.key[:, HERE]).tolist()
    entry = Entry(
        url="log", size=0, mark="0", rows=ROWS, n_rows=1, n_vehicles=1, start_ns=0, end_ns=1, n_squares=0, tiles=tiles,
        config=store.config.digest, status="whole",
    )  # fmt: skip
    store.check_frame("log", "")
    store.record(entry)
    with monkeypatch.context() as patch:
        patch.setattr(Store, "archive", of_all_steps)
        (archive,) = compacted(store, before_ns=40 * 86400 * 10**9)
    assert table.read_summary(store.recording(archive.name)).digest == archive.name
