"""Calibrations of a parameter file in the inputs of a re-run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import attlog
from attlog.flight.px4.ekf2_inputs import EstimatorStates
from attlog.metrics.metric import Case
from attlog.pipeline.onboard_rerun import flown_inputs
from attlog.pipeline.recalibrated_inputs import recalibrate_inputs
from tests.conftest import SAMPLES

PX4, COPTER = SAMPLES / "px4_steps.ulg", SAMPLES / "copter_steps_stabilize.bin"


@pytest.fixture(scope="module", params=[PX4, COPTER], ids=["px4", "ardupilot"])
def case(request: pytest.FixtureRequest) -> Case:
    return attlog.prepare(request.param)


def changes(case: Case) -> dict[str, float]:
    """Return offsets larger by 0.01 rad/s, 0.2 m/s^2 and 50 mG about x."""
    names = {
        "PX4": (("CAL_GYRO0_XOFF", 0.01), ("CAL_ACC0_XOFF", 0.2), ("CAL_MAG0_XOFF", 0.05)),
        "ArduPilot": (("INS_GYROFFS_X", 0.01), ("INS_ACCOFFS_X", 0.2), ("COMPASS_OFS_X", -50.0)),
    }[case.log.firmware.name]
    return {name: (case.log.param(name) or 0.0) + step for name, step in names}


def test_offsets_are_subtracted_in_the_units_of_the_firmware(case: Case) -> None:
    inputs = flown_inputs(case, next(iter(case.imus.values())))
    found, remarks = recalibrate_inputs(case.log, inputs, changes(case))
    imu, before = getattr(found, "imu", found), getattr(inputs, "imu", inputs)
    calibrated = case.log.firmware.name == "PX4" or case.log.param("INS_GYR_CAL") == 0
    np.testing.assert_allclose(np.ptp(imu.gyro - before.gyro, axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose((imu.gyro - before.gyro)[0], [-0.01 * calibrated, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose((imu.acc - before.acc)[0], [-0.2, 0.0, 0.0], atol=2e-3)
    np.testing.assert_allclose((found.mag["x"] - inputs.mag["x"])[0], [-0.05, 0.0, 0.0], atol=1e-3)
    assert len(remarks) == 3
    assert ("not applied. The gyro is calibrated anew at each boot" in "".join(remarks)) is not calibrated


def test_logged_biases_move_with_their_samples(case: Case) -> None:
    inputs, per = flown_inputs(case, next(iter(case.imus.values()))), 1.0
    if case.log.firmware.name == "PX4":  # 1.12 logs biases per step of 10 ms
        states = EstimatorStates(np.zeros(3), np.ones((3, 24)), np.zeros((3, 24)), 24)
        inputs, per = replace(inputs, states=states, version=(1, 12)), 0.01
    moved, _ = recalibrate_inputs(case.log, inputs, changes(case))
    ours, logged = (x.states.states if case.log.firmware.name == "PX4" else x.states.x for x in (moved, inputs))
    calibrated = case.log.firmware.name == "PX4" or case.log.param("INS_GYR_CAL") == 0
    np.testing.assert_allclose((ours - logged)[:, 10:13], [[-0.01 * per * calibrated, 0, 0]] * len(ours), atol=1e-6)
    np.testing.assert_allclose((ours - logged)[:, 13:16], [[-0.2 * per, 0, 0]] * len(ours), atol=2e-3)
    field, learned = (ours - logged)[:, 19], np.any(logged[:, 19:22] != 0, axis=1)
    assert np.all(field[~learned] == 0.0)
    assert np.all((field >= -0.0505) & (field <= 0.0))


def test_what_differs_and_is_not_applied_is_named(case: Case) -> None:
    inputs = flown_inputs(case, next(iter(case.imus.values())))
    turned = "SENS_BOARD_ROT" if case.log.firmware.name == "PX4" else "AHRS_ORIENTATION"
    found, remarks = recalibrate_inputs(case.log, inputs, {**changes(case), turned: 4.0})
    assert np.array_equal(found.mag["x"], inputs.mag["x"])
    assert sum("not applied" in text and f"{turned} differs too" in text for text in remarks) >= 2
    assert any(text.startswith(f"{turned} 4 (was 0): no sample") for text in remarks)
    assert recalibrate_inputs(case.log, inputs, {"MC_ROLL_P": 9.0, "ATC_RAT_RLL_P": 9.0})[1] == []
