"""Simulated flights with truth: what is known of them must come out."""

import copy
from pathlib import Path

import numpy as np
import pytest

from attlog import estimators, metrics, read, reference, segments
from attlog.core import rotation
from attlog.metrics import drift, lag, step_fit, step_turning
from tests.reference.test_choice import MAG_FAULTS, ROWS

pytestmark = pytest.mark.slow


def trial_of(path, names="gyro", clock="sample"):
    """A log with truth, replayed by the named estimators."""
    log = read(path)
    phases = segments.build(log)
    ref = reference.choose(log, phases, reference.ReferenceOptions(clock=clock))
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
    events = step_turning.reference_steps(trial_of(corpus / "sitl" / name))
    found = [sum(e.axis == axis for e in events) for axis in range(3)]
    assert np.abs(np.array(found) - [roll, pitch, yaw]).max() <= 1


@pytest.mark.parametrize("row", [r for r in ROWS if Path(r["file"]).name not in MAG_FAULTS], ids=lambda r: r["file"])
def test_the_onboard_attitude_is_not_late_at_sample_time(corpus, row):
    """Within 2 ms or with an interval that holds 0; in telemetry, whose truth has no clock of its own, within 3 ms."""
    case = trial_of(corpus / "sitl" / row["file"])
    answer = lag.LAG.ask(case, row_of(case, "onboard"), "all")["lag_ms"]
    if answer.value is None:
        assert answer.code == "no_events"
        assert row["att_lag_ms"] == ""
    else:
        limit = 3.0 if row["file"].endswith(".tlog") else 2.0
        assert abs(answer.value) < limit or answer.ci95[0] < 0.0 < answer.ci95[1] < 10.0


@pytest.mark.parametrize("name", ["px4/px4_steps.ulg", "ardupilot/copter_steps_stabilize.bin"])
def test_integrated_gyro_is_not_late_once_the_input_delay_is_known(corpus, name):
    case = trial_of(corpus / "sitl" / name)
    answer = lag.LAG.ask(case, row_of(case, "gyro"), "all")["lag_ms"]
    assert abs(answer.value) < 1.0
    assert answer.taken_out == pytest.approx(1000 * case.reference.alignment.input_delay_s)


def flown_again(case, names, gyro=None, late_s=0.0):
    """The case's flight, IMU late by a time or gyro made from truth, with the named filters run again."""
    log = copy.deepcopy(case.log)
    imu, mag = log.imus[log.imu], log.mags[log.mag].field
    for stream in (imu.gyro, imu.acc, mag):
        stream.t = stream.t + late_s
        stream.t_sample = None if stream.t_sample is None else stream.t_sample + late_s
    t = imu.gyro.t_best
    if gyro is not None:
        imu.gyro.x, imu.gyro.sampling, imu.dt = gyro, "interval", None
    rows = []
    for spec in estimators.select(names):
        uses_mag = "mag" in spec.estimator.uses
        field = estimators.place(t, mag.t_best, mag.x) if uses_mag else None
        found = estimators.estimate(spec, t, imu.gyro.x, imu.acc.x, field, sampling=imu.gyro.sampling, dt=imu.dt)
        rows.append(reference.replayed(log, case.segments, case.reference, found, name=spec.name, uses_mag=uses_mag))
    return metrics.Case(log, case.segments, case.reference, rows)


def gyro_of_truth(case):
    """Rates (n, 3) that turn truth from each IMU sample to the next."""
    t, ref = case.log.imus[case.log.imu].gyro.t_best, case.reference
    q = rotation.slerp(ref.t, ref.q, np.clip(t, ref.t[0], ref.t[-1]))
    turns = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]))
    return np.concatenate([np.zeros((1, 3)), turns / np.diff(t)[:, None]])


@pytest.mark.parametrize("name", ["px4/px4_wind.ulg", "ardupilot/copter_steps_stabilize.bin"])
def test_with_a_gyro_made_from_truth_no_filter_is_late(corpus, name):
    case = trial_of(corpus / "sitl" / name)
    again = flown_again(case, "gyro,mahony@xu-0.6,mahony@xu-2,complementary:kp=3", gyro_of_truth(case))
    for row in again.rows:
        found = step_fit.fits(again, row, "all")["all"]
        assert 1000 * found.delay == pytest.approx(0.0, abs=0.05)
        assert found.gain == pytest.approx(1.0, abs=0.002)


@pytest.mark.parametrize("name", ["px4/px4_wind.ulg", "ardupilot/plane_fbwa_cruise.bin"])
def test_an_imu_made_late_is_found_late_by_as_much(corpus, name):
    case = trial_of(corpus / "sitl" / name)
    lag_of = {}
    for late_ms in (0.0, 5.0, 30.0):
        again = flown_again(case, "gyro,mahony@xu-0.6,vqf", late_s=1e-3 * late_ms)
        lag_of[late_ms] = [1000 * step_fit.fits(again, row, "all")["all"].delay for row in again.rows]
    for late_ms in (5.0, 30.0):
        np.testing.assert_allclose(np.subtract(lag_of[late_ms], lag_of[0.0]), late_ms, atol=0.02)


TRUE_LAG = (
    "px4/px4_steps.ulg",
    "px4/px4_wind.ulg",
    "ardupilot/copter_aggressive.bin",
    "ardupilot/copter_yaw_turns.bin",
)


def test_the_intervals_hold_the_true_lag_of_nearly_every_filter(corpus):
    """True lag: that of the same filter with a gyro made from truth. Every filter row is told."""
    names = "mahony@xu-0.6,mahony@xu-2,complementary@fan,madgwick,ekf12,vqf"
    held, half = [], []
    for flight in TRUE_LAG:
        case = trial_of(corpus / "sitl" / flight)
        real, made = flown_again(case, names), flown_again(case, names, gyro_of_truth(case))
        for row, exact in zip(real.rows, made.rows, strict=True):
            told = lag.LAG.ask(real, row, "all")["lag_ms"]
            assert told.value is not None, (flight, row.name, told.reason)
            true = 1000 * step_fit.fits(made, exact, "all")["all"].delay
            held.append(told.ci95[0] <= true <= told.ci95[1])
            half.append(0.5 * (told.ci95[1] - told.ci95[0]))
    assert np.mean(held) >= 0.9
    assert np.median(half) < 3.0


@pytest.mark.parametrize("name", ["px4/px4_hover.ulg", "px4/px4_static.ulg", "ardupilot/copter_static_hop.bin"])
def test_integrated_gyro_drifts_at_rest_by_its_offset(corpus, name):
    known = next(r for r in ROWS if r["file"] == name)
    case = trial_of(corpus / "sitl" / name)
    row = row_of(case, "gyro")
    first = drift.rest_records(case, row, "rest")[0]
    bias_z = float(known["checks.gyro_bias_dps"].split()[2])
    assert first.value / 60.0 == pytest.approx(bias_z, abs=0.1)
