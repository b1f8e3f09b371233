import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dirprim_filter.distributions.angles import difference, wrap

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
