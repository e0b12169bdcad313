"""Does gravity or the field turn as the gyro says? Planted turns, from both sides of each limit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.metrics.evidence import common_bias

T = np.arange(0.0, 60.0, 0.1)
SPAN = (5.0, 45.0)


def seen(rate: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """A vector of the earth in the axes of a body that turns at a rate (3,) rad/s."""
    return np.asarray(Rotation.from_rotvec(T[:, None] * rate).inv().apply(vector))


RATE = np.radians([0.5, -0.2, 0.4])
VECTOR = np.array([1.0, 3.0, -9.0])


def test_a_vector_that_turns_as_the_gyro_says_follows_and_one_that_stands_or_turns_back_does_not() -> None:
    assert common_bias._follows(T, seen(RATE, VECTOR), RATE, SPAN)
    assert not common_bias._follows(T, seen(0.0 * RATE, VECTOR), RATE, SPAN)
    assert not common_bias._follows(T, seen(-RATE, VECTOR), RATE, SPAN)


def test_a_part_of_the_turn_is_enough_from_its_share_on() -> None:
    share = common_bias.TURNED_SHARE
    for factor, follows in ((share + 0.07, True), (share - 0.07, False)):
        assert common_bias._follows(T, seen(factor * RATE, VECTOR), RATE, SPAN) is follows


def test_a_turn_about_the_vector_itself_and_one_that_is_too_small_tell_nothing() -> None:
    along = 0.7 * VECTOR / np.linalg.norm(VECTOR) * np.radians(1.0)
    assert not common_bias._follows(T, seen(along, VECTOR), along, SPAN)
    across = np.cross(VECTOR, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    seconds = 0.8 * 40.0  # between the middles of the first and the last fifth
    for degrees, follows in ((1.1 * common_bias.TURN_DEG, True), (0.9 * common_bias.TURN_DEG, False)):
        rate = across * np.radians(degrees) / seconds
        assert common_bias._follows(T, seen(rate, VECTOR), rate, SPAN) is follows


def test_without_samples_at_both_ends_nothing_follows() -> None:
    v = seen(RATE, VECTOR)
    for hole in ((4.0, 13.5), (36.5, 46.0)):
        kept = (T < hole[0]) | (T > hole[1])
        assert not common_bias._follows(T[kept], v[kept], RATE, SPAN)


@pytest.mark.parametrize("which", [0, 1])
def test_either_vector_tells_a_turn_and_a_span_without_a_gyro_none(which: int) -> None:
    vectors = [(T, seen(0.0 * RATE, VECTOR)), (T, seen(0.0 * RATE, VECTOR))]
    gyro = T, np.tile(RATE, (len(T), 1))
    assert not common_bias.turned(gyro, vectors, SPAN)
    vectors[which] = (T, seen(RATE, VECTOR))
    assert common_bias.turned(gyro, vectors, SPAN)
    assert not common_bias.turned((T + 100.0, gyro[1]), vectors, SPAN)


@pytest.mark.parametrize(("seconds", "count"), [(10.0, 10), (2.0, 4), (0.15, 2)])
def test_blocks_are_of_a_second_but_four_at_least(seconds: float, count: int) -> None:
    t = T[T < seconds]
    x = np.random.default_rng(1).normal(size=(len(t), 3))
    found = common_bias._blocks(t, x)
    assert abs(len(found) - count) <= 1
    np.testing.assert_allclose(found, [part.mean(axis=0) for part in np.array_split(x, len(found))])
