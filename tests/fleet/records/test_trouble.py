"""Which logs somebody should open first, and why in words."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from attlog.fleet.records.trouble import RANKS, reasons, trouble, with_gates
from attlog.health.findings import Weight
from attlog.result import Check, Finding
from attlog.story.event import Event
from tests.present.made import result, row


def said(found: Sequence[Finding] = (), **statuses: str) -> dict:
    """The trouble of a flight with these findings and rows of these states."""
    rows = [row(name, {}, status=status, reason="tilt error above 45 deg") for name, status in statuses.items()]
    made = result([row("onboard", {}), row("vqf", {}), *rows])
    made.findings = list(found)
    return trouble(reasons(made))


def problem(code: str, severity: Weight = "warning", **more: object) -> Finding:
    return Finding(code, severity, f"What {code} says.", **more)  # type: ignore[arg-type]


def test_a_good_flight_has_none() -> None:
    assert said() == {"level": "none", "rank": 3, "score": 0.0, "reasons": []}
    assert said([problem("gyro", "note"), problem("unanswered", "note")])["reasons"] == []


def test_a_wrong_attitude_comes_before_a_crash_before_a_sensor_before_the_recording() -> None:
    order = [
        problem("attitude", "serious"),
        problem("crash", "serious"),
        problem("gyro_bias", "serious"),
        problem("estimator"),
        problem("compass"),
        problem("gaps"),
    ]
    alone = [said([p])["score"] for p in order]
    assert alone == sorted(alone, reverse=True)
    assert len(set(alone)) == len(alone)
    together = said(order[::-1])
    assert [r["code"] for r in together["reasons"]] == [p.kind for p in order]
    assert together["score"] == sum(alone)
    assert together["reasons"][0]["text"] == "What attitude says."


@pytest.mark.parametrize(
    ("code", "severity", "level"),
    [
        ("mounting", "serious", "serious"),
        ("crash", "serious", "serious"),
        ("gyro", "serious", "serious"),
        ("estimator", "warning", "look"),
        ("compass", "warning", "look"),
        ("reset", "warning", "look"),
        ("rate", "warning", "none"),
    ],
)
def test_the_level_is_that_of_the_gravest_reason(code: str, severity: Weight, level: str) -> None:
    assert said([problem(code, severity), problem("gaps")])["level"] == level


def test_a_jump_weighs_by_its_size() -> None:
    small, large = (said([problem("reset", value=size, unit="deg")]) for size in (4.0, -60.0))
    assert (small["level"], large["level"]) == ("none", "look")
    assert large["score"] - small["score"] == 28.0
    assert said([problem("reset", value=400.0, unit="deg")])["score"] == large["score"]


def test_filters_that_diverged_are_named_but_for_those_that_must() -> None:
    found = said(mahony="diverged", ekf12="diverged", gyro="diverged", accel_mag="diverged", madgwick="not_converged")
    assert [(r["kind"], r["text"]) for r in found["reasons"]] == [("filter", "Mahony and EKF12 diverged.")]
    assert found["level"] == "look"
    assert said(mahony="failed")["reasons"][0]["text"] == "Mahony failed: tilt error above 45 deg."
    assert said(gyro="diverged")["reasons"] == []


def test_the_attitude_that_flew_and_diverged_is_serious_another_of_the_log_is_not() -> None:
    made = result([row("onboard", {}, status="diverged", reason="heading error above 45 deg")])
    found = trouble(reasons(made))
    assert found["level"] == "serious"
    assert found["reasons"][0]["text"] == "The onboard attitude diverged: heading error above 45 deg."
    assert trouble(reasons(result([row("onboard:AHR2", {}, status="diverged")])))["reasons"] == []


def test_a_refused_truth_is_a_reason_a_smoother_that_cannot_run_is_none() -> None:
    made = result([row("onboard", {})])
    assert made.reference is not None
    made.reference.refused = {"truth": "it moves otherwise than the gyro", "smoother": "it needs 20 s"}
    assert [r.text for r in reasons(made)] == ["The truth is refused as reference: it moves otherwise than the gyro."]


def test_a_refused_onboard_attitude_is_told_once() -> None:
    made = result([row("onboard", {})])
    assert made.reference is not None
    made.reference.refused = {"onboard": "it is wrong"}
    assert len(reasons(made)) == 1
    made.findings = [problem("attitude", "serious")]
    assert [r.code for r in reasons(made)] == ["attitude"]


def test_failed_gates_come_on_top_and_none_changes_nothing() -> None:
    before = said([problem("compass")])
    assert with_gates(before, []) == before
    after = with_gates(before, ["mekf: tilt 3.1 deg; at most 2"])
    assert after["level"] == "serious"
    assert [r["kind"] for r in after["reasons"]] == ["gate", "sensor"]
    assert after["score"] == before["score"] + 100.0


def test_how_often_it_happened_is_told_once() -> None:
    texts = [
        said([problem("estimator", count=3)]),
        said([Finding("estimator", "warning", "It failed 3 times.", count=3)]),
    ]
    assert [t["reasons"][0]["text"] for t in texts] == ["What estimator says. (3 times)", "It failed 3 times."]


def test_a_bad_check_weighs_more_than_one_to_look_at() -> None:
    made = result([row("onboard", {})])
    made.findings = [problem("compass", evidence=["The field varies."]), problem("gaps", evidence=["Gaps."])]
    checks = [Check("field", "fault", "The field varies."), Check("gaps", "fault", "Gaps.")]
    points = {}
    for verdict in ("warning", "fault"):
        made.audit = [Check(c.name, verdict, c.text) for c in checks]
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
    return RANKS[trouble(reasons(made))["rank"]]


def test_a_crash_is_what_sensors_show_not_what_the_autopilot_reports() -> None:
    reported = problem("crash", "serious", t=30.0)
    assert rank([reported], impact=30.0) == rank([], overturn=5.0) == "crash"
    assert rank([reported]) == "other"
    assert rank([reported], hard_landing=60.0) == "other"


IN_FLIGHT = {None: "attitude", 5.0: "attitude", 61.0: "attitude", 63.0: "other"}


@pytest.mark.parametrize(("t", "expected"), IN_FLIGHT.items())
def test_a_wrong_attitude_counts_as_one_in_flight_until_the_last_landing(t: float | None, expected: str) -> None:
    assert rank([problem("attitude", "serious", t=t)]) == expected
    assert rank([problem("attitude", "serious", t=t)], airborne=()) == "other"


def test_only_serious_findings_of_a_flight_come_before_all_else() -> None:
    assert rank([problem("gyro", "serious")]) == "serious"
    assert rank([problem("gyro", "warning"), problem("estimator")]) == "other"
    assert rank([problem("gyro", "serious")], airborne=()) == "other"


def test_a_failed_gate_ranks_with_serious_findings_wherever_the_log_was_made() -> None:
    bench = trouble([])
    assert RANKS[with_gates(bench, ["mekf: lag_ms 9 ms"])["rank"]] == "serious"
