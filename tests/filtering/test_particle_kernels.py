"""The compiled steps on weights, against numpy, scipy, filterpy and counting."""

import filterpy.monte_carlo
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from dirprim_filter.config import FilterConfig
from dirprim_filter.distributions.angles import wrap
from dirprim_filter.filtering import _interaction, _kernels, _measuring, particle_filter
from dirprim_filter.filtering.belief import FIRST_CAPACITY, ParticleBelief, birth_key
from dirprim_filter.primitives._leader import ALONE
from dirprim_filter.primitives.motion_table import motion_table
from situations import one_cell_map

FALSE_ALARM = 1e-4  # of each statistical test below; seeds are fixed
VEHICLE = np.array([2, 0], np.int64)


@pytest.fixture
def cloud():
    """Three vehicles of 500 unequally weighted particles, those of the last two around (3, -2) and (40, 7)."""
    rng = np.random.default_rng(0)
    weight = rng.dirichlet(np.full(500, 0.5), size=3)
    center = np.array([[40.0, 7.0], [0.0, 0.0], [3.0, -2.0]])
    return _kernels.Cloud(
        position=center[:, None] + rng.normal(0, [1.0, 2.0], (3, 500, 2)),
        direction=rng.vonmises(3.0, 4.0, (3, 500)),
        speed=rng.gamma(5.0, 2.0, (3, 500)),
        cell=rng.integers(0, 9, (3, 500)),
        manoeuvre=rng.integers(0, 3, (3, 500)),
        push=rng.normal(size=(3, 500)),
        weight=weight,
        state=rng.integers(2**63, size=(3, 4), dtype=np.uint64),
    )


def copied(cloud):
    return _kernels.Cloud(*(column.copy() for column in cloud))


def test_moments_are_numpys_weighted_mean_and_covariance(cloud):
    out = np.empty((2, 10))
    _kernels.moments(cloud, VEHICLE, out)
    for row, v in zip(out, VEHICLE, strict=True):
        w = cloud.weight[v]
        covariance = np.cov(cloud.position[v].T, aweights=w, ddof=0)
        toward = np.average(np.exp(1j * cloud.direction[v]), weights=w)
        expected = [
            *np.average(cloud.position[v], axis=0, weights=w), covariance[0, 0], covariance[0, 1], covariance[1, 1],
            np.angle(toward), np.abs(toward), np.average(cloud.speed[v], weights=w),
            np.sqrt(np.cov(cloud.speed[v], aweights=w, ddof=0)), 1 / (w**2).sum(),
        ]  # fmt: skip
        np.testing.assert_allclose(row, expected, rtol=1e-10)


def weighed(cloud, vehicle, place, *, noise_m):
    """Weigh by a position that cannot be an outlier."""
    config = FilterConfig(noise_m=noise_m, outlier_probability=1e-290, outlier_extent_m=1.0)
    noise = particle_filter._noise(config)
    column = np.array([[*place, noise_m**-2, 0.0, noise_m**-2, -np.log(2 * np.pi * noise_m**2), np.nan, np.nan]])
    _measuring.weigh(cloud, vehicle, column, np.empty((1, 3)), noise)


def test_a_measurement_of_huge_noise_after_next_to_no_time_changes_no_belief(cloud):
    before = copied(cloud)
    table = motion_table(one_cell_map())
    vehicle = np.array([1], np.int64)
    _kernels.initialise_motion(table, cloud, vehicle)
    none, own = np.empty((1, 0, 4)), np.array([-1])
    _interaction.predict(table, ALONE, cloud, none, vehicle, own, np.zeros(1), np.array([1e-9]))
    weighed(cloud, vehicle, [50.0, -20.0], noise_m=1e7)
    np.testing.assert_allclose(cloud.weight[1], before.weight[1], rtol=1e-9)
    np.testing.assert_allclose(cloud.position[1], before.position[1], atol=1e-4)
    np.testing.assert_allclose(cloud.speed[1], before.speed[1], atol=1e-2)
    weighed(cloud, vehicle, [0.0, 0.0], noise_m=1.0)
    assert np.abs(np.log(cloud.weight[1] / before.weight[1])).max() > 1.0  # a telling one does
    for other in (0, 2):  # not asked for
        np.testing.assert_array_equal(cloud.weight[other], before.weight[other])


def effective_sample_size(weight):
    weight = np.asarray(weight, dtype=float)
    return _kernels.effective_sample_size(weight)


def test_effective_sample_size_is_n_of_equal_weights_and_one_of_a_single_survivor():
    assert effective_sample_size(np.full(64, 1 / 64)) == pytest.approx(64)
    assert effective_sample_size([0, 0, 1, 0]) == pytest.approx(1)
    assert effective_sample_size([0.5, 0, 0.5, 0]) == pytest.approx(2)


def ancestors(weight, u):
    survivors = np.empty(len(weight), np.int64)
    _kernels.systematic(np.asarray(weight, dtype=float), float(u), survivors)
    return np.repeat(np.arange(len(weight)), survivors)


@settings(max_examples=200, deadline=None)
@given(
    weight=st.lists(st.floats(0, 1), min_size=1, max_size=40).filter(lambda w: sum(w) > 1e-3),
    u=st.floats(1e-9, 1 - 1e-9),
)
def test_every_particle_survives_floor_or_ceil_of_n_w_times(weight, u):
    expected = len(weight) * np.array(weight) / np.sum(weight)
    count = np.bincount(ancestors(weight, u), minlength=len(weight))
    assert count.sum() == len(weight)
    assert (count >= np.floor(expected - 1e-9)).all()
    assert (count <= np.ceil(expected + 1e-9)).all()
    assert (count[np.array(weight) == 0] == 0).all()


@pytest.mark.parametrize("seed", range(20))
def test_systematic_resampling_is_filterpys_for_the_same_number(seed):
    weight = np.random.default_rng(seed).dirichlet(np.full(200, 0.2))
    np.random.seed(seed)  # noqa: NPY002 filterpy draws from numpy's global numbers
    u = np.random.random()  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    theirs = filterpy.monte_carlo.systematic_resample(weight)
    np.testing.assert_array_equal(ancestors(weight, u), theirs)
    assert not np.array_equal(ancestors(weight, (u + 0.5) % 1), theirs)


@pytest.mark.parametrize("survivor", [0, 3, 6])
def test_a_particle_with_all_the_weight_is_the_only_ancestor(survivor):
    np.testing.assert_array_equal(ancestors(np.eye(7)[survivor], 0.999999), survivor)


def test_a_belief_that_has_kept_its_weight_is_left_as_it_is(cloud):
    before = copied(cloud)
    size = [1.0 / (cloud.weight[v] ** 2).sum() for v in VEHICLE]
    below = np.mean(size)  # between the two
    _kernels.resample(cloud, VEHICLE, below)
    for v, n in zip(VEHICLE, size, strict=True):
        assert (cloud.weight[v] == before.weight[v]).all() == (n >= below)


def test_resampling_keeps_whole_particles_and_forgets_the_weights(cloud):
    cloud.push[2] = np.arange(500)  # names of the particles, which their copies keep
    before = copied(cloud)
    heaviest = int(before.weight[2].argmax())
    _kernels.resample(cloud, VEHICLE, np.inf)
    np.testing.assert_allclose(cloud.weight[VEHICLE], 1 / 500)
    origin = cloud.push[2].astype(np.int64)
    for name in ("cell", "manoeuvre"):
        np.testing.assert_array_equal(getattr(cloud, name)[2], getattr(before, name)[2, origin])
    stays = np.unique(origin)
    columns = (("position", np.asarray), ("direction", wrap), ("speed", np.asarray))
    for name, off_by in columns:  # copies are spread a little, the others stay
        kept, now = getattr(before, name)[2, origin], getattr(cloud, name)[2]
        copies = np.setdiff1d(np.arange(500), stays)
        np.testing.assert_array_equal(now[stays], kept[stays])
        share = np.median(np.abs(off_by(now - kept)[copies])) / np.std(off_by(kept - np.median(kept)))
        assert 0.05 < share < 0.25
    expected = 500 * before.weight[2, heaviest]
    assert np.floor(expected) <= (origin == heaviest).sum() <= np.ceil(expected)
    for mine, old in zip(cloud, before, strict=True):
        np.testing.assert_array_equal(mine[1], old[1])  # not asked for


def test_birth_follows_the_measurement_and_the_primitive_there(ring_map):
    table = motion_table(ring_map)
    belief = ParticleBelief(n_particles=20_000, mode_of=ring_map.motion.mode)
    place = np.array([20.0, 0.0])
    key = np.array([7], np.uint64)
    first = np.array([0])
    _kernels.scatter(ring_map.compiled(), belief.cloud, first, key, place[None], 0.01)
    _kernels.initialise_motion(table, belief.cloud, first)
    x, y = (belief.cloud.position[0] - place).T
    assert stats.kstest(x, stats.norm(0, 0.01).cdf).pvalue > FALSE_ALARM
    assert stats.kstest(y, stats.norm(0, 0.01).cdf).pvalue > FALSE_ALARM
    assert stats.kstest(x, stats.norm(0, 0.011).cdf).pvalue < FALSE_ALARM
    # a cell's border runs along y = 0: each half follows the primitive of its own cell
    for half in (y > 0, y < 0):
        at = belief.cloud.position[0, half]
        direction, _ = ring_map.sample(at, rng=np.random.default_rng(1))
        assert stats.ks_2samp(belief.cloud.direction[0, half], direction).pvalue > FALSE_ALARM
        assert stats.ks_2samp(belief.cloud.direction[0, half], direction + 0.02).pvalue < FALSE_ALARM
    np.testing.assert_array_equal(belief.cloud.cell[0], ring_map.tessellation.cell_of(belief.cloud.position[0]))


def test_slots_keep_what_they_hold_when_there_is_room_for_more():
    belief = ParticleBelief(n_particles=3, mode_of=np.zeros(1, np.int64))
    belief.cloud.position[:] = np.arange(FIRST_CAPACITY)[:, None, None]
    before = copied(belief.cloud)
    belief.reserve(FIRST_CAPACITY + 5)
    assert belief.n_slots == FIRST_CAPACITY + 5
    for column, old in zip(belief.cloud, before, strict=True):
        np.testing.assert_array_equal(column[:FIRST_CAPACITY], old)
    belief.reserve(2)
    assert belief.n_slots == FIRST_CAPACITY + 5
    belief.copy(np.array([3]), np.array([20]))
    assert (belief.cloud.position[20] == 3.0).all()


def test_a_birth_key_differs_by_seed_by_vehicle_and_by_time():
    keys = {int(birth_key(*given)) for given in [(1, "a", 5), (2, "a", 5), (1, "b", 5), (1, "a", 6), (1, "a", 5)]}
    assert len(keys) == 4
    assert birth_key(1, "2/3", 4) != birth_key(1, "3", 42)


def test_a_belief_without_particles_is_refused():
    with pytest.raises(ValueError, match="n_particles: expected at least 1, got 0"):
        ParticleBelief(n_particles=0, mode_of=np.zeros(1, np.int64))
