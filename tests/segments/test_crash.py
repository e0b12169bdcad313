"""How flights ended: crashes that were found by hand in real logs, and flights, benches and hands without one."""

from __future__ import annotations

import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.core.spans import Span
from attlog.flight.model import FlightLog, Stream, TimeLine
from attlog.segments import crash, rest
from attlog.segments.impacts import CrashContext, CrashEvent, impact_peaks, onboard_tilt, rest_tilt
from attlog.story.headlines import TURNED
from tests.segments.flights import ARMED, DISARMED, LANDED, TAKE_OFF, flight
from tests.segments.test_airborne import found_in

CRASHES = {
    "cases/copter_3.3dev_118.BIN": [165.7, 300.7],
    "cases/copter_3.3dev_31.BIN": [250.2, 362.3],
    "cases/copter_3.3dev_37.BIN": [26.9, 39.8],
    "cases/copter_flip_at_takeoff.bin": [5.6],
    "cases/plane_px4_1.13_crash.ulg": [28.5],
    "cases/px4_1.14_clipping_crash.ulg": [46.1],
    "bin_copter_3.3dev_solo_tumble_cut.bin": [21.5],
    "bin_copter_3.4.4_mechfail_cut.bin": [26.8],
    "bin_copter_4.7dev_crash_isb_cut.bin": [7.9],
    "ulg_px4_1.15_tropic_quad_ekffail_cut.ulg": [18.0],
}
"""Seconds at which each begins: read by hand from raw samples, attitudes and texts."""
HARD = {"cases/copter_falsely_accused.bin": (179.8, 4.1), "cases/px4_1.14_hard_landing.ulg": (75.1, 10.3)}
CONTROLS = [
    "bin_copter_3.2.1rc1_aerobatic_cut.BIN",
    "bin_copter_3.3dev_27hz_zeromag_upsidedown.BIN",
    "bin_copter_4.7dev_hand_isb_cut.bin",
    "log_copter_3.1.1_nan.log",
    "cases/copter_3.6.8_compass.bin",
    "cases/copter_heading_28deg_off.BIN",
    "cases/copter_never_lifted.BIN",
    "cases/px4_1.8_hexa.ulg",
    "cases/copter_two_compasses.bin",
    "cases/px4_1.6.5_hand_rotation.ulg",
    "cases/copter_3.2.1_bench.log",
    "cases/px4_1.14_clipping_field.ulg",
    "ulg_px4_1.6.5_fmuv2_handrotated_cut.ulg",
]
SIMULATED = [
    "px4/px4_aggressive.ulg",
    "px4/px4_plane.ulg",
    "px4/px4_wind.ulg",
    "px4/px4_yaw.ulg",
    "ardupilot/copter_aggressive.bin",
    "ardupilot/copter_wind_guided.bin",
    "ardupilot/plane_dcm.bin",
]


def ended(log: FlightLog) -> tuple[list[Span], list[CrashEvent]]:
    """Flights and endings of a log."""
    clock = sys.modules["attlog.segments.build"]._clock(log)
    armed = rest.armed_spans(log, float(clock.min()), float(clock.max()))
    found = crash.find_crashes(log, found_in(log), armed.spans if armed.known else None, float(clock.max()))
    return found.flights, found.crash_events


def crashes(path: Path) -> list[float]:
    """When each crash of a log begins: an impact within 5 s of an overturn is the same crash."""
    begins: list[float] = []
    for ending in ended(attlog.read(path))[1]:
        if ending.is_crash and not (begins and ending.t - begins[-1] < 5.0):
            begins.append(ending.t)
    return begins


@pytest.mark.parametrize("name", CRASHES)
def test_every_known_crash_of_real_logs_is_found_at_its_time(corpus, name):
    assert crashes(corpus / "logs" / name) == [pytest.approx(t, abs=0.3) for t in CRASHES[name]]


@pytest.mark.parametrize("name", CONTROLS)
def test_no_crash_is_found_in_benches_hands_aerobatics_and_landings(corpus, name):
    assert crashes(corpus / "logs" / name) == []


@pytest.mark.parametrize("name", SIMULATED)
def test_no_crash_or_hard_landing_is_found_in_simulated_flights(corpus, name):
    """The simulators' ground is hard: touch-downs of 3.7 to 9.6 g."""
    assert ended(attlog.read(corpus / "sitl" / name))[1] == []


@pytest.mark.parametrize("name", HARD)
def test_a_blow_at_touch_down_that_leaves_it_upright_is_a_hard_landing(corpus, name):
    t, g = HARD[name]
    (found,) = ended(attlog.read(corpus / "logs" / name))[1]
    assert (found.kind, found.t, found.size) == ("hard_landing", pytest.approx(t, abs=0.2), pytest.approx(g, abs=0.1))
    assert found.lies_deg is not None
    assert found.lies_deg < 10.0


def test_a_wreck_that_is_carried_home_does_not_fly(corpus):
    """It lies at 44 deg from 46.1 s, and is carried from 61 s."""
    flown, (impact,) = ended(attlog.read(corpus / "logs" / "cases" / "px4_1.14_clipping_crash.ulg"))
    assert flown[-1][1] == pytest.approx(46.1, abs=0.1)
    assert impact.size == pytest.approx(13.4, abs=0.1)
    assert impact.lies_deg == pytest.approx(44.0, abs=2.0)


def test_flights_after_a_crash_count_once_the_vehicle_has_stood_upright(corpus):
    flown, _ = ended(attlog.read(corpus / "logs" / "cases" / "copter_3.3dev_118.BIN"))
    assert [round(a) for a, _ in flown] == [8, 119, 225]


def made(g: float, at: float, lies_deg: float = 0.0) -> FlightLog:
    """A flight of 40 s with two samples of force, and what lies tilted by some degrees from then on."""
    log = flight()
    imu = log.imus[0]
    i = int(np.searchsorted(imu.acc.t, at))
    after, attitude = imu.acc.t >= at + 0.2, log.attitudes["ATT"]
    if lies_deg:
        turn = rotation.from_euler(np.radians(lies_deg), 0.0, 0.0)
        still = rotation.rotate_inverse(turn, np.array([0.0, 0.0, -9.81]))
        imu.acc.x[after] = still + 0.02 * imu.gyro.x[after]
        imu.gyro.x[after] *= 0.05
        attitude.q[attitude.t >= at + 0.2] = turn
    imu.acc.x[i : i + 2] = [0.0, 0.0, -g * 9.81]
    return log


def endings(log: FlightLog) -> list[CrashEvent]:
    """The endings of a made flight in the air from TAKE_OFF to LANDED, whatever its sensors say of that."""
    air = found_in(log)
    air.spans = [(TAKE_OFF, LANDED)]
    air.driven = (air.grid.t > TAKE_OFF) & (air.grid.t < DISARMED)
    return crash.find_crashes(log, air, [(TAKE_OFF - 5.0, DISARMED)], float(log.imus[0].acc.t[-1])).crash_events


def test_a_blow_after_which_it_lies_tilted_is_an_impact_to_the_sample():
    (found,) = endings(made(8.0, LANDED - 0.3, lies_deg=60.0))
    assert (found.kind, found.t) == ("impact", pytest.approx(LANDED - 0.3, abs=0.006))
    assert found.size == pytest.approx(8.0, abs=0.05)
    assert found.lies_deg == pytest.approx(60.0, abs=1.0)


def test_the_same_blow_upright_is_a_hard_landing():
    (found,) = endings(made(8.0, LANDED - 0.3))
    assert found.kind == "hard_landing"


@pytest.mark.parametrize(("disarmed", "kind"), [(False, "impact"), (True, "hard_landing")])
def test_a_log_that_stops_as_it_is_disarmed_upright_shows_no_crash(disarmed, kind):
    log = made(5.0, LANDED - 0.3)
    log.state.armed = TimeLine(
        np.array([0.0, *([LANDED + 0.3] if disarmed else [])]), [True, False][: 1 + disarmed], ""
    )
    imu = log.imus[0]
    kept = imu.acc.t < LANDED + 0.5
    for stream in (imu.acc, imu.gyro):
        stream.t, stream.x = stream.t[kept], stream.x[kept]
    (found,) = endings(log)
    assert found.kind == kind


@pytest.mark.parametrize(("roll", "pitch", "said"), [(100, 0, "Rolled"), (0, -100, "Pitched"), (100, 40, "Tilted")])
def test_an_overturn_is_about_the_axis_that_tilts(roll, pitch, said):
    log = flight()
    log.attitudes["ATT"].q[:] = rotation.from_euler(np.radians(roll), np.radians(pitch), 1.0)
    assert TURNED[crash._tilt_axis(log, 5)] == said


def test_a_blow_below_three_g_is_a_landing():
    assert endings(made(2.8, LANDED - 0.3)) == []


def test_a_blow_in_the_air_that_is_flown_on_is_none_of_these():
    assert endings(made(8.0, TAKE_OFF + 10.0)) == []


def test_vibration_is_no_blow():
    """7 g for seconds before, as seen in four real logs: 8 g do not stand out of it."""
    log = made(8.0, LANDED - 0.3, lies_deg=60.0)
    imu = log.imus[0]
    shaking = (imu.acc.t > LANDED - 6.0) & (imu.acc.t < LANDED - 0.35)
    imu.acc.x[shaking, 2] *= np.where(np.arange(shaking.sum()) % 3 == 0, 7.0, 0.1)
    assert [e.kind for e in endings(log) if e.kind == "impact"] == []


def scene_of(log: FlightLog) -> CrashContext:
    """What the rules look at, of a made flight."""
    return CrashContext(log, found_in(log), [(ARMED, DISARMED)], float(log.imus[0].acc.t[-1]), onboard_tilt(log))


@pytest.mark.parametrize("fault", ["heavy", "silent"])
def test_how_it_lies_is_told_by_another_unit_where_the_replayed_one_cannot(fault):
    """An accelerometer that reads 4 m/s^2 too much feels more than gravity; one that was torn off has no samples."""
    log = made(8.0, LANDED - 0.3, lies_deg=60.0)
    log.imus.append(deepcopy(log.imus[0]))
    broken, after = log.imus[0], log.imus[0].acc.t > LANDED
    if fault == "heavy":
        broken.acc.x[after] *= 1.4
    else:
        broken.acc.x[after] = np.nan
    assert rest_tilt(scene_of(log), LANDED - 0.3) == pytest.approx(60.0, abs=1.0)
    log.imus.pop()
    assert rest_tilt(scene_of(log), LANDED - 0.3) is None


def fallen(degrees: float, leans: float, seconds: float = 8.0) -> FlightLog:
    """A flight that never lifts: with motors driven it goes to some tilt at 50 s, its force leans by ``leans``."""
    log = flight(calm=True)
    imu, attitude = log.imus[0], log.attitudes["ATT"]
    for t, x, angle in ((imu.acc.t, imu.acc.x, leans), (attitude.t, attitude.q, degrees)):
        after = (t >= 50.0) & (t < 50.0 + seconds)
        turn = rotation.from_euler(np.radians(angle), 0.0, 0.0)
        x[after] = turn if x is attitude.q else rotation.rotate_inverse(turn, np.array([0.0, 0.0, -9.81]))
    return log


def fallen_endings(log: FlightLog) -> list[CrashEvent]:
    air = found_in(log)
    air.spans, air.driven = [], (air.grid.t > ARMED) & (air.grid.t < DISARMED)
    return crash.find_crashes(log, air, [(ARMED, DISARMED)], float(log.imus[0].acc.t[-1])).crash_events


def test_a_fall_to_one_side_with_motors_driven_is_a_crash_though_it_never_flew():
    (found,) = fallen_endings(fallen(45.0, 50.0))
    assert (found.kind, found.t, found.t_end) == (
        "overturn",
        pytest.approx(50.0, abs=0.1),
        pytest.approx(58.0, abs=0.3),
    )
    assert found.size == pytest.approx(45.0, abs=1.0)


@pytest.mark.parametrize(("degrees", "leans", "seconds"), [(45.0, 2.0, 8.0), (3.0, 45.0, 8.0), (45.0, 45.0, 2.0)])
def test_a_tilt_that_the_force_does_not_show_a_drift_of_either_and_a_short_lean_are_no_fall(degrees, leans, seconds):
    """Rotors push along their own axis; an attitude or an accelerometer that errs is alone with it."""
    assert fallen_endings(fallen(degrees, leans, seconds)) == []


@pytest.mark.parametrize(("spin", "found"), [(0.0, [5.1]), (20.0, [])])
def test_the_pull_of_a_spin_is_no_blow(spin, found):
    """At 20 rad/s a sensor 0.1 m off the axis feels 20^2 x 0.1 / 9.81 = 4.1 g beside gravity."""
    log = flight()
    imu = log.imus[0]
    part = (imu.acc.t >= 60.0) & (imu.acc.t < 60.3)
    imu.acc.x[part] = [4.1 * 9.81, 0.0, -3.0 * 9.81]
    imu.gyro.x[part] = [0.0, 0.0, spin]
    assert [b.g for b in impact_peaks([imu], [(TAKE_OFF, LANDED)], 3.0)] == pytest.approx(found, abs=0.1)


@pytest.mark.parametrize("driven", [False, True])
def test_a_wreck_stands_again_when_it_is_upright_still_and_undriven(driven):
    """Motors that turn hold a vehicle upright too, or let it fall over."""
    log = flight(calm=True)
    air = found_in(log)
    air.driven = np.full(len(air.grid.t), driven)
    stood = crash._stood_since(air.grid, air.driven, 1.0, 25.0)
    assert (stood is None) == driven


@pytest.mark.parametrize(("asked_dps", "tumbles"), [(0.0, True), (200.0, True), (300.0, False), (600.0, False)])
def test_a_fast_turn_of_which_half_was_asked_for_is_no_tumble(asked_dps, tumbles):
    """At 500 deg/s for a second, just before the flight ends."""
    log = flight(calm=True)
    imu = log.imus[0]
    imu.gyro.x[(imu.gyro.t >= 72.0) & (imu.gyro.t < 73.0), 0] = np.radians(500.0)
    t = np.arange(0.0, 105.0, 0.02)
    asked = np.where((t >= 71.9) & (t < 73.1), asked_dps, 0.0)
    log.setpoints.rates = Stream(t, np.radians(np.column_stack([asked, 0 * t, 0 * t])), "rad/s", "FRD", "RATE")
    scene = scene_of(log)
    scene.air.spans = [(TAKE_OFF, LANDED)]
    assert [e.t for e in crash.find_tumbles(scene)] == ([pytest.approx(72.0, abs=0.01)] if tumbles else [])


def test_of_two_turns_that_are_one_the_larger_is_told_in_size_and_words(corpus):
    """It went to 113 deg, came up and lay at 162: the sentence said the one, the evidence the other."""
    log = attlog.read(corpus / "logs" / "log_copter_3.1_noimu.log")
    (found,) = (e for e in ended(log)[1] if e.kind == "overturn")
    assert found.size == pytest.approx(162.0, abs=1.0)
    assert found.why == f"it turned over to {found.size:.0f} deg"


def test_of_two_tumbles_that_are_one_the_faster_is_told_in_size_and_words():
    log = flight(calm=True)
    imu = log.imus[0]
    for t0, dps in ((70.0, 450.0), (72.0, 600.0)):
        imu.gyro.x[(imu.gyro.t >= t0) & (imu.gyro.t < t0 + 1.0), 0] = np.radians(dps)
    t = np.arange(0.0, 105.0, 0.02)
    log.setpoints.rates = Stream(t, np.zeros((len(t), 3)), "rad/s", "FRD", "RATE")
    scene = scene_of(log)
    scene.air.spans = [(TAKE_OFF, LANDED)]
    (found,) = crash.find_tumbles(scene)
    assert (found.size, "600 deg/s" in found.why) == (pytest.approx(600.0, abs=0.1), True)


@pytest.mark.parametrize(("fell_m", "counts"), [(0.0, False), (50.0, True)])
def test_a_wreck_that_spins_is_no_tumble(fell_m, counts):
    """After a blow in the air it tumbles, after one with the ground it rolls."""
    blow = CrashEvent("impact", 10.0, 10.1, 20.0, "g", "", fell_m=fell_m)
    spin = CrashEvent("tumble", 10.9, 11.5, 700.0, "deg/s", "")
    assert blow.in_air == counts
    assert crash._same_crash([blow], spin) == counts


@pytest.mark.parametrize(("driven", "angle"), [(False, 60.0), (True, None)])
def test_an_attitude_argues_with_how_it_lies_only_while_motors_push(driven, angle):
    """The onboard attitude says level: with motors off the accelerometer is right."""
    log = made(8.0, LANDED - 0.3, lies_deg=60.0)
    attitude = log.attitudes["ATT"]
    attitude.q[attitude.t > LANDED - 0.3] = [1.0, 0.0, 0.0, 0.0]
    scene = scene_of(log)
    scene.air.driven[:] = driven
    found = rest_tilt(scene, LANDED - 0.3)
    assert found == (None if angle is None else pytest.approx(angle, abs=1.0))


def test_a_bounce_is_the_landing_of_its_first_contact():
    """It touches down at 72.8 s with 8 g, hops and lands again with 5 g at 74.6 s."""
    log = made(8.0, LANDED - 2.2)
    imu = log.imus[0]
    i = int(np.searchsorted(imu.acc.t, LANDED - 0.4))
    imu.acc.x[i : i + 2] = [0.0, 0.0, -5.0 * 9.81]
    t = np.arange(0.0, 105.0, 0.1)
    for height, found in ((0.4, [72.8]), (6.0, [74.6])):
        high = np.interp(t, [35.0, 40.0, 70.0, 72.0, 74.0, 75.0], [0.0, 8.0, 8.0, height, height, 0.0])
        log.baro = [Stream(t, high[:, None], "m", "", "BARO")]
        landings = [e.t for e in endings(log) if e.kind == "hard_landing"]
        assert landings == [pytest.approx(x, abs=0.01) for x in found]


def test_a_harder_contact_later_has_its_own_time_and_each_its_own_size():
    log = made(9.0, LANDED - 0.3, lies_deg=60.0)
    imu = log.imus[0]
    for at, g in ((LANDED, 5.0), (LANDED + 0.9, 14.0)):
        i = int(np.searchsorted(imu.acc.t, at))
        imu.acc.x[i : i + 2] = [0.0, 0.0, -g * 9.81]
    found = [(e.t, e.size) for e in endings(log) if e.kind == "impact"]
    assert found == [
        (pytest.approx(LANDED - 0.3, abs=0.01), pytest.approx(9.0, abs=0.05)),
        (pytest.approx(LANDED + 0.9, abs=0.01), pytest.approx(14.0, abs=0.05)),
    ]


def test_what_tips_over_after_a_soft_landing_falls_as_it_passes_thirty_degrees():
    """It lands at 75 s, leans from 76 to 77 s and lies at 60 deg; no blow above 3 g."""
    log = flight()
    imu, attitude = log.imus[0], log.attitudes["ATT"]
    for t, x in ((imu.acc.t, imu.acc.x), (attitude.t, attitude.q)):
        lean = np.radians(np.interp(t, [76.0, 77.0], [0.0, 60.0]))
        after = t > LANDED
        turn = rotation.from_euler(lean[after], 0.0 * lean[after], 0.0 * lean[after])
        x[after] = turn if x is attitude.q else rotation.rotate_inverse(turn, np.array([0.0, 0.0, -9.81]))
    imu.gyro.x[imu.gyro.t > LANDED] *= 0.05
    air = found_in(log)
    air.spans, air.driven = [(TAKE_OFF, LANDED)], (air.grid.t > TAKE_OFF) & (air.grid.t < LANDED)
    (found,) = crash.find_crashes(log, air, [(TAKE_OFF - 5.0, LANDED)], 105.0).crash_events
    assert (found.kind, found.t) == ("overturn", pytest.approx(76.5, abs=0.06))
    assert found.size == pytest.approx(60.0, abs=1.0)


def test_a_blow_high_above_the_ground_is_one_in_the_air_and_the_ground_follows():
    """It is struck at 71 s, 20 m up, falls, and strikes the ground at 74 s, as hard."""
    log = made(8.0, LANDED - 1.0, lies_deg=60.0)
    imu = log.imus[0]
    i = int(np.searchsorted(imu.acc.t, LANDED - 4.0))
    imu.acc.x[i : i + 2] = [0.0, 0.0, -8.0 * 9.81]
    log.attitudes["ATT"].q[log.attitudes["ATT"].t >= LANDED - 3.9] = rotation.from_euler(np.radians(100.0), 0.0, 0.0)
    t = np.arange(0.0, 105.0, 0.1)
    high = np.interp(t, [35.0, 40.0, 72.0, 74.0], [0.0, 20.0, 20.0, 0.0])
    log.baro = [Stream(t, high[:, None], "m", "", "BARO")]
    blows = [e for e in endings(log) if e.kind == "impact"]
    assert [(round(e.t), e.in_air) for e in blows] == [(71, True), (74, False)]


def test_a_wreck_that_lies_over_with_motors_driven_hit_the_ground(corpus):
    """17 g at 21.7 s, then tumbling upside down with throttle for eight seconds more, which is no flight."""
    found = ended(attlog.read(corpus / "logs" / "bin_copter_3.3dev_solo_tumble_cut.bin"))[1]
    assert [(e.kind, round(e.t, 1)) for e in found] == [("overturn", 21.5), ("impact", 21.7)]
