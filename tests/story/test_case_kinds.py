"""The kinds of error of 28 real logs, each shown gone by a flight that was made: the corpus is not needed for these.

The logs themselves are read by tests/segments/test_cases.py, tests/health/test_cases.py, tests/story/test_story.py,
tests/segments/test_crash.py and tests/segments/test_in_air.py.
"""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from attlog import segments, story
from attlog.flight.builder import LogBuilder
from attlog.flight.model import FlightLog, Stream, TimeLine
from attlog.flight.px4.clipping import gyro_mask_problem
from attlog.segments import spans
from tests.flight.fake import messages
from tests.segments.flights import imu_log
from tests.segments.test_in_air import carried

CASES = {
    "copter_3.3dev_118": "story.test_case_kinds::test_a_landed_flag_in_the_air_ends_no_flight",
    "copter_3.3dev_37": "segments.test_crash::"
    "test_a_fall_to_one_side_with_motors_driven_is_a_crash_though_it_never_flew",
    "copter_3.3dev_31": "segments.test_crash::test_a_blow_in_the_air_that_is_flown_on_is_none_of_these",
    "copter_3.3dev_181": "health.test_planted::test_a_force_that_vibration_takes_away_is_told_by_the_barometer",
    "rover_2.46_61": "simulate.test_logs_findings::test_a_planted_fault_is_found",
    "copter_4.4dev_sitl_swarm": "segments.test_rest::test_a_calm_hover_is_never_rest",
    "copter_4.7dev_sitl_climb": "story.test_case_kinds::test_a_climb_as_still_as_a_table_is_no_rest",
    "px4_1.6.5_hand_rotation": "health.onboard.test_against_smoother::"
    "test_a_tilt_that_is_off_for_long_is_the_wrong_one_with_size_sigma_and_time",
    "px4_1.6.5_bench": "health.test_health::test_a_rest_counts_only_when_filters_have_settled",
    "copter_4.7dev_33": "health.test_planted::test_an_estimated_bias_is_told_as_tilt_and_as_what_it_explains",
    "copter_3.6.8_compass": "health.test_planted::test_a_field_that_follows_the_throttle_is_told_in_percent",
    "px4_1.17dev_hil_absurd": "flight.test_odd_values::test_a_log_that_is_mostly_damaged_is_not_told_what_to_log",
    "copter_3.5.7_radio": "story.test_case_kinds::test_a_unit_at_one_hertz_shows_rest_and_no_movement",
    "copter_3.2.1_bench": "segments.test_flags::test_throttle_without_climb_is_no_flight",
    "px4_1.8_hexa": "present.test_lag::test_less_than_half_a_sample_is_no_lag",
    "copter_4.8dev_barodrift": "flight.ardupilot.test_advice::"
    "test_limits_of_the_rate_are_named_where_they_are_the_reason",
    "px4_1.14_clipping_crash": "story.test_simulated::"
    "test_a_wreck_that_is_carried_home_is_told_from_then_on_and_does_not_fly",
    "plane_px4_1.13_crash": "story.test_simulated::test_a_plane_that_rolls_in_is_told_by_the_rules_for_planes",
    "copter_flip_at_takeoff": "story.test_simulated::test_headlines_of_scenarios_say_what_happened",
    "copter_heading_28deg_off": "health.fits.test_planted_sensors::"
    "test_iron_beside_the_compass_is_an_offset_in_its_axes",
    "copter_never_lifted": "story.test_simulated::test_what_happens_in_a_scenario_is_told_at_its_time_and_nothing_else",
    "copter_falsely_accused": "health.onboard.test_against_smoother::"
    "test_a_heading_of_which_the_smoother_is_not_sure_judges_nobody",
    "px4_1.14_hard_landing": "segments.test_crash::test_the_same_blow_upright_is_a_hard_landing",
    "px4_1.14_clipping_field": "story.test_case_kinds::test_a_mask_that_is_none_is_no_gyro_at_the_end_of_its_range",
    "copter_two_compasses": "health.fits.test_planted_sensors::test_iron_beside_the_compass_is_an_offset_in_its_axes",
    "copter_4.6_standing_accused": "health.onboard.test_against_smoother::"
    "test_nothing_is_judged_where_the_smoother_is_no_reference",
    "gcs_heartbeats": "flight.mavlink.test_mavlink::"
    "test_a_ground_stations_file_without_a_vehicle_ends_with_65_and_that_sentence",
    "copter_4.2_radio_4hz": "story.test_case_kinds::test_telemetry_at_four_hertz_tells_the_flight_and_no_blow",
}
"""Case (a log's name without its suffix) to the test that shows its kind."""


@pytest.mark.parametrize("case", CASES)
def test_every_case_has_a_test_of_its_kind(case: str) -> None:
    module, _, name = CASES[case].partition("::")
    assert hasattr(importlib.import_module(f"tests.{module}"), name)


def flown(log: FlightLog) -> list[spans.Span]:
    return segments.build(log).spans("airborne")


def test_a_landed_flag_in_the_air_ends_no_flight() -> None:
    """LAND_COMPLETE_MAYBE comes in slow descents, too."""
    log = carried(0.05)
    (whole,) = flown(log)
    log.landed = TimeLine(np.array([0.0, 6.0, 12.0]), [True, False, True], "EV")
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


@pytest.mark.parametrize(("mask", "release", "told"), [(243, 0x010E0300, 0), (7, 0x010E0300, 0), (1, 0x010F00FF, 1)])
def test_a_mask_that_is_none_is_no_gyro_at_the_end_of_its_range(mask: int, release: int, told: int) -> None:
    """Before 1.15 the memory is unset; three axes make a mask of up to 7; above 80 % of the range it is believed."""
    column = "gyro_clipping"
    masks = np.zeros(50, np.uint8)
    masks[20] = mask
    made = messages(
        "ulog", {("sensor_combined", 0): {"timestamp": np.arange(50), column: masks}}, info={"ver_sw_release": release}
    )
    rate = np.full((50, 3), np.radians(1900.0))
    table = made.tables["sensor_combined", 0]
    assert len(gyro_mask_problem(LogBuilder(made), "sensor_combined", table, column, rate)) == told


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
