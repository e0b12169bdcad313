"""What happened, told of real logs that were read by hand: events by kind and time, and headlines by meaning."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import segments, story
from attlog.core import spans
from attlog.flight.model import Clipping, FlightLog, Gnss, Problem, Stream, TimeLine
from attlog.segments import Segments
from attlog.segments.impacts import CrashEvent
from attlog.story import Event, flight_events
from attlog.words.flight import what_happened
from tests.conftest import corpus_logs
from tests.flight.made_log import with_fields
from tests.segments.flights import imu_log
from tests.segments.test_airborne import carried


@cache
def told(path: Path) -> tuple[FlightLog, Segments, list[Event]]:
    """A log, its phases and its events."""
    log = attlog.read(path)
    phases = segments.build(log)
    return log, phases, story.events(log, phases)


def headline(path: Path) -> str:
    """The headline of a log."""
    return story.headline(*told(path))


def headline_of(log: FlightLog) -> str:
    """The headline of a made log."""
    phases = segments.build(log)
    return story.headline(log, phases, story.events(log, phases))


SAID = {
    "copter_4.8dev_barodrift.BIN": ["never left the ground", r"EKF failsafe at 52\.4 s, disarmed"],
    "px4_1.14_clipping_crash.ulg": [
        "PX4 1.14.3",
        "34 to 46 s",
        "clipped from 37 s",
        "vibration 2[01]",
        r"46\.1 s \(13 g\)",
        "lay at 4[45]°",
    ],
    "plane_px4_1.13_crash.ulg": [
        "Fixed wing, PX4 1.13.3",
        "flew 6 to 29 s",
        "clipped",
        "107° at 28.5 s",
        r"29\.1 s \(15 g\)",
    ],
    "copter_flip_at_takeoff.bin": ["ArduCopter 4.6.3", "never flew", "clipped", "take-off", "178°", "upside down"],
    "copter_heading_28deg_off.BIN": [
        "ArduCopter 4.5.7",
        "11 to 103 s",
        "landed safely",
        "re-aligned yaw at 12.5 and 17.1 s",
    ],
    "copter_never_lifted.BIN": ["ArduCopter 4.7-dev", "never left the ground", "hrottle up", "re-aligned yaw at 165 s"],
    "copter_falsely_accused.bin": [
        "Octorotor",
        "3 to 180 s and 221 to 335 s",
        "Hard landing at 179.8 s",
        "4.1 g",
        "nothing else went wrong",
    ],
    "px4_1.14_hard_landing.ulg": [
        "Octorotor, PX4 1.14.0",
        "4 to 75 s",
        "Battery failsafe at 23.7 s",
        "Kill switch at 74.9 s",
        "10 g",
        "upright",
    ],
    "px4_1.14_clipping_field.ulg": ["stood armed to 14 s", "9° of tilt", "landed safely", "Nothing went wrong"],
    "copter_two_compasses.bin": ["ArduCopter 4.0.1", "4 to 237 s", "40° of tilt", "landed safely", "re-aligned yaw"],
    "copter_4.6_standing_accused.BIN": ["ArduCopter 4.6-dev", "never left the ground", "1119 s"],
    "copter_4.2_radio_4hz.tlog": [
        "telemetry at 4 Hz",
        "43 to 303 s",
        "11 m and 25°",
        "upright",
        "Blows cannot be determined",
    ],
    "copter_3.3dev_118.BIN": ["three flights from 8 s", "165.7 s", "4.6 g", "crashed again at 300.7 s", "7.2 g"],
}


@pytest.mark.parametrize("name", SAID)
def test_headlines_of_logs_read_by_hand_hold_their_facts(corpus, name):
    said = headline(corpus / "logs" / "cases" / name)
    assert [fact for fact in SAID[name] if not re.search(fact, said)] == [], said


@pytest.mark.parametrize("path", corpus_logs(".ulg", ".bin", ".tlog"), ids=lambda p: p.name)
def test_every_headline_has_at_most_thirty_words_and_every_event_its_evidence(path):
    try:
        log, phases, events = told(path)
    except attlog.AttlogError as error:
        pytest.skip(str(error))
    assert 4 <= len(story.headline(log, phases, events).split()) <= 30
    assert all(e.evidence and e.kind in story.KINDS and e.text.endswith((".", "”)")) for e in events)
    assert [e.t for e in events] == sorted(e.t for e in events)


def kinds(path: Path, kind: str) -> list[float]:
    """Times of the events of a kind."""
    return [e.t for e in told(path)[2] if e.kind == kind]


def test_one_event_has_what_sensors_flags_and_the_autopilot_say_of_it(corpus):
    """Flags from 37.2 s, the counter of the other unit, and the text of 41.4 s are one clipping."""
    path = corpus / "logs" / "cases" / "px4_1.14_clipping_crash.ulg"
    (clip,) = (e for e in told(path)[2] if e.kind == "clipping")
    assert clip.t == pytest.approx(37.2, abs=0.1)
    assert clip.value == pytest.approx(1611, abs=50)
    assert any("vehicle_imu_status:1" in x for x in clip.evidence)
    assert any("Accel 1 clipping, not safe to fly!" in x for x in clip.evidence)
    assert not any("clipping" in e.text for e in told(path)[2] if e.kind == "message")


def test_a_wreck_warns_of_nothing_and_is_carried(corpus):
    path = corpus / "logs" / "cases" / "px4_1.14_clipping_crash.ulg"
    assert [e.kind for e in told(path)[2] if e.severity == "warning" and e.t > 46.2] == []
    assert kinds(path, "wreck_moved") == [pytest.approx(64.0, abs=5.0)]


def test_warnings_stand_in_the_autopilots_words_at_their_time(corpus):
    path = corpus / "logs" / "cases" / "plane_px4_1.13_crash.ulg"
    (said,) = (e for e in told(path)[2] if "Land now" in e.text)
    assert (said.kind, said.t) == ("message", pytest.approx(30.0, abs=0.1))


def test_a_failsafe_for_the_battery_is_one_event_with_flag_and_text(corpus):
    path = corpus / "logs" / "cases" / "px4_1.14_hard_landing.ulg"
    assert kinds(path, "battery") == [pytest.approx(23.7, abs=0.1)]
    assert kinds(path, "failsafe") == [pytest.approx(74.9, abs=0.1)]


def test_the_first_yaw_alignment_after_arming_is_custom_and_an_anomaly_is_none(corpus):
    custom = [
        e.severity for e in told(corpus / "logs" / "cases" / "copter_4.2_radio_4hz.tlog")[2] if e.kind == "realigned"
    ]
    odd = [e.severity for e in told(corpus / "logs" / "cases" / "copter_never_lifted.BIN")[2] if e.kind == "realigned"]
    assert (custom, odd) == (["info"], ["warning"])


def test_a_lost_gnss_is_told_with_its_length(corpus):
    (lost,) = (e for e in told(corpus / "sitl" / "px4" / "px4_gnssloss.ulg")[2] if e.kind == "gnss_lost")
    assert lost.value is not None
    assert lost.value > 20.0


def made(**more: object) -> tuple[FlightLog, Segments, list[Event]]:
    """A made flight from 5 to 35 s with whatever else is given."""
    log = with_fields(carried(0.05), **more)
    phases = segments.build(log)
    return log, phases, story.events(log, phases)


def test_nothing_went_wrong_is_said_where_no_finding_is_a_warning():
    log, phases, events = made()
    assert "Nothing went wrong." in story.headline(log, phases, events, sound=True)
    assert "Nothing went wrong" not in story.headline(log, phases, events, sound=False)


def test_an_angle_that_was_proven_wrong_stands_first_with_its_time():
    log, phases, events = made()
    (lift, land) = phases.spans("airborne")[0]
    whole = story.WrongAngle("heading", 27.4, lift + 1.0, land - 1.0)
    part = story.WrongAngle("tilt", 12.0, lift + 15.0, land)
    assert "Heading was 27° wrong throughout." in story.headline(log, phases, events, False, whole)
    assert f"Tilt was 12° wrong from {lift + 15:.0f} to {land:.0f} s." in story.headline(
        log, phases, events, False, part
    )
    on_the_ground = segments.Segments()
    assert "wrong" not in story.headline(log, on_the_ground, [], False, whole)


def test_a_text_of_the_autopilot_in_flight_is_a_warning_and_on_the_ground_a_note():
    texts = [(2.0, 4, "[a] Compass inconsistent"), (20.0, 4, "[a] High wind lost"), (21.0, 6, "Reached command")]
    found = [(e.text, e.severity) for e in made(texts=texts)[2] if e.kind == "message"]
    assert found == [("“Compass inconsistent”.", "note"), ("“High wind lost”.", "warning")]


def test_a_failsafe_as_the_log_begins_is_the_autopilot_starting_and_a_later_one_a_warning():
    logs = [made(texts=[(t, 4, "Failsafe enabled")]) for t in (-0.001, 20.0)]
    found = [(e.text, e.severity) for log in logs for e in log[2] if e.kind == "failsafe"]
    assert found == [("Failsafe at 0.0 s.", "note"), ("Failsafe at 20.0 s.", "warning")]


def test_a_text_that_repeats_is_one_event():
    texts = [(20.0 + k, 3, "GPS bad") for k in range(5)]
    (said,) = (e for e in made(texts=texts)[2] if e.kind == "message")
    assert said.text == "“GPS bad” (5 times)."
    assert (said.t, said.t_end) == (20.0, 24.0)


def test_strong_vibration_in_flight_is_told_from_when_to_when():
    log = carried(0.05)
    imu = log.imus[0]
    shaking = (imu.acc.t > 15.0) & (imu.acc.t < 25.0)
    imu.acc.x[shaking, 0] += 28.3 * np.sin(2 * np.pi * 30.0 * imu.acc.t[shaking])
    phases = segments.build(log)
    (found,) = (e for e in story.events(log, phases) if e.kind == "vibration")
    assert found.value == pytest.approx(20.0, rel=0.1)
    assert (found.t, found.t_end) == (pytest.approx(15.0, abs=1.1), pytest.approx(25.0, abs=1.1))


def test_a_log_that_stops_in_flight_ends_in_the_air():
    log = carried(0.05)
    log.state.armed = None
    log.power.throttle = Stream(np.arange(0.0, 40.0, 0.1), np.full((400, 1), 0.4), "1", "", "CTUN.ThO")
    phases = segments.build(log)
    events = story.events(log, phases)
    assert "ends_in_air" in [e.kind for e in events]
    assert story.headline(log, phases, events).endswith("The log ends in the air.")


@pytest.mark.parametrize(
    ("name", "rate"), [("cases/copter_4.2_radio_4hz.tlog", "3.9 Hz"), ("tlog_mav2_plane_3.6.0_sys2_cut.tlog", "1.0 Hz")]
)
def test_a_log_that_cannot_be_replayed_is_told_without_the_comparison(corpus, tmp_path, name, rate):
    """Radio telemetry: the flight, the events, the findings, and what would have to be logged to compare filters."""
    result = attlog.analyze(corpus / "logs" / name)
    assert "flew" in result.headline
    assert {"armed", "liftoff"} <= {e.kind for e in result.events}
    assert [p.text for p in result.findings if p.kind == "rate" and rate in p.text]
    assert (result.estimators, result.verdicts, result.reference) == ([], [], None)
    result.to_html(tmp_path / "x.html")
    page = (tmp_path / "x.html").read_text(encoding="utf-8")
    assert what_happened(result) in page
    assert "no filter was run" in page
    result.to_json(tmp_path / "x.json")
    assert attlog.Result.load(tmp_path / "x.json").events == result.events


@pytest.mark.parametrize(("t", "severity"), [(2.0, "note"), (20.0, "warning"), (35.5, "warning"), (39.0, "note")])
def test_a_failsafe_of_a_disarmed_vehicle_warns_nobody(t, severity):
    """Armed from 5 to 34 s; what follows within 2 s of disarming may have been its cause."""
    line = TimeLine(np.array([0.0, 5.0, 34.0]), [False, True, False], "ARM")
    (said,) = (e for e in made(armed=line, texts=[(t, 4, "Radio Failsafe")])[2] if e.kind == "failsafe")
    assert said.severity == severity


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Radio Failsafe - Disarming", "Radio failsafe"),
        ("Failsafe trigger 0x1", "Radio failsafe"),
        ("Failsafe trigger 0x2", "Ground station failsafe"),
        ("Failsafe trigger 0x10", "Failsafe"),
        ("[failsafe] Failsafe activated", "Failsafe"),
        ("GCS Failsafe", "Ground station failsafe"),
        ("Failsafe: Terrain data missing", "Terrain failsafe"),
        ("Battery 1 is low 10.1V Failsafe", "Battery failsafe"),
    ],
)
def test_a_failsafe_is_named_by_what_the_autopilot_says_of_it(text, name):
    (said,) = (e for e in made(texts=[(20.0, 4, text)])[2] if e.kind in ("failsafe", "battery"))
    assert said.text == f"{name} at 20.0 s."


@pytest.mark.parametrize(("fix_s", "severity"), [(17.0, "note"), (14.0, "warning"), (None, "warning")])
def test_a_failsafe_of_gnss_just_after_its_first_fix_is_no_lost_gnss(fix_s, severity):
    """It means 5 s without a position, and ArduPilot 3 counts them from the start where there never was one."""
    t = np.arange(0.0, 40.0, 0.2)
    none = np.full(len(t), np.nan)
    fix = np.where(t >= (np.inf if fix_s is None else fix_s), 3, 1).astype(np.int64)
    gnss = Gnss(0, t, "GPS", none, none, none, np.full((len(t), 3), np.nan), none, none, none, fix)
    late = [Problem("err_7_1", "warning", "GNSS failsafe (ERR 7/1).", t=20.0)]
    (said,) = (e for e in made(gnss=[gnss], problems=late)[2] if e.kind == "failsafe")
    assert said.severity == severity


def test_a_motor_test_is_no_motor_that_never_ran():
    log = carried(1.0, throttle=0.0)
    log.state.armed = None
    assert "motors never ran" in headline_of(log)
    log.texts = [(3.0, 6, "starting motor test")]
    assert "only motor tests" in headline_of(log)


def test_a_second_crash_is_told_beside_a_wrong_heading():
    log, phases, _ = made()
    phases.endings = [crashed(20.0), crashed(30.0)]
    wrong = story.WrongAngle("heading", 31.2, 25.0, 30.0)
    said = story.headline(log, phases, story.events(log, phases), False, wrong)
    assert "Heading was 31° wrong from 25 to 30 s." in said
    assert "at 20.0 s" in said
    assert "crashed again at 30.0 s" in said
    assert len(said.split()) <= 30


def test_idling_is_no_throttle_that_was_up():
    """Copter 3.3 idles at 7 %."""
    log = carried(1.0, throttle=0.07)
    phases = segments.build(log)
    assert "never left the ground" in story.headline(log, phases, story.events(log, phases))
    assert "throttle up" not in story.headline(log, phases, story.events(log, phases))


def crashed(t: float) -> CrashEvent:
    """A blow at a time."""
    return CrashEvent("impact", t, t, 8.0, "g", "a blow of 8.0 g", 60.0, 200.0, ("IMU:0",))


@pytest.mark.parametrize(
    ("before_s", "crash", "told"), [(3.0, False, 1), (0.5, False, 0), (0.5, True, 1), (0.0, True, 0)]
)
def test_clipping_counts_up_to_the_touch_down_or_the_blow_of_a_crash(before_s, crash, told):
    log, phases, _ = made()
    end = phases.spans("airborne")[-1][1]
    phases.endings = [crashed(end)] if crash else []
    log.vibration.clippings = [Clipping("accelerometer", 0, "IMU:0", np.array([end - before_s]), np.array([50]), True)]
    assert len(flight_events.sensor_events(log, phases)[0]) == told


def test_what_the_autopilot_says_of_a_crash_is_said_after_it():
    log, phases, _ = made(texts=[(15.0, 4, "Crash: Disarming"), (23.0, 4, "Crash: Disarming again")])
    phases.endings = [crashed(20.0)]
    (impact,) = (e for e in flight_events.movement_events(log, phases)[0] if e.kind == "impact")
    assert [x for x in impact.evidence if x.startswith("text")] == ["text at 23.0 s: Crash: Disarming again"]


def test_a_yaw_that_is_aligned_again_while_armed_is_an_anomaly():
    """Both cores say so within a second: one event."""
    texts = [(t, 6, f"EKF3 IMU{core} yaw aligned") for t in (8.0, 20.0) for core in (0, 1)]
    found = [e for e in made(texts=texts)[2] if e.kind == "realigned"]
    assert [(e.t, e.severity) for e in found] == [(8.0, "info"), (20.0, "warning")]


@pytest.mark.parametrize(("after_s", "severity"), [(-5.0, "warning"), (0.5, "warning"), (3.0, "note")])
def test_a_kill_switch_in_flight_or_with_its_end_is_a_warning_and_on_the_ground_a_note(after_s, severity):
    end = made()[1].spans("airborne")[-1][1]
    _, _, events = made(texts=[(end + after_s, 4, "Kill switch engaged")], armed=None)
    (said,) = (e for e in events if e.kind == "failsafe")
    assert (said.t, said.severity) == (end + after_s, severity)


def flown(log: FlightLog) -> list[spans.Span]:
    return segments.build(log).spans("airborne")


def test_a_landed_flag_in_the_air_ends_no_flight() -> None:
    """LAND_COMPLETE_MAYBE comes in slow descents, too."""
    log = carried(0.05)
    (whole,) = flown(log)
    log.state.landed = TimeLine(np.array([0.0, 6.0, 12.0]), [True, False, True], "EV")
    assert flown(log) == [whole]
    assert whole[1] - whole[0] == pytest.approx(30.0, abs=4.0)


def test_a_pause_of_the_logger_is_no_flight() -> None:
    """Copter 3.3 stopped logging for 59 s in the middle of what its flags call a flight."""
    log = carried(0.05)
    kept = (log.imus[0].gyro.t < 15.0) | (log.imus[0].gyro.t > 25.0)
    for stream in (log.imus[0].gyro, log.imus[0].acc):
        stream.t, stream.x = stream.t[kept], stream.x[kept]
    found = flown(log)
    assert spans.intersect(found, [(15.1, 24.9)]) == []
    assert len(found) == 2


def still(t: np.ndarray, **more: object) -> FlightLog:
    """A unit that does not move at all."""
    rng = np.random.default_rng(1)
    gyro, acc = 1e-4 * rng.normal(size=(len(t), 3)), 0.01 * rng.normal(size=(len(t), 3))
    return imu_log(t, gyro, acc - [0.0, 0.0, 9.81], **more)


def test_a_climb_as_still_as_a_table_is_no_rest() -> None:
    """Simulated without vibration at 2.5 m/s, in a log without a record of arming."""
    t = np.arange(0.0, 40.0, 0.1)
    height = Stream(t, (2.5 * np.clip(t - 10.0, 0.0, 15.0))[:, None], "m", "", "BARO")
    sample = np.arange(0.0, 40.0, 0.01)
    throttle = Stream(t, np.where((t > 9.0) & (t < 26.0), 0.5, 0.0)[:, None], "1", "", "CTUN")
    climbing = segments.build(still(sample, baro=[height], throttle=throttle)).spans("rest")
    assert spans.intersect(climbing, [(11.0, 24.0)]) == []
    assert spans.seconds(segments.build(still(sample)).spans("rest")) > 30.0


def test_a_unit_at_one_hertz_shows_rest_and_no_movement() -> None:
    """Too slow to replay; that it stood still can be seen."""
    t = np.arange(0.0, 400.0, 0.8)
    off = TimeLine(np.array([0.0]), [False], "HEARTBEAT")
    assert spans.seconds(segments.build(still(t, armed=off)).spans("rest")) > 300.0


def test_telemetry_at_four_hertz_tells_the_flight_and_no_blow() -> None:
    """A replay is impossible, what happened is not; a blow of 8 g between two samples would not show."""
    log = carried(0.05)
    every = slice(None, None, 25)
    for stream in (log.imus[0].gyro, log.imus[0].acc):
        stream.t, stream.x = stream.t[every], stream.x[every]
    log.imu = None
    t = np.arange(0.0, 40.0, 0.25)
    log.baro = [Stream(t, np.clip(np.minimum(t - 5.0, 35.0 - t), 0.0, 8.0)[:, None], "m", "", "SCALED_PRESSURE")]
    phases = segments.build(log)
    events = story.events(log, phases)
    assert {"liftoff", "landing"} <= {e.kind for e in events}
    assert not any(e.is_crash for e in events)
    assert "Blows cannot be" in story.headline(log, phases, events)
