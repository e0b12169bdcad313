"""Which parameters switch a compass: by the firmware's own names, where the log holds them."""

from __future__ import annotations

from attlog.flight.ardupilot import remedies


def test_switches_are_those_that_the_log_holds() -> None:
    assert remedies.compass_switches({"COMPASS_USE": 1.0, "COMPASS_USE3": 0.0}) == {0: "COMPASS_USE", 2: "COMPASS_USE3"}


def test_firmware_before_priorities_has_a_first_compass() -> None:
    assert remedies.compass_first({"COMPASS_PRIMARY": 0.0}) == "COMPASS_PRIMARY"
    assert remedies.compass_first({"COMPASS_PRIO1_ID": 97539.0}) == ""


def test_the_orientation_that_is_named_is_that_of_the_compass_in_use() -> None:
    values = {"COMPASS_ORIENT": 4.0, "COMPASS_ORIENT2": 0.0}
    assert "COMPASS_ORIENT 4," in remedies.of(values)["compass_mounting"]
    assert "COMPASS_ORIENT2 0," in remedies.of(values, 1)["compass_mounting"]
    assert "COMPASS_ORIENT" not in remedies.of(values, 2)["compass_mounting"]
