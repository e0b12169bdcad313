"""What comes before the filter: closed forms, and the log left as it was."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from scipy import signal  # type: ignore[import-untyped]

from attlog.compare.filter_input import prepare_input
from attlog.compare.setting import parse_configuration
from attlog.core.errors import UsageError
from attlog.flight.model import Firmware, FlightLog, Imu, Mag, Stream
from tests.flight.made_log import with_fields

HZ = 400.0


def unit(t: np.ndarray, gyro: np.ndarray, sampling: Literal["interval", "instant"] = "instant") -> Imu:
    acc = np.tile([0.0, 0.0, -9.81], (len(t), 1))
    return Imu(0, Stream(t, gyro, "rad/s", "FRD", "made", sampling), Stream(t, acc, "m/s^2", "FRD", "made", sampling))


def log(imu: Imu, rpm: Stream | None = None) -> FlightLog:
    made = FlightLog(Path("made-up.bin"), "dataflash", 0, 0, Firmware("ArduPilot"), "quad", imus=[imu], imu=0)
    return with_fields(made, rpm=rpm)


def run(settings: str, imu: Imu, rpm: Stream | None = None, mag: Mag | None = None) -> tuple[Imu, Mag | None]:
    return prepare_input(parse_configuration(f"mahony:{settings}").before, log(imu, rpm), imu, mag)


T = np.arange(0.0, 10.0, 1.0 / HZ)


def tone(hz: float) -> np.ndarray:
    return np.asarray(np.sin(2.0 * np.pi * hz * T)[:, None] * np.array([1.0, 0.5, -2.0]))


def size(x: np.ndarray) -> np.ndarray:
    """Amplitude of each column once the filter has settled."""
    return np.asarray(np.sqrt(2.0 * np.mean(x[len(x) // 2 :] ** 2, axis=0)))


@pytest.mark.parametrize("hz", [5.0, 20.0, 60.0])
def test_a_low_pass_lets_a_tone_through_as_its_response_says(hz: float) -> None:
    imu = unit(T, tone(hz))
    before = imu.gyro.x.copy()
    found, _ = run("lowpass=20", imu)
    _, h = signal.freqz(*signal.butter(2, 20.0, fs=HZ), [hz], fs=HZ)
    np.testing.assert_allclose(size(found.gyro.x), abs(h[0]) * np.array([1.0, 0.5, 2.0]), rtol=2e-3)
    np.testing.assert_allclose(found.acc.x, imu.acc.x, atol=1e-12)
    np.testing.assert_array_equal(imu.gyro.x, before)


def test_a_low_pass_is_not_counted_as_a_known_delay_of_the_log() -> None:
    found, _ = run("lowpass=20", unit(T, tone(5.0)))
    assert found.gyro.delay == 0.0


def test_a_low_pass_of_one_sensor_leaves_the_other() -> None:
    imu = unit(T, tone(60.0))
    imu.acc.x = imu.gyro.x.copy()
    found, _ = run("acc_lowpass=20", imu)
    assert size(found.acc.x)[0] < 0.15
    np.testing.assert_array_equal(found.gyro.x, imu.gyro.x)


def test_notches_follow_the_rotors_and_their_harmonics() -> None:
    """Two rotors whose speeds change half way; the tones at them and at twice of them vanish, another stays."""
    t_rpm = np.arange(0.0, 10.0, 0.1)
    rotors = np.column_stack([np.where(t_rpm < 5.0, 40.0, 50.0), np.full(len(t_rpm), 63.0)])
    rpm = Stream(t_rpm, 60.0 * rotors, "rpm", "", "ESC")
    speed = np.where(T < 5.0, 40.0, 50.0)
    phase = 2.0 * np.pi * np.cumsum(speed) / HZ
    hum = np.sin(phase) + np.sin(2.0 * phase) + np.sin(2.0 * np.pi * 63.0 * T)
    kept = np.sin(2.0 * np.pi * 5.0 * T)
    found, _ = run("rpm_notch=6/2", unit(T, (hum + kept)[:, None] * np.ones(3)), rpm)
    late = T > 8.0
    assert np.max(np.abs(found.gyro.x[late, 0] - kept[late])) < 0.2
    single, _ = run("rpm_notch=6", unit(T, (hum + kept)[:, None] * np.ones(3)), rpm)
    assert np.max(np.abs(single.gyro.x[late, 0] - kept[late])) > 0.8


def test_samples_before_the_first_rotor_speed_and_in_the_time_of_unknown_ones_pass() -> None:
    """The first rotor is told from 4 s on and not from 6 to 7 s."""
    t_rpm = np.arange(4.0, 10.0, 0.1)
    speed = np.where((t_rpm > 5.95) & (t_rpm < 6.95), np.nan, 40.0)
    rpm = Stream(t_rpm, 60.0 * speed[:, None], "rpm", "", "ESC")
    imu = unit(T, tone(40.0))
    found, _ = run("rpm_notch=6", imu, rpm)
    passed = (T < 4.0) | ((T >= 6.0) & (T < 6.999))
    np.testing.assert_array_equal(found.gyro.x[passed], imu.gyro.x[passed])
    settled = ((T > 5.0) & (T < 6.0)) | (T > 8.0)
    assert np.max(np.abs(found.gyro.x[settled])) < 0.01


def test_a_log_without_rotor_speeds_cannot_have_their_notches() -> None:
    with pytest.raises(UsageError, match="holds none"):
        run("rpm_notch=6", unit(T, tone(5.0)))


def test_calibration_is_offset_then_scale_then_rotation() -> None:
    x = np.random.default_rng(1).normal(size=(len(T), 3))
    imu = unit(T, x)
    found, _ = run("gyro_offset=10/0/-20,gyro_scale=2/1/0.5,imu_rotation=0/0/90", imu)
    scaled = (x - np.radians([10.0, 0.0, -20.0])) * [2.0, 1.0, 0.5]
    wanted = np.column_stack([-scaled[:, 1], scaled[:, 0], scaled[:, 2]])
    np.testing.assert_allclose(found.gyro.x, wanted, atol=1e-12)
    np.testing.assert_allclose(found.acc.x, imu.acc.x, atol=1e-12)


def test_the_magnetometer_is_calibrated_thinned_out_or_gone() -> None:
    t = np.arange(0.0, 10.0, 0.02)
    mag = Mag(0, Stream(t, np.tile([20e-6, 0.0, 40e-6], (len(t), 1)), "T", "FRD", "made"))
    _, found = run("mag_offset=5/0/0,mag_scale=2,mag_rotation=180/0/0,mag_rate=10", unit(T, tone(5.0)), mag=mag)
    assert found is not None
    np.testing.assert_allclose(found.field.x[0], [30e-6, 0.0, -80e-6], atol=1e-12)
    assert found.field.rate == pytest.approx(10.0, rel=0.02)
    assert run("mag=off", unit(T, tone(5.0)), mag=mag)[1] is None


@pytest.mark.parametrize("sampling", ["interval", "instant"])
def test_a_lower_rate_keeps_the_angle_that_was_turned(sampling: Literal["interval", "instant"]) -> None:
    """Means over four samples turn as far as the samples; a linear ramp of the accelerometer keeps its time."""
    imu = unit(T, tone(3.0), sampling)
    imu.acc.x = np.outer(T, [1.0, 2.0, 3.0])
    found, _ = run("rate=100", imu)
    assert found.gyro.rate == pytest.approx(100.0)
    assert found.gyro.sampling == "interval"
    x = imu.gyro.x if sampling == "interval" else 0.5 * (imu.gyro.x + np.vstack([imu.gyro.x[:1], imu.gyro.x[:-1]]))
    turned, wanted = np.cumsum(found.gyro.x / 100.0, axis=0), np.cumsum(x / HZ, axis=0)[3::4]
    np.testing.assert_allclose(turned - turned[0], wanted - wanted[0], atol=1e-9)
    middle = found.acc.t[1:] - 0.5 / 100.0 + (0.5 / HZ if sampling == "interval" else 0.0)
    np.testing.assert_allclose(found.acc.x[1:, 0], middle, atol=1e-9)


def test_picked_samples_are_samples_of_the_log() -> None:
    imu = unit(T, tone(3.0))
    found, _ = run("pick=100", imu)
    np.testing.assert_array_equal(found.gyro.x, imu.gyro.x[3::4])
    np.testing.assert_array_equal(found.gyro.t, imu.gyro.t[3::4])
    assert found.gyro.sampling == "instant"


def test_latency_makes_every_sample_come_later() -> None:
    t = np.arange(0.0, 10.0, 0.02)
    mag = Mag(0, Stream(t, np.ones((len(t), 3)), "T", "FRD", "made", t_sample=t - 0.001))
    found, field = run("latency=12", unit(T, tone(3.0)), mag=mag)
    assert field is not None
    np.testing.assert_allclose(found.gyro.t, T + 0.012)
    np.testing.assert_allclose(found.acc.t, T + 0.012)
    np.testing.assert_allclose(field.field.t_best, t + 0.011)


def test_filters_begin_anew_after_a_gap() -> None:
    t = np.concatenate([T[:2000], T[2000:] + 3.0])
    x = np.ones((len(t), 3))
    x[2000:] = 5.0
    found, _ = run("lowpass=5", unit(t, x))
    np.testing.assert_allclose(found.gyro.x, x, atol=1e-12)


@pytest.mark.parametrize("how", ["rate", "pick"])
@pytest.mark.parametrize(("hz", "n"), [(520.0, 1), (270.0, 1), (260.0, 2), (130.0, 3)])
def test_a_rate_is_the_nearest_whole_part_of_the_logs(how: str, hz: float, n: int) -> None:
    found, _ = run(f"{how}={hz:g}", unit(T, tone(5.0)))
    assert np.median(np.diff(found.gyro.t)) == pytest.approx(n / HZ)


@pytest.mark.parametrize("how", ["rate", "pick"])
def test_a_rate_above_four_thirds_of_the_logs_is_refused(how: str) -> None:
    with pytest.raises(UsageError, match="540 Hz is above that of the log, 400 Hz"):
        run(f"{how}=540", unit(T, tone(5.0)))
