"""Which logs somebody should open first, and why in words."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from attlog.batch.index_row import index_row, reasons
from attlog.batch.job import Record
from attlog.batch.order import IndexRow, index_rows, short_names, summary
from attlog.health.check import Weight
from attlog.result import Check, Finding, Result
from attlog.story.flight_events import Event
from tests.batch.made import failed, flown, reason
from tests.words.made import result, row


def seen(made: Result, *gates: str) -> IndexRow:
    """A result as it stands in the index."""
    return index_rows([Record("drive/a.ulg", "a.ulg", row=index_row(made), gates=gates)])[0]


def said(found: Sequence[Finding] = (), *gates: str, **statuses: str) -> IndexRow:
    """A flight with these findings and rows of these states."""
    rows = [row(name, {}, status=status, reason="tilt error above 45 deg") for name, status in statuses.items()]
    made = result([row("onboard", {}), row("vqf", {}), *rows])
    made.findings = list(found)
    return seen(made, *gates)


def problem(code: str, severity: Weight = "warning", **more: object) -> Finding:
    return Finding(code, severity, f"What {code} says.", **more)  # type: ignore[arg-type]


def test_a_good_flight_has_none() -> None:
    good = said()
    assert (good.level, good.score, good.reasons) == ("none", 0.0, [])
    assert said([problem("gyro", "note"), problem("unanswered", "note")]).reasons == []


def test_a_wrong_attitude_comes_before_a_crash_before_a_sensor_before_the_recording() -> None:
    order = [
        problem("attitude", "serious"),
        problem("crash", "serious"),
        problem("gyro_bias", "serious"),
        problem("estimator"),
        problem("compass"),
        problem("gaps"),
    ]
    alone = [said([p]).score for p in order]
    assert alone == sorted(alone, reverse=True)
    assert len(set(alone)) == len(alone)
    together = said(order[::-1])
    assert [r.code for r in together.reasons] == [p.kind for p in order]
    assert together.score == sum(alone)
    assert together.reasons[0].text == "What attitude says."


@pytest.mark.parametrize(
    ("code", "severity", "level"),
    [
        ("mounting", "serious", "attitude"),
        ("crash", "serious", "crash"),
        ("gyro", "serious", "serious"),
        ("estimator", "warning", "look"),
        ("compass", "warning", "look"),
        ("reset", "warning", "look"),
        ("rate", "warning", "none"),
    ],
)
def test_the_level_is_that_of_the_gravest_reason(code: str, severity: Weight, level: str) -> None:
    assert said([problem(code, severity), problem("gaps")]).level == level


def test_a_jump_weighs_by_its_size() -> None:
    small, large = (said([problem("reset", value=size, unit="deg")]) for size in (4.0, -60.0))
    assert (small.level, large.level) == ("none", "look")
    assert large.score - small.score == 28.0
    assert said([problem("reset", value=400.0, unit="deg")]).score == large.score


def test_filters_that_diverged_are_named_but_for_those_that_must() -> None:
    found = said(mahony="diverged", ekf12="diverged", gyro="diverged", accel_mag="diverged", madgwick="not_converged")
    assert [(r.kind, r.text) for r in found.reasons] == [("filter", "Mahony and EKF12 diverged.")]
    assert found.level == "look"
    assert said(mahony="failed").reasons[0].text == "Mahony failed: tilt error above 45 deg."
    assert said(gyro="diverged").reasons == []


def test_the_attitude_that_flew_and_diverged_is_serious_another_of_the_log_is_not() -> None:
    made = result([row("onboard", {}, status="diverged", reason="heading error above 45 deg")])
    found = seen(made)
    assert found.level == "attitude"
    assert found.reasons[0].text == "The onboard attitude diverged: heading error above 45 deg."
    assert seen(result([row("onboard:AHR2", {}, status="diverged")])).reasons == []


def test_a_refused_truth_is_a_reason_a_smoother_that_cannot_run_is_none() -> None:
    made = result([row("onboard", {})])
    assert made.reference is not None
    made.reference.refused = {"truth": "it moves otherwise than the gyro", "smoother": "it needs 20 s"}
    assert [r.text for r in reasons(made)] == ["The truth is refused as reference: it moves otherwise than the gyro."]
    made.reference.refused = {"onboard": "it is wrong"}
    assert len(reasons(made)) == 1
    made.findings = [problem("attitude", "serious")]
    assert [r.code for r in reasons(made)] == ["attitude"]


def test_failed_gates_come_on_top() -> None:
    before, after = said([problem("compass")]), said([problem("compass")], "mekf: tilt 3.1 deg; at most 2")
    assert after.level == "serious"
    assert [r.kind for r in after.reasons] == ["gate", "sensor"]
    assert after.score == before.score + 100.0


def test_a_bad_check_weighs_more_than_one_to_look_at() -> None:
    made = result([row("onboard", {})])
    made.findings = [problem("compass", evidence=["The field varies."]), problem("gaps", evidence=["Gaps."])]
    checks = [Check("field", "fault", "The field varies."), Check("gaps", "fault", "Gaps.")]
    points = {}
    for verdict in ("warning", "fault"):
        made.checks = [Check(c.question, verdict, c.text) for c in checks]
        points[verdict] = {r.code: r.points for r in reasons(made)}
    assert points["warning"] == {"compass": 10.0, "gaps": 3.0}
    assert points["fault"] == {"compass": 20.0, "gaps": 3.0}


def rank(found: Sequence[Finding], airborne: Sequence[Sequence[float]] = ((10.0, 60.0),), **events: float) -> str:
    """Where a log with these findings, flights and serious events (kind: time, s) stands."""
    made = result([row("onboard", {}), row("vqf", {})])
    made.findings = list(found)
    made.log |= {"timeline": {"airborne": [list(s) for s in airborne]}, "seconds": {"airborne": 50.0 * len(airborne)}}
    made.events = [Event("power_up", 0.0, "info", "Power-up.")]
    made.events += [Event(kind, t, "serious", "It fell.") for kind, t in events.items()]
    return seen(made).level


def test_a_crash_is_what_sensors_show_not_what_the_autopilot_reports() -> None:
    reported = problem("crash", "serious", t=30.0)
    assert rank([reported], impact=30.0) == rank([], overturn=5.0) == "crash"
    assert rank([reported]) == "ground"
    assert rank([reported], hard_landing=60.0) == "ground"


IN_FLIGHT = {None: "attitude", 5.0: "attitude", 61.0: "attitude", 63.0: "ground"}


@pytest.mark.parametrize(("t", "expected"), IN_FLIGHT.items())
def test_a_wrong_attitude_counts_as_one_in_flight_until_the_last_landing(t: float | None, expected: str) -> None:
    assert rank([problem("attitude", "serious", t=t)]) == expected
    assert rank([problem("attitude", "serious", t=t)], airborne=()) == "ground"


# Which logs of a batch stand first, and how they are called.

CLASSES = [
    ("crash", [reason("crash")]),
    ("attitude", [reason("attitude")]),
    ("sensor", [reason("sensor")]),
    ("bench", [reason("attitude", in_flight=False)]),
    ("look", [reason("sensor", "warning")]),
    ("fine", []),
]
REAL, STOOD, SIMULATED = {}, {"airborne_s": 0.0}, {"simulated": True}


def test_classes_come_before_points_and_real_flights_before_others_of_their_class() -> None:
    kinds = (("a", REAL), ("b", STOOD), ("c", SIMULATED))
    logs = [flown(f"{name}-{k}.ulg", *why, **about) for name, why in CLASSES for k, about in kinds]
    expected = [entry.name for entry in logs]
    for mixed in (logs[::-1], logs[7:] + logs[:7]):
        assert [log.name for log in index_rows(mixed)] == expected


def test_a_log_that_failed_stands_between_those_with_trouble_and_those_without() -> None:
    logs = [flown("a.ulg"), failed("b.bin"), flown("c.ulg", reason("sensor", "warning"), simulated=True)]
    assert [log.name for log in index_rows(logs)] == ["c.ulg", "b.bin", "a.ulg"]


def test_a_log_of_which_nothing_could_be_re_run_is_not_without_trouble() -> None:
    logs = index_rows(
        [flown("a"), flown("b", reference=None), flown("c", reason("sensor"), reference=None), failed("d")]
    )
    assert [(log.name, log.level, log.opens_first) for log in logs] == [
        ("c", "serious", True),
        ("d", "failed", False),
        ("b", "unjudged", False),
        ("a", "none", False),
    ]


def test_names_lose_the_words_that_all_begin_with_and_no_part_of_a_number() -> None:
    assert short_names(["log_0_12.ulg", "log_0_134.ulg"]) == ["12.ulg", "134.ulg"]
    assert short_names(["2024-05-01 10-20.bin", "2024-05-17 09-00.bin"]) == ["01 10-20.bin", "17 09-00.bin"]
    assert short_names(["flight.bin", "fly.bin"]) == ["flight.bin", "fly.bin"]


def test_short_names_of_different_logs_differ() -> None:
    for alone in (["log_1.ulg"], ["log_.ulg", "log_a.b"], ["a.bin", "a.ulg"], []):
        assert short_names(alone) == alone  # a name is never left without a word
    names = [f"{a}{b}" for a, b in itertools.product(("x_1", "x_", "x 2"), ("", "_3", ".ulg"))]
    assert len(set(short_names(names))) == len(names)


# What became of many logs, in a screen.

OUT = Path("out")


def answering(name: str, *questions: str, reference: str = "truth") -> Record:
    """A log on which filters answer these questions alone."""
    entry = flown(name, reference=reference)
    for verdict in entry.row["verdicts"]:
        verdict["answered"] = verdict["question"] in questions
    return entry


def test_it_counts_what_was_answered_and_what_logs_were_compared_with() -> None:
    done = [
        answering("a", "accuracy"),
        answering("b", "accuracy", "noise", reference="smoother"),
        answering("c", reference="onboard"),
        answering("d", "accuracy", reference="smoother"),
        answering("e", reference="none"),
    ]
    assert list(summary(done, 6, 62.0, OUT, again=3)) == [
        "6 logs: 5 reports in out, 62 s; 3 done before; 1 not reached",
        "  compared with: truth 1, smoother 2, onboard 1, nothing 1",
        "  answered: accuracy 3, noise 1, lag 0, yaw drift 0",
        "  found: without trouble 5",
    ]


def test_it_counts_by_reason_and_names_five_logs_to_open_first_with_what_happened() -> None:
    logs = [flown(f"{k}.ulg", reason("sensor", "warning"), headline=f"Rover {k}.") for k in range(4)]
    logs.append(flown("fell.ulg", reason("crash"), headline="Quadrotor: hit the ground."))
    logs.append(flown("bench.ulg", reason("sensor", in_flight=False), airborne_s=0.0, headline="Never flew."))
    logs += [flown("gyro.ulg", reason("sensor"), headline="Plane."), flown("fine.ulg", headline="Nothing.")]
    lines = list(summary(logs, 8, 1.0, OUT, width=400))[3:]
    assert lines[0].removeprefix("  found: ").split(", ") == [
        "crash or loss of control 1",
        "other serious finding in flight 1",
        "serious but not in flight 1",
        "to look at 4",
        "without trouble 1",
    ]
    assert lines[1:] == [
        "  open first:",
        "    fell.ulg: Quadrotor: hit the ground.",
        "    gyro.ulg: Plane. (Something about the sensor)",
        "    bench.ulg: Never flew. (Something about the sensor)",
        "    0.ulg: Rover 0. (Something about the sensor)",
        "    1.ulg: Rover 1. (Something about the sensor)",
    ]


def test_gates_that_failed_are_counted_and_open_first() -> None:
    entries = [flown("a", reason("sensor", "warning")), flown("b", gates=("lag_ms 9 ms, at most 5 ms",))]
    lines = list(summary(entries, 2, 1.0, OUT))
    assert "  gates failed on 1 of 2 logs" in lines
    assert lines[-2:] == ["    b: lag_ms 9 ms, at most 5 ms", "    a: Something about the sensor."]


def test_lines_fit_the_terminal_and_no_headline_is_cut() -> None:
    headline = " ".join(f"word{k}" for k in range(30))
    entries = [flown("x" * 60, reason("crash"), headline=headline), failed("y" * 200, "word " * 100)]
    lines = list(summary(entries, 2, 1.0, OUT, width=72))
    assert max(map(len, lines)) <= 72
    assert " ".join(" ".join(lines).split()).endswith(headline)


def test_failures_are_grouped_by_reason_and_those_of_an_earlier_run_come_last() -> None:
    old = [replace(failed(f"{k}.ulg", f"{k}00 bytes, no flight log"), known=True) for k in range(3)]
    new = [failed("x", "encrypted"), *(failed(f"y{k}", f"{k} s of data are too short") for k in range(2))]
    assert list(summary([*old, *new], 6, 1.0, OUT)) == [
        "6 logs: 0 reports in out, 1.0 s; 3 failed before",
        "  3 logs cannot be used (exit code 65):",
        "    0 s of data are too short (y0 and 1 more)",
        "    encrypted (x)",
        "  3 logs cannot be used, as before:",
        "    000 bytes, no flight log (0.ulg and 2 more)",
    ]


def test_it_counts_the_logs_whose_sensors_are_off_and_those_with_something_to_set() -> None:
    logs = [flown(f"{k}.ulg") for k in range(4)]
    for entry, faults, warnings, settings in zip(
        logs, (2, 0, 1), (0, 1, 3), ([], ["A 1 -> 2", "B 3"], []), strict=False
    ):
        entry.row["sensors"] = {"faults": faults, "warnings": warnings, "to_set": settings}
    assert "  sensors: faults in 2 logs, warnings in 2 logs, settings offered for 1 log" in summary(logs, 4, 1.0, OUT)
    assert not [line for line in summary(logs[3:], 1, 1.0, OUT) if "sensors" in line]
