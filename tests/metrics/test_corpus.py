"""Simulated flights with truth: what is known of them must come out."""

from pathlib import Path

import numpy as np
import pytest

from attlog import estimators, metrics, read, reference, segments
from attlog.metrics import drift_rest, lag, steps
from tests.reference.test_corpus import MAG_FAULTS, ROWS

pytestmark = pytest.mark.slow


def trial_of(path, names="gyro", clock="sample"):
    """A log with truth, replayed by the named estimators."""
    log = read(path)
    phases = segments.build(log)
    ref = reference.choose(log, phases, reference.Options(clock=clock))
    imu = log.imus[log.imu]
    rows = []
    for spec in estimators.select(names):
        found = estimators.estimate(spec, imu.gyro.t, imu.gyro.x, imu.acc.x, sampling=imu.gyro.sampling, dt=imu.dt)
        rows.append(reference.replayed(log, phases, ref, found, name=spec.name, estimator=spec.estimator.name))
    rows += reference.onboard_rows(log, phases, ref)
    return metrics.Case(log, phases, ref, rows, reference.heading_references(log, phases, ref))


def row_of(case, name):
    return next(r for r in case.rows if r.name == name)


@pytest.mark.parametrize(
    ("name", "roll", "pitch", "yaw"),
    [
        ("px4/px4_steps.ulg", 14, 13, 0),
        ("ardupilot/copter_steps_stabilize.bin", 14, 11, 0),
        ("px4/px4_yaw.ulg", 0, 0, 8),
        ("ardupilot/copter_yaw_turns.bin", 0, 0, 10),
    ],
)
def test_the_commanded_movements_are_found(corpus, name, roll, pitch, yaw):
    events = steps.of_reference(trial_of(corpus / "sitl" / name))
    found = [sum(e.axis == axis for e in events) for axis in range(3)]
    assert np.abs(np.array(found) - [roll, pitch, yaw]).max() <= 1


@pytest.mark.parametrize("row", [r for r in ROWS if Path(r["file"]).name not in MAG_FAULTS], ids=lambda r: r["file"])
def test_the_onboard_attitude_is_not_late_at_sample_time(corpus, row):
    """Within 2 ms; in telemetry, whose truth has no clock of its own, within 3 ms."""
    case = trial_of(corpus / "sitl" / row["file"])
    answer = lag.compute(case, row_of(case, "onboard"), "all")["lag_ms"]
    if answer.value is None:
        assert answer.code == "no_events"
        assert row["att_lag_ms"] == ""
    else:
        assert abs(answer.value) < (3.0 if row["file"].endswith(".tlog") else 2.0)


@pytest.mark.parametrize("name", ["px4/px4_steps.ulg", "ardupilot/copter_steps_stabilize.bin"])
def test_integrated_gyro_is_not_late_once_the_input_delay_is_known(corpus, name):
    case = trial_of(corpus / "sitl" / name)
    answer = lag.compute(case, row_of(case, "gyro"), "all")["lag_ms"]
    assert abs(answer.value) < 1.0
    assert answer.detail["input_delay_ms"] == pytest.approx(1000 * case.reference.input_delay_s)


@pytest.mark.parametrize("name", ["px4/px4_hover.ulg", "px4/px4_static.ulg", "ardupilot/copter_static_hop.bin"])
def test_integrated_gyro_drifts_at_rest_by_its_offset(corpus, name):
    known = next(r for r in ROWS if r["file"] == name)
    case = trial_of(corpus / "sitl" / name)
    row = row_of(case, "gyro")
    first = drift_rest.records(case, row, "rest")[0]
    bias_z = float(known["checks.gyro_bias_dps"].split()[2])
    assert first.value / 60.0 == pytest.approx(bias_z, abs=0.1)
