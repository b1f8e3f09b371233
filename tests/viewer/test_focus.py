"""Whom to look at, and what is shown of it: Eq. 4 around the circle."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.detections import Detections
from dirprim_filter.viewer.focus import KEPT_S, Focus, Look, polar_curves

EVERYWHERE = np.array([[-1e3, -1e3], [1e3, 1e3]])


def looks_of(focus, frames, box=EVERYWHERE):
    looks = [focus.see(frame, box=box) for frame in frames]
    return [None if look is None else look.track_id for look in looks]


def with_evidence(frame, seven, eight):
    return replace(frame, estimates=replace(frame.estimates, log_evidence=np.array([seven, eight])))


def test_the_vehicle_that_is_least_expected_is_looked_at_for_a_while(scene_frames):
    frames = [with_evidence(frame, -1.0, -5.0) for frame in scene_frames[:3]]
    frames += [with_evidence(frame, -50.0, -5.0) for frame in scene_frames[3:5]]
    assert looks_of(Focus("7"), frames) == ["7"] * 5
    assert looks_of(Focus("none"), frames) == [None] * 5
    focus = Focus(None)
    assert looks_of(focus, frames) == ["8"] * 5
    later = replace(frames[4], time_ns=frames[0].time_ns + int(1.1e9 * KEPT_S))
    assert looks_of(focus, [later, scene_frames[5]]) == ["7", None]
    seven_alone = np.array([[0.0, 0.0], [10.0, 10.0]])  # who is in view comes first
    assert looks_of(Focus(None), frames[:1], seven_alone) == ["7"]


def look_at(position, *, cue=(0.0, 0.0)):
    return Look("a", np.array(position), cue, np.full(72, 1 / 72))


def density_of(line, theta):
    """What a closed polar line says of the density at angles, to a factor: its radius squared."""
    angle, radius = np.arctan2(line[:-1, 1], line[:-1, 0]), np.hypot(*line[:-1].T)
    return np.interp(theta, angle, radius**2, period=2 * np.pi)


def test_the_posterior_is_the_product_of_the_prior_and_the_cue(scene_map):
    look = look_at((15.0, 15.0), cue=(1.2, 6.0))
    curves = {name: lines[0] for name, lines in polar_curves([look], scene_map).items()}
    theta = np.linspace(-np.pi, np.pi, 721)
    prior = np.exp(scene_map.primitive_at(look.position).direction.log_density(theta))
    product = prior * np.exp(6.0 * np.cos(theta - 1.2))
    posterior, reported = density_of(curves["posterior"], theta), density_of(curves["prior"], theta)
    assert posterior / posterior.max() == pytest.approx(product / product.max(), abs=0.02)
    assert reported / reported.max() == pytest.approx(prior / prior.max(), abs=0.02)
    assert np.abs(posterior / posterior.max() - prior / prior.max()).max() > 0.2  # the cue counts
    assert posterior.mean() == pytest.approx(reported.mean(), rel=0.02)  # one scale for all
    assert max(np.hypot(*line.T).max() for line in curves.values()) == pytest.approx(1.0)
    blind = polar_curves([look_at((15.0, 15.0))], scene_map)  # without a cue the posterior is the prior
    assert density_of(blind["posterior"][0], theta) == pytest.approx(density_of(blind["prior"][0], theta), abs=1e-3)
    assert np.ptp(density_of(blind["cue"][0], theta)) < 1e-9


def test_a_turn_signal_is_the_cue(scene_frames):
    def cue_of(turn):
        seen = scene_frames[0].detections
        signalled = Detections(
            track_id=seen.track_id, time_ns=seen.time_ns, position=seen.position, cue=np.array(turn)
        )  # fmt: skip
        look = Focus("8").see(replace(scene_frames[0], detections=signalled), box=EVERYWHERE)
        assert look is not None
        assert look.belief.sum() == pytest.approx(1.0)
        return look.cue

    assert cue_of([[np.nan, np.nan], [-np.pi / 2, 2.5]]) == pytest.approx((np.pi / 4 - np.pi / 2, 2.5))
    assert cue_of([[-np.pi / 2, 2.5], [np.nan, np.nan]]) == (0.0, 0.0)  # control: another vehicle signals
