"""One model of existence for tracks with and without ids: Bayes' rule, and what follows from it in the tracker."""

import numpy as np
import pytest
from scipy.linalg import expm

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.filtering import existence
from dirprim_filter.filtering.existence import Undetected
from dirprim_filter.filtering.roster import NO_GAPS, remembered, usual
from situations import on_the_ring, one_cell_map, seen_at, tracker_of


def existence_by_the_chain(steps, config):
    """(3,) the density of all that was seen and each state, by the exponential of rates; steps as of the filter."""
    out, back, leave = config.occlusion_rate, config.reappearance_rate, config.departure_rate
    rates = np.array([[-out - leave, out, leave], [back, -back - leave, leave], [0.0, 0.0, 0.0]])
    by_chance, p = config.clutter_density + config.birth_density, config.detection_probability
    total = np.array([config.birth_density, 0.0, config.clutter_density]) / by_chance
    for dt_s, density in steps:
        hit = 0.0 if density is None else p * density / by_chance  # else a detection there is there by chance
        total = total @ expm(rates * dt_s) * [1.0 - p + hit, 1.0, 1.0]
    return total


def existence_by_the_filter(steps, config):
    """Likewise, by steps of (dt_s, density of the hit or None), normalised; and the tally."""
    first, tally = np.array([config.birth_density]), existence.Tally()
    state = existence.at_birth(first, config.clutter_density)
    for dt_s, density in steps:
        before = existence.later(state, np.array([dt_s]), config, departs=config.departure_rate)
        if density is None:
            state = existence.after_miss(before, config)
        else:
            state = existence.after_hit(before, np.log([density]), first + config.clutter_density, config)
        tally.add(before, state, np.array([density is not None]), config)
    return state[0], tally


@pytest.mark.parametrize(
    "steps",
    [
        [(0.1, 0.2), (0.1, 0.3)],
        [(0.1, 0.2), (0.1, None), (0.2, None), (0.1, 0.01), (1.0, None)],
        [(0.5, None), (0.5, 1e-4), (0.1, 0.5)],
    ],
)
def test_existence_is_the_sum_over_all_ways_through_the_states(steps):
    config = TrackingConfig(detection_probability=0.8, occlusion_rate=0.3, reappearance_rate=0.6, departure_rate=0.2)
    expected, (found, tally) = existence_by_the_chain(steps, config), existence_by_the_filter(steps, config)
    np.testing.assert_allclose(found, expected / expected.sum(), rtol=1e-9)
    assert tally.log_density == pytest.approx(np.log(expected.sum()), rel=1e-9)
    other = existence_by_the_chain(steps, TrackingConfig(detection_probability=0.7))
    assert np.abs(other / other.sum() - expected / expected.sum()).max() > 1e-6


def followed(model, frames, *, tracking=None):
    """What is reported in each frame: of (seconds, {name: place})."""
    tracker = tracker_of(model, tracking=tracking, n_particles=300)
    seen = [(t, list(places.values()), ["" if name[0] == "?" else name for name in places]) for t, places in frames]
    return [tracker.step(seen_at(*frame), time_ns=round(frame[0] * 1e9)) for frame in seen]


def alone(name, *, n=30, hide=lambda i: False, place=on_the_ring):
    return [(0.1 * i, {} if hide(i) else {name: place(0.1 * i)}) for i in range(n)]


def log_odds(ring_map, *, turned=None, off=0.0, n=3):
    """Of existence after some detections on the ring, of a course turned and a speed off by so much; None: none."""
    tracker = tracker_of(ring_map, n_particles=2000)
    for i in range(n):
        known = {} if turned is None else {"direction": [0.04 * i + np.pi / 2 + turned], "speed": [8.0 + off]}
        tracker.step(seen_at(0.1 * i, [on_the_ring(0.1 * i)], **(known if i else {})))
    visible, occluded, gone = tracker._roster.existence[tracker._roster.unlabelled[0]]
    return np.log((visible + occluded) / gone)


BOTH_KINDS = pytest.mark.parametrize("name", ["a", "?"])
"""With the sensor's id, and without."""


@BOTH_KINDS
def test_one_detection_confirms_nothing_and_four_a_vehicle(either, name):
    found = followed(either, alone(name, n=20))
    first = next(i for i, estimates in enumerate(found) if len(estimates))
    assert 1 <= first <= 3
    assert all(len(estimates) == 1 for estimates in found[first:])
    assert found[first].existence[0] >= TrackingConfig().confirm_above
    at_once = TrackingConfig(clutter_density=1e-9)  # the control: of a sensor that says it never errs
    assert len(followed(either, alone(name, n=1), tracking=at_once)[0]) == 1


def test_a_right_course_and_speed_are_evidence_for_a_vehicle_and_wrong_ones_against(ring_map):
    """In the same units as clutter's: what is measured beside a position is a ratio, whatever its unit."""
    position, right = log_odds(ring_map), log_odds(ring_map, turned=0.0)
    reversed_, fast = (log_odds(ring_map, **wrong) for wrong in ({"turned": np.pi}, {"turned": 0.0, "off": 40}))
    assert right > position + 1.0
    assert max(reversed_, fast) < right - 2.0


@BOTH_KINDS
def test_a_false_detection_is_never_reported(ring_map, name):
    rng = np.random.default_rng(3)
    frames = [(0.1 * i, {f"{name}{i}": rng.uniform(-50, 50, 2), "true": on_the_ring(0.1 * i)}) for i in range(60)]
    reported = Estimates.concatenate(followed(ring_map, frames))
    assert set(reported.track_id.tolist()) == {"true"}
    gullible = TrackingConfig(clutter_density=1e-7)  # the control: one in ten detections begins a vehicle
    gulled = Estimates.concatenate(followed(ring_map, frames, tracking=gullible))
    assert len(set(gulled.track_id.tolist())) > 20


def test_an_id_that_comes_again_is_evidence_beside_the_place():
    rng = np.random.default_rng(0)
    missed, noise = rng.random(60) < 0.2, rng.normal(0, 0.5, (60, 2))

    def of(name, tracking=None):
        frames = alone(name, n=60, hide=lambda i: missed[i], place=lambda t: on_the_ring(t) + noise[round(10 * t)])
        return Estimates.concatenate(followed(None, frames, tracking=tracking))

    labelled, unlabelled = of("a"), of("?")
    at = np.searchsorted(labelled.time_ns, unlabelled.time_ns)
    np.testing.assert_array_equal(labelled.time_ns[at], unlabelled.time_ns)
    assert (labelled.existence[at] >= unlabelled.existence - 1e-12).all()
    np.testing.assert_allclose(labelled.unseen_s[at], unlabelled.unseen_s, atol=1e-9)
    assert np.abs(labelled.existence - of("a", TrackingConfig(detection_probability=0.8)).existence).max() > 1e-6


def test_without_a_map_too_a_false_detection_hardly_has_the_id_of_a_track():
    """Of fast vehicles each some seconds the next place is less certain than a false detection's: ids tell."""
    undetected, false = Undetected(None, TrackingConfig(), FilterConfig()), TrackingConfig().clutter_density
    unlabelled, labelled = undetected.by_chance(np.zeros((2, 2)), np.array([False, True]), false)
    assert unlabelled > false
    assert labelled < 1e-5


@BOTH_KINDS
def test_a_vehicle_occluded_for_three_seconds_on_the_map_survives_and_keeps_its_name(ring_map, name):
    found = followed(ring_map, alone(name, n=70, hide=lambda i: 30 <= i < 60))
    assert all(len(estimates) == 1 for estimates in found[5:])
    assert len({estimates.track_id[0] for estimates in found[5:]}) == 1
    assert found[59].unseen_s[0] == pytest.approx(3.0)
    assert found[59].existence[0] < found[35].existence[0] < found[29].existence[0]


@BOTH_KINDS
def test_who_leaves_the_map_is_gone_half_a_second_after(ring_map, name):
    """It is seen until x = 33.5 m, beside the ring's cells; no particle brakes within 1.5 s of the last hit."""

    def tangent(time_s):
        return np.array([20.0, -20.0]) + time_s * np.array([12.0, 0.0])

    end_s = (33.5 - 20.0) / 12.0
    frames = alone(name, n=40, hide=lambda i: 0.1 * i > end_s, place=tangent)
    found = followed(ring_map, frames)
    last = max(i for i, estimates in enumerate(found) if len(estimates))
    assert end_s - 0.2 < 0.1 * last < end_s + 0.5
    stays = followed(None, frames)  # the control: it knows no map
    assert max(i for i, estimates in enumerate(stays) if len(estimates)) > last + 10


def test_who_is_seen_off_the_map_is_reported_there_even_if_missed_now_and_then(ring_map):
    frames = alone("a", n=60, hide=lambda i: i in (25, 40), place=lambda t: np.array([100.0 + 8.0 * t, 50.0]))
    assert all(len(estimates) == 1 for estimates in followed(ring_map, frames)[5:])


def east(n_frames, interval_s, *, n_vehicles=2, at_once=True, named=True):
    """Frames of vehicles that drive east at 10 m/s on roads of their own, all in one frame or each in its own."""
    frames = [range(n_vehicles)] if at_once else [[v] for v in range(n_vehicles)]
    for i in range(n_frames * len(frames)):
        time_s, of = interval_s * i / len(frames), frames[i % len(frames)]
        yield seen_at(time_s, [(10.0 * time_s, 100.0 * v) for v in of], [f"v{v}" if named else "" for v in of])


@pytest.mark.parametrize("how", [{}, {"at_once": False, "n_vehicles": 3}, {"named": False}])
@pytest.mark.parametrize("interval_s", [0.1, 6.0])
def test_nine_tenths_of_the_rows_have_an_estimate_however_slow_the_sensor_is(interval_s, how):
    """Also where each vehicle reports at its own times: frames of others are no misses."""
    tracker, frames = tracker_of(None, density=0.3), list(east(50, interval_s, **how))
    n_estimated = sum(int((tracker.step(frame).unseen_s == 0).sum()) for frame in frames)
    assert n_estimated > 0.9 * sum(map(len, frames)) >= 90


def test_an_interval_is_the_median_of_the_last_and_a_pause_of_an_hour_is_none():
    rng, gaps = np.random.default_rng(0), NO_GAPS[None]
    assert np.isnan(usual(gaps)).all()
    for gap_s in rng.uniform(8.0, 13.0, 300):
        gaps = remembered(gaps, np.array([gap_s * 1e9]))
    middle, jitter = usual(gaps)[0] * 1e-9
    assert middle == pytest.approx(10.5, abs=2.5)
    assert 0.0 < jitter < 4.0
    np.testing.assert_array_equal(remembered(gaps, np.array([3.6e12])), gaps)


def test_a_vehicle_of_which_is_heard_each_ten_minutes_is_estimated_from_its_second_message_on():
    """Its belief covers square kilometres by then; the control is one of the same name, too far away for it."""
    model = one_cell_map(concentration=400.0, shape=100.0).without_places()
    for off_m, expected in ((0.0, [0, 1, 1, 1, 1, 1, 1, 1]), (1e6, [0, 0, 0, 0, 1, 1, 1, 1])):
        tracker = tracker_of(model, n_particles=300, step_s=30.0)
        frames = [seen_at(600.0 * i, [(3000.0 * i + off_m * (i == 1), 0.0)], ["bus"]) for i in range(8)]
        assert [len(tracker.step(frame)) for frame in frames] == expected


@pytest.mark.parametrize(("max_gap_s", "unseen_s"), [(5.0, 4.9), (600.0, 100.0), (600.0, 590.0)])
def test_who_has_an_id_is_estimated_as_long_as_its_belief_is_to_last(max_gap_s, unseen_s):
    """No frame was looked at in between, so none says that it left; the control is one without an id."""
    for name in ("bus", ""):
        tracker = tracker_of(None, density=0.3, max_gap_s=max_gap_s)
        for i in range(10):
            tracker.step(seen_at(float(i), [(10.0 * i, 0.0)], [name]))
        frame = tracker.track(Detections.none(), time_ns=round((9.0 + unseen_s) * 1e9), is_scan=False)
        assert (len(frame.estimates) == 1) == (bool(name) or unseen_s < 5.0)
        assert (frame.estimates.existence > 0.7).all()
