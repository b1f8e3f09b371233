"""What motion holds: columns that fit each other, and the manoeuvres that primitives alone say."""

from dataclasses import replace

import numpy as np
import pytest

from dirprim_filter.distributions import Gamma, VonMisesMixture
from dirprim_filter.primitives.motion import FLOATS, Motion
from moving import motion_by_hand, squares


def two_cells():
    """Of two manoeuvres and one, with a transition."""
    return motion_by_hand([0, 0, 1], course=[0.1, 0.2, 0.3], transitions=[(0, 2, 3.0), (3, 3, 7.0), (3, 4, 1.0)])


def test_without_places_only_the_background_manoeuvres_are_left():
    motion = two_cells()
    free = motion.without_places()
    assert (len(motion), motion.n_placed, len(free), free.n_placed) == (5, 3, 2, 0)
    for name in FLOATS:
        np.testing.assert_array_equal(getattr(free, name), getattr(motion, name)[3:])
    assert free.first.tolist() == [0, 2, 2]
    assert free.following.tolist() == [0, 1]
    assert free.count.tolist() == [7.0, 1.0]
    assert (motion.start_rate > 0).tolist() == [False, False, False, False, True]


def column(motion, name, value, *, at=0):
    changed = getattr(motion, name).copy()
    changed[at] = value
    return {name: changed}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: {"course": m.course[:-1]}, "course: expected shape"),
        (lambda m: {"path": m.path[:, :2]}, "path: expected shape"),
        (lambda m: {"mode": m.mode[:-1]}, "mode, first, following, count: expected"),
        (lambda m: {"count": np.ones(2)}, "mode, first, following, count: expected"),
        (lambda m: {"cell": np.array([0, 0, 1, 2, 2])}, "cell: expected cells in ascending order"),
        (lambda m: column(m, "first", 4, at=-1), "first, following: expected transitions to manoeuvres 0 to 4"),
        (lambda m: {"following": np.array([-1, 3, 4])}, "first, following: expected transitions to manoeuvres 0 to 4"),
    ],
)
def test_columns_that_do_not_fit_are_refused_by_name(change, message):
    motion = two_cells()
    with pytest.raises(ValueError, match=message):
        replace(motion, **change(motion))


def test_a_map_refuses_the_motion_of_other_cells():
    with pytest.raises(ValueError, match="motion: expected manoeuvres of 1 cells and 1 modes, got others"):
        squares(1, 1, two_cells())


def test_primitives_alone_say_a_manoeuvre_of_each_mode_of_a_cell_and_none_of_the_background():
    weight = np.array([[0.7, 0.2, 0.1], [0.0, 0.9, 0.1], [0.0, 0.0, 1.0]])
    mean = np.array([[0.5, -1.0, 0.0]] * 3)
    direction = VonMisesMixture(weight=weight, mean_direction=mean, concentration=np.full((3, 3), 25.0))
    speed = Gamma(shape=np.full((3, 3), 4.0), rate=4.0 / np.array([[8.0, 0.1, 5.0]] * 3))
    bend, gain = np.full((3, 3, 2), 0.03), np.full((3, 3, 2), 0.02)
    motion = Motion.settling(direction, speed, bend, gain, n_own=2)
    assert motion.cell.tolist() == [0, 0, 1, -1, -1]
    assert motion.mode[:3].tolist() == [0, 1, 1]
    np.testing.assert_allclose(motion.course[:3], [0.5, -1.0, -1.0])
    np.testing.assert_allclose(motion.course_spread[:3], 0.2)
    np.testing.assert_allclose(motion.bend[:3], 0.03)
    assert (motion.start_rate > 0).tolist() == [False, True, True, False, True]  # 0.1 m/s is standing
    np.testing.assert_allclose(motion.visits[:3] / motion.visits[0] * 0.7, [0.7, 0.2, 0.9])
    # The speed settles on 8 m/s at the centre, and where it has gained a tenth.
    for place, expected in (([0.0, 0.0], 8.0), ([5.0, 0.0], 8.0 * 1.1)):
        constant, by_speed = motion.acceleration[0, :3] @ [1.0, *place], motion.acceleration[0, 3]
        assert -constant / by_speed == pytest.approx(expected)
