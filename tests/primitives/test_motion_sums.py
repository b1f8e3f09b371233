"""Sums of two logs are the sums of both, and their regressions are those of the rows."""

import numpy as np
import pytest

from dirprim_filter import learn_primitives
from dirprim_filter.primitives.background import Background, learn_chain
from dirprim_filter.primitives.motion_learning import label_visits, motion_of
from dirprim_filter.primitives.motion_sums import MotionSums, Regression
from dirprim_filter.primitives.rows import TrackRows
from dirprim_filter.primitives.visits import Visits
from situations import junction_traffic


@pytest.fixture(scope="module")
def counted():
    """A junction's map; the visits of all of its vehicles, of some, and of the others; their manoeuvres."""
    tracks = junction_traffic(np.random.default_rng(1), n_vehicles=36)
    learned = learn_primitives(tracks, tessellation="grid", cell_size=10.0, rng=np.random.default_rng(1))
    rows = TrackRows.thinned(tracks, interval_s=0.2)
    some = rows.vehicle % 3 == 0
    visits = [Visits.of(part, learned.tessellation) for part in (rows, rows[some], rows[~some])]
    labels = label_visits(learned, visits[0], detail=1.0, rng=np.random.default_rng(2))
    is_some = visits[0].vehicle[visits[0].begin] % 3 == 0
    label = [labels.label, labels.label[is_some], labels.label[~is_some]]
    sums = [MotionSums.of(v, labels._replace(label=z), learned) for v, z in zip(visits, label, strict=True)]
    return learned, visits[0], labels, sums


def columns(sums):
    """All numbers of sums, by name."""
    found = {}
    for name, part in sums._asdict().items():
        if isinstance(part, Regression):
            found |= {f"{name}.{key}": column for key, column in part._asdict().items()}
        else:
            found[name] = part.toarray() if name == "transition" else part
    return found


def assert_same(one, other, *, atol=1e-9):
    for (name, mine), theirs in zip(columns(one).items(), columns(other).values(), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=atol * np.abs(theirs).max(initial=1.0), err_msg=name)


def test_sums_of_some_vehicles_and_of_the_others_are_those_of_all(counted):
    *_, (of_all, of_some, of_others) = counted
    assert_same(of_some + of_others, of_all)
    with pytest.raises(AssertionError):
        assert_same(of_some + of_some, of_all)


def test_motion_follows_from_the_sums_alone(counted):
    learned, visits, labels, (of_all, of_some, of_others) = counted
    following, columns_of_chain = learn_chain(visits, rng=np.random.default_rng(0))[::-1]
    background = Background(None, 1.0, columns_of_chain, following)

    def motion(sums):
        made = motion_of(sums, labels, learned, background)
        return {name: np.asarray(getattr(made, name)) for name in made.__dataclass_fields__ if name != "leader"}

    at_once, added, other = (motion(s) for s in (of_all, of_some + of_others, of_some))
    for name, column in at_once.items():
        np.testing.assert_allclose(added[name], column, rtol=1e-6, atol=1e-8, err_msg=name)
    assert np.abs(at_once["course"] - other["course"]).max() > 1e-3


def test_every_visit_is_counted_once_and_every_transition_that_was_driven(counted):
    _, visits, labels, (of_all, *_) = counted
    known = labels.label >= 0
    np.testing.assert_array_equal(of_all.visits, np.bincount(labels.label[known]))
    assert of_all.visits.min() > 0
    assert of_all.seconds.sum() == pytest.approx(visits.seconds[known].sum())
    pairs = {}
    for v in range(len(visits) - 1):
        same = visits.segment[visits.begin[v]] == visits.segment[visits.begin[v + 1]]
        if same and known[v] and known[v + 1]:
            pair = labels.label[v], labels.label[v + 1]
            pairs[pair] = pairs.get(pair, 0) + 1
    counts = of_all.transition.toarray()
    assert {(i, j): counts[i, j] for i, j in np.argwhere(counts)} == pairs


def test_regressions_are_numpys_least_squares_of_the_same_rows():
    rng = np.random.default_rng(3)
    n, p, k = 600, 3, 4
    x = np.column_stack([np.ones(n), rng.normal(size=(n, p - 1))])
    label, weight = rng.integers(-1, k, n), rng.gamma(2.0, 1.0, n)
    y = (x * rng.normal(size=(k + 1, p))[label]).sum(axis=1) + rng.normal(0, 0.3, n)
    y[rng.random(n) < 0.1] = np.nan
    sums = Regression.of(x, y, weight, label, k)
    prior = np.array([0.3, 3.0, 1e-12])
    found, leaning = sums.solved(np.full(p, 1e-12)), sums.solved(prior)
    for z in range(k):
        rows = (label == z) & np.isfinite(y)
        root = np.sqrt(weight[rows])
        beta = np.linalg.lstsq(root[:, None] * x[rows], root * y[rows])[0]
        np.testing.assert_allclose(found[z], beta, rtol=1e-9)
        residual = y[rows] - x[rows] @ beta
        expected = weight[rows] @ residual**2 / weight[rows].sum()
        assert sums.mean_square(found)[z] == pytest.approx(expected, rel=1e-9)
        # A ridge is as many rows more that say 0.
        augmented = np.vstack([root[:, None] * x[rows], np.diag(np.sqrt(prior))])
        also = np.concatenate([root * y[rows], np.zeros(p)])
        np.testing.assert_allclose(leaning[z], np.linalg.lstsq(augmented, also)[0], rtol=1e-9)
        assert not np.allclose(leaning[z], beta, rtol=1e-3)
