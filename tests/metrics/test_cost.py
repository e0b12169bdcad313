import numpy as np
import pytest

from attlog.metrics import cost
from tests.metrics import flights


def row(name, estimator=None, ns=50.0, **fields):
    t = np.arange(0.0, 1.0, 0.01)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    return flights.row(t, q, name, estimator=name if estimator is None else estimator, ns_per_update=ns, **fields)


def test_cost_is_the_median_of_repeats_between_the_fastest_and_the_slowest():
    rows = [row("gyro"), row("mahony@xu-0.6", "mahony"), row("ekf12")]
    case = flights.case(rows, [])
    found = {r.name: cost.compute_cost(case, r, "all") for r in rows}
    for answers in found.values():
        for answer in answers.values():
            assert answer.n == cost.REPEATS
            assert answer.ci95[0] <= answer.value <= answer.ci95[1]
            assert not answer.ranked
    assert found["mahony@xu-0.6"]["cost_ratio"].value == pytest.approx(1.0)
    assert found["gyro"]["cost_ratio"].value < 1.0 < found["ekf12"]["cost_ratio"].value


def test_the_cost_is_measured_once_per_process(monkeypatch):
    first = row("complementary")
    before = cost.compute_cost(flights.case([first], []), first, "all")["cost_ns"]
    monkeypatch.setattr(cost, "run", None)
    again = row("complementary", ns=80.0)
    assert cost.compute_cost(flights.case([again], []), again, "all")["cost_ns"].value == before.value


def test_a_filter_that_cannot_be_run_again_has_the_cost_of_its_one_replay():
    mine, mahony = row("mine", ns=123.0), row("mahony")
    answers = cost.compute_cost(flights.case([mine, mahony], []), mine, "all")
    assert answers["cost_ns"].value == 123.0
    assert answers["cost_ns"].ci95 is None
    assert answers["cost_ratio"].value > 0


def test_what_flew_on_board_has_no_cost_and_without_mahony_there_is_no_ratio():
    onboard = row("onboard", ns=None)
    onboard.kind = "onboard"
    assert cost.compute_cost(flights.case([onboard], []), onboard, "all")["cost_ns"].code == "not_applicable"
    alone = row("gyro")
    assert cost.compute_cost(flights.case([alone], []), alone, "all")["cost_ratio"].code == "not_applicable"
