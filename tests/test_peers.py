"""What the comparison with other packages' trackers rests on: search, truth, training traffic."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dirprim_filter import Tracks
from dirprim_filter.config import TrackingConfig
from dirprim_filter.detections import Detections
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.evaluation.settings import Axis
from dirprim_filter.evaluation.tracked_rows import TrackedRows

sys.path.insert(0, str(Path(__file__).with_name("benchmarks")))

from peer_scenes import Fold, Part, at_ten_hertz, near_the_truth
from peer_trackers import HALF_DECADE, Peer, Tracked
from peers import PACKAGES, scored, tuned

from situations import tracks_of


def circling(*, rate_hz: float, n: int = 3, seconds: float = 20.0) -> Tracks:
    """Vehicles at 8 m/s on a circle of 20 m radius, a third of it apart."""
    time_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    turned = 8.0 / 20.0 * time_s + 2.0 * np.pi / n * np.arange(n)[:, None]
    place, time_ns = 20.0 * np.stack([np.cos(turned), np.sin(turned)], axis=-1), np.round(time_s * 1e9).astype(np.int64)
    return tracks_of(place, time_ns=time_ns, direction=wrap(turned + np.pi / 2), speed=8.0)


def fold_of(truth: Tracks, *, noise_m: float = 0.3) -> Fold:
    seen = Detections.of(truth).without_ids()
    noisy = seen.position + noise_m * np.random.default_rng(1).standard_normal((len(seen), 2))
    part = Part(seen=Detections(track_id=seen.track_id, time_ns=seen.time_ns, position=noisy), truth=truth)
    return Fold(
        judged=(part,), training=(part,), traffic=truth, noise_m=noise_m,
        tracking=TrackingConfig(detection_probability=0.99, clutter_density=1e-6, birth_density=1e-5),
    )  # fmt: skip


def test_the_search_goes_as_far_as_the_optimum_lies():
    """One setting is best 300 times above where the search starts, the other at a fifth of it, neither is at an end."""
    fold = fold_of(circling(rate_hz=10.0, seconds=2.0))

    def off_by_settings(part, settings):
        off = abs(np.log(settings["far"] / 300.0)) + abs(np.log(settings["near"] / 0.2))
        truth, spread = part.truth, np.random.default_rng(0).standard_normal(part.truth.position.shape)
        return Tracked(
            TrackedRows(track_id=truth.track_id, time_ns=truth.time_ns, position=truth.position + 0.5 * off * spread),
            0.0,
        )

    best = tuned(Peer(off_by_settings, (Axis("far", 1.0, HALF_DECADE), Axis("near", 1.0, 1.5))), fold, {})
    assert best["far"] == pytest.approx(10.0**2.5, rel=1e-3)  # the grid's nearest to 300 and to .2
    assert best["near"] == pytest.approx(1.5**-4, rel=1e-3)


def test_a_partial_truth_of_any_group_judges_the_rows_near_it_alone():
    """One of three vehicles is instrumented: tracks of the others are no false ones, a second one beside it is."""
    whole = circling(rate_hz=10.0)
    truth = replace(whole[whole.track_id == 0], group=np.full(200, 7))
    part = Part(seen=Detections.of(whole).without_ids(), truth=truth, judged=near_the_truth)

    def hota(position, names):
        rows = TrackedRows(track_id=names, time_ns=np.tile(whole.time_ns, len(names) // 600), position=position)
        return scored(Tracked(rows, 0.0), part, 5.0).hota

    assert hota(whole.position, whole.track_id) == pytest.approx(1.0)
    twice = np.concatenate([whole.position, whole.position + 1.0])
    assert hota(twice, np.concatenate([whole.track_id, whole.track_id + 10])) < 0.8


def test_slow_rows_are_filled_in_within_centimetres_of_the_bend():
    filled = at_ten_hertz(circling(rate_hz=5.0), from_s=3.0, to_s=12.0)
    whole = circling(rate_hz=10.0)
    whole = whole[(whole.time_ns >= 3_000_000_000) & (whole.time_ns < 12_000_000_000)]
    assert len(filled) == len(whole) == 270
    order, other = (np.lexsort((of.time_ns, of.track_id)) for of in (filled, whole))
    assert np.abs(filled.position[order] - whole.position[other]).max() < 0.02  # a chord of 1.6 m
    assert np.abs(filled.speed - 8.0).max() < 0.1


@pytest.mark.parametrize("package", PACKAGES[:2], ids=lambda package: package.__name__)
def test_every_tracker_follows_vehicles_that_are_always_seen(package):
    pytest.importorskip(package.__name__.replace("_", ""), reason="the extra `peers` is not installed")
    fold = fold_of(circling(rate_hz=10.0, seconds=5.0))
    starts: dict[str, dict[str, float]] = {}
    for name, peer in package(fold).items():
        starts[name] = starts.get(peer.after, {}) | {of.name: of.start for of in peer.axes}
        found = peer.track(fold.judged[0], starts[name])
        score = scored(found, fold.judged[0], fold.similarity_m)
        assert score.switches <= 1, name
        assert score.hota > 0.8, name
        assert 0.0 < score.rmse < 0.5, name
