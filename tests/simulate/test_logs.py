"""A simulated flight written as a log and read back: the same numbers to the format's steps, on one clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog import flight as flights
from attlog import formats
from attlog.core import rotation
from attlog.flight.model import FlightLog
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.logs import recording, write
from attlog.simulate.logs.records import START_US, logged_samples, micros, vibration
from attlog.simulate.scenario import build_scenario, scenario_values
from attlog.simulate.scenario_text import override_values
from tests.conftest import few
from tests.formats.reference import differences

SUFFIXES = (".ulg", ".bin", ".tlog")
TWO = tuple(f"sensors.{kind}.1.rate_hz={hz}" for kind, hz in (("imu", 400), ("mag", 20), ("gnss", 10), ("baro", 10)))


def made(name: str, *settings: str, seed: int = 0) -> Flight:
    return fly(build_scenario(override_values(scenario_values(name), settings)), seed)


@pytest.fixture(scope="module")
def flown() -> Flight:
    """The first 30 s of the hover: at rest, armed, taken off."""
    return made("hover", "seconds=30", *TWO)


@pytest.fixture(scope="module")
def logs(flown: Flight, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("logs")
    paths = {suffix: folder / f"hover{suffix}" for suffix in SUFFIXES}
    for path in paths.values():
        write(path, flown)
    return paths


@pytest.fixture(scope="module")
def read(logs: dict[str, Path]) -> dict[str, FlightLog]:
    return {suffix: flights.read(path) for suffix, path in logs.items()}


def on_log(log: FlightLog, t: np.ndarray) -> np.ndarray:
    """Times of the flight on the log's clock, as whole microseconds."""
    return (micros(t).astype(np.int64) - log.t0_us) * 1e-6


def close(x: np.ndarray, y: np.ndarray, atol: float, rtol: float = 3e-7) -> None:
    np.testing.assert_allclose(x, y, rtol=rtol, atol=atol)


@pytest.mark.parametrize("suffix", few([".ulg", ".bin"], 1))
def test_every_unit_comes_back(suffix: str, flown: Flight, read: dict[str, FlightLog]) -> None:
    log = read[suffix]
    assert [imu.index for imu in log.imus] == [0, 1]
    for imu, written in zip(log.imus, flown.imus, strict=True):
        assert imu.gyro.sampling == written.sampling == "interval"
        assert imu.calibrated
        close(imu.gyro.t, on_log(log, written.t_sample), 1e-9)
        close(imu.gyro.x, written.gyro, 1e-8)
        close(imu.acc.x, written.acc, 1e-6)
        assert imu.dt is not None
        close(imu.dt, written.dt, 1e-6)


def test_a_telemetry_link_carries_what_its_steps_hold(flown: Flight, read: dict[str, FlightLog]) -> None:
    log = read[".tlog"]
    assert [imu.gyro.source for imu in log.imus] == ["RAW_IMU", "SCALED_IMU2"]
    for imu, written in zip(log.imus, flown.imus, strict=True):
        # the link's periods begin at whole multiples of 20 ms: seven samples, then eight at a time
        whole = 7 + 8 * ((len(written.t) - 7) // 8)
        middle = written.t_sample[7:whole].reshape(-1, 8)[:, -1] - 0.01
        close(imu.gyro.t[1 : len(middle) + 1], on_log(log, middle), 1e-3)
        for got, x, step in ((imu.gyro.x, written.gyro, 1e-3), (imu.acc.x, written.acc, 9.80665e-3)):
            means = x[7:whole].reshape(-1, 8, 3).mean(axis=1)
            close(got[1 : len(means) + 1], means, 0.50001 * step)
    assert log.utc_offset == pytest.approx(flown.scenario.place.unix_time + (log.t0_us - START_US) * 1e-6, abs=1e-3)


@pytest.mark.parametrize(("suffix", "step_t"), [(".ulg", 1e-11), (".bin", 0.50001e-7)])
def test_compasses_receivers_and_barometers_come_back(
    suffix: str, step_t: float, flown: Flight, read: dict[str, FlightLog]
) -> None:
    log = read[suffix]
    assert len(log.mags) == len(log.gnss) == len(log.baro) == 2
    for mag, written in zip(log.mags, flown.mags, strict=True):
        assert mag.field.t_sample is not None
        close(mag.field.t, on_log(log, written.t), 1e-9)
        close(mag.field.t_sample, on_log(log, written.t_sample), 1e-9)
        close(mag.field.x, written.field, step_t)
    cm = 1e-9 if suffix == ".ulg" else 0.00501
    for gnss, fixes in zip(log.gnss, flown.gnss, strict=True):
        close(gnss.t, on_log(log, fixes.t), 1e-9)
        for got, wanted in ((gnss.lat, fixes.lat), (gnss.lon, fixes.lon)):
            close(got, wanted, 1e-12 if suffix == ".ulg" else 0.50001e-7, 1e-15)
        close(gnss.alt, fixes.alt, cm, 1e-12)
        close(gnss.vel_ned, fixes.vel, 1e-6)
        close(gnss.h_acc, fixes.h_acc, cm)
        assert gnss.utc_us is not None
        close(gnss.utc_us * 1e-6, fixes.utc, 1e-6 if suffix == ".ulg" else 0.501e-3, 1e-16)
    for baro, heights in zip(log.baro, flown.baro, strict=True):
        close(baro.t, on_log(log, heights.t), 1e-9)
        close(np.diff(baro.x[:, 0]), np.diff(heights.height), 1e-4)


@pytest.mark.parametrize(("suffix", "rate"), [(".ulg", 100.0), (".bin", 100.0), (".tlog", 25.0)])
def test_attitudes_come_back(suffix: str, rate: float, flown: Flight, read: dict[str, FlightLog]) -> None:
    log, board = read[suffix], flown.onboard
    known = np.isfinite(board.q).all(axis=1)
    t, q = board.t[known], board.q[known]
    own, packets = (1e-3, 2e-3) if suffix == ".tlog" else (1e-9, 1e-9)  # SIM_STATE has no clock but its packets'
    truth = flown.truth
    for got, t_all, q_all, clock in ((log.onboard_attitude, t, q, own), (log.truth, truth.t, truth.q, packets)):
        k = logged_samples(t_all, rate)
        assert got is not None
        close(got.t, on_log(log, t_all[k]), clock)
        assert np.degrees(rotation.total_angle(rotation.earth_error(got.q, q_all[k]))).max() < 1e-4
    if suffix != ".tlog":
        assert log.estimator.gyro_bias is not None
        k = logged_samples(t, 1.0 if suffix == ".ulg" else 10.0)
        close(log.estimator.gyro_bias.x, board.bias[known][k], 1e-8 if suffix == ".ulg" else np.radians(0.00501))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_set_points_come_back(suffix: str, flown: Flight, read: dict[str, FlightLog]) -> None:
    log, board = read[suffix], flown.onboard
    known = np.isfinite(board.q).all(axis=1)
    rate = {".ulg": (50.0, 50.0), ".bin": (100.0, 50.0), ".tlog": (10.0, 10.0)}[suffix]
    t = board.t[known]
    wanted = board.q_setpoint[known][logged_samples(t, rate[0])]
    assert log.setpoints.attitude is not None
    set_ = np.abs(np.sum(wanted**2, axis=1) - 1.0) < 1e-6
    assert (
        np.degrees(rotation.total_angle(rotation.earth_error(log.setpoints.attitude.q[-50:], wanted[set_][-50:]))).max()
        < 1e-4
    )
    assert log.setpoints.rates is not None
    close(log.setpoints.rates.x[-50:], board.rate_setpoint[known][logged_samples(t, rate[1])][-50:], 1e-6)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_states_battery_rotors_and_parameters_come_back(suffix: str, flown: Flight, read: dict[str, FlightLog]) -> None:
    log, board = read[suffix], flown.onboard
    assert (log.simulated, log.vehicle) == (True, "quadrotor")
    assert log.state.armed is not None
    assert log.state.armed.value == [value for _, value in board.armed]
    assert log.state.landed is not None
    assert log.state.landed.value == [value for _, value in board.landed]
    late = 1e-3 if suffix == ".tlog" else 1e-6
    for line, events in ((log.state.armed, board.armed), (log.state.landed, board.landed)):
        close(line.t[1:], [t + (START_US - log.t0_us) * 1e-6 for t, _ in events[1:]], late)
    assert log.state.mode is not None
    assert len(log.state.mode.value) == len(dict(board.mode))
    assert log.power.rpm is not None
    assert flown.rpm is not None
    k = logged_samples(flown.rpm.t, 5.0 if suffix == ".tlog" else 0.0)
    close(log.power.rpm.x, flown.rpm.rpm[k], 0.501)
    assert log.power.battery is not None
    assert flown.battery is not None
    k = logged_samples(flown.battery.t, 5.0 if suffix == ".tlog" else 0.0)
    close(log.power.battery.x, np.column_stack([flown.battery.voltage, flown.battery.current])[k], 0.00501)
    assert log.power.throttle is not None
    assert np.max(log.power.throttle.x) == pytest.approx(float(np.nanmax(board.thrust_setpoint)), abs=0.02)
    assert log.parameters.declination == pytest.approx(flown.declination_deg, abs=1e-5)
    gain = "MC_ROLL_P" if suffix == ".ulg" else "ATC_ANG_RLL_P"
    assert log.param(gain) == pytest.approx(flown.scenario.controller.angle_kp)
    assert any("simulated this flight" in text for _, _, text in log.texts)
    assert not [p for p in log.problems if p.severity in ("warning", "error")]


@pytest.mark.parametrize("suffix", few(SUFFIXES, 1))
def test_the_official_libraries_read_every_value_of_a_flight(suffix: str, logs: dict[str, Path]) -> None:
    assert differences(logs[suffix]) == []


@pytest.mark.slow
def test_same_seed_same_bytes_and_another_seed_other_bytes(tmp_path: Path) -> None:
    for seed, name in ((4, "a"), (4, "b"), (5, "c")):
        flight = made("static", "seconds=5", seed=seed)
        for suffix in (*SUFFIXES, ".mcap"):
            write(tmp_path / f"{name}{suffix}", flight)
    for suffix in (*SUFFIXES, ".mcap"):
        one, same, other = ((tmp_path / f"{name}{suffix}").read_bytes() for name in "abc")
        assert one == same
        assert one != other


def test_instants_are_logged_as_such(tmp_path: Path) -> None:
    slow = ("sensors.imu.0.sampling=instant", "sensors.imu.0.gyro.lowpass_hz=80", "sensors.imu.0.acc.lowpass_hz=20")
    flight = made("static", "seconds=8", *slow)
    write(tmp_path / "a.bin", flight)
    imu = flights.read(tmp_path / "a.bin").imus[0]
    assert (imu.gyro.source, imu.gyro.sampling, imu.filtered) == ("IMU:0", "instant", "low-pass 80 Hz")
    assert imu.gyro.delay == pytest.approx(np.sqrt(2) / (2 * np.pi * 80), rel=1e-3)
    close(imu.gyro.x, flight.imus[0].gyro, 1e-8)
    write(tmp_path / "a.ulg", flight)
    imu = flights.read(tmp_path / "a.ulg").imus[0]
    assert (imu.gyro.source, imu.gyro.sampling, imu.calibrated) == ("sensor_gyro:0", "instant", True)
    close(imu.gyro.x, flight.imus[0].gyro, 1e-8)
    close(imu.acc.x, flight.imus[0].acc, 2e-6)


@pytest.mark.slow
def test_a_fast_unit_is_logged_raw(tmp_path: Path) -> None:
    fast = made("static", "seconds=8", "sensors.imu.0.sampling=instant", "sensors.imu.0.rate_hz=2000")
    write(tmp_path / "a.bin", fast)
    log = flights.read(tmp_path / "a.bin")
    assert log.imus[0].gyro.source == "GYR:0"
    close(log.imus[0].gyro.t, on_log(log, fast.imus[0].t_sample), 1e-9)
    close(log.imus[0].gyro.x, fast.imus[0].gyro, 1e-8)
    assert formats.open(tmp_path / "a.bin")["IMU", 0].fields["GyrX"].unit == "rad/s"


def test_increments_of_an_old_record_lie_beside_instants_at_the_middle_of_each(flown: Flight) -> None:
    messages = recording(flown, "dataflash").messages
    imu = flown.imus[0]
    close(messages["IMU", 0]["TimeUS"].astype(np.int64) - START_US, (imu.t_sample - imu.dt / 2) * 1e6, 0.51)


def test_units_and_multipliers_are_those_of_the_firmware(corpus: Path, logs: dict[str, Path]) -> None:
    """Column by column against a log of ArduPilot's own simulator."""
    theirs = formats.open(corpus / "sitl" / "ardupilot" / "copter_loop400.bin")
    mine = formats.open(logs[".bin"])
    compared = 0
    for (name, instance), table in mine.items():
        firmware = theirs.tables.get((name, 0))
        if firmware is None or instance or name in ("RCOU", "FMT", "UNIT", "MULT"):
            continue  # the firmware's RCOU has more channels
        for column, field in firmware.fields.items():
            assert (table.fields[column].dtype, table.fields[column].scale) == (field.dtype, field.scale)
            assert table.fields[column].unit == field.unit, (name, column)
            compared += 1
    assert compared > 100


def test_topics_have_the_types_of_the_firmware(corpus: Path, logs: dict[str, Path]) -> None:
    theirs = formats.open(corpus / "sitl" / "px4" / "px4_steps.ulg")
    mine = formats.open(logs[".ulg"])
    compared = 0
    for (name, instance), table in mine.items():
        firmware = theirs.tables.get((name, instance))
        for column, field in table.fields.items() if firmware is not None else ():
            assert firmware is not None
            if name == "actuator_armed":
                continue  # renamed since
            assert firmware.fields[column].dtype == field.dtype, (name, column)
            compared += 1
    assert compared > 200


@pytest.mark.slow
def test_the_vibration_level_is_that_of_a_sine_behind_its_filters() -> None:
    flight = made("static", "seconds=20")
    imu = flight.imus[0]
    imu.acc = np.zeros_like(imu.acc)
    imu.acc[:, 0] = 2.0 * np.sin(2 * np.pi * 80.0 * imu.t_sample)
    level = vibration(imu)
    gain = 1.0 / (1.0 + 400.0 / (2 * np.pi * 5.0))  # of the first-order low-pass, and what it leaves of 80 Hz
    left = abs(1.0 - gain / (1.0 - (1.0 - gain) * np.exp(-2j * np.pi * 80.0 / 400.0)))
    assert level[-400:, 0].mean() == pytest.approx(2.0 / np.sqrt(2.0) * left, rel=0.01)
    assert level[:, 1].max() == 0.0


# A flight as a bag is the flight as a ULog, beside a motion capture on a clock and in axes of its own.

Logs = tuple[FlightLog, FlightLog]


@pytest.fixture(scope="module")
def bag_flight() -> Flight:
    """The first 12 s of the hover: at rest, armed, taken off."""
    return fly(build_scenario(override_values(scenario_values("hover"), ["seconds=12"])), 0)


@pytest.fixture(scope="module")
def bag(bag_flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "a.mcap"
    write(path, bag_flight)
    return path


@pytest.fixture(scope="module")
def both(bag_flight: Flight, bag: Path) -> Logs:
    write(bag.with_suffix(".ulg"), bag_flight)
    return flights.read(bag), flights.read(bag.with_suffix(".ulg"))


def test_every_stream_equals_that_of_the_ulog(both: Logs) -> None:
    one, other = both
    assert one.replay_imu is not None
    assert other.replay_imu is not None
    assert (one.t0_us, one.replay_imu.gyro.source) == (other.t0_us, other.replay_imu.gyro.source)
    pairs = [(one.replay_imu.gyro, other.replay_imu.gyro), (one.replay_imu.acc, other.replay_imu.acc)]
    pairs += [(a.field, b.field) for a, b in zip(one.mags, other.mags, strict=True)]
    for a, b in pairs:
        np.testing.assert_array_equal(a.t, b.t)
        np.testing.assert_array_equal(a.x, b.x)
    np.testing.assert_array_equal(one.attitudes["vehicle_attitude"].q, other.attitudes["vehicle_attitude"].q)
    np.testing.assert_array_equal(one.gnss[0].vel_ned, other.gnss[0].vel_ned)
    assert one.state.armed is not None
    assert other.state.armed is not None
    assert (one.state.armed.value, list(one.state.armed.t)) == (other.state.armed.value, list(other.state.armed.t))


def test_the_motion_capture_is_the_truth_but_for_its_axes_and_noise(both: Logs) -> None:
    one, other = both
    truth, pose = other.truth, one.poses["/mocap/pose"]
    assert truth is not None
    at = np.searchsorted(truth.t, pose.t[100:-100])
    world = rotation.multiply(pose.q[100:-100], np.array([0.0, 1.0, 0.0, 0.0]))  # body forward-right-down
    turned = rotation.multiply(world, rotation.conjugate(truth.q[at]))
    spread = rotation.total_angle(rotation.multiply(rotation.conjugate(turned[:1]), turned))
    assert 0.02 < np.degrees(np.median(spread)) < 0.5
    assert len(pose.t) > 1100


# Parameters set in flight, and logs without the truth.


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_parameter_is_set_at_its_time_in_the_log_of_its_firmware_and_the_truth_left_out(
    suffix: str, tmp_path: Path
) -> None:
    changes = [
        {"t": 3.0, "firmware": "ardupilot", "name": "AHRS_ORIENTATION", "value": 8.0},
        {"t": 3.0, "firmware": "px4", "name": "SENS_BOARD_ROT", "value": 8.0},
    ]
    path, name = tmp_path / f"x{suffix}", {".ulg": "SENS_BOARD_ROT"}.get(suffix, "AHRS_ORIENTATION")
    write(path, fly(build_scenario({"seconds": 6, "logging": {"truth": False}, "parameter": changes})))
    assert flights.read(path).truth is None
    found = formats.open(path).params
    values = [(p.value, p.t_us) for p in found if p.name == name and not p.is_default]
    assert [value for value, _ in values] == [0, 8]
    assert {p.name for p in found if p.value == 8} == {name}
    assert values[1][1] == pytest.approx(START_US + 3_000_000, abs=10_000 if suffix == ".tlog" else 0)
