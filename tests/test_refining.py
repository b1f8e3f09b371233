"""Another tracker's output, refined: what it measured, and that its errors get smaller by the map."""

from dataclasses import replace

import numpy as np

from dirprim_filter.config import FilterConfig, TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.estimates import Estimates
from dirprim_filter.refining import is_measured, refine
from oracles import filterpy_constant_velocity
from situations import beside, keys, ring_traffic

NOISE_M, LOST = 0.5, slice(30, 45)
"""Rows in which the other tracker's sensor sees nothing."""


def other_tracker(tracks, *, seed):
    """What filterpy's constant velocity makes of noisy positions, and where it measured them."""
    rng, rows, measured = np.random.default_rng(seed), [], []
    for name in np.unique(tracks.track_id):
        own = tracks[tracks.track_id == name]
        place = own.position + rng.normal(0.0, NOISE_M, own.position.shape)
        place[LOST] = np.nan
        given = {"density": 5.0, "noise_m": NOISE_M, "first_speed_std": 10.0}
        (mean, _), _ = filterpy_constant_velocity(place, 1e-9 * own.time_ns, **given)
        rows.append(Detections(track_id=own.track_id, time_ns=own.time_ns, position=mean[:, :2]))
        measured.append(~np.isnan(place).any(axis=1))
    return Detections.concatenate(rows), np.concatenate(measured)


def refined(rows, primitive_map, seed, **options):
    config, rng = FilterConfig(n_particles=300, noise_m=0.4), lambda: np.random.default_rng(seed)
    frames = refine(rows, primitive_map, config=config, tracking=TrackingConfig(), rng=rng, **options)
    return Estimates.concatenate(frame.estimates for frame in frames)


def errors(rows, tracks):
    return np.hypot(*(rows.position - tracks.position[beside(rows, tracks)[1]]).T)


def test_rows_in_which_a_tracker_coasts_are_told_from_measured_ones_in_any_order():
    tracks = ring_traffic(np.random.default_rng(1), n_vehicles=4, n_rows=60)
    rows, measured = other_tracker(tracks, seed=0)
    np.testing.assert_array_equal(is_measured(rows), measured)
    shuffled = np.random.default_rng(0).permutation(len(rows))
    np.testing.assert_array_equal(is_measured(rows[shuffled]), measured[shuffled])
    standing = replace(rows, position=np.random.default_rng(1).normal(0.0, 0.1, (len(rows), 2)))
    assert is_measured(standing).mean() > 0.98  # it stands, but it is measured
    late = replace(rows, time_ns=rows.time_ns + 1_700_000_000 * 10**9)  # of these seconds float64 keeps 0.2 us
    np.testing.assert_array_equal(is_measured(late), measured)


def test_who_stands_exactly_still_drives_exactly_evenly_or_is_rounded_is_measured():
    tracks = ring_traffic(np.random.default_rng(1), n_vehicles=4, n_rows=60)
    rows, _ = other_tracker(tracks, seed=0)
    assert is_measured(replace(rows, position=rows.position.round(1))).all()
    is_first = tracks.track_id == tracks.track_id[0]
    place = tracks.position + np.random.default_rng(2).normal(0.0, 0.3, tracks.position.shape)
    place[is_first] = place[is_first][0]
    exact = Detections(track_id=tracks.track_id, time_ns=tracks.time_ns, position=place)
    assert is_measured(exact).all()
    later_s = np.maximum(tracks.time_ns * 1e-9 - 3.0, 0.0)
    straight = np.column_stack([tracks.time_ns * 1e-8, later_s**2])
    assert is_measured(replace(exact, position=straight)).all()


def test_the_map_makes_another_trackers_errors_smaller_and_fills_what_it_did_not_see(ring_map):
    for seed in range(2):
        tracks = ring_traffic(np.random.default_rng([30, seed]), n_vehicles=4, n_rows=60)
        rows, measured = other_tracker(tracks, seed=seed)
        after = refined(rows, ring_map, seed)
        assert sorted(keys(after)) == sorted(keys(rows))
        before_m, after_m = np.median(errors(rows, tracks)), np.median(errors(after, tracks))
        assert after_m < 0.8 * before_m, seed
        of_unseen, of_lost = (errors(of[~np.isin(of.time_ns, rows.time_ns[measured])], tracks) for of in (after, rows))
        assert np.median(of_unseen) < 0.3 * np.median(of_lost), seed


def test_a_track_that_was_broken_where_nothing_was_seen_is_one_again(ring_map):
    rows, measured = other_tracker(ring_traffic(np.random.default_rng(31), n_vehicles=3, n_rows=60), seed=0)
    number = np.concatenate([np.arange((rows.track_id == name).sum()) for name in np.unique(rows.track_id)])
    pieces = np.where(number >= LOST.stop, np.char.add(rows.track_id, "-anew"), rows.track_id)
    kept = measured | (number < LOST.start + 5)  # it coasted for some rows, then started again
    found = refined(replace(rows, track_id=pieces)[kept], ring_map, 0)
    assert set(map(str, found.track_id.tolist())) == set(rows.track_id.tolist())


def test_at_a_rate_what_a_tracker_left_out_is_filled_too(ring_map):
    tracks = ring_traffic(np.random.default_rng(31), n_vehicles=2, n_rows=60)
    rows, measured = other_tracker(tracks, seed=0)
    after = refined(rows[measured], ring_map, 0, rate_hz=1e9 / np.diff(np.unique(tracks.time_ns))[0])
    assert sorted(keys(after)) == sorted(keys(rows))
    assert np.isin(keys(refined(rows[measured], ring_map, 0)), keys(rows[measured])).all()
