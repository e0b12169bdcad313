"""Settings that checks offer, tried on the filter that flew."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.flight.recalibration import motor_power
from attlog.health import Check, Setting
from attlog.metrics.metric import Case
from attlog.pipeline.proven_settings import prove_settings
from tests.conftest import SAMPLES

PX4, COPTER = "px4_steps.ulg", "copter_steps_stabilize.bin"
OFFER = {"settings": [Setting("COMPASS_USE2", 0.0, 1.0)], "action": "Use the other one.", "other_compass": "MAG:1"}


@cache
def case(name: str) -> Case:
    return attlog.prepare(SAMPLES / name)


def tried(log: str | Case, *settings: Setting, question: str = "gnss_delay", **more: Any) -> Check:
    more = {"settings": list(settings), "action": "Set it."} | more
    (found,) = prove_settings(case(log) if isinstance(log, str) else log, [Check(question, "warning", "Off.", **more)])
    return found


def changed_inputs(name: str, change: Callable[[Any, attlog.FlightLog], Any]) -> Case:
    """A case whose onboard filter read other inputs than the log holds."""
    log = attlog.read(SAMPLES / name)
    read = log.estimator.inputs
    assert read is not None
    log.estimator.inputs = lambda unit=None: change(read() if unit is None else read(unit=unit), log)
    return attlog.prepare(log)


def test_a_delay_that_makes_the_filter_predict_worse_is_not_offered() -> None:
    found = tried(PX4, Setting("EKF2_GPS_DELAY", 110.0, 250.0, "ms"))
    assert (found.settings, found.action, found.verdict) == ([], "", "warning")
    assert found.why_no_setting.startswith("Not offered: run again with EKF2_GPS_DELAY 250, EKF2 predicts worse: GNSS")


def test_the_name_of_another_version_is_the_same_parameter() -> None:
    assert tried(PX4, Setting("SENS_GPS0_DELAY", 110.0, 250.0, "ms")).settings == []


@pytest.mark.parametrize(
    ("log", "setting"),
    [(PX4, Setting("EKF2_MAG_NOISE", 0.05, 0.06)), (COPTER, Setting("GPS1_DELAY_MS", 0.0, 225.0, "ms"))],
)
def test_a_setting_that_harms_nothing_carries_what_it_changes(log: str, setting: Setting) -> None:
    found = tried(log, setting)
    assert (found.settings, found.action) == ([setting], "Set it.")
    assert f" run again with {setting.name} " in found.evidence[-1]


@pytest.mark.parametrize(("size", "stays"), [(0.1, False), (0.0005, True)])
def test_an_offset_is_tried_as_the_firmware_would_apply_it(size: float, stays: bool) -> None:
    found = tried(PX4, Setting("CAL_MAG0_XOFF", 0.0, size, "gauss"), question="compass_offset")
    assert bool(found.settings) == stays
    assert f"run again with CAL_MAG0_XOFF {size:g}" in (found.evidence[-1] if stays else found.why_no_setting)


def with_motor_field(inputs: Any, log: attlog.FlightLog) -> Any:
    """Add 0.4 uT per ampere, downwards, to the compass."""
    ampere = motor_power(log, "current", inputs.mag["t"] - log.t0_us * 1e-6)
    return replace(inputs, mag={**inputs.mag, "x": inputs.mag["x"] + ampere * np.array([0.0, 0.0, 4e-3])})


@pytest.mark.parametrize(("planted", "mot", "stays"), [(True, -4.0, True), (True, 4.0, False), (False, 8.0, False)])
def test_the_motor_field_is_tried_with_the_logged_current(planted: bool, mot: float, stays: bool) -> None:
    flown = changed_inputs(COPTER, with_motor_field) if planted else case(COPTER)
    values = [Setting("COMPASS_MOTCT", 0.0, 2.0), Setting("COMPASS_MOT_Z", 0.0, mot)]
    assert bool(tried(flown, *values, question="compass_motors").settings) == stays


@pytest.mark.parametrize(("turn_deg", "stays"), [(0.0, True), (-30.0, False)])
def test_another_compass_is_tried_with_its_own_samples(turn_deg: float, stays: bool) -> None:
    flown = attlog.prepare(attlog.read(SAMPLES / COPTER))
    used = flown.log.mags[0]
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    other = replace(used.field, source="MAG:1", x=used.field.x @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T)
    flown.log.mags.append(replace(used, index=1, field=other))
    found = tried(flown, question="compass_choice", **OFFER)
    assert bool(found.settings) == bool(found.action) == stays
    assert "run again with the samples of MAG:1" in (found.evidence[-1] if stays else found.why_no_setting)


def with_narrow_gate(inputs: Any, log: attlog.FlightLog) -> Any:
    narrow = {"EK3_MAG_I_GATE": 100.0, "EK3_MAG_M_NSE": 0.01}
    log.parameters.lines["EK3_MAG_I_GATE"].value[-1] = 100.0
    log.parameters.lines["EK3_MAG_M_NSE"].value[-1] = 0.01
    return replace(inputs, params=inputs.params | narrow)


@pytest.mark.parametrize("at_fault", [False, True])
def test_a_rejected_compass_carries_the_gate_that_accepts_it_as_evidence_only(at_fault: bool) -> None:
    flown = changed_inputs(COPTER, with_narrow_gate)
    test = next(test for test in flown.log.estimator.innovation_tests if test.aid == "compass")
    test.ratio[:] = 2.0
    checks = [Check("innovations", "fault", "It rejects its compass.", t=30.0, sensor="EKF compass")]
    checks += [Check("field", "warning", "Too strong.")] if at_fault else []
    found = prove_settings(flown, checks)[0]
    gate, noise, *fault, without = found.evidence
    assert gate.startswith("EKF3 run again with EK3_MAG_I_GATE 190 (was 100) accepts them: ")
    assert noise.startswith("EKF3 run again with EK3_MAG_M_NSE 0.025 (was 0.01) accepts them: ")
    assert fault == (["The compass is at fault: a wider gate only hides it."] if at_fault else [])
    assert "without its compass (EK3_SRC1_YAW 8): GNSS velocity innovation 0.0" in without
    assert (found.settings, found.action) == ([], "")


@pytest.mark.parametrize(
    ("setting", "more"),
    [
        (Setting("INS_HNTCH_FREQ", 0.0, 80.0), {}),
        (Setting("EKF2_MAGBIAS_X", 0.0, 0.1), {}),  # of versions to 1.11
        (Setting("EKF2_GPS_DELAY", 110.0, 250.0), {"in_use": False}),
    ],
)
def test_settings_that_the_filter_does_not_read_stay(setting: Setting, more: dict[str, object]) -> None:
    found = tried(PX4, setting, **more)
    assert (found.settings, found.evidence) == ([setting], [])
