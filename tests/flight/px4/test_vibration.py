"""PX4's own level in m/s^2 in every version, and the peaks of its spectrum."""

from __future__ import annotations

import numpy as np
import pytest

import attlog
from attlog.flight.builder import LogBuilder
from attlog.flight.px4 import vibration
from attlog.health.assessments.vibration.level import of_samples, seconds_of
from tests.flight import fake

N = 20


def test_increments_of_velocity_become_accelerations_in_old_versions() -> None:
    t = fake.micros(N, 1.0)
    old = {"timestamp": t, "accel_vibration_metric": np.full(N, 0.05, np.float32)}
    new = old | {"var_accel": np.zeros((N, 3), np.float32)}
    imu = {"timestamp": t, "delta_velocity_dt": np.full(N, 4000, np.uint32)}
    tables = {("vehicle_imu_status", 0): old, ("vehicle_imu_status", 1): new, ("vehicle_imu", 0): imu}
    levels = vibration.levels(LogBuilder(fake.messages("ulog", tables), t0_us=int(t[0])))
    assert [(v.unit, v.measure) for v in levels] == [(0, "difference"), (1, "difference")]
    assert levels[0].level == pytest.approx(0.05 / 0.004)
    assert levels[1].level == pytest.approx(0.05)


def test_without_increments_the_default_rate_counts() -> None:
    t = fake.micros(N, 1.0)
    old = {"timestamp": t, "accel_vibration_metric": np.full(N, 0.05, np.float32)}
    (found,) = vibration.levels(LogBuilder(fake.messages("ulog", {("vehicle_imu_status", 0): old}), t0_us=int(t[0])))
    assert found.level == pytest.approx(10.0)


def test_impossible_peaks_of_the_onboard_spectrum_are_none() -> None:
    t = fake.micros(N, 20.0)
    table = {"timestamp": t, "sensor_sample_rate_hz": np.full(N, 2000.0), "resolution_hz": np.full(N, 3.9)} | {
        f"peak_frequencies_{axis}": np.tile(np.array([90.0, np.nan, value], np.float32), (N, 1))
        for axis, value in zip("xyz", (-5.0, 1e9, 150.0), strict=True)
    }
    found = vibration.spectrum(LogBuilder(fake.messages("ulog", {("sensor_gyro_fft", 0): table}), t0_us=int(t[0])))
    assert found is not None
    assert found.peaks.shape == (N, 9)
    assert np.unique(found.peaks[np.isfinite(found.peaks)]).tolist() == [90.0, 150.0]
    assert (found.rate, found.resolution) == (2000.0, 3.9)


@pytest.mark.parametrize(
    ("name", "low", "high"), [("px4_1.14_clipping_field", 0.97, 1.03), ("px4_1.14_hard_landing", 0.90, 0.97)]
)
def test_the_level_of_samples_is_the_one_that_was_logged(corpus, name: str, low: float, high: float) -> None:
    """Measured 0.93 to 1.06 on 18 logs; where the logger lost samples it is least."""
    log = attlog.read(corpus / "logs" / "cases" / f"{name}.ulg")
    imu = log.replay_imu
    assert imu is not None
    own = of_samples(imu)
    told = next(v for v in log.vibrations if v.unit == imu.index)
    t, logged = seconds_of(told.t, told.level)
    mine = np.interp(t, own.t, own.level)
    shaking = logged > 3.0
    assert low < np.median(mine[shaking]) / np.median(logged[shaking]) < high
