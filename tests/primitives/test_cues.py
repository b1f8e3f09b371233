import numpy as np
import pytest
from scipy import stats

from dirprim_filter.distributions import VonMisesMixture
from dirprim_filter.distributions.product import multiply_mixtures
from dirprim_filter.primitives.cues import TURN_LEFT, TURN_RIGHT, Cue

STRAIGHT_OR_RIGHT = VonMisesMixture(
    weight=np.array([0.5, 0.5]), mean_direction=np.array([0.0, -np.pi / 2]), concentration=np.array([20.0, 20.0])
)


def test_the_papers_signal_is_a_von_mises_a_right_angle_from_the_heading():
    theta = np.linspace(-3, 3, 50)
    belief = TURN_RIGHT.belief(0.4)
    np.testing.assert_allclose(
        belief.log_density(theta), stats.vonmises.logpdf(theta, 2.5, loc=0.4 - np.pi / 2), atol=1e-12
    )
    left = TURN_LEFT.belief(0.4).log_density(0.8 - theta)
    np.testing.assert_allclose(left, belief.log_density(theta), atol=1e-12)


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
    ("wrong", "match"),
    [
        ({"turn": 0.0, "concentration": -1.0}, "no negative concentration"),
        ({"turn": np.nan, "concentration": 1.0}, "finite"),
        ({"turn": [], "concentration": 1.0}, "at least one direction"),
    ],
)
def test_what_is_no_cue_is_refused(wrong, match):
    with pytest.raises(ValueError, match=match):
        Cue(**wrong)
