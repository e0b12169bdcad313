"""Units, axes and choices of ArduPilot's rarer messages: other numbers in every column."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.flight.ardupilot import drive, estimator, imu, sensors, vehicle
from attlog.flight.ardupilot.imu import DataflashBuilder
from attlog.flight.model import Attitude, Problem
from tests.flight import fake
from tests.flight.fake import messages

N = 6
T = fake.micros(N, 10.0)


def made(*known: tuple[str, int, dict[str, Any]], stamps: Any = T, **values: float) -> DataflashBuilder:
    """Return a builder of messages (name, instance, columns) at the same times, with parameters at boot."""
    tables = {
        (name, k): {"TimeUS": stamps, **{key: np.asarray(x) for key, x in columns.items()}}
        for name, k, columns in known
    }
    return DataflashBuilder(fake.messages("dataflash", tables, values), t0_us=int(T[0]))


def ramp(*factors: float) -> list[np.ndarray]:
    return [f * (1.0 + np.arange(N)) for f in factors]


def receiver(**more: Any) -> dict[str, Any]:
    values = {"Lat": 47.1, "Lng": -8.2, "Alt": 430.0, "Spd": 5.0, "GCrs": 120.0, "VZ": -0.7, "HDop": 0.8}
    found = {name: np.full(N, value) for name, value in values.items()}
    return {**found, "Status": np.full(N, 3, np.uint8), "NSats": np.full(N, 14, np.uint8), **more}


def test_a_receivers_velocity_follows_from_speed_course_and_vertical_speed() -> None:
    builder = made(("GPS", 0, receiver()))
    one = sensors.read_receiver(builder, 0, builder.messages["GPS", 0])
    assert one is not None
    assert (one.lat[0], one.lon[0], one.alt[0]) == (47.1, -8.2, 430.0)
    np.testing.assert_allclose(one.vel_ned[0], [5.0 * np.cos(np.radians(120)), 5.0 * np.sin(np.radians(120)), -0.7])
    assert np.isnan(one.h_acc).all()
    assert one.yaw is None


def test_an_accuracy_is_that_of_the_nearest_record_of_its_unit_within_half_a_second() -> None:
    at = (int(T[0]) + np.array([0, 400_000, 2_000_000])).astype(np.uint64)
    tables: Any = {
        ("GPA", 0): {"TimeUS": at, "HAcc": np.array([1.0, 2.0, 3.0]), "VAcc": np.array([4.0, 5.0, 6.0])},
        ("GPA", 1): {"TimeUS": at, "HAcc": np.array([7.0, 8.0, 9.0])},
    }
    messages = fake.messages("dataflash", tables)
    builder = DataflashBuilder(messages, t0_us=int(T[0]))
    asked = int(T[0]) + np.array([0, 190_000, 210_000, 899_000, 901_000, 1_499_000, 1_501_000, 2_500_000, 2_501_000])
    found = sensors.nearest_accuracy(builder, 0, asked, "HAcc")
    np.testing.assert_array_equal(found, [1.0, 1.0, 2.0, 2.0, np.nan, np.nan, 3.0, 3.0, np.nan])
    np.testing.assert_array_equal(sensors.nearest_accuracy(builder, 1, asked[:1], "HAcc"), [7.0])
    assert np.isnan(sensors.nearest_accuracy(builder, 1, asked, "VAcc")).all()


def test_copter_3_1_logs_its_motors_by_number() -> None:
    builder = made(("MOT", 0, {f"Mot{n}": np.full(N, 1000.0 + 100.0 * n) for n in range(1, 5)}))
    builder.log.vehicle, builder.values = "quadrotor", {"RC3_MIN": 1000.0, "RC3_MAX": 2000.0, "THR_MIN": 0.0}
    found = drive.motor_outputs(builder)
    assert found is not None
    np.testing.assert_allclose(found.x[0], [0.1, 0.2, 0.3, 0.4])


def test_motors_are_the_outputs_with_their_function_between_their_limits() -> None:
    outputs = {f"C{n}": np.full(N, 1000.0 + 100.0 * n) for n in range(1, 9)}
    builder = made(("RCOU", 0, outputs))

    def shares(vehicle: str = "quadrotor", **values: float) -> Any:
        builder.log.vehicle, builder.values = vehicle, values
        found = sensors.motor_outputs(builder)
        return None if found is None else found.x[0]

    limits = {"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0}
    np.testing.assert_allclose(shares(**limits), [0.0, 0.125, 0.25, 0.375])
    functions = {"SERVO5_FUNCTION": 33.0, "SERVO7_FUNCTION": 82.0, "SERVO8_FUNCTION": 85.0, "SERVO1_FUNCTION": 41.0}
    np.testing.assert_allclose(shares(**limits, **functions), [0.5, 0.75, 0.875])
    np.testing.assert_allclose(shares(RC3_MIN=1000.0, RC3_MAX=2000.0, MOT_PWM_MIN=0.0), [0.1, 0.2, 0.3, 0.4])
    other = {"RCMAP_THROTTLE": 2.0, "RC2_MIN": 1100.0, "RC2_MAX": 1200.0, "RC3_MIN": 1000.0, "RC3_MAX": 2000.0}
    assert shares(**other) is not None
    assert shares(**(other | {"RC2_MAX": 1199.0})) is None
    assert shares("plane", **limits) is None
    assert shares() is None


def test_rotor_speeds_are_those_of_the_escs_else_of_the_sensors() -> None:
    one, two = ramp(1000.0, 300.0)
    builder = made(("ESC", 0, {"RPM": one}), ("ESC", 1, {"RPM": two}), ("RPM", 0, {"rpm1": two}))
    found = sensors.rpm_stream(builder)
    assert found is not None
    assert (found.source, found.x[1].tolist()) == ("ESC", [2000.0, 600.0])
    builder = made(("RPM", 0, {"rpm1": one, "rpm2": two}))
    found = sensors.rpm_stream(builder)
    assert found is not None
    assert (found.source, found.x[1].tolist()) == ("RPM", [2000.0, 600.0])


@pytest.mark.parametrize(
    ("volts", "scale"), [(np.full(N, 1480, np.int16), 0.01), (np.full(N, 151.0), 0.01), (np.full(N, 149.0), 1.0)]
)
def test_a_battery_of_whole_numbers_or_above_150_v_is_in_hundredths(volts: np.ndarray, scale: float) -> None:
    builder = made(("BAT", 0, {"Volt": volts, "Curr": 10.0 * np.ones(N)}))
    found = sensors.battery_stream(builder)
    assert found is not None
    np.testing.assert_allclose(found.x[0], [scale * float(volts[0]), 10.0 * scale])


ANGLES = np.column_stack(ramp(2.0, -3.0, 20.0))


def matches(q: np.ndarray, degrees: np.ndarray) -> bool:
    wanted = Rotation.from_euler("ZYX", degrees[:, ::-1], degrees=True).as_quat()
    return bool(np.allclose(np.abs(np.sum(q * np.roll(wanted, 1, axis=1), axis=1)), 1.0, atol=1e-9))


def test_set_points_stand_beside_the_attitude_that_flew() -> None:
    columns = dict(zip(("DesRoll", "DesPitch", "DesYaw"), ANGLES.T, strict=True))
    doubled = {name: 0.5 * x for name, x in columns.items()}
    builder = made(("ATT", 0, columns), ("ANG", 0, doubled))
    for flew, source, factor in (("ATT", "ATT.Des", 1.0), ("ANG", "ANG.Des", 0.5), (None, "ANG.Des", 0.5)):
        builder.log.onboard = flew
        found = estimator.attitude_setpoint(builder)
        assert found is not None
        assert found.source == source
        assert matches(found.q, factor * ANGLES)
    builder = made(("ATT", 0, {"DesRoll": ANGLES[:, 0]}))
    builder.log.onboard = "ATT"
    assert estimator.attitude_setpoint(builder) is None


def test_a_pose_has_its_time_of_measurement_and_not_what_the_vehicle_ignored() -> None:
    columns = dict(zip(("R", "P", "Y"), ANGLES.T, strict=True))
    more = {"CTimeMS": (9_950 + 100 * np.arange(N)).astype(np.uint32), "Ign": np.array([0, 1, 0, 0, 0, 0], np.uint8)}
    builder = made(("VISP", 0, {**columns, **more, "Rst": np.array([0, 0, 0, 1, 1, 1], np.uint8)}))
    found = estimator.vision_poses(builder)["VISP"]
    assert matches(found.q, np.delete(ANGLES, 1, axis=0))
    assert found.t_sample is not None
    np.testing.assert_allclose(found.t - found.t_sample, 0.05, atol=1e-9)
    assert found.resets.tolist() == [2]
    builder = made(("VISP", 0, {"R": ANGLES[:, 0], "Y": ANGLES[:, 2]}))
    assert estimator.vision_poses(builder) == {}


def flown(seconds: float, hz: float, begin: float = 0.0) -> Attitude:
    t = begin + np.arange(0.0, seconds, 1.0 / hz)
    return Attitude(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), "X")


def test_the_attitude_that_flew_is_the_fast_one_where_it_covers_as_much() -> None:
    att = flown(100.0, 10.0)
    for ang, wins in ((flown(100.0, 400.0), "ANG"), (flown(60.0, 400.0), "ATT"), (flown(100.0, 9.0), "ATT")):
        assert estimator.onboard_source({"ANG": ang, "ATT": att}, "XK", 1) == wins
    others = {"AHR2": att, "XKQ.0": att, "XKQ.1": att, "XKF1.1": att}
    assert estimator.onboard_source(others, "XK", 1) == "XKQ.1"
    assert estimator.onboard_source(others, "XK", None) == "XKQ.0"
    assert estimator.onboard_source({"AHR2": att, "XKF1.1": att}, "XK", 1) == "XKF1.1"
    assert estimator.onboard_source({"AHR2": att, "XKF1.1": att}, "XK", 0) == "AHR2"
    assert estimator.onboard_source({}, "", None) is None


def compass(factor: float = 1.0) -> dict[str, Any]:
    field = dict(
        zip(
            ("MagX", "MagY", "MagZ"),
            (200.0 * factor + np.arange(N), -100.0 * np.ones(N), 400.0 * np.ones(N)),
            strict=True,
        )
    )
    return {**field, "OfsX": np.array([5.0] * 3 + [6.0] * 3), "OfsY": np.ones(N), "OfsZ": np.zeros(N)}


def test_a_compass_counts_milligauss_and_its_offsets_stand_at_each_change() -> None:
    builder = made(("MAG", 0, compass()))
    (one,) = sensors.magnetometers(builder)
    np.testing.assert_allclose(one.field.x[2], 1e-7 * np.array([202.0, -100.0, 400.0]))
    assert one.offsets is not None
    np.testing.assert_allclose(one.offsets.x, 1e-7 * np.array([[5.0, 1.0, 0.0], [6.0, 1.0, 0.0]]))
    np.testing.assert_allclose(one.offsets.t, [0.0, 0.3])


def test_each_compass_is_switched_by_its_own_parameter() -> None:
    builder = made(*(("MAG", k, compass(1.0 + k)) for k in range(3)))
    for values, enabled in (
        ({}, [True, True, True]),
        ({"COMPASS_USE": 0.0}, [False, True, True]),
        ({"COMPASS_USE2": 0.0}, [True, False, True]),
        ({"COMPASS_USE3": 0.0}, [True, True, False]),
    ):
        builder.values = values
        assert [m.enabled for m in sensors.magnetometers(builder)] == enabled


def test_the_first_compass_or_the_primary_one_is_preferred() -> None:
    builder = made(("MAG", 1, compass()), ("MAG", 2, compass(2.0)))
    assert sensors.primary_compass(builder) is None
    builder.log.mags = sensors.magnetometers(builder)
    assert sensors.primary_compass(builder) == 1
    builder.values["COMPASS_PRIMARY"] = 2.0
    assert sensors.primary_compass(builder) == 2


def test_rates_are_degrees_per_second_and_the_rangefinder_looks_down_within_its_range() -> None:
    names = ("RDes", "PDes", "YDes", "R", "P", "Y")
    builder = made(
        ("RATE", 0, dict(zip(names, ramp(1.0, -2.0, 3.0, 9.0, 9.0, 9.0), strict=True))),
        ("RFND", 0, {"Dist": ramp(1.0)[0], "Orient": np.zeros(N), "Stat": np.full(N, 4)}),
        ("RFND", 1, {"Dist": ramp(2.0)[0], "Orient": np.full(N, 25), "Stat": np.array([4, 3, 4, 4, 5, 4])}),
    )
    rates = sensors.rate_setpoint_stream(builder)
    assert rates is not None
    np.testing.assert_allclose(np.degrees(rates.x[1]), [2.0, -4.0, 6.0])
    found = sensors.rangefinder_stream(builder)
    assert found is not None
    assert found.x[:, 0].tolist() == [2.0, 6.0, 8.0, 12.0]


def test_airspeed_is_true_and_that_of_the_primary_tube_while_it_is_sound_and_used() -> None:
    """At 79,495 Pa (2,000 m) air has 0.8217 of its density at sea level (standard atmosphere, tabulated)."""
    flags = {"Pri": np.ones(N), "H": np.array([0, 1, 1, 1, 1, 1]), "U": np.array([1, 1, 1, 1, 0, 1])}
    builder = made(
        ("ARSP", 0, {"Airspeed": ramp(9.0)[0], **flags}),
        ("ARSP", 1, {"Airspeed": ramp(10.0)[0], **flags}),
        ("BARO", 0, {"Press": np.full(N, 79_495.0)}),
    )
    found = sensors.airspeed_stream(builder)
    assert found is not None
    np.testing.assert_allclose(found.x[:, 0], np.array([20.0, 30.0, 40.0, 60.0]) / np.sqrt(0.8217), rtol=1e-3)
    builder = made(("ARSP", 0, {"Airspeed": ramp(10.0)[0]}))
    old = sensors.airspeed_stream(builder)
    assert old is not None
    assert old.x[:, 0].tolist() == [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
    assert sensors.airspeed_stream(made(("BARO", 0, {"Press": np.full(N, 1e5)}))) is None


def test_a_record_without_a_time_has_that_of_the_record_before_it_in_the_file() -> None:
    builder = made(("ATT", 0, {"Roll": np.zeros(N)}))
    clock, at = builder.clock, builder.messages["ATT", 0].offsets
    asked = np.array([at[0] - 1, at[0], at[0] + 1, at[3] + 50, at[-1] + 999])
    stamps = T.astype(np.int64)
    assert clock.at(asked).tolist() == [stamps[0], stamps[0], stamps[0], stamps[3], stamps[-1]]


@pytest.mark.parametrize("which", ["DADT", "DVDT"])
@pytest.mark.parametrize(("seconds", "kept"), [(0.9e-5, 5), (1.1e-5, 6), (0.99, 6), (1.01, 5), (np.nan, 5)])
def test_increments_over_no_time_or_more_than_a_second_are_left_out(which: str, seconds: float, kept: int) -> None:
    columns = {"DADT": np.full(N, 0.01), "DVDT": np.full(N, 0.02)}
    columns[which][2] = seconds
    columns |= {name: np.full(N, x) for name, x in zip(("DAX", "DAY", "DAZ"), (0.001, -0.002, 0.003), strict=True)}
    columns |= {name: np.full(N, x) for name, x in zip(("DVX", "DVY", "DVZ"), (0.2, 0.4, -0.6), strict=True)}
    table = fake.table("RISI", 3, columns, np.arange(N))
    found = imu.candidate_from_increments(3, 1, T.astype(np.int64), table, imu.RISI_COLUMNS, "RISI:3")
    assert len(found.t_us) == len(found.gyro) == kept
    np.testing.assert_allclose(found.gyro[0], [0.1, -0.2, 0.3])
    np.testing.assert_allclose(found.acc[0], [10.0, 20.0, -30.0])


def test_an_ekf_core_uses_the_set_bits_of_its_mask_in_their_order() -> None:
    masked, free = made(EK3_IMU_MASK=0b0110), made()
    assert [imu.unit_of_core(masked, "XK", core, [0, 1]) for core in range(3)] == [1, 2, 0]
    assert [imu.unit_of_core(free, "XK", core, [0, 1]) for core in range(3)] == [0, 1, 0]


def test_the_family_that_flew_is_that_of_its_type_and_cores_out_of_range_tell_nothing() -> None:
    lanes = {"PI": np.array([0, 1, 7, -1, 5, 6], np.int8)}
    builder = made(("NKF4", 0, lanes), ("XKF4", 0, lanes))
    for ekf, family in ((None, "XK"), (2.0, "NK"), (3.0, "XK")):
        builder.values = {} if ekf is None else {"AHRS_EKF_TYPE": ekf}
        assert imu.primary_core(builder)[0] == family
    _, t_us, cores = imu.primary_core(builder)
    assert (cores, (t_us - int(T[0])).tolist()) == ([0, 1, 5], [0, 100_000, 400_000])
    assert imu.primary_core(made())[0] == ""


# What ERR and EV records say: codes of the firmware's list, severities, when first and how often.

# subsystem, code, a word of its meaning, severity: of ArduPilot's list of error codes
LISTED = [
    (3, 1, "compass failed to start", "warning"),
    (7, 1, "GNSS failsafe", "warning"),
    (11, 2, "GNSS glitch", "warning"),
    (12, 1, "Crash check", "error"),
    (16, 2, "EKF check", "warning"),
    (17, 1, "EKF failsafe", "error"),
    (22, 6, "range finder", "note"),
    (29, 1, "Vibration failsafe", "warning"),
    (9, 6, ": circle and polygon", "warning"),
    (9, 16, ": code 16", "warning"),
    (10, 5, "flight mode 5 was refused", "note"),
    (24, 0, "switched to lane 0", "warning"),
    (12, 9, "Subsystem 12 reported error 9", "note"),
    (99, 1, "Subsystem 99 reported error 1", "note"),
]


def told(record: str, rows: Iterable[tuple[int, ...]], step_us: int = 1_000_000) -> list[Problem]:
    """Problems by the records, a second apart from 10 s on, in a log that begins at 10 s."""
    numbers = np.array(list(rows))
    names = ("Subsys", "ECode") if record == "ERR" else ("Id",)
    columns = {"TimeUS": 10_000_000 + step_us * np.arange(len(numbers)).astype(np.uint64)}
    made = messages("dataflash", {(record, 0): columns | {n: numbers[:, k] for k, n in enumerate(names)}})
    builder = DataflashBuilder(made, t0_us=10_000_000)
    vehicle.report_events(builder)
    return builder.problems


@pytest.mark.parametrize(("subsystem", "code", "words", "severity"), LISTED)
def test_a_code_means_what_the_firmwares_list_says(subsystem: int, code: int, words: str, severity: str) -> None:
    meaning = vehicle.error_meaning(subsystem, code)
    assert meaning is not None
    assert (words in meaning.text, meaning.severity) == (True, severity)


@pytest.mark.parametrize("subsystem", [3, 9, 10, 16, 99])
def test_code_0_ends_a_fault(subsystem: int) -> None:
    assert vehicle.error_meaning(subsystem, 0) is None


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


# Which of ArduPilot's attitudes flew.
