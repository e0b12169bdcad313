"""What several questions ask of one sensor is found once while a block lasts, and let go of with it."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core.log_cache import cached_by_content, cached_per_log, log_cache
from attlog.estimators.aids import Measurements


class Sensor:
    """Anything that is told apart by which object it is."""


@pytest.fixture
def counted():
    asked = []

    @cached_per_log
    def answer(sensor, more=0):
        asked.append(sensor)
        return len(asked) + more

    return asked, answer


def test_within_a_block_each_object_is_asked_once(counted):
    asked, answer = counted
    one, other = Sensor(), Sensor()
    with log_cache():
        assert [answer(one), answer(other), answer(one), answer(one)] == [1, 2, 1, 1]
    assert asked == [one, other]


def test_a_block_within_another_shares_what_that_has_found_and_a_later_one_asks_anew(counted):
    asked, answer = counted
    one = Sensor()
    with log_cache():
        first = answer(one)
        with log_cache():
            assert answer(one) == first
        assert answer(one) == first
    with log_cache():
        assert answer(one) == first + 1
    assert len(asked) == 2


def test_an_object_that_is_gone_does_not_answer_for_another_in_its_place(counted):
    _, answer = counted
    with log_cache():
        found = {answer(Sensor()) for _ in range(50)}
    assert len(found) == 50


def test_equal_content_is_computed_once_within_a_block():
    asked = []

    @cached_by_content
    def answer(fixes, level):
        asked.append(level)
        return len(asked)

    def fixes(x=1.0):
        return Measurements(np.array([0.0, 1.0]), np.array([x, 2.0]))

    with log_cache():
        found = [answer(fixes(), 1.0), answer(fixes(), 1.0), answer(fixes(1.5), 1.0), answer(fixes(), 2.0)]
    assert found == [1, 1, 2, 3]
    assert answer(fixes(), 1.0) == 4
