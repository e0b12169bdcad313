import time

import numpy as np

from attlog import estimators
from attlog.metrics import cost
from tests.metrics import flights


def row(name, ns=50.0, samples=10_000, **fields):
    t = 0.01 * np.arange(samples)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    return flights.row(t, q, name, estimator=name, ns_per_update=ns, **fields)


def asked(one):
    return cost.COST.ask(flights.case([one], []), one, "all")["cost_ns"]


def test_the_cost_is_that_of_the_replay_and_ranks_nothing():
    answer, flown = asked(row("mine", ns=123.0)), row("px4")
    flown.kind = "onboard"
    assert (answer.value, answer.ci95, answer.ranked) == (123.0, None, False)
    assert [asked(row("mine", ns=None)).code, asked(flown).code] == ["not_applicable"] * 2


def test_a_run_as_short_as_its_start_has_no_cost():
    answer = asked(row("mine", ns=798.0, samples=83))
    assert (answer.value, answer.code) == (None, "record_too_short")
    assert asked(row("mine", ns=26_000.0, samples=83)).value == 26_000.0


def test_the_time_of_a_replay_is_within_that_of_the_whole_call():
    t = 0.004 * np.arange(5000)
    acc = np.tile([0.0, 0.0, -9.81], (len(t), 1))
    for name in ("gyro", "complementary"):
        clock = time.thread_time()
        found = estimators.estimate(name, t, np.zeros((len(t), 3)), acc, check_units=False)
        assert 0.0 < found.ns_per_update * len(t) < 1e9 * (time.thread_time() - clock)
