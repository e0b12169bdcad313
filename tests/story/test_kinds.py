"""Kinds of false statements on real logs: what each log shows is said, and what it refutes is not.

The truth is that of logs/cases/CASES.md (third table), or was read from raw records. Patterns are meanings.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

import pytest

import attlog
from attlog.health.check import agreed_settings
from attlog.result import Result
from tests.conftest import corpus_root

FOLDER = None if corpus_root() is None else corpus_root() / "logs" / "cases"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(FOLDER is None or not FOLDER.is_dir(), reason="needs the corpus")]


@dataclass(frozen=True)
class Case:
    """What the headline and the whole report must say, and what the report may not; times of events [s]."""

    headline: tuple[str, ...] = ()
    said: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    events: tuple[tuple[str, float, float], ...] = ()
    flights: int | None = None


CASES = {
    "vtol_px4_1.12_crash_lost.ulg": Case(
        headline=(r"[Hh]it the ground|[Cc]rash|turned over|[Rr]olled",),
        never=(r"ends in the air", r"no loss of control and no impact"),
        events=(("impact|overturn|tumble", 30.2, 31.4),),
    ),
    "vtol_px4_1.12_no_throttle_topic.ulg": Case(
        headline=(r"flew",),
        never=(r"never left the ground", r"[Ff]lip", r"[Cc]alibrate the compass outdoors"),
        flights=1,
    ),
    "plane_px4_1.17_15_lane_switches.ulg": Case(
        headline=(r"flew",),
        said=(r"clip", r"not safe to fly"),
        never=(r"Kill switch at \d{1,2}\.", r"shows whether it flew"),
    ),
    "copter_radio_one_flight_cut_up.tlog": Case(headline=(r"flew",), never=(r"\d+ flights",), flights=1),
    "copter_radio_link_pauses.tlog": Case(
        headline=(r"flew",), never=(r"GNSS lost", r"memory card", r"Landed at 1?\d\d?\.\d s.*Landed"), flights=1
    ),
    "sub_radio_stale_clock.log": Case(headline=(r"\b1(29|30) s",), never=(r"65[234](\.\d)? s",)),
    "copter_3.3dev_slow_loop.BIN": Case(said=(r"loop",), never=(r"[Rr]eplace", r"gyro (z )?reads \d")),
    "copter_3.5_gyro_bias_ran_away.bin": Case(
        said=(r"bias",), never=(r"\(simulated\)", r"[Rr]eplace", r"gyro z?.{0,12}7\.\d %", r"[Uu]se (MAG2|the other)")
    ),
    "copter_4.5.7_compass_orientation.BIN": Case(
        said=(r"COMPASS_ORIENT",), never=(r"[Cc]alibrate the compass outdoors", r"no attitude can turn the field")
    ),
    "copter_heading_28deg_off.BIN": Case(said=(r"COMPASS_ORIENT",), never=(r"[Cc]alibrate the compass outdoors",)),
    "px4_1.14_spoofing_text.ulg": Case(
        headline=(r"never left the ground",), said=(r"[Ss]poofing",), never=(r"EKF and GNSS diverged",)
    ),
    "copter_motor_failure_imu3.bin": Case(
        headline=(r"[Mm]otor 2",),
        said=(r"IMU3.*vibrat|vibrat.*IMU3",),
        never=(r"[Cc]alibrate .*six positions", r"[Mm]otor 1 .*no thrust"),
    ),
    "px4_1.17_gnss_messages_missing.ulg": Case(
        said=(r"[Nn]o GNSS message", r"[Bb]lind land"), never=(r"no fix for", r"antenna")
    ),
    "copter_4.5.7_gps_delay.BIN": Case(never=(r"GPS_DELAY_MS \d+ ->",)),
    "copter_sitl_false_accelerometer_offset.BIN": Case(never=(r"INS_ACCOFFS_Y \S+ ->",)),
    "copter_3.3dev_no_thrust_left.BIN": Case(said=(r"thrust",), events=(("impact|hard_landing", 147.0, 151.0),)),
    "copter_4.6dev_would_not_arm.BIN": Case(headline=(r"Gyros not calibrated",)),
    "rover_px4_1.16_encoder_errors.ulg": Case(
        said=(r"Error reading encoders", r"2,?054|2,?053 more"), never=(r"Nothing to fix", r"stood still")
    ),
    # Three more, read by hand: a dead motor 14 m up, a landing detected in the air, a fall from level flight.
    "../bin_copter_4.7dev_crash_isb_cut.bin": Case(
        headline=(r"Motor 1 \(front right\)", r"[Hh]it the ground at 10\.6 s"),
        never=(r"[Hh]it the ground (or an obstacle )?at 7\.9",),
    ),
    "../ulg_px4_1.15_tropic_quad_ekffail_cut.ulg": Case(
        headline=(r"motors were off", r"[Hh]it the ground at 19\.0"), never=(r"[Mm]otor \d \([a-z ]+\) gave no thrust",)
    ),
    "../bin_copter_3.3dev_solo_tumble_cut.bin": Case(headline=(r"[Hh]it the ground at 21\.[567]",)),
    "copter_4.0_headline_cut.bin": Case(headline=(r"[Hh]ard landing",), never=(r"Neither .* shows which one is off",)),
    "copter_bench_log_disarmed_gaps.bin": Case(said=(r"[Cc]ompass not calibrated",), never=(r"memory card",)),
}


@cache
def result(name: str) -> Result:
    """The analysed log."""
    assert FOLDER is not None
    return attlog.analyze(FOLDER / name)


@cache
def report(name: str) -> str:
    """Every statement, one a line: headline, events, findings with cause, action and evidence, what is offered."""
    told = result(name)
    lines = [told.headline, *(e.text for e in told.events)]
    for finding in told.findings:
        lines += [finding.text, finding.cause, finding.action, *finding.evidence]
    lines += [f"{s.name} {s.old} -> {s.new:.7g}" for s in agreed_settings(told.checks)]
    return "\n".join(line for line in lines if line)


@pytest.mark.parametrize("name", CASES)
def test_what_a_log_shows_is_said_and_what_it_refutes_is_not(name: str) -> None:
    case, told = CASES[name], result(name)
    missing = [x for x in case.headline if not re.search(x, told.headline)]
    missing += [x for x in case.said if not re.search(x, report(name))]
    false = [line for x in case.never for line in report(name).splitlines() if re.search(x, line)]
    late = [w for w in case.events if not any(re.fullmatch(w[0], e.kind) and w[1] <= e.t <= w[2] for e in told.events)]
    assert (missing, false, late) == ([], [], []), told.headline
    if case.flights is not None:
        assert sum(e.kind == "liftoff" for e in told.events) == case.flights
    assert told.headline.count("(") == told.headline.count(")")
    assert told.headline.endswith(".")
