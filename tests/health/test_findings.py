"""One list of what is wrong: from every check, report and event, one entry for each cause, and silence without any."""

from __future__ import annotations

import re
from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.flight.advice import GENERAL_REMEDIES
from attlog.flight.model import FlightLog, Problem, Stream, TimeLine
from attlog.health import findings as rules
from attlog.health.check import Check, Setting, unknown
from attlog.health.findings import FLIPPED_ADVICE, MAX_LISTED, Context, Finding, crash_signs, findings, join_repeated
from attlog.health.gravity import MEAN_GRAVITY
from attlog.health.registry import CAUSES, CHECKS
from attlog.story.flight_events import Cause, Event
from tests.conftest import ROOT, SAMPLES
from tests.flight.fake import messages
from tests.health.made import OFFSET, REFUSED, SILENT, SOUND
from tests.health.test_health import good


@pytest.fixture
def log() -> FlightLog:
    found = deepcopy(good("px4_steps.ulg"))
    found.problems = []
    return found


def check(name: str, verdict: str = "fault", value: float | None = None, t: float | None = None) -> Check:
    return Check(name, verdict, f"{name} is off.", value, "m", t=t)


def test_nothing_is_found_where_every_check_is_ok_and_every_question_answered(log: FlightLog) -> None:
    assert findings(log, [check(name, "ok") for name in CHECKS]) == []


def test_every_check_has_a_row_in_the_docs() -> None:
    pages = "\n".join(page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs").glob("*.md")))
    rows = [row.split("|") for row in pages.splitlines() if row.startswith("|")]
    known = {name for cells in rows for name in re.findall(r"`([^`]+)`", cells[1])}
    assert sorted(set(CHECKS) - known) == []


@pytest.mark.parametrize("name", CHECKS)
def test_every_check_that_is_not_ok_is_a_finding(log: FlightLog, name: str) -> None:
    for verdict in ("warning", "fault"):
        found = findings(log, [check(name, verdict, 40.0, 7.0)])
        assert [f.text for f in found] == [f"{name} is off."]
        assert (found[0].t, found[0].value, found[0].unit) == (7.0, 40.0, "m")


def test_an_unknown_check_never_reads_as_ok(log: FlightLog) -> None:
    (one,) = findings(log, [unknown("crash", "IMU at 25 Hz.")])
    assert one.text == "Not checked: crash."
    assert one.evidence == ["crash: IMU at 25 Hz."]


def test_the_worst_stands_first(log: FlightLog) -> None:
    others = [Problem("cut_at_end", "note", "Cut."), Problem("x", "error", "Broken.")]
    found = findings(log, [check("field", "warning"), check("crash")], others)
    assert [f.severity for f in found] == ["serious", "serious", "warning", "note"]
    assert found[0].kind == "crash"


def test_one_compass_is_one_finding_and_its_size_leads(log: FlightLog) -> None:
    checks = [check("declination"), check("field_against_attitude"), check("field", value=70.0)]
    jump = Check("attitude_jumps", "fault", "Heading jumped.", 20.0, "deg", t=9.0, about="heading")
    rejected = Check("innovations", "warning", "Rejected.", t=3.0, kind="compass")
    (one,) = findings(log, [*checks, jump, rejected])
    assert (one.kind, one.text, one.value, one.t) == ("compass", "field is off.", 70.0, None)
    assert one.evidence == ["field_against_attitude is off.", "declination is off.", "Heading jumped.", "Rejected."]


def test_a_tilt_that_jumps_gets_no_advice_about_the_compass(log: FlightLog) -> None:
    jump = Check("attitude_jumps", "fault", "It jumped.", 20.0, "deg", t=9.0, about="tilt")
    found = {f.kind: f for f in findings(log, [check("field"), jump])}
    assert set(found) == {"compass", "reset"}
    assert found["reset"].action == ""


def test_who_believed_a_wrong_field_accuses_no_heading(log: FlightLog) -> None:
    accused = Check("onboard_against_smoother", "fault", "Heading 32 deg off.", 32.0, "deg", about="heading")
    (one,) = findings(log, [check("field"), accused])
    assert (one.kind, one.severity) == ("compass", "warning")
    (alone,) = findings(log, [accused])
    assert (alone.kind, alone.severity) == ("attitude", "serious")


def test_what_vibration_explains_is_its_evidence_from_its_onset_on(log: FlightLog) -> None:
    clipped = Event("clipping", 36.0, "warning", "Clipped.", 40.0, 400.0, "samples")
    early, late = (Check("innovations", "warning", f"Rejected at {t}.", t=t) for t in (12.0, 38.0))
    found = {f.kind: f for f in findings(log, [check("vibration_level", t=36.0), early, late], events=[clipped])}
    assert found["vibration"].text == "Clipped."
    assert set(found["vibration"].evidence) == {"vibration_level is off.", "Rejected at 38.0."}
    assert found["estimator"].text == "Rejected at 12.0."


def test_a_gyro_that_turns_at_rest_explains_a_wrong_attitude(log: FlightLog) -> None:
    refused = Problem("reference_contradicted", "error", "ATT is wrong.")
    (one,) = findings(log, [check("gyro_bias", value=-24.3), check("gravity_direction")], [refused])
    assert (one.kind, one.severity) == ("gyro_bias", "serious")
    found = findings(log, [check("gyro_bias", value=4.0)], [refused])
    assert [(f.kind, f.severity) for f in found] == [("attitude", "serious"), ("gyro_bias", "warning")]


def test_what_a_refused_attitude_judges_is_not_said_beside_it(log: FlightLog) -> None:
    refused = Problem("reference_contradicted", "error", "ATT is wrong.")
    found = findings(log, [check("gravity_in_flight"), check("field_against_attitude"), check("gyro_range")], [refused])
    assert {f.kind for f in found} == {"attitude", "gyro_range"}


def test_crashes_come_from_events_with_the_others_as_evidence(log: FlightLog) -> None:
    events = [
        Event("overturn", 5.6, "serious", "Turned over at 5.6 s.", evidence=["ATT"]),
        Event("impact", 6.0, "serious", "Hit the ground.", value=9.0, unit="g"),
        Event("realigned", 8.0, "warning", "Realigned."),
    ]
    (one,) = findings(log, [check("crash")], events=events)
    assert (one.text, one.t, one.action) == ("Turned over at 5.6 s. Hit the ground.", 5.6, rules.LOST_ADVICE)
    assert one.evidence == ["ATT"]  # the rest is in the sentence


def test_every_crash_is_told_and_how_it_lay_in_the_end(log: FlightLog) -> None:
    events = [
        Event("overturn", 28.5, "serious", "Turned over at 28.5 s, to 107°. It then lay at 6°.", t_end=29.2),
        Event("impact", 29.1, "serious", "Hit the ground at 29.1 s: 15 g. It then lay at 8°."),
        Event("liftoff", 40.0, "info", "Lifted off."),
        Event("impact", 61.2, "serious", "Hit the ground at 61.2 s: 7 g."),
        Event("overturn", 61.9, "serious", "Turned over at 61.9 s, to 170°."),
        Event("impact", 90.3, "serious", "Hit the ground at 90.3 s: 5 g."),
    ]
    (one,) = findings(log, [], events=events)
    first = "Turned over at 28.5 s, to 107°. Hit the ground at 29.1 s: 15 g. It then lay at 8°."
    assert one.text == f"{first} Crashed again at 61.2 s and 90.3 s."


def test_many_crashes_are_counted(log: FlightLog) -> None:
    events = [Event("impact", 20.0 * k, "serious", f"Hit at {20.0 * k:.1f} s.") for k in range(1, 6)]
    (one,) = findings(log, [], events=events)
    assert one.text == "Hit at 20.0 s. Crashed again at 40.0 s, 60.0 s and 2 times more."


def test_what_happened_in_a_flight_after_a_crash_counts_again(log: FlightLog) -> None:
    events = [
        Event("impact", 20.0, "serious", "Hit."),
        Event("hard_landing", 30.0, "warning", "A wreck fell.", value=9.0, unit="g"),
        Event("liftoff", 60.0, "info", "Lift-off."),
        Event("hard_landing", 90.0, "warning", "Hard landing.", value=5.0, unit="g"),
    ]
    assert [f.text for f in findings(log, [], events=events)] == ["Hit.", "Hard landing."]


def test_the_largest_of_a_kind_leads(log: FlightLog) -> None:
    blows = [Event("hard_landing", t, "warning", f"{g} g.", value=g, unit="g") for t, g in ((9.0, 3.4), (50.0, 7.5))]
    (one,) = findings(log, [], events=blows)
    assert (one.text, one.t, one.evidence) == ("7.5 g.", 50.0, ["3.4 g."])
    ratios = [Check("innovations", "fault", f"{v} of the gate.", v) for v in (0.2, 1.3)]
    assert findings(log, ratios)[0].text == "1.3 of the gate."


def test_a_kill_switch_is_a_finding_of_its_own_and_a_hard_landing_goes_before_a_weak_one(log: FlightLog) -> None:
    happened = [
        Event("liftoff", 4.0, "info", "Lifted off."),
        Event("failsafe", 51.5, "warning", "Failsafe at 51.5 s."),
        Event("failsafe", 74.9, "warning", "Kill switch at 74.9 s.", about="kill switch"),
        Event("hard_landing", 75.1, "warning", "Hard landing at 75.1 s: 10 g.", value=10.0, unit="g"),
    ]
    found = [f for f in findings(log, [check("vibration_level", "warning")], events=happened) if f.is_trouble]
    assert [f.kind for f in found] == ["hard_landing", "vibration", "failsafe", "failsafe"]
    assert "kill switch" in found[-1].action


@pytest.mark.parametrize("flew", [False, True])
def test_who_never_flew_is_not_asked_to_return_earlier(log: FlightLog, flew: bool) -> None:
    happened = [Event("liftoff", 4.0, "info", "Lifted off.")] * flew
    low = Event("battery", 22.4, "warning", "Low battery at 22.4 s.")
    (found,) = (f for f in findings(log, [], events=[*happened, low]) if f.kind == "battery")
    assert ("return earlier" in found.action) is flew


def test_a_failsafe_that_harms_nobody_warns_nobody(log: FlightLog) -> None:
    report = Problem("err_7_1", "warning", "GNSS failsafe (ERR 7/1).", t=9.0)
    for weight in ("note", "warning"):
        (one,) = findings(log, [], [report], events=[Event("failsafe", 9.0, weight, "GNSS failsafe.")])
        assert one.severity == weight


@pytest.mark.parametrize(("apart_m", "kind", "action"), [(1.2, "estimator", False), (40.0, "gnss", True)])
def test_gnss_is_blamed_only_where_it_jumped_itself(log: FlightLog, apart_m: float, kind: str, action: bool) -> None:
    report = Problem("gnss_glitch", "warning", "GNSS glitch (ERR 11/2).", t=9.0, remedy="Raise the antenna.")
    event = Event("gnss_jump", 9.0, "warning", "The EKF and GNSS diverged at 9.0 s.", value=apart_m, unit="m")
    (one,) = findings(
        log, [check("gnss_quality", "ok")] if not action else [check("gnss_quality")], [report], events=[event]
    )
    assert (one.kind, "antenna" in one.action) == (kind, action)


def test_no_calibration_mends_a_sensor_that_does_not_answer(log: FlightLog) -> None:
    (dead,) = findings(log, [check("accelerometer_dead")])
    (wrong,) = findings(log, [check("accelerometer_rest", value=9.2)])
    assert (dead.action, wrong.action) == (GENERAL_REMEDIES["bus"], GENERAL_REMEDIES["accelerometer"])


def test_a_crash_that_only_the_autopilot_reports_is_no_crash(log: FlightLog) -> None:
    report = Problem("crash", "error", "Crash check (ERR 12/1).", t=9.0)
    (doubted,) = findings(log, [], [report])
    assert (doubted.kind, doubted.severity) == ("crash_check", "warning")
    blow = Event("impact", 9.1, "serious", "Hit the ground.")
    (shown,) = findings(log, [], [report], events=[blow])
    assert (shown.kind, shown.text, shown.evidence) == ("crash", "Hit the ground.", ["Crash check (ERR 12/1)."])


def test_what_is_reported_of_a_wreck_warns_nobody_until_it_flies_again(log: FlightLog) -> None:
    events = [Event("impact", 20.0, "serious", "Hit."), Event("liftoff", 60.0, "info", "Lift-off.")]
    for t, severity in ((10.0, "warning"), (24.0, "note"), (70.0, "warning")):
        found = {f.kind: f for f in findings(log, [], [Problem("ekf_check", "warning", "Check.", t=t)], events=events)}
        assert found["estimator"].severity == severity


def test_a_logger_that_stops_for_long_is_not_cured_by_a_card(log: FlightLog) -> None:
    short = Check("gaps", "warning", "2 gaps.", 2, t=5.0)
    stopped = Check("gaps", "warning", "1 gap of 40 s.", 1, t=5.0, about="stopped")
    assert ["card" in f.action for f in findings(log, [short])] == [True]
    assert [f.action for f in findings(log, [stopped])] == [""]


def test_a_message_in_flight_speaks_for_what_it_names(log: FlightLog) -> None:
    said = [
        Event("message", 30.0, "warning", "“Compass needs calibration - Land now!”."),
        Event("message", 31.0, "warning", "“Thrust loss”."),
        Event("message", 32.0, "note", "“PreArm: GPS”."),
    ]
    found = {f.kind: f.text for f in findings(log, [], events=said)}
    assert found == {
        "compass": "The autopilot reported “Compass needs calibration - Land now!”.",
        "message": "The autopilot reported “Thrust loss”.",
    }


def test_the_same_report_twice_is_one_entry_with_both_counts(log: FlightLog) -> None:
    log.problems = [Problem("a", "note", "A.", t=5.0, count=2), Problem("a", "note", "A.", t=3.0)]
    (one,) = findings(log, [])
    assert (one.count, one.t) == (3, 5.0)


def test_what_costs_the_reader_and_changes_nothing_is_a_note(log: FlightLog) -> None:
    slow = Problem("imu_low_rate", "warning", "25 Hz.")
    parameter = Problem("values_out_of_range", "warning", "RC6_MAX.")
    jump = Check("attitude_jumps", "warning", "3 deg.", 3.4, "deg", about="heading")
    found = findings(log, [jump], [slow, parameter])
    assert {f.severity for f in found} == {"note"}
    many = Problem("values_out_of_range", "warning", "Left out 2,000.", count=2000)
    assert [f.severity for f in findings(log, [], [many])] == ["warning"]


def test_every_fault_has_a_general_remedy() -> None:
    assert {row.remedy for row in CHECKS.values() if row.remedy} <= set(GENERAL_REMEDIES)


def test_equal_findings_stand_in_the_order_of_time(log: FlightLog) -> None:
    found = findings(log, [], [Problem(code, "error", code, t=t) for code, t in (("tea", 20.0), ("coffee", 10.0))])
    assert [f.t for f in found] == [10.0, 20.0]


@pytest.mark.parametrize(("percent", "leads"), [(40.0, "Motors."), (20.0, "field is off.")])
def test_motors_that_bend_the_field_by_a_third_lead_what_is_said_of_a_compass(
    log: FlightLog, percent: float, leads: str
) -> None:
    motors = Check("compass_motors", "fault", "Motors.", percent, "%", about="field_size")
    (one,) = findings(log, [check("field", value=70.0), motors])
    assert (one.kind, one.text) == ("compass", leads)


def test_a_wrong_attitude_explains_no_vibration(log: FlightLog) -> None:
    """The vertical force is off by the barometer too, which no attitude turns."""
    refused = Problem("reference_contradicted", "error", "ATT is wrong.")
    found = findings(log, [check("vertical_force"), check("gravity_in_flight")], [refused])
    assert {f.kind: f.evidence for f in found} == {"attitude": ["gravity_in_flight is off."], "vibration": []}


def test_a_compass_that_is_its_offsets_is_reported_with_what_to_check(log: FlightLog) -> None:
    log.problems = [Problem("mag_only_offsets", "warning", "MAG: every value is an offset.", source="MAG")]
    (one,) = findings(log, [])
    assert (one.cause, one.action) == (CAUSES["compass_dead"], GENERAL_REMEDIES["compass_wiring"])


def test_of_a_sensor_whose_records_were_refused_no_check_is_told(log: FlightLog) -> None:
    """Of 74 % impossible values a mean force of 68 m/s^2 and a tilt of 54 deg were told as faults of a calibration."""
    wrong = [check("gravity_in_flight"), check("gravity_direction"), check("jitter"), check("field")]
    assert len(findings(log, wrong)) > 2
    log.problems = [Problem("imu_mostly_refused", "error", "Mostly refused.")]
    assert {f.text for f in findings(log, wrong)} == {"Mostly refused.", "field is off."}


def test_what_was_reported_before_arming_and_before_the_first_sample_is_a_note(log: FlightLog) -> None:
    """A simulator's processor stood still as it started, which headed its page."""
    stood = Problem("err_19_1", "error", "The main loop stood still.", t=-2.1)
    log.problems, log.state.armed = [stood], TimeLine(np.array([0.0]), [True], "ARM")
    assert [f.severity for f in findings(log, [])] == ["note"]
    log.state.armed = TimeLine(np.array([-60.0, 0.0]), [True, False], "ARM")
    assert [f.severity for f in findings(log, [])] == ["serious"]
    log.problems, log.state.armed = [replace(stood, t=0.4)], None
    assert [f.severity for f in findings(log, [])] == ["serious"]


# What signs about the onboard attitude stand for, once their common cause is known.

LOG: Any = SimpleNamespace(remedy={"accelerometer": "Calibrate the level."}.get, simulated=False)


def of(*signs: Finding, log: Any = LOG) -> list[Finding]:
    signs_ = list(signs)
    for rule in rules.RULES:
        signs_ = rule(signs_, Context(log))
    return signs_


def sign(kind: str, severity: Any = "warning", about: str = "", **more: Any) -> Finding:
    return Finding(kind, severity, "said", about=about, cause="its own", action="do", **more)


@pytest.mark.parametrize(("deg", "severity"), [(9.9, "note"), (10.1, "warning"), (None, "warning")])
def test_a_small_jump_is_a_note(deg: float | None, severity: str) -> None:
    (found,) = of(sign("reset", value=deg))
    assert found.severity == severity
    assert of(sign("attitude", value=deg))[0].severity == "warning"


@pytest.mark.parametrize(
    ("about", "severity", "kind"),
    [
        ("gravity_direction", "warning", "accelerometer"),
        ("gravity_direction", "serious", "mounting"),
        ("gyro_against_attitude", "warning", "mounting"),
        (MEAN_GRAVITY, "warning", "mounting"),
    ],
)
def test_a_small_angle_to_gravity_is_the_accelerometers_and_a_large_one_the_mountings(
    about: str, severity: str, kind: str
) -> None:
    (found,) = of(sign("mounting", severity, about))
    assert found.kind == kind
    if kind == "accelerometer":
        assert (found.cause, found.action) == (rules.LEVEL_CAUSE, "Calibrate the level.")


@pytest.mark.parametrize("gyro", ["gyro", "gyro_bias", "frozen_gyro"])
def test_a_broken_gyro_explains_a_wrong_attitude_and_mounting(gyro: str) -> None:
    wrong, turned, other = sign("attitude"), sign("mounting"), sign("battery")
    assert [f.kind for f in of(wrong, turned, other, sign(gyro, "serious"))] == [gyro, gyro, "battery", gyro]
    assert [f.kind for f in of(wrong, turned, sign(gyro))] == ["attitude", "mounting", gyro]


def test_axes_of_the_force_that_are_wrong_leave_out_what_the_force_says_of_the_attitude() -> None:
    frame = sign("accelerometer_axes", about="accelerometer_axes")
    kept = of(frame, sign("mounting", "serious", "gravity_in_flight"), sign("trim", "note", "trim"), sign("gps"))
    assert [f.kind for f in kept] == [frame.kind, "gps"]


def test_a_simulator_whose_frames_differ_has_no_mounting() -> None:
    simulated: Any = SimpleNamespace(remedy=str, simulated=True)
    (found,) = of(sign("mounting", "serious"), log=simulated)
    assert (found.kind, found.cause, found.action) == ("simulator", rules.FRAMES_CAUSE, "")
    assert of(sign("mounting", "note"), log=simulated)[0].kind == "mounting"


# What is to be done after a crash, where the log shows it.

OVER = Event("overturn", 5.6, "serious", "Turned over at 5.6 s, to 178°. It then lay at 175°.")
ARMED = Event("armed", 1.0, "info", "Armed.")
LIFT = Event("liftoff", 3.0, "info", "Lift-off.")


def test_a_copter_that_flips_before_any_lift_off_has_motors_or_mount_to_check(log: FlightLog) -> None:
    assert crash_signs([ARMED, OVER], log)[0].action == FLIPPED_ADVICE


def test_a_crash_has_an_action_by_vehicle_and_log_unless_its_cause_has_one(log: FlightLog) -> None:
    assert crash_signs([ARMED, LIFT, OVER], log)[0].action == rules.LOST_ADVICE
    log.power.outputs, log.messages = None, messages("dataflash", {})
    assert crash_signs([ARMED, LIFT, OVER], log)[0].action == rules.UNLOGGED_ADVICE
    failed = Event("motor_failed", 5.0, "serious", "Motor 2 gave no thrust from 5.0 s.")
    caused = replace(OVER, cause=Cause("motor_failed", 5.0, failed.text, ""))
    assert crash_signs([ARMED, LIFT, failed, caused], log)[0].action == ""
    log.vehicle = "fixed wing"
    assert crash_signs([ARMED, OVER], log)[0].action == rules.STEERED_ADVICE


def test_a_log_that_begins_long_after_arming_may_begin_in_the_air_and_a_blow_is_no_flip(log: FlightLog) -> None:
    before = Event("armed", -156.2, "info", "Armed before the log begins.")
    assert crash_signs([before, OVER], log)[0].action == rules.LOST_ADVICE
    hit = Event("impact", 9.0, "serious", "Hit the ground at 9.0 s: 12 g.")
    assert crash_signs([ARMED, hit], log)[0].action == rules.LOST_ADVICE


def test_a_hard_landing_is_answered_by_the_speed_of_its_landing_mode_or_by_the_pilot(log: FlightLog) -> None:
    log.state.mode = TimeLine(np.array([0.0, 10.0, 20.0]), ["LOITER", "LAND", "LOITER"], "MODE")
    log.parameters.lines["LAND_SPEED"] = TimeLine(np.array([0.0]), [50.0], "PARM")
    assert "LAND_SPEED (50 cm/s)" in rules.landing_advice(log, 20.2, [])
    assert "sink slower" in rules.landing_advice(log, 9.0, [])
    killed = Event("failsafe", 8.8, "warning", "Kill switch at 8.8 s.", about="kill switch")
    assert "not 0.2 s before" in rules.landing_advice(log, 9.0, [killed])
    assert "not just before" in rules.landing_advice(log, 8.84, [killed])
    log.state.mode = TimeLine(np.array([0.0]), ["AUTO"], "MODE")
    assert "LAND_SPEED (50 cm/s)" in rules.landing_advice(log, 9.0, [])


@pytest.mark.parametrize(
    ("sink_m_s", "said"),
    [(0.5, "sank as LAND_SPEED (50 cm/s) sets"), (2.0, "check LAND_SPEED"), (0.0, "check LAND_SPEED")],
)
def test_a_landing_speed_is_to_be_lowered_where_the_vehicle_sank_as_set(
    log: FlightLog, sink_m_s: float, said: str
) -> None:
    log.state.mode = TimeLine(np.array([0.0]), ["LAND"], "MODE")
    log.parameters.lines["LAND_SPEED"] = TimeLine(np.array([0.0]), [50.0], "PARM")
    t = np.arange(0.0, 20.0, 0.1)
    log.baro = [Stream(t, (sink_m_s * (20.0 - t))[:, None], "m", "", "BARO")]
    assert said in rules.landing_advice(log, 20.0, [])


def test_evidence_of_a_named_effect_is_only_what_the_autopilot_said() -> None:
    lead = Finding(
        "vibration", "warning", "It clipped. Effect: IMU 1 replaced IMU 0 at 37.2 s.", about=rules.FIRST_CAUSE
    )
    effect = Finding(
        "vibration", "warning", "IMU 1 replaced IMU 0 at 37.2 s.", evidence=["selector", "text at 3.0 s: x"]
    )
    (merged,) = rules.merge_causes([lead, effect])
    assert merged.evidence == ["text at 3.0 s: x"]


def test_every_serious_finding_of_a_lost_flight_has_an_action(log: FlightLog) -> None:
    """Of an attitude, an estimator, a damage and a dead compass no sign has an action of its own."""
    reports = [Problem(code, "error", f"{code}.") for code in ("damage", "ekf_check", "imu_all_zero", "mag_dead")]
    log.simulated = False
    found = findings(log, [check("gravity_direction"), check("second_source", "warning")], reports)
    assert [f.kind for f in found if not f.action] == []


def test_how_it_lay_is_told_of_the_last_move_alone(log: FlightLog) -> None:
    """It fell over and lay at 44 deg, then turned over to 175; it did not lie at 44 then."""
    fell = Event("overturn", 26.9, "serious", "Fell over at 26.9 s, to 44°. It then lay at 44°.", t_end=40.1)
    over = Event("overturn", 39.8, "serious", "Turned over at 39.8 s, to 175°.")
    assert (
        crash_signs([ARMED, LIFT, fell, over], log)[0].text
        == "Fell over at 26.9 s, to 44°. Turned over at 39.8 s, to 175°."
    )
    hit = Event("impact", 41.0, "serious", "Hit the ground at 41.0 s: 9.0 g. It then lay at 170°.")
    assert crash_signs([ARMED, LIFT, fell, over, hit], log)[0].text.endswith("9.0 g. It then lay at 170°.")


# What comes in dozens is one sign with its number; what comes a few times stands for itself.


def damaged(number: int, **more: object) -> list[Finding]:
    return [Finding("part_failed", "serious", f"Message M{k} is out.", count=k + 1, **more) for k in range(number)]  # type: ignore[arg-type]


def test_a_few_of_a_kind_stand_for_themselves() -> None:
    few = [*damaged(MAX_LISTED), Finding("no_mag", "warning", "No field.")]
    assert join_repeated(few, Context(LOG)) == few


def test_hundreds_of_a_kind_are_one_with_their_number_and_the_first_of_them() -> None:
    signs = [Finding("no_mag", "warning", "No field."), *damaged(400, action="Report it.", value=3.0, unit="V")]
    found = join_repeated(signs, Context(LOG))
    assert [f.kind for f in found] == ["no_mag", "part_failed"]
    one = found[1]
    assert one.count == 400 * 401 // 2
    assert one.text == "Message M0 is out, and 399 more of the kind."
    assert one.evidence[0] == "Message M1 is out."
    assert (one.action, one.value, one.unit) == ("Report it.", None, "")


def test_severities_are_kept_apart_and_the_first_time_is_told() -> None:
    notes = [Finding("ev", "note", f"Event {k}.", t=10.0 - k, cause=str(k)) for k in range(9)]
    found = join_repeated([*notes, Finding("ev", "serious", "Event x.")], Context(LOG))
    assert [(f.severity, f.t, f.cause) for f in found] == [("note", 2.0, ""), ("serious", None, "")]


# Actions of findings: what checks offer to set wins over the usual remedy; sensors not in use offer nothing.


LOG = attlog.read(SAMPLES / "px4_hover.ulg")
FIELD = Check("field", "warning", "The field varies by 40 %.", value=40.0)
SET = "Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.25."


def of_kind(kind: str, *checks: Check) -> list[Finding]:
    return [finding for finding in findings(LOG, checks) if finding.kind == kind]


def test_a_finding_takes_what_to_set_and_keeps_its_sentence() -> None:
    (before,), (after,) = of_kind("compass", FIELD), of_kind("compass", FIELD, OFFSET)
    assert before.action not in ("", SET)
    assert (after.text, after.severity, after.action) == (before.text, before.severity, SET)
    assert OFFSET.text in after.evidence


def test_a_note_of_the_same_kind_gives_way() -> None:
    (found,) = of_kind("compass", Check("declination", "warning", "It differs by 2 deg."), OFFSET)
    assert (found.severity, found.text, found.value, found.action) == ("warning", OFFSET.text, OFFSET.value, SET)
    assert "It differs by 2 deg." in found.evidence


def test_what_is_ok_or_unknown_offers_no_action() -> None:
    quiet = [replace(check, settings=[Setting("A", 1.0, 2.0)]) for check in (SOUND, SILENT)]
    assert of_kind("compass", FIELD, *quiet) == of_kind("compass", FIELD)


def test_a_disputed_value_is_no_action() -> None:
    other = replace(REFUSED, settings=[Setting("COMPASS_OFS_X", -12.0, 99.0)])
    (found,) = of_kind("compass", FIELD, OFFSET, other)
    assert found.action == LOG.remedy("interference")


def test_a_check_that_names_its_parameters_is_quoted() -> None:
    words = "A suggestion: COMPASS_OFS_X 145 and COMPASS_OFS_Y -20.25."
    assert of_kind("compass", FIELD, replace(OFFSET, action=words))[0].action == words
    assert of_kind("compass", FIELD, replace(OFFSET, action="Reboot."))[0].action == SET


def test_what_a_check_of_the_compass_advises_wins_with_its_cause() -> None:
    """A calibration mends no field of motors."""
    (before,), (found,) = of_kind("compass", FIELD), of_kind("compass", FIELD, replace(REFUSED, action="Move it."))
    assert "not calibrated" in before.cause
    assert "Currents of motors" in found.cause
    assert found.action == "Move it."


def test_of_other_sensors_the_usual_remedy_stays() -> None:
    shaken = Check("vibration_level", "warning", "It vibrates.", 4.0)
    (before,), (after,) = of_kind("vibration", shaken), of_kind("vibration", shaken, replace(shaken, action="X."))
    assert after.action == before.action == LOG.remedy("vibration")


def test_motors_that_turn_no_heading_are_no_cause() -> None:
    heading = Check("heading_by_gnss", "warning", "The heading is 15 deg off.", 15.0, "deg", t=3.0)
    heading.action = LOG.remedy("compass")
    (found,) = of_kind("compass", heading, REFUSED)
    assert "motors" not in found.cause + found.action
    assert REFUSED.text in found.evidence
    assert found.action == LOG.remedy("compass")


def test_a_sensor_that_is_not_in_use_is_a_note_and_no_evidence_against_the_one_that_is() -> None:
    spare = replace(OFFSET, in_use=False)
    (alone,) = of_kind("compass", spare)
    assert (alone.severity, alone.action) == ("note", SET)
    (found,) = of_kind("compass", FIELD, spare)
    assert (found.severity, found.text, found.evidence) == ("warning", FIELD.text, [])
    assert found.action != SET
    (other,) = of_kind("unused_sensor", FIELD, spare)
    assert (other.severity, other.text, other.action) == ("note", OFFSET.text, SET)


@pytest.mark.parametrize(
    ("kind", "about"),
    [("lane_switch", ""), ("sensor_switch", ""), ("gnss_lost", "fix"), ("gnss_lost", "messages"), ("failsafe", "")]
    + [("failsafe", about) for about in ("radio", "ground station", "ekf", "gnss", "terrain", "kill switch")],
)
def test_every_switch_failsafe_and_loss_has_its_own_action(kind: str, about: str) -> None:
    other = "messages" if about == "fix" else "fix"
    events = [Event(kind, 20.0, "warning", "It happened at 20.0 s.", about=about)]
    (found,) = rules.event_signs(events, [], LOG)
    assert found.action
    elsewhere = [Event("gnss_lost", 20.0, "warning", "It happened.", about=other)]
    assert found.action != rules.event_signs(elsewhere, [], LOG)[0].action


def test_the_offset_of_a_spare_unit_stands_beside_the_pair_that_differs() -> None:
    pair = Check("imu_instances", "warning", "IMU2 and IMU differ.", action="Calibrate in six positions.")
    spare = Check("accelerometer_offset", "warning", "IMU2 is off.", in_use=False)
    spare.settings = [Setting("INS_ACC2OFFS_Z", 1.8, 1.5)]
    (found,) = of_kind("accelerometer", pair, spare)
    assert (found.text, found.evidence) == (pair.text, ["IMU2 is off."])
    assert found.action == "Calibrate in six positions, or set INS_ACC2OFFS_Z 1.5."


@pytest.mark.parametrize("kind", ["", "gyro_bias"])
def test_a_check_may_name_another_kind(kind: str) -> None:
    apart = Check("imu_instances", "warning", "They differ.", kind=kind)
    assert [f.kind for f in findings(LOG, [apart])] == [kind or "accelerometer"]
