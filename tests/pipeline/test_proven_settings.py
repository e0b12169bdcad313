"""Settings that checks offer, tried on the filter that flew."""

from __future__ import annotations

from functools import cache

import pytest

import attlog
from attlog.health import Check, Setting
from attlog.metrics.metric import Case
from attlog.pipeline.proven_settings import prove_settings
from tests.conftest import SAMPLES

PX4, COPTER = "px4_steps.ulg", "copter_steps_stabilize.bin"


@cache
def case(name: str) -> Case:
    return attlog.prepare(SAMPLES / name)


def tried(log: str, *settings: Setting, question: str = "gnss_delay", **more: object) -> Check:
    check = Check(question, "warning", "It is wrong.", settings=list(settings), action="Set it.", **more)  # type: ignore[arg-type]
    (found,) = prove_settings(case(log), [check])
    return found


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


def test_an_offset_of_the_compass_is_removed_from_its_samples() -> None:
    offer = Setting("CAL_MAG0_XOFF", 0.0, 0.1, "gauss")
    wrong = tried(PX4, offer, question="compass_offset", vector=[10.0, 0.0, 0.0])
    assert "run again with this offset removed, EKF2 predicts worse" in wrong.why_no_setting
    small = tried(PX4, offer, question="compass_offset", vector=[0.05, 0.0, 0.0])
    assert small.settings == [offer]


@pytest.mark.parametrize(
    ("setting", "more"),
    [(Setting("INS_HNTCH_FREQ", 0.0, 80.0), {}), (Setting("EKF2_GPS_DELAY", 110.0, 250.0), {"in_use": False})],
)
def test_settings_that_the_filter_does_not_read_stay(setting: Setting, more: dict[str, object]) -> None:
    found = tried(PX4, setting, **more)
    assert (found.settings, found.evidence) == ([setting], [])
