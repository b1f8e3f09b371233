"""Angles: wrapped, and in clusters as scikit-learn finds them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN

from dirprim_filter.distributions.angles import difference, wrap
from dirprim_filter.distributions.modes import NOISE, dbscan
from oracles import circular_distance

ODD_PI = np.array([np.nextafter(k * np.pi, s * np.inf) for k in range(-9, 10) for s in (-1, 1)] + [-np.pi, np.pi])


@given(st.floats(-1e6, 1e6))
def test_wrap_keeps_the_angle_and_the_interval(angle):
    wrapped = float(wrap(np.array(angle)))
    assert -np.pi < wrapped <= np.pi
    assert abs(np.exp(1j * wrapped) - np.exp(1j * angle)) < 1e-8
    assert float(wrap(np.array(wrapped))) == wrapped


def test_wrap_at_the_edges_and_the_short_way_round():
    wrapped = wrap(ODD_PI)
    assert (wrapped > -np.pi).all()
    assert (wrapped <= np.pi).all()
    assert wrap(np.array(-np.pi)) == np.pi
    assert np.isclose(difference(np.array(-3.1), np.array(3.1)), 2 * np.pi - 6.2)


@pytest.mark.parametrize("seed", range(8))
def test_labels_are_those_of_scikit_learn(seed):
    rng = np.random.default_rng(seed)
    around = [rng.vonmises(rng.uniform(-np.pi, np.pi), rng.choice([1, 20, 300]), rng.integers(1, 60)) for _ in range(2)]
    theta = np.concatenate([*around, rng.uniform(-np.pi, np.pi, rng.integers(0, 10))])
    if seed % 3 == 0:
        theta = np.round(theta, 1)  # repeated angles
    for eps in (0.021, 0.13, 0.77, 3.2):
        for min_samples in (1, 2, 6):
            distance = circular_distance(theta[:, None], theta[None])
            expected = DBSCAN(eps=eps, min_samples=min_samples, metric="precomputed").fit(distance).labels_
            np.testing.assert_array_equal(dbscan(theta, eps=eps, min_samples=min_samples), expected)


def test_one_angle_and_a_cluster_across_the_wrap():
    assert dbscan(np.array([2.0]), eps=0.1, min_samples=1).tolist() == [0]
    assert dbscan(np.array([2.0]), eps=0.1, min_samples=2).tolist() == [NOISE]
    theta = np.array([3.1, -3.1, 3.12, -3.13, 0.0, 0.01])
    assert dbscan(theta, eps=0.1, min_samples=2).tolist() == [0, 0, 0, 0, 1, 1]
