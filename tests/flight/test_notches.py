"""Which notches flew, and which parameters make one: by firmware, in range, and with what must come first."""

from __future__ import annotations

import pytest

from attlog.flight.notches import (
    WantedNotch,
    active_notches,
    advise_fast_gyro,
    advise_reboot,
    fixed_notch,
    notch_parameters,
)
from tests.health.shaken import params, shaken

ON = {"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_FREQ": 80.0, "INS_HNTCH_BW": 40.0}


def flew(firmware: str = "ArduPilot", **values: float):
    return shaken(50.0, 60.0, firmware=firmware, lines=params(**values))


@pytest.mark.parametrize(
    ("mode", "reference", "follows", "covered"),
    [(0.0, 0.0, "", (61.0, 99.0)), (1.0, 0.3, "throttle", (61.0, 99.0)), (4.0, 1.0, "measurement", (10.0, 300.0)),
     (1.0, 0.0, "", (61.0, 99.0))],
)  # fmt: skip
def test_a_notch_covers_its_stop_band_or_what_it_measures(mode, reference, follows, covered) -> None:
    log = flew(**ON, INS_HNTCH_MODE=mode, INS_HNTCH_REF=reference, MOT_THST_HOVER=0.3)
    (found,) = active_notches(log)
    assert found.follows == follows
    assert all(found.covers(f) for f in covered)
    assert found.covers(120.0) == (follows == "measurement")


def test_notches_that_are_off_did_not_fly() -> None:
    assert active_notches(flew(**ON | {"INS_HNTCH_ENABLE": 0.0})) == []
    assert active_notches(flew("PX4", IMU_GYRO_NF0_FRQ=0.0, IMU_GYRO_DNF_EN=0.0)) == []
    names = [
        n.name for n in active_notches(flew("PX4", IMU_GYRO_NF0_FRQ=90.0, IMU_GYRO_NF0_BW=20.0, IMU_GYRO_DNF_EN=2.0))
    ]
    assert names == ["IMU_GYRO_NF0_FRQ", "IMU_GYRO_DNF_EN"]


def test_a_firmware_without_the_notch_gets_none() -> None:
    assert notch_parameters(flew(MOT_THST_HOVER=0.3), WantedNotch(90.0, "throttle", 0.3)) == {}
    assert notch_parameters(flew("PX4"), WantedNotch(90.0, "throttle", 0.3)) == {}


@pytest.mark.parametrize("frequency", [8.0, 450.0])
def test_what_lies_outside_the_documented_range_is_no_value(frequency: float) -> None:
    log = flew(INS_HNTCH_ENABLE=0.0, MOT_THST_HOVER=0.3)
    assert notch_parameters(log, WantedNotch(90.0, "throttle", 0.3)) != {}
    assert notch_parameters(log, WantedNotch(frequency, "throttle", 0.3)) == {}


def test_old_px4_has_one_notch_of_another_name() -> None:
    log = flew("PX4", IMU_GYRO_NF_FREQ=0.0, IMU_GYRO_NF_BW=20.0)
    made = notch_parameters(log, WantedNotch(90.0, "throttle", 0.3, spread=25.2))
    assert made == {"IMU_GYRO_NF_FREQ": (90.0, "Hz"), "IMU_GYRO_NF_BW": (26.0, "Hz")}
    assert notch_parameters(log, WantedNotch(90.0, "throttle", 0.3, spread=60.0)) == {}  # no fixed notch is so wide
    assert fixed_notch({n: v for n, (v, _) in made.items()}) == ("IMU_GYRO_NF_FREQ", 90.0, 26.0)


def test_a_second_harmonic_is_added_to_those_that_are_set() -> None:
    log = flew(**ON, INS_HNTCH_HMNCS=1.0, MOT_THST_HOVER=0.3)
    log.power.rpm = log.power.throttle
    made = notch_parameters(log, WantedNotch(180.0, "rotors", 0.3, harmonic=2, slowest=80.0))
    assert made["INS_HNTCH_HMNCS"] == (3.0, "")
    assert made["INS_HNTCH_FREQ"] == (72.0, "Hz")
    assert made["INS_HNTCH_MODE"] == (2.0, "")
    assert "reboot" in advise_reboot({"INS_HNTCH_ENABLE": 1.0})
    assert advise_reboot({"INS_HNTCH_FREQ": 72.0}) == ""


@pytest.mark.parametrize(
    ("firmware", "version", "values", "advice"),
    [
        ("ArduPilot", "4.5.0", {"INS_LOG_BAT_MASK": 0.0}, "Set INS_LOG_BAT_MASK to 1"),
        ("ArduPilot", "4.5.0", {"INS_LOG_BAT_MASK": 1.0}, "set already"),
        ("ArduPilot", "3.5.0", {}, "3.7 and later"),
        ("PX4", "1.14.0", {"SDLOG_PROFILE": 1.0}, "Set bit 8"),
        ("PX4", "1.14.0", {"SDLOG_PROFILE": 257.0}, "set already"),
        ("PX4", "1.10.0", {"SDLOG_PROFILE": 1.0}, "1.12 and later"),
        ("other", "", {}, ""),
    ],
)
def test_the_advice_names_what_is_not_set_yet(firmware, version, values, advice) -> None:
    log = flew(firmware, **values)
    log.firmware = type(log.firmware)(firmware, version)
    assert advice in advise_fast_gyro(log)
    assert bool(advise_fast_gyro(log)) == bool(advice)


def test_px4s_dynamic_notch_keeps_the_sources_that_are_switched_on_already() -> None:
    """IMU_GYRO_DNF_EN: bit 0 speed controllers, bit 1 FFT."""
    fft = {"IMU_GYRO_FFT_EN": 1.0, "IMU_GYRO_FFT_MIN": 30.0, "IMU_GYRO_FFT_MAX": 200.0}
    rotors, unknown = WantedNotch(90.0, "rotors"), WantedNotch(90.0, "throttle")
    assert notch_parameters(flew("PX4", IMU_GYRO_DNF_EN=2.0), rotors) == {"IMU_GYRO_DNF_EN": (3.0, "")}
    assert notch_parameters(flew("PX4", IMU_GYRO_DNF_EN=1.0, **fft), unknown) == {"IMU_GYRO_DNF_EN": (3.0, "")}
