"""Advice on PX4's logging: src/modules/logger/params.c and logged_topics.cpp; src/modules/sdlog2/params.c."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog import flight
from attlog.flight.px4.advice import OtherLogging, Px4Logging, Sdlog2Logging


@pytest.mark.parametrize(
    ("version", "profile", "said"),
    [
        ("1.15.0", 0, "Set bit 0 of SDLOG_PROFILE (default set), which logs sensor_combined at full rate."),
        ("1.9.0", 1, "Set bit 1 of SDLOG_PROFILE (estimator replay), which logs sensor_combined at full rate."),
        ("1.15.0", 1, "Bit 0 of SDLOG_PROFILE (default set) is set already"),
        ("1.15.0", 16, "Bit 4 of SDLOG_PROFILE (high rate) is set already"),
        ("1.8.0", 3, "Bit 1 of SDLOG_PROFILE (estimator replay) is set already"),
    ],
)
def test_a_topic_set_that_is_on_is_not_advised(version: str, profile: int, said: str) -> None:
    for rate in (None, 9.0):
        assert Px4Logging(version, {"SDLOG_PROFILE": profile}).advice("imu", rate).startswith(said)


def test_the_attitude_at_full_rate_is_bit_4() -> None:
    assert "Set bit 4 of SDLOG_PROFILE" in Px4Logging("1.15.0", {"SDLOG_PROFILE": 1}).advice("attitude", 4.0)
    assert "set already" in Px4Logging("1.15.0", {"SDLOG_PROFILE": 17}).advice("attitude", 4.0)


@pytest.mark.parametrize(("version", "values"), [("1.6.5", {"SDLOG_PROFILE": 0}), ("", {"SYS_LOGGER": 1})])
def test_versions_without_topic_sets_have_a_file(version: str, values: dict[str, float]) -> None:
    said = Px4Logging(version, values).advice("attitude", 4.0)
    assert "vehicle_attitude" in said
    assert "logger_topics.txt" in said
    assert "SDLOG_PROFILE" not in said


@pytest.mark.parametrize(("mode", "advised"), [(0, True), (1, False), (2, False), (-1, True), (3, True)])
def test_logging_from_boot_is_advised_only_where_it_is_off(mode: int, advised: bool) -> None:
    said = Px4Logging("1.15.0", {"SDLOG_MODE": mode}).advice("rest")
    assert said.startswith("Set SDLOG_MODE to 1 and let" if advised else f"SDLOG_MODE is {mode} already: let")


def test_versions_without_the_mode_are_not_told_to_set_it() -> None:
    assert "SDLOG_MODE" not in Px4Logging("", {"SYS_LOGGER": 0, "SDLOG_RATE": -1}).advice("rest")


def test_sdlog2_has_one_rate_and_no_topic_sets() -> None:
    assert Sdlog2Logging({"SDLOG_RATE": -1}).advice("imu", 45.0) == "Set SDLOG_RATE to 200 (sdlog2 start -r 200)."
    assert "already" in Sdlog2Logging({"SDLOG_RATE": 250}).advice("imu", 45.0)
    assert "SDLOG_RATE" not in Sdlog2Logging({}).advice("imu", 45.0)
    for what in ("imu", "attitude", "rest", "mag"):
        said = Sdlog2Logging({"SDLOG_RATE": -1}).advice(what)  # type: ignore[arg-type]
        assert "SDLOG_MODE" not in said
        assert "SDLOG_PROFILE" not in said


def test_a_log_that_begins_before_arming_is_told_to_stand_still_only(corpus: Path) -> None:
    log = flight.read(corpus / "logs" / "cases" / "px4_1.6.5_hand_rotation.ulg")
    assert log.advice("rest") == (
        "The log begins before arming already: let the vehicle stand still with motors off for 30 s."
    )


def test_a_unit_whose_records_are_mostly_refused_is_no_flight(corpus: Path) -> None:
    log = flight.read(corpus / "logs" / "cases" / "px4_1.17dev_hil_absurd.ulg")
    assert log.imu is None
    (problem,) = (p for p in log.problems if p.code == "imu_mostly_refused")
    assert problem.severity == "error"
    assert "74 %" in problem.text
    assert "SDLOG" not in problem.text


def test_a_program_that_is_no_autopilot_is_told_by_its_name_without_settings() -> None:
    logging = OtherLogging("ULogExampleWriter")
    assert logging.advice("imu").startswith("ULogExampleWriter wrote it")
    assert [logging.advice(what) for what in ("fast_imu", "attitude", "mag", "rest")] == [""] * 4
