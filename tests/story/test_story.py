"""What happened, told of real logs that were read by hand: events by kind and time, and headlines by meaning."""

from __future__ import annotations

from collections.abc import Iterator
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
from tests.golden import check_golden
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


GOLDEN = Path(__file__).parent / "golden"
# Logs that were read by hand, below ``logs/cases`` of the corpus, and a simulated loss of GNSS.
CASES = (
    "copter_4.8dev_barodrift.BIN",
    "px4_1.14_clipping_crash.ulg",
    "plane_px4_1.13_crash.ulg",
    "copter_flip_at_takeoff.bin",
    "copter_heading_28deg_off.BIN",
    "copter_never_lifted.BIN",
    "copter_falsely_accused.bin",
    "px4_1.14_hard_landing.ulg",
    "px4_1.14_clipping_field.ulg",
    "copter_two_compasses.bin",
    "copter_4.6_standing_accused.BIN",
    "copter_4.2_radio_4hz.tlog",
    "copter_3.3dev_118.BIN",
    "../../sitl/px4/px4_gnssloss.ulg",
)


def printed(said: str, events: list[Event]) -> list[str]:
    """The headline, then each event with severity and evidence."""
    return [said, *(f"{e.t:.1f} {e.kind}, {e.severity}: {e.text} <{'; '.join(e.evidence)}>" for e in events)]


@pytest.mark.parametrize("name", CASES)
def test_what_is_told_of_logs_read_by_hand_is_as_reviewed(corpus, name):
    path = corpus / "logs" / "cases" / name
    check_golden(GOLDEN / f"{path.name}.txt", printed(headline(path), told(path)[2]))


@pytest.mark.parametrize("path", corpus_logs(".ulg", ".bin", ".tlog"), ids=lambda p: p.name)
def test_every_headline_has_at_most_thirty_words_and_every_event_its_evidence(path):
    try:
        log, phases, events = told(path)
    except attlog.AttlogError as error:
        pytest.skip(str(error))
    assert 4 <= len(story.headline(log, phases, events).split()) <= 30
    assert all(e.evidence and e.kind in story.KINDS and e.text.endswith((".", "”)")) for e in events)
    assert [e.t for e in events] == sorted(e.t for e in events)


def made(**more: object) -> tuple[FlightLog, Segments, list[Event]]:
    """A made flight from 5 to 35 s with whatever else is given."""
    log = with_fields(carried(0.05), **more)
    phases = segments.build(log)
    return log, phases, story.events(log, phases)


# Made flights from 5 to 35 s, armed from 5 to 34 s where arming is given.

ARMED = TimeLine(np.array([0.0, 5.0, 34.0]), [False, True, False], "ARM")
FAILSAFES = (
    "Radio Failsafe - Disarming",
    "Failsafe trigger 0x1",
    "Failsafe trigger 0x2",
    "Failsafe trigger 0x10",
    "[failsafe] Failsafe activated",
    "GCS Failsafe",
    "Failsafe: Terrain data missing",
    "Battery 1 is low 10.1V Failsafe",
)


def first_fix(at_s: float) -> Gnss:
    """A receiver with a fix from a time on."""
    t = np.arange(0.0, 40.0, 0.2)
    none = np.full(len(t), np.nan)
    fix = np.where(t >= at_s, 3, 1).astype(np.int64)
    return Gnss(0, t, "GPS", none, none, none, np.full((len(t), 3), np.nan), none, none, none, fix)


def situations() -> Iterator[tuple[str, dict[str, object]]]:
    texts = [(2.0, 4, "[a] Compass inconsistent"), (20.0, 4, "[a] High wind lost"), (21.0, 6, "Reached command")]
    yield "warnings on the ground and in flight", {"texts": texts}
    yield "a text that repeats", {"texts": [(20.0 + k, 3, "GPS bad") for k in range(5)]}
    yield "a failsafe as the autopilot starts", {"texts": [(-0.001, 4, "Failsafe enabled")]}
    for t in (2.0, 20.0, 35.5, 39.0):  # what follows within 2 s of disarming may have been its cause
        yield f"a failsafe at {t:g} s", {"armed": ARMED, "texts": [(t, 4, "Radio Failsafe")]}
    for text in FAILSAFES:
        yield text, {"texts": [(20.0, 4, text)]}
    late = Problem("err_7_1", "warning", "GNSS failsafe (ERR 7/1).", t=20.0)
    for at in (17.0, 14.0, np.inf):  # it means 5 s without a position, which ArduPilot 3 counts from the start
        yield f"GNSS failsafe at 20 s, first fix at {at:g} s", {"gnss": [first_fix(at)], "problems": [late]}
    cores = [(t, 6, f"EKF3 IMU{core} yaw aligned") for t in (8.0, 20.0) for core in (0, 1)]
    yield "yaw aligned by two cores, and again", {"texts": cores}
    end = made()[1].spans("airborne")[-1][1]
    for after in (-5.0, 0.5, 3.0):
        kill = [(end + after, 4, "Kill switch engaged")]
        yield f"a kill switch {after:+g} s from the landing", {"texts": kill, "armed": None}


def test_what_is_told_of_made_flights_is_as_reviewed():
    plain = printed("", made()[2])
    lines = ["== plain", *printed(story.headline(*made(), sound=True), made()[2])]
    for name, fields in situations():
        log, phases, events = made(**fields)
        said = story.headline(log, phases, events, sound=False)
        lines += [f"== {name}", *(x for x in printed(said, events) if x not in plain)]
    check_golden(GOLDEN / "made.txt", lines)


def test_headlines_of_faults_and_of_flights_that_never_were_are_as_reviewed():
    log, phases, events = made()
    lift, land = phases.spans("airborne")[0]
    whole = story.WrongAngle("heading", 27.4, lift + 1.0, land - 1.0)
    part = story.WrongAngle("tilt", 12.0, lift + 15.0, land)
    lines = [story.headline(log, phases, events, False, wrong) for wrong in (whole, part)]
    lines.append(story.headline(log, segments.Segments(), [], False, whole))
    phases.crash_events = [crashed(20.0), crashed(30.0)]
    again = story.WrongAngle("heading", 31.2, 25.0, 30.0)
    lines.append(story.headline(log, phases, story.events(log, phases), False, again))
    for throttle in (0.0, 0.07):  # Copter 3.3 idles at 7 %
        idle = carried(1.0, throttle=throttle)
        lines.append(headline_of(idle))
        idle.state.armed = None
        lines.append(headline_of(idle))
        idle.texts = [(3.0, 6, "starting motor test")]
        lines.append(headline_of(idle))
    log, phases, _ = made(texts=[(15.0, 4, "Crash: Disarming"), (23.0, 4, "Crash: Disarming again")])
    phases.crash_events = [crashed(20.0)]
    lines += printed("a crash between two texts", flight_events.movement_events(log, phases)[0])
    check_golden(GOLDEN / "headlines.txt", lines)


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
    page = (tmp_path / "x.html").read_text(encoding="utf-8").replace("\N{NO-BREAK SPACE}", " ")
    assert what_happened(result) in page
    assert "no filter was run" in page
    result.to_json(tmp_path / "x.json")
    assert attlog.Result.load(tmp_path / "x.json").events == result.events


def crashed(t: float) -> CrashEvent:
    """A blow at a time."""
    return CrashEvent("impact", t, t, 8.0, "g", "a blow of 8.0 g", 60.0, 200.0, ("IMU:0",))


@pytest.mark.parametrize(
    ("before_s", "crash", "told"), [(3.0, False, 1), (0.5, False, 0), (0.5, True, 1), (0.0, True, 0)]
)
def test_clipping_counts_up_to_the_touch_down_or_the_blow_of_a_crash(before_s, crash, told):
    log, phases, _ = made()
    end = phases.spans("airborne")[-1][1]
    phases.crash_events = [crashed(end)] if crash else []
    log.vibration.clippings = [Clipping("accelerometer", 0, "IMU:0", np.array([end - before_s]), np.array([50]), True)]
    assert len(flight_events.sensor_events(log, phases)[0]) == told


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
    assert "Impacts cannot be" in story.headline(log, phases, events)
