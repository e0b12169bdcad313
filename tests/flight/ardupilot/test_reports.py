"""What ERR and EV records say: codes of the firmware's list, severities, when first and how often."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from attlog.flight.ardupilot import events
from attlog.flight.ardupilot.clock import Clock
from attlog.flight.builder import LogBuilder
from attlog.flight.model import Problem
from tests.flight.fake import messages

# subsystem, code, a word of its meaning, severity: of ArduPilot's list of error codes
LISTED = [
    (1, 1, "main loop waited", "note"),
    (2, 2, "Radio frames", "note"),
    (3, 1, "compass failed to start", "warning"),
    (3, 4, "compass was not healthy", "warning"),
    (5, 1, "Radio failsafe", "warning"),
    (6, 1, "Battery failsafe", "warning"),
    (7, 1, "GNSS failsafe", "warning"),
    (8, 1, "Ground station failsafe", "warning"),
    (11, 2, "GNSS glitch", "warning"),
    (12, 1, "Crash check", "error"),
    (12, 2, "Loss of control", "error"),
    (13, 2, "flip", "note"),
    (14, 2, "Autotune", "note"),
    (15, 2, "too low", "error"),
    (15, 3, "landed", "note"),
    (16, 2, "EKF check", "warning"),
    (17, 1, "EKF failsafe", "error"),
    (18, 1, "barometer failed to start", "warning"),
    (18, 2, "barometer jumped", "note"),
    (18, 4, "barometer was not healthy", "warning"),
    (19, 1, "stood still", "error"),
    (20, 1, "Another aircraft", "note"),
    (21, 2, "Terrain data", "note"),
    (22, 2, "destination could not be set", "note"),
    (22, 3, "restarted", "note"),
    (22, 4, "circle mode", "note"),
    (22, 5, "outside the fence", "note"),
    (22, 6, "range finder", "note"),
    (23, 1, "Terrain failsafe", "warning"),
    (25, 1, "Thrust loss", "error"),
    (26, 1, "Sensor failsafe", "warning"),
    (27, 1, "Leak", "error"),
    (28, 1, "No input", "warning"),
    (29, 1, "Vibration failsafe", "warning"),
    (30, 1, "internal error", "warning"),
    (31, 1, "Dead reckoning", "warning"),
    (9, 1, "(height)", "warning"),
    (9, 6, "(circle and polygon)", "warning"),
    (9, 8, "(lowest height)", "warning"),
    (9, 16, "(code 16)", "warning"),
    (10, 5, "flight mode 5 was refused", "note"),
    (24, 1, "primary core to 1", "warning"),
    (24, 0, "primary core to 0", "warning"),
    (12, 9, "Subsystem 12 reported error 9", "note"),
    (99, 1, "Subsystem 99 reported error 1", "note"),
]


def told(record: str, rows: Iterable[tuple[int, ...]], step_us: int = 1_000_000) -> list[Problem]:
    """Problems by the records, a second apart from 10 s on, in a log that begins at 10 s."""
    numbers = np.array(list(rows))
    names = ("Subsys", "ECode") if record == "ERR" else ("Id",)
    columns = {"TimeUS": 10_000_000 + step_us * np.arange(len(numbers)).astype(np.uint64)}
    made = messages("dataflash", {(record, 0): columns | {n: numbers[:, k] for k, n in enumerate(names)}})
    builder = LogBuilder(made)
    builder.t0_us = 10_000_000
    events.report(builder, Clock(made))
    return builder.problems


@pytest.mark.parametrize(("subsystem", "code", "words", "severity"), LISTED)
def test_a_code_means_what_the_firmwares_list_says(subsystem: int, code: int, words: str, severity: str) -> None:
    meaning = events.of_error(subsystem, code)
    assert meaning is not None
    assert (words in meaning.text, meaning.severity) == (True, severity)


@pytest.mark.parametrize("subsystem", [3, 9, 10, 16, 99])
def test_code_0_ends_a_fault(subsystem: int) -> None:
    assert events.of_error(subsystem, 0) is None


def test_each_kind_is_told_once_with_its_first_time_and_its_number() -> None:
    found = told("ERR", [(16, 2), (16, 0), (5, 1), (16, 2), (16, 2), (24, 0)])
    assert [(p.code, p.t, p.count) for p in found] == [
        ("ekf_check", 0.0, 3),
        ("err_5/1".replace("/", "_"), 2.0, 1),
        ("lane_switch", 5.0, 1),
    ]
    assert found[0].text.endswith("(ERR 16/2).")
    assert (bool(found[1].cause), bool(found[1].remedy)) == (True, True)


def test_events_of_the_pilot_and_the_parachute_are_told_and_others_are_not() -> None:
    found = told("EV", [(10,), (54,), (19,), (60,), (51,), (62,)])
    assert [(p.t, p.severity) for p in found] == [(1.0, "warning"), (2.0, "warning"), (3.0, "note"), (4.0, "error")]
    words = ("emergency stop", "GNSS was lost", "height anew", "parachute was released")
    assert all(w in p.text for w, p in zip(words, found, strict=True))


@pytest.mark.parametrize(("kinds", "shown"), [(100, 100), (101, 101)])
def test_more_than_a_hundred_kinds_are_damage(kinds: int, shown: int) -> None:
    found = told("ERR", [(40 + k, 1) for k in range(kinds)], 1000)
    assert len(found) == shown
    assert ("damaged_reports" in {p.code for p in found}) is (kinds > 100)
    if kinds > 100:
        assert found[-1].count == kinds


def test_records_without_their_columns_say_nothing() -> None:
    made = messages("dataflash", {("ERR", 0): {"TimeUS": np.array([10_000_000]), "Subsys": np.array([16])}})
    builder = LogBuilder(made)
    events.report(builder, Clock(made))
    assert builder.problems == []
