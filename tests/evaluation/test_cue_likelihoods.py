"""Cues: what one says, what the map adds to one, and what is none."""

import numpy as np
import pytest
from scipy import stats

from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.evaluation.cues import (
    evaluate_cues,
    most_probable_direction,
    observation_concentration,
    steps_between_cells,
)
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT, Cue
from dirprim_filter.tracks import Tracks
from moving import squares
from situations import tracks_of

PLAIN = squares(4, 1, None, side=10.0)
STRAIGHT_OR_RIGHT = VonMisesMixture(
    weight=np.array([0.5, 0.5]), mean_direction=np.array([0.0, -np.pi / 2]), concentration=np.array([20.0, 20.0])
)


def drive(x, *, time_s=None, track_id=0):
    time_ns = np.round(1e9 * np.arange(len(x)) if time_s is None else time_s).astype(int)
    return tracks_of([[(east, 5.0) for east in x]], track_id=track_id, time_ns=time_ns, speed=5.0)


def test_a_step_is_the_middle_of_a_visit_and_the_last_row_of_the_one_before_of_one_vehicle():
    steps = steps_between_cells(PLAIN, drive([1, 5, 9, 12, 15, 18, 25]))
    np.testing.assert_array_equal(steps.before, [2, 5])
    np.testing.assert_array_equal(steps.row, [4, 6])
    two = Tracks.concatenate([drive([1, 5], track_id=0), drive([15, 25], track_id=1)])
    steps = steps_between_cells(PLAIN, two)
    assert two.position[steps.before, 0].tolist() == [15.0]
    for none in (drive([1, 15], time_s=np.array([0.0, 2.5e9])), drive([1, -50, 15]), drive([1])):
        assert steps_between_cells(PLAIN, none).row.size == 0


def test_the_most_probable_direction_is_where_a_fine_grid_finds_it():
    rng = np.random.default_rng(1)
    weight, mean = rng.dirichlet(np.ones(4), 50), rng.uniform(-np.pi, np.pi, (50, 4))
    mixture = VonMisesMixture(weight=weight, mean_direction=mean, concentration=rng.gamma(2.0, 10.0, (50, 4)))
    theta = np.linspace(-np.pi, np.pi, 4001)
    density = mixture[:, None].log_density(theta[None, :])
    found = most_probable_direction(mixture)
    np.testing.assert_allclose(mixture.log_density(found), density.max(axis=1), atol=2e-4)


def test_no_other_concentration_fits_the_observation_better():
    truth = np.random.default_rng(2).vonmises(0.3, 6.0, 500)
    found = observation_concentration(np.zeros(500), truth)
    less, likelihood, more = (stats.vonmises.logpdf(truth, found * by).sum() for by in (0.9, 1.0, 1.1))
    assert likelihood > max(less, more)
    assert observation_concentration(np.full(500, np.pi), truth) == 0.0  # worse than nothing is reported by nothing


def test_on_a_bend_the_prior_adds_to_the_cell_before_and_less_to_the_own_course(ring):
    table = evaluate_cues(ring, n_folds=2, tessellation="grid", rng=np.random.default_rng(3))
    assert (table.split_by, table.n_vehicles) == ("vehicle", 40)
    before, own = table.cell_before, table.own_course
    assert before.log_gain.n_clusters == 40
    assert min(before.log_gain.low, own.log_gain.low) > 2.0  # a cell before, on a bend, is a poor guide
    assert before.log_gain.value == pytest.approx(before.posterior.mean_log.value - before.observation.mean_log.value)
    assert before.over_prior.value == pytest.approx(before.posterior.mean_log.value - table.prior.mean_log.value)
    assert before.posterior.mean > max(table.prior.mean, before.observation.mean)


def test_a_prior_that_knows_nothing_adds_nothing():  # the negative control of the test above
    rng = np.random.default_rng(4)
    course = rng.uniform(-np.pi, np.pi, (60, 1))
    way = (np.arange(40) * 2.0 - 40.0)[:, None] * np.stack([np.cos(course), np.sin(course)], axis=-1)
    tracks = tracks_of(
        way + rng.uniform(-30, 30, (60, 1, 2)), time_ns=np.arange(40) * 250_000_000,
        direction=course + rng.normal(0, 0.05, (60, 40)), speed=8.0 + rng.random((60, 40)),
    )  # fmt: skip
    table = evaluate_cues(tracks, n_folds=2, tessellation="grid", rng=np.random.default_rng(5))
    assert table.own_course.log_gain.value < 0.05


def test_steps_need_whole_vehicles(ring):
    with pytest.raises(ValueError, match="'vehicle' or 'group', got 'random'"):
        evaluate_cues(ring, split_by="random", rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="from one cell to another, got none"):
        evaluate_cues(ring[ring.time_ns == 0], n_folds=2, rng=np.random.default_rng(0))


def test_the_papers_signal_is_a_von_mises_a_right_angle_from_the_heading():
    theta = np.linspace(-3, 3, 50)
    for cue, turn in ((TURN_RIGHT, -np.pi / 2), (TURN_LEFT, np.pi / 2)):
        expected = stats.vonmises.logpdf(theta, 2.5, loc=0.4 + turn)
        np.testing.assert_allclose(cue.belief(0.4).log_density(theta), expected, atol=1e-12)


def test_a_signal_draws_samples_to_the_turn_as_in_the_paper():
    """Its Fig. 8: the RMSE of sampled angles to the turn falls from about 60 to 40 degrees."""
    posterior = multiply_mixtures(STRAIGHT_OR_RIGHT, TURN_RIGHT.belief(0.0)).mixture
    before, after = (
        np.rad2deg(np.sqrt(((of.sample(n_samples=20_000, rng=np.random.default_rng(6))[0] + np.pi / 2) ** 2).mean()))
        for of in (STRAIGHT_OR_RIGHT, posterior)
    )
    assert before > 60
    assert after < 40


@pytest.mark.parametrize(
    ("turn", "concentration", "match"),
    [(0.0, -1.0, "no negative concentration"), (np.nan, 1.0, "finite"), ([], 1.0, "at least one direction")],
)
def test_what_is_no_cue_is_refused(turn, concentration, match):
    with pytest.raises(ValueError, match=match):
        Cue(turn=turn, concentration=concentration)
