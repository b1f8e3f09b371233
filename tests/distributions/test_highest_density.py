"""Laws of highest density regions: they hold the share of the rollouts that they say, and split where rollouts do."""

import numpy as np
import pytest
from matplotlib.path import Path as Outline
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import gaussian_filter
from scipy.stats import norm

from dirprim_filter.distributions import highest_density
from dirprim_filter.distributions.highest_density import EASED, FINEST_M, KERNEL_SQUARES, N_SQUARES, triangles_above

SHARES = (0.9, 0.5)


def region_triangles(paths, shares):
    """The corners of the triangles of each region, (n, 3, 2)."""
    return [fan.vertex[fan.triangle] for fan in highest_density.highest_density_regions(paths, shares)]


def area_of(triangles):
    (ax, ay), (bx, by) = (triangles[:, 1] - triangles[:, 0]).T, (triangles[:, 2] - triangles[:, 0]).T
    return 0.5 * (ax * by - ay * bx)


def holds(triangles, points):
    """(n,) whether each point lies in one of the triangles, by matplotlib."""
    return np.any([Outline(t).contains_points(points, radius=1e-6) for t in triangles], axis=0)


def fork(n, *, seed):
    """Rollouts that go on to the east or turn off to the north, at 10 m/s; (n, 16, 2)."""
    rng = np.random.default_rng(seed)
    turn = np.where(rng.random(n) < 0.5, 0.0, 0.35)[:, None] + rng.normal(0, 0.03, (n, 1))
    heading = np.cumsum(np.broadcast_to(turn, (n, 16)), axis=1) * 0.25
    step = 2.5 * rng.gamma(100.0, 0.01, (n, 1, 1)) * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return np.cumsum(step, axis=1)


def test_at_every_instant_the_fan_holds_its_share_and_a_smaller_one_lies_within():
    paths = fork(60, seed=1)
    wide, narrow = fans = region_triangles(paths, SHARES)
    for share, fan in zip(SHARES, fans, strict=True):
        for step in range(paths.shape[1]):  # straight edges between nodes cost a sample or two
            assert holds(fan, paths[:, step]).mean() >= share - 0.05
    assert 0.0 < area_of(narrow).sum() < 0.8 * area_of(wide).sum()
    assert holds(wide, narrow.mean(axis=1)).mean() > 0.98


def test_a_fan_splits_where_rollouts_do():
    paths = fork(60, seed=5)
    (fan,), ends = region_triangles(paths, (0.9,)), paths[:, -1]
    ways = np.stack([ends[ends[:, 1] > 10].mean(axis=0), ends[ends[:, 1] <= 10].mean(axis=0)])
    assert holds(fan, ways).all()
    assert not holds(fan, ways.mean(axis=0)[None]).any()  # where an ellipse around all would lie


def test_the_area_is_that_of_the_highest_density_region():
    rng = np.random.default_rng(6)
    cloud = np.array([40.0, 25.0]) + 12.0 * rng.normal(size=(4000, 1, 2))
    kernel = KERNEL_SQUARES * np.ptp(cloud, axis=0).max() / N_SQUARES
    for share, fan in zip(SHARES, region_triangles(cloud, SHARES), strict=True):
        # A normal law, blurred by the kernel; a twentieth of the area is what samples and straight edges may cost.
        squared = (-2.0 * np.log(1.0 - share) * 144.0 / (144.0 + kernel**2) - 2.0 * np.log(EASED)) * (144 + kernel**2)
        assert area_of(fan).sum() == pytest.approx(np.pi * squared, rel=0.07)


@pytest.mark.parametrize("paths", [np.full((5, 3, 2), 7.0), np.zeros((1, 1, 2)), np.arange(4.0).reshape(1, 2, 2)])
def test_rollouts_that_agree_have_a_small_fan(paths):
    for fan in region_triangles(paths, SHARES):
        assert 0.0 < area_of(fan).sum() < 40.0
        away = np.linalg.norm(fan.reshape(-1, 1, 2) - paths[0], axis=-1)
        assert (away.min(axis=0) < FINEST_M).all()


def test_densities_are_sums_of_normal_ones():
    rng = np.random.default_rng(7)
    place, shares = rng.uniform(6, [24, 34], (5, 40, 2)), np.array([0.9, 0.5])
    found = highest_density.highest_densities(place, shares, (30, 40))
    expected = np.zeros_like(found)
    for samples in place:
        along, across = np.arange(30), np.arange(40)
        rows, columns = (norm.pdf(at[:, None], samples[:, i], KERNEL_SQUARES) for i, at in enumerate((along, across)))
        density = rows @ columns.T
        at_sample = np.sort(RegularGridInterpolator((along, across), density)(samples))
        for k, share in enumerate(shares):
            expected[k] = np.maximum(expected[k], density / (EASED * at_sample[int((1 - share) * 40)]))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("shape", [(9, 14), (1, 5), (3, 1), (12, 12)])
def test_triangles_cover_what_is_high_and_nothing_twice(shape):
    rng = np.random.default_rng(9)
    for _ in range(20):
        height = np.full(shape, -1.0)
        height[1:-1, 1:-1] = gaussian_filter(rng.normal(size=shape), 1.2)[1:-1, 1:-1]
        corners = triangles_above(height)
        assert (area_of(corners) >= -1e-12).all()
        middle = corners.mean(axis=1)
        inside = np.sum([Outline(t).contains_points(middle, radius=-1e-9) for t in corners], axis=0)
        assert (inside <= 1).all()
        high = np.argwhere(height >= 0)
        assert len(corners) > 0 or len(high) == 0
        if len(high) and len(corners):  # each high node is a point of the area, each low one is none
            low = np.argwhere(height < 0)
            assert holds(corners, high[:, ::-1] + 1e-9).sum() >= 0.9 * len(high)
            assert not any(Outline(t).contains_points(low[:, ::-1], radius=-1e-6).any() for t in corners)
