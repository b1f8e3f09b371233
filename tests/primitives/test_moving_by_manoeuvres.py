"""Particles move by manoeuvres: kernels against slow twins, who goes where as often as counted, in a place or none."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.distributions.angles import wrap
from dirprim_filter.primitives import _manoeuvres, _motion
from dirprim_filter.primitives.background import learn_chain
from dirprim_filter.primitives.motion import FLOATS, background_manoeuvres, joined
from dirprim_filter.primitives.motion_table import motion_table
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.visits import Visits
from moving import ALONE, SIDE, motion_by_hand, moved, only_places, seeded, squares
from oracles import manoeuvre_weights, moved_without_noise
from situations import tracks_of
from tessellation import GridTessellation

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed
N = 20_000
EXTENT = 0.6 * SIDE


def random_map(rng, *, noise=1.0, n_moving=4):
    """Two cells, some manoeuvres in motion and one that stands in each, of random fields."""
    n = 2 * (n_moving + 1)
    motion = motion_by_hand(
        np.repeat([0, 1], n_moving + 1), start_rate=np.tile([*np.zeros(n_moving), 0.3], 2),
        visits=rng.gamma(2.0, 5.0, n), seconds=rng.gamma(2.0, 5.0, n), course=rng.uniform(-3, 3, n),
        bend=rng.normal(0, 0.05, (n, 2)), course_spread=noise * rng.gamma(2.0, 0.2, n),
        log_pace=rng.normal(2.0, 0.3, n), turning=0.2 * noise,
        gain=rng.normal(0, 0.02, (n, 2)), log_pace_spread=rng.gamma(2.0, 0.3, n), background_visits=3.0,
        path=rng.normal(0, [1.0, 0.1, 0.01], (n, 3)),
        path_spread=rng.gamma(2.0, 1.0, n), path_direction=rng.uniform(-3, 3, n),
        acceleration=rng.normal(0, [1.0, 0.05, 0.05, 0.1], (n, 4)), push=rng.gamma(2.0, 0.5, n),
        stretch=rng.normal(0, 0.1, n),
    )  # fmt: skip
    return squares(2, 1, motion)


def somewhere(rng):
    """A place in or near the two cells, a direction, a speed: every fourth stands."""
    speed = rng.choice([rng.uniform(0.0, 0.09), *rng.uniform(0.11, 20.0, 3)])
    return rng.uniform([-8.0, -8.0], [48.0, 28.0]), rng.uniform(-np.pi, np.pi), speed


@pytest.mark.parametrize("rate", [_manoeuvres.BY_VISITS, _manoeuvres.BY_TIME])
@pytest.mark.parametrize("n_moving", [4, 8, 11])
def test_weights_of_manoeuvres_are_what_the_slow_twin_says(rate, n_moving):
    rng = np.random.default_rng(2)
    for _ in range(12):
        random = only_places(random_map(rng, n_moving=n_moving))
        may = motion_table(random).candidates
        place, direction, speed = somewhere(rng)
        for cell in (0, 1):
            given = (random.motion, cell, random.centers[cell], EXTENT, place, direction, speed)
            slow = manoeuvre_weights(*given, by_time=rate == _manoeuvres.BY_TIME)
            slow = slow[:-1] if speed > 0.1 else slow[-1:]
            for quicker in (0.0, 1e-2):
                room = np.full((3, 8), np.nan, np.float32)
                given = (*place, direction, (speed + 0.3) * (1.0 + quicker) - 0.3, rate, np.empty(0), room)
                total = _manoeuvres.weigh_candidates(may, cell, speed < 0.1, *given)
                found = room[~np.isnan(room)]
                assert len(found) % 8 == 0
                assert total == found[-1]
                assert (found[slow.size :] == total).all()
                is_close = np.isclose(found[: slow.size], np.cumsum(slow), rtol=2e-4, atol=1e-30)
                assert is_close.all() if quicker == 0.0 else not is_close.all()


def test_manoeuvres_are_taken_up_by_their_weights_against_those_of_the_background():
    rng = np.random.default_rng(5)
    random = random_map(rng)
    place, direction, speed = np.array([12.0, 8.0]), 0.3, 8.0
    weight = manoeuvre_weights(random.motion, 0, random.centers[0], EXTENT, place, direction, speed, by_time=True)
    for free in (1 / 3, 0.7):
        motion = replace(random.motion, background_visits=free / (1.0 - free) * weight.sum())
        table = motion_table(replace(random, motion=motion))
        given = (*place, direction, speed, _manoeuvres.BY_TIME, np.empty((3, 8), np.float32), seeded(4))
        found = [_manoeuvres.take_up(table, -1, 0, *given) for _ in range(N)]
        count = np.bincount(found, minlength=12)
        expected = N * np.append((1 - free) * weight / weight.sum(), free)
        seen = np.append(count[:5], count[10:].sum())
        assert count[5:10].sum() == count[11] == 0  # of the other cell; who moves does not stand
        often = expected > 5
        right = expected[often]
        assert stats.chisquare(seen[often], right * seen[often].sum() / right.sum()).pvalue > FALSE_ALARM
        wrong = N * np.append((1 - 0.9 * free) * weight / weight.sum(), 0.9 * free)[often]
        assert stats.chisquare(seen[often], wrong * seen[often].sum() / wrong.sum()).pvalue < FALSE_ALARM


def test_a_step_that_nothing_disturbs_is_the_slow_twins():
    rng = np.random.default_rng(3)
    for _ in range(100):
        random = random_map(rng, noise=0.0)
        table = motion_table(random)
        z = int(rng.choice([0, 1, 2, 3, 10]))
        place, direction, speed = rng.uniform(4.0, 16.0, 2), rng.uniform(-np.pi, np.pi), rng.uniform(4.0, 20.0)
        push = rng.normal() if z < 10 else 0.0
        position, (course, pace, pushes) = place[None].copy(), np.array([[direction], [speed], [push]])
        z_of = np.array([z])
        _motion.move(table, position, course, pace, np.zeros(1, np.int64), z_of, pushes, ALONE, 0.07, seeded(1))
        center = random.centers[random.motion.cell[z]]
        there, *slow = moved_without_noise(random.motion, z, center, EXTENT, place, direction, speed, push, 0.07)
        assert z_of[0] == z
        np.testing.assert_allclose(position[0], there, rtol=1e-9)
        assert [course[0], pace[0]] == pytest.approx(slow[:2], rel=1e-9, abs=1e-9)
        assert np.linalg.norm(there - place) > 0.1


def test_a_step_follows_the_arc():
    """The way to the middle direction, to second order: over a turn of 0.1 rad off by less than 0.1^3 / 48."""
    turns = motion_by_hand([0], bend=[[0.1, 0.0]])
    found = moved(squares(1, 1, turns), 0.1, n=1, place=(10.0, 10.0), course_rate=1e-9)
    np.testing.assert_allclose(found.position[0] - 10.0, [np.cos(0.05), np.sin(0.05)], atol=0.1**3 / 48 + 1e-9)


def fork():
    """A stem whose vehicles leave it up or down into cells of three ways that differ by how often they were seen.

    Cells from south to north: 0, the stem, 2. Who came up went on by manoeuvre 5 six times and 6 once; none was seen
    to come down. Vehicles start in the middle of the stem, heading between the two.
    """
    up = 1.2
    return squares(1, 3, motion_by_hand(
        [0, 0, 0, 1, 1, 2, 2, 2], visits=[1.0, 2.0, 5.0, 10.0, 30.0, 4.0, 4.0, 2.0],
        seconds=[1.0, 1.0, 1.0, 10.0, 30.0, 1.0, 1.0, 1.0], course=[-up, -up, -up, -up, up, up, up, up],
        course_spread=0.1,
        transitions=[(4, 5, 6.0), (4, 6, 1.0)],
    ))  # fmt: skip


def test_vehicles_go_where_the_counts_say_and_back_off_where_nothing_was_counted():
    found = moved(fork(), 1.9, n=N, place=(2.0, 30.0))
    above = found.cell == 2
    assert (found.cell != 1).all()
    assert (above == (found.manoeuvre >= 5)).all()
    assert stats.binomtest(int(above.sum()), N, 0.75).pvalue > FALSE_ALARM

    def as_seen(share, of):
        return stats.chisquare(np.bincount(of, minlength=3), of.size * np.array(share)).pvalue > FALSE_ALARM

    up, down = found.manoeuvre[above] - 5, found.manoeuvre[~above]
    unseen = _manoeuvres.DISCOUNT  # of each kind that was seen, for what was not
    seen, backed_off = np.array([6 - unseen, 1 - unseen, 0.0]), 2 * unseen * np.array([0.4, 0.4, 0.2])
    assert as_seen((seen + backed_off) / 7, up)
    assert not as_seen(np.array([6 - 0.01, 1.0, 0.01]) / 7, up)  # counts as they are
    assert as_seen([1 / 8, 2 / 8, 5 / 8], down)  # by visits, for none was counted
    assert not as_seen([1 / 3, 1 / 3, 1 / 3], down)  # by seconds


def test_who_is_beside_the_course_stays_so_in_the_next_cell_less_what_is_forgotten():
    for into, rate in ((0.5, 0.3), (-1.0, 0.3), (3.0, 1e-9)):
        ahead = squares(2, 1, motion_by_hand([0, 1], course=[0.0, into]))
        for beside in (0.05, -0.2):
            start = {"n": 3, "place": (17.0, 10.0), "direction": beside, "course_rate": rate}
            before, after = (moved(ahead, t, **start) for t in (0.2, 0.4))
            np.testing.assert_allclose(before.direction, beside * np.exp(-0.2 * rate), rtol=1e-9)
            assert (before.cell == 0).all()
            assert (after.cell == 1).all()
            off = np.angle(np.exp(1j * (after.direction - into)))
            np.testing.assert_allclose(off, beside * np.exp(-0.4 * rate), rtol=1e-9)


def test_who_fits_no_manoeuvre_of_the_cell_entered_keeps_its_own_until_it_looks_again():
    """A cell of oncoming traffic alone: the road does not end there, and a second later who drives there is asked."""
    ahead = squares(2, 1, motion_by_hand([0, 1], course=[0.0, np.pi], course_spread=0.02, background_visits=1e-6))
    start = {"n": N, "place": (18.0, 10.0), "step_s": 0.1}
    inside, entered = moved(ahead, 0.1, **start), moved(ahead, 0.4, **start)
    np.testing.assert_array_equal(inside.cell, 0)
    np.testing.assert_array_equal(entered.cell, 1)
    followed = inside.manoeuvre == 0  # by no place from the start on are few
    assert 0.9 < followed.mean() < 1.0 or followed.all()
    kept = int((entered.manoeuvre == 0)[followed].sum())
    assert set(entered.manoeuvre[followed]) == {0, 2}
    # It enters in the step that ends at 0.2 s or 0.3 s, and looks again in that and in the one or two that follow.
    shares = np.exp(-np.array([0.3, 0.2]))
    assert shares[0] - 0.02 < kept / followed.sum() < shares[1] + 0.02


def test_in_the_next_cell_who_drives_by_no_place_keeps_its_direction_and_all_their_own_pace():
    ahead = squares(2, 1, motion_by_hand([1], course=[0.5], turning=0.0))
    found = moved(ahead, 0.4, n=3, place=(17.0, 10.0), direction=0.05, step_s=0.4, course_rate=1e-9)
    assert (found.cell == 1).all()
    assert (found.manoeuvre == 0).all()
    np.testing.assert_allclose(found.direction, 0.05, rtol=1e-9)
    ahead = squares(2, 1, motion_by_hand([0, 1], push=1.0))
    found = moved(ahead, 0.4, n=N, place=(17.0, 10.0))
    later = moved(ahead, 0.6, n=N, place=(17.0, 10.0))  # the same numbers, two steps more
    assert (found.cell == 1).all()
    assert np.corrcoef(found.speed - 10.0, later.speed - found.speed)[0, 1] > 0.8


# Where the place says nothing: a Markov chain of what vehicles do


def visits_of(speed, course=0.0):
    """Of vehicles that drive so, (vehicles, instants 0.1 s apart), outside of all cells."""
    speed, course = np.broadcast_arrays(speed, course)
    place = np.cumsum(0.1 * speed[..., None] * np.stack([np.cos(course), np.sin(course)], axis=-1), axis=1)
    rows = TrackRows.thinned(tracks_of(place, direction=wrap(course), speed=speed), interval_s=1e-3)
    return Visits.of(rows, GridTessellation.empty())


def two_habits(rng, *, n_vehicles=60, seconds=20):
    """Vehicles at 10 m/s that now go straight on, now turn left on 50 m, and change as a coin says every second."""
    turns = np.repeat(rng.random((n_vehicles, seconds)) < 0.5, 10, axis=1)
    course = np.cumsum(np.where(turns, 0.02, 0.0), axis=1) + rng.uniform(-np.pi, np.pi, (n_vehicles, 1))
    return visits_of(10.0, course)


def test_groups_tell_who_turns_from_who_does_not():
    columns, follow = learn_chain(two_habits(np.random.default_rng(1)), rng=np.random.default_rng(0))
    moves = columns["start_rate"] == 0
    share, curvature = columns["seconds"][moves], columns["curvature"][moves]
    assert share.sum() == pytest.approx(1.0)
    # Windows of a second are straight, left, or partly; of each habit there is one that is nothing else.
    assert curvature.min() == pytest.approx(0.0, abs=2e-3)
    assert curvature.max() == pytest.approx(0.02, abs=2e-3)
    assert share @ curvature == pytest.approx(0.01, abs=1e-3)
    np.testing.assert_allclose(columns["log_pace"][moves], np.log(10.3), rtol=1e-9)
    # Where habits are independent from second to second, seconds that begin anywhere share on average 1/4 of them:
    # the integral of f (1 - f) by that of f^2 + (1 - f)^2.
    before, after = follow.nonzero()
    count = np.asarray(follow[before, after]).ravel()
    turned = columns["curvature"] - np.average(columns["curvature"][before], weights=count)
    shared = np.average(turned[before] * turned[after], weights=count) / np.average(turned[before] ** 2, weights=count)
    assert shared == pytest.approx(0.25, abs=0.05)
    assert (columns["start_rate"][after] == 0).all()  # none stood


def test_who_brakes_and_who_speeds_up_are_of_different_groups():
    rng = np.random.default_rng(2)
    gained = rng.choice([-1.0, 1.0], 80)
    speed = 10.0 + gained[:, None] * np.arange(0.0, 4.0, 0.1)
    columns, _ = learn_chain(visits_of(speed), rng=np.random.default_rng(0))
    moves = columns["start_rate"] == 0
    acceleration, pace = columns["acceleration"][moves], np.exp(columns["log_pace"][moves]) - 0.3
    by_pace = acceleration[:, 0] + acceleration[:, 3] * pace
    np.testing.assert_allclose(np.abs(by_pace), 1.0, atol=0.05)
    assert {-1.0, 1.0} == set(np.sign(by_pace))


def test_the_share_of_those_that_stand_and_their_start_rate_are_counted():
    speed = np.tile(np.repeat([0.0, 5.0], [100, 300]), (4, 1))
    columns, _ = learn_chain(visits_of(speed), rng=np.random.default_rng(0))
    assert columns["seconds"][-1] == pytest.approx(0.25)
    assert columns["start_rate"][-1] == pytest.approx(4.1 / 41.0)
    assert (columns["start_rate"][:-1] == 0).all()


def chain(count):
    """Two background manoeuvres, straight and left, that follow each other as counted, and no cell to drive in."""
    nowhere = motion_by_hand([0], course=0.0)
    free = background_manoeuvres(
        share=[0.5, 0.5], log_pace=[2.3, 2.3], log_pace_spread=[1.0, 1.0], acceleration=np.zeros((2, 2)),
        push=[0.0, 0.0], turning=[0.0, 0.0], curvature=[0.0, 1e-6], standing=0.0, start_rate=0.1,
    )  # fmt: skip
    placed = {name: getattr(nowhere, name)[:1] for name in (*FLOATS, "cell", "mode")}
    before, after = np.nonzero(count)
    return replace(
        nowhere, **joined(placed, free), first=np.searchsorted(before + 1, np.arange(5)), following=after + 1,
        count=np.asarray(count, np.float64)[before, after],
    )  # fmt: skip


def test_vehicles_of_no_place_go_over_once_a_second_as_counted():
    """The share that turns after t seconds is that of the chain whose rows are drawn at rate 1/s."""
    count = np.array([[3.0, 1.0], [2.0, 2.0]])
    rate = count / count.sum(axis=1, keepdims=True) - np.eye(2)
    for seconds in (0.5, 2.0):
        found = moved(squares(1, 1, chain(count)), seconds, n=N, place=(500.0, 500.0), step_s=0.02)
        assert (found.manoeuvre > 0).all()
        turning = int((found.manoeuvre == 2).sum())
        # exp(Q t) of two states: what is left of the difference from the stationary share decays at a + b.
        a, b = rate[0, 1], rate[1, 0]
        still = a / (a + b)
        expected = still + (0.5 - still) * np.exp(-(a + b) * seconds)
        assert stats.binomtest(turning, N, expected).pvalue > FALSE_ALARM
        assert stats.binomtest(turning, N, 0.5).pvalue < FALSE_ALARM  # as if none went over
