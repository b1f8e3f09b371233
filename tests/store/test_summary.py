"""Summaries add and subtract exactly, and their steps chain into ways that make each as often as it was counted."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.config import LearningConfig
from dirprim_filter.distributions.angles import difference
from dirprim_filter.primitives.leader_learning import LeaderSums
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.store import tallies
from dirprim_filter.store.lattice import NONE, Lattice
from dirprim_filter.store.pseudo_tracks import pseudo_tracks
from dirprim_filter.store.steps import HOUR_NS, TICK_NS, Instants, unpacked_when
from dirprim_filter.store.summary import LEADER_UNIT, Summary
from dirprim_filter.store.tallies import Tally
from dirprim_filter.tracks import Tracks
from oracles import between_rows
from situations import ring_traffic

N_RECORDINGS = 100


def recording(seed, *, hour=0):
    """A few vehicles on a ring, some of which stand for a while; the ring is driven around more than once."""
    rng = np.random.default_rng(seed)
    ring = ring_traffic(rng, n_vehicles=4, radius=6.0, n_rows=80, dt_s=0.2)
    stands = (ring.track_id == 0) & (ring.time_ns > 4e9) & (ring.time_ns < 9e9)
    at = np.flatnonzero(stands)[0]
    return replace(
        ring,
        time_ns=ring.time_ns + hour * HOUR_NS,
        speed=np.where(stands, 0.0, ring.speed),
        position=np.where(stands[:, None], ring.position[at], ring.position),
    )


@pytest.fixture(scope="module")
def parts():
    return [Summary.of(recording(seed, hour=seed % 3)) for seed in range(12)]


@pytest.fixture(scope="module")
def many():
    """Of two vehicles and two seconds each; ten of the sums of leaders are as good as all."""
    ring = ring_traffic(np.random.default_rng(0), n_vehicles=2 * N_RECORDINGS, radius=6.0, n_rows=10, dt_s=0.2)
    summaries = [Summary.of(ring[ring.vehicle // 2 == number]) for number in range(N_RECORDINGS)]
    return [replace(summary, leader=summary.leader[:10]) for summary in summaries]


def test_adding_is_commutative_and_associative_and_has_a_zero(parts):
    a, b, c = parts[:3]
    assert a + b == b + a
    assert (a + b) + c == a + (b + c)
    assert a + Summary.none() == a == Summary.none() + a
    assert a + b != a + c


def test_any_sharding_order_and_grouping_gives_the_same(many):
    """Maps follow from a summary alone, and `test_store_learning` holds that: so the bytes of the sum decide."""
    whole = Summary.total(many).digest
    rng = np.random.default_rng(0)
    for _ in range(200):
        shards = np.array_split(rng.permutation(N_RECORDINGS), rng.integers(1, 13))
        sums = [Summary.total([many[i] for i in shard]) for shard in shards]
        while len(sums) > 1:  # in groups of groups
            size = int(rng.integers(2, len(sums) + 1))
            sums = [Summary.total(sums[i : i + size]) for i in range(0, len(sums), size)]
        assert sums[0].digest == whole
    assert Summary.total(many[1:]).digest != whole


@pytest.mark.parametrize(
    "far", [3, 1 << 13, 1 << 40], ids=["one number holds a key and its row", "one holds a key", "none does"]
)
def test_keys_are_summed_as_by_a_loop_and_piece_by_piece(far, monkeypatch):
    rng = np.random.default_rng(0)
    key, value = rng.integers(-1, 3, (200, 4)) * far, rng.integers(1, 9, (200, 2))
    looped = {}
    for row, more in zip(key.tolist(), value, strict=True):
        looped[tuple(row)] = looped.get(tuple(row), 0) + more
    whole = Tally.of(key, value)
    assert [tuple(row) for row in whole.key.tolist()] == sorted(looped)
    np.testing.assert_array_equal(whole.value, [looped[row] for row in sorted(looped)])
    monkeypatch.setattr(tallies, "BLOCK_KEYS", 7)
    thirds = [Tally.of(key[i::3], value[i::3]) for i in range(3)]
    assert Tally.total(thirds) == whole
    assert Tally.total(thirds[:2]) != whole


def test_what_is_taken_away_was_never_there(parts):
    a, b, c = parts[:3]
    assert (a + b + c) - b == a + c
    assert (a - a).digest == Summary.none().digest
    with pytest.raises(ValueError, match="expected a part of what it is taken from"):
        _ = a - b


def test_another_lattice_or_frame_is_refused(parts):
    with pytest.raises(ValueError, match=r"expected square_m 1.0, got 2.0"):
        _ = parts[0] + Summary.none(lattice=Lattice(square_m=2.0))
    with pytest.raises(ValueError, match="expected positions in frame '', got 'odom'"):
        _ = parts[0] - Summary.none(frame="odom")


def test_steps_are_counted_as_by_a_loop():
    tracks, lattice = recording(3, hour=7), Lattice()
    summary = Summary.of(tracks, lattice=lattice)
    counted = Counter()
    for vehicle in range(tracks.n_tracks):
        own = tracks[tracks.vehicle == vehicle]
        (seen,) = Instants.blocks(own)
        at_step = np.arange(0, own.time_ns[-1] - own.time_ns[0] + 1, seen.ticks * TICK_NS)
        east = np.interp(at_step, own.time_ns - own.time_ns[0], own.position[:, 0])
        np.testing.assert_allclose(seen.position[:, 0], east, atol=0.1)  # a spline beside straight lines
        states = lattice.states(seen.position, seen.direction, seen.speed)[0].tolist()
        counted.update(zip([NONE, *states], states, [*states[1:], NONE], strict=False))
    any_fold = steps_of_any_hour(summary.steps)
    kinds = [tuple(key) for key in any_fold.key.tolist()]
    assert Counter(dict(zip(kinds, any_fold.value[:, 0].tolist(), strict=True))) == counted
    hour, _, ticks = unpacked_when(summary.steps.key[:, 0], lattice)
    assert (set(hour.tolist()), set(ticks.tolist())) == ({7}, {4})


@pytest.mark.parametrize(
    ("rows_apart_s", "step_s"), [(0.02, 0.2), (0.1, 0.2), (0.08, 0.25), (0.2, 0.2), (0.5, 0.5), (1 / 3, 0.35)]
)
def test_a_step_is_as_long_as_the_rows_are_apart_that_learning_keeps(rows_apart_s, step_s):
    rng = np.random.default_rng(0)
    tracks = ring_traffic(rng, n_vehicles=2, n_rows=60, dt_s=rows_apart_s)
    jitter = rng.integers(-1_000_000, 1_000_000, len(tracks))
    (seen,) = Instants.blocks(replace(tracks, time_ns=np.maximum(tracks.time_ns + jitter, 0)))
    assert seen.ticks * TICK_NS == pytest.approx(step_s * 1e9)
    learned_from = TrackRows.thinned(tracks, interval_s=LearningConfig().row_interval_s)
    assert seen.speed.size == pytest.approx(len(learned_from), rel=0.1)


def test_leaders_count_as_in_the_log(parts):
    sums, told = LeaderSums.of(recording(0)), parts[0].leader_sums
    for ours, theirs in zip((*sums.acceleration, *sums[1:]), (*told.acceleration, *told[1:]), strict=True):
        np.testing.assert_allclose(theirs, ours, atol=LEADER_UNIT)


def steps_of_any_hour(steps):
    return Tally.of(steps.key[:, 1:], steps.value[:, :1])


def test_pseudo_vehicles_make_every_step_as_often_as_it_was_counted(parts):
    total = Summary.total(parts)
    tracks, _ = pseudo_tracks(total.steps, total.lattice)
    again = Summary.of(tracks)
    assert steps_of_any_hour(again.steps) == steps_of_any_hour(total.steps)
    assert tracks.n_tracks == total.steps.value[total.steps.key[:, 1] == NONE, 0].sum()
    assert len(total.steps) < 0.9 * len(tracks)  # some kinds of steps were made more than once


def test_pseudo_vehicles_have_the_mean_and_variance_of_each_kind_of_step():
    position = np.array([[0.15, 0.55], [0.45, 0.35], [0.85, 0.1]])
    tracks = Tracks(
        track_id=np.arange(3), time_ns=np.zeros(3, np.int64), position=position, direction=np.full(3, 0.1),
        speed=np.array([3.0, 3.5, 3.1]),
    )  # fmt: skip
    summary = Summary.of(tracks, lattice=Lattice(n_folds=1))
    assert len(summary.steps) == 1
    pseudo, _ = pseudo_tracks(summary.steps, summary.lattice)
    np.testing.assert_allclose(pseudo.position.mean(axis=0), position.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(pseudo.position.std(axis=0), position.std(axis=0), atol=0.02)


def test_steps_that_do_not_chain_are_refused(parts):
    steps, lattice = parts[0].steps, parts[0].lattice
    holed = np.arange(len(steps)) != np.flatnonzero(steps.key[:, 1] != NONE)[0]
    with pytest.raises(ValueError, match="expected those of whole recordings"):
        pseudo_tracks(Tally(key=steps.key[holed], value=steps.value[holed]), lattice)


def test_a_gap_ends_a_way_and_a_row_alone_is_one():
    tracks = Tracks(
        track_id=np.zeros(5, int), time_ns=(np.array([0.0, 0.5, 1.0, 4.0, 8.0]) * 1e9).astype(np.int64),
        position=np.zeros((5, 2)), direction=np.zeros(5), speed=np.zeros(5),
    )  # fmt: skip
    steps = Summary.of(tracks).steps
    came, went = steps.key[:, 1] == NONE, steps.key[:, 3] == NONE
    assert steps.value[:, 0].sum() == 5
    assert steps.value[came, 0].sum() == steps.value[went, 0].sum() == 3
    assert steps.value[came & went, 0].sum() == 2


def test_positions_beyond_the_lattice_are_refused():
    far = Tracks(
        track_id=[1], time_ns=np.array([0]), position=np.array([[1e8, 0.0]]), direction=np.zeros(1), speed=np.ones(1)
    )
    with pytest.raises(ValueError, match="expected coordinates within"):
        Summary.of(far)


def test_steps_are_those_of_splines_between_rows():
    """Wherever steps fall between rows, around a turn through south-west and beside a gap."""
    rng = np.random.default_rng(0)
    tracks = ring_traffic(rng, n_vehicles=3, radius=6.0, n_rows=40, dt_s=0.13)
    time_ns = tracks.time_ns + rng.integers(0, 50_000_000, len(tracks)) + (tracks.time_ns > 3e9) * 4_000_000_000
    tracks = replace(tracks, time_ns=time_ns)
    (seen,) = Instants.blocks(tracks)
    n = 0
    for vehicle in range(tracks.n_tracks):
        own = tracks[tracks.vehicle == vehicle]
        for part in np.split(np.arange(len(own)), np.flatnonzero(np.diff(own.time_ns) > 1_500_000_000) + 1):
            at = np.arange(own.time_ns[part[0]], own.time_ns[part[-1]] + 1, seen.ticks * TICK_NS)
            place, course, speed = between_rows(
                own.time_ns[part] * 1e-9, own.position[part], own.direction[part], own.speed[part], at * 1e-9
            )
            rows = slice(n, n + at.size)
            np.testing.assert_allclose(seen.position[rows], place, atol=1e-9)
            np.testing.assert_allclose(difference(seen.direction[rows], course), 0.0, atol=1e-9)
            np.testing.assert_allclose(seen.speed[rows], speed, atol=1e-9)
            np.testing.assert_array_equal(np.flatnonzero(seen.begins[rows]), [0])
            assert (seen.vehicle[rows] == vehicle).all()
            n += at.size
    assert n == seen.speed.size
