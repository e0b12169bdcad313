import numpy as np
import pytest

from attlog import estimators
from attlog.flight.model import Imu, Stream
from attlog.metrics import compute
from attlog.metrics.evidence import level
from attlog.segments.model import Segment
from tests.metrics import flights


def case_with(estimator, uses_mag=False, hz=100.0):
    t = np.arange(0.0, 40.0, 1.0 / hz)
    rng = np.random.default_rng(1)
    gyro = Stream(t, 1e-3 * rng.standard_normal((len(t), 3)), "rad/s", "FRD", "imu")
    acc = Stream(t, np.array([0.0, 0.0, -9.81]) + 0.02 * rng.standard_normal((len(t), 3)), "m/s^2", "FRD", "imu")
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    row = flights.row(t, q, estimator, estimator=estimator)
    row.uses_mag = uses_mag
    case = flights.case([row], [Segment("continuous", 0, 40), Segment("rest.long", 0, 40)], (t, q))
    case.log.imus, case.log.imu = [Imu(0, gyro, acc)], 0
    return case, row


CAUSAL = [n for n in estimators.names() if n != "gyro" and estimators.get(n).causal]


@pytest.mark.parametrize(("name", "hz"), [*((n, 100.0) for n in CAUSAL), ("mekf", 25.0)])
def test_every_filter_but_the_gyro_is_corrected_by_gravity(name, hz):
    uses = estimators.get(name).uses
    case, row = case_with(name, "mag" in uses, hz)
    left = level.tilt_left(case, row)
    assert left < (0.6 if name == "mekf" else 0.4)  # it may take a tilt for a bias of the accelerometer
    assert level.why_not(case, row) is None


def test_a_row_that_looks_ahead_is_not_put_to_a_test_of_its_last_sample():
    case, row = case_with("smoother")
    row.causal = False
    assert level.tilt_left(case, row) is None
    assert level.why_not(case, row) is None


@pytest.mark.parametrize("hz", [25.0, 100.0, 1000.0])
def test_integrated_gyro_keeps_the_whole_tilt(hz):
    case, row = case_with("gyro", hz=hz)
    assert level.tilt_left(case, row) == pytest.approx(1.0, abs=0.01)


def test_a_row_that_gravity_does_not_correct_is_ranked_nowhere():
    for name, ranked in (("gyro", False), ("mahony", True)):
        case, row = case_with(name)
        answers = compute(case, row, ["all", "rest"])
        values = {m: a for w in answers.values() for m, a in w.items() if a.value is not None}
        assert "inclination_rmse_deg" in values
        assert any(a.ranked for a in values.values()) == ranked
        assert (level.UNCORRECTED in {a.reason for a in values.values()}) != ranked


def test_a_row_that_cannot_be_run_again_is_not_called_uncorrected():
    case, row = case_with("no-such-filter")
    assert level.tilt_left(case, row) is None
    assert level.why_not(case, row) is None
