import numpy as np

from attlog.metrics import cost
from tests.metrics import flights


def row(name, estimator=None, ns=50.0, **fields):
    t = np.arange(0.0, 1.0, 0.01)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    return flights.row(t, q, name, estimator=name if estimator is None else estimator, ns_per_update=ns, **fields)


def test_cost_is_the_median_of_repeats_between_the_fastest_and_the_slowest():
    rows = [row("gyro"), row("ekf12")]
    case = flights.case(rows, [])
    found = {r.name: cost.COST.ask(case, r, "all") for r in rows}
    for answers in found.values():
        for answer in answers.values():
            assert answer.n == cost.REPEATS
            assert answer.ci95[0] <= answer.value <= answer.ci95[1]
            assert not answer.ranked
    assert found["gyro"]["cost_ns"].value < found["ekf12"]["cost_ns"].value


def test_the_cost_is_measured_once_per_process(monkeypatch):
    first = row("complementary")
    before = cost.COST.ask(flights.case([first], []), first, "all")["cost_ns"]
    monkeypatch.setattr(cost, "run", None)
    again = row("complementary", ns=80.0)
    assert cost.COST.ask(flights.case([again], []), again, "all")["cost_ns"].value == before.value


def test_a_filter_that_cannot_be_run_again_has_the_cost_of_its_one_replay():
    mine = row("mine", ns=123.0)
    answer = cost.COST.ask(flights.case([mine], []), mine, "all")["cost_ns"]
    assert (answer.value, answer.ci95) == (123.0, None)
