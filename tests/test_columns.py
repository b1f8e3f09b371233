"""Tables of columns, of every kind: what does not fit is refused by name, rows stay together, frames ascend."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter import Detections, Estimates, Tracks
from dirprim_filter.columns import CHECKS, column_fields, is_held, known_sizes
from dirprim_filter.estimates import Particles
from dirprim_filter.evaluation.tracked_rows import TrackedRows

N = 5
KINDS = (Tracks, Detections, Estimates, Particles, TrackedRows)
FIELDS = [(kind, f.name) for kind in KINDS for f in column_fields(kind)]
WRONG = {
    "direction": 90.0, "heading": -90.0, "speed": -1.0, "size": 0.0, "covariance": np.array([[1.0, 2.0], [2.0, 1.0]]),
    "cue": -2.0, "confidence": 1.5,
}  # fmt: skip


def columns_of(kind, n=N):
    """Columns of which every number is another, and good."""
    rng, made = np.random.default_rng(0), {}
    for f in column_fields(kind):
        column = rng.uniform(0.1, 1.0, (n, *f.metadata["none"].shape[1:]))
        made[f.name] = column + 2.0 * np.eye(2) if f.name == "covariance" else column
        if f.name == "covariance":
            made[f.name] = made[f.name] + made[f.name].swapaxes(1, 2)
        if f.metadata["none"].dtype == np.int64:
            made[f.name] = np.arange(n) + 3
    return made


def refused(kind, message, **changes):
    with pytest.raises(ValueError, match=message):
        kind(**columns_of(kind) | changes)


@pytest.mark.parametrize(("kind", "name"), FIELDS)
def test_a_column_that_does_not_fit_is_refused_by_name(kind, name):
    good, about = columns_of(kind)[name], {f.name: f.metadata for f in column_fields(kind)}[name]
    refused(kind, rf"columns: expected one length n, got .*{name} \({N - 1},", **{name: good[:-1]})
    if name == "track_id":
        return
    if about["none"].dtype == np.int64:
        for wrong in (good + 0.0, good.astype(np.uint64) + np.uint64(2**63), [*range(N - 1), 10**30]):
            refused(kind, rf"{name}: expected whole numbers \(int64\), got", **{name: wrong})
        return
    refused(kind, f"{name}: expected shape", **{name: good[..., None]})
    for wrong in (np.inf,) if np.isnan(about["left_out"] or 0.0) else (np.inf, np.nan):
        bad = good.copy()
        bad.flat[-1] = wrong
        refused(kind, f"{name}: expected finite numbers", **{name: bad})
    if about["checked"]:
        bad = good.copy()
        bad[1] = WRONG[name]
        refused(kind, f"{name}: expected .*{CHECKS[name][1][:9]}.* in row 1", **{name: bad})
    bare = columns_of(kind)
    del bare[name]
    if about["left_out"] is None:
        with pytest.raises(TypeError, match=name):
            kind(**bare)
    else:
        np.testing.assert_array_equal(getattr(kind(**bare), name), np.full_like(good, about["left_out"]))


@pytest.mark.parametrize("kind", KINDS)
def test_rows_stay_together_whether_chosen_or_joined(kind):
    table = kind(**columns_of(kind))
    for rows in (np.arange(N) % 2 == 0, np.array([1, 3, 4]), slice(1, 4), slice(0, 0)):
        some = table[rows]
        assert len(some) == len(np.arange(N)[rows])
        for f in column_fields(kind):
            np.testing.assert_array_equal(getattr(some, f.name), getattr(table, f.name)[rows])
    assert kind.concatenate(iter([table[:2], kind.none(), table[2:]])) == table
    assert kind.concatenate([]) == kind.none()
    assert len(kind.none()) == 0


@pytest.mark.parametrize("kind", KINDS)
def test_tables_are_equal_where_every_number_is(kind):
    table = kind(**columns_of(kind))
    assert table == kind(**columns_of(kind))
    assert table != table[:-1]
    assert table != columns_of(kind)
    for f in column_fields(kind):
        other = np.arange(N) + 4 if f.name == "track_id" else getattr(table, f.name).copy()
        other.flat[-1] += 1 if other.dtype == np.int64 else 1e-9
        assert table != replace(table, **{f.name: other})
    with pytest.raises(TypeError, match="unhashable"):
        hash(table)


@pytest.mark.parametrize(
    ("kind", "name"), [of for of in FIELDS if of[1] in ("size", "heading", "cue") and of[0] is not Particles]
)
def test_what_is_known_of_some_rows_stays_with_them_and_of_none_takes_no_memory(kind, name):
    bare = columns_of(kind)
    values = bare.pop(name)
    known = kind(**bare, **{name: values})
    unknown = kind(**bare | {"track_id": np.arange(N) + 90})
    both = kind.concatenate([known, unknown])
    is_new = both.track_id.astype(int) >= 90
    assert np.isnan(getattr(both, name)[is_new]).all()
    np.testing.assert_array_equal(getattr(both, name)[~is_new], values)
    for part in (unknown, unknown[:2], kind(**bare, **{name: values * np.nan})):
        assert not is_held(getattr(part, name))
        assert not any(getattr(part, name).strides)
    of_file = known_sizes(np.array([[0.0, 2.0, -1.0], [np.inf, -np.inf, np.nan]]))  # unknown, not wrong
    np.testing.assert_array_equal(of_file, [[np.nan, 2.0, np.nan], [np.nan] * 3])


def test_numbers_among_names_become_text():
    one, other = (Detections(track_id=ids, time_ns=[1, 2], position=np.zeros((2, 2))) for ids in ([4, 9], ["x", "y"]))
    assert Detections.concatenate([one, other]).track_id.tolist() == ["4", "9", "x", "y"]
    mixed = Tracks.concatenate(
        Tracks(**columns_of(Tracks) | {"track_id": ids}) for ids in (np.arange(N), np.array(list("abcde")))
    )
    assert mixed.track_id.dtype.kind == "U"


def some():
    return Detections(track_id=["b", "a", "c", "a"], time_ns=[20, 10, 20, 30], position=np.arange(8.0).reshape(4, 2))


def test_frames_ascend_in_time_and_hold_every_row_once_in_its_order():
    frames = list(some().frames())
    assert [frame.time_ns.tolist() for frame in frames] == [[10], [20, 20], [30]]
    assert [frame.track_id.tolist() for frame in frames] == [["a"], ["b", "c"], ["a"]]
    assert frames[1].position.tolist() == [[0, 1], [4, 5]]
    before_the_epoch = Detections(track_id=["a", "a"], time_ns=[-5, -9], position=np.zeros((2, 2)))
    assert [int(frame.time_ns[0]) for frame in before_the_epoch.frames()] == [-9, -5]
    assert list(Detections.none().frames()) == []


def test_a_frame_is_of_one_instant_one_group_and_each_id_once():
    frame = Detections(track_id=["a", "b"], time_ns=[5, 5], position=np.zeros((2, 2)))
    assert frame.instant() == 5
    for wrong in (some(), replace(frame, track_id=["a", "a"])):
        with pytest.raises(ValueError, match="one instant and each track id once"):
            wrong.instant()
    with pytest.raises(ValueError, match="rows of one group"):
        replace(frame, group=[0, 1]).instant()
