"""A notch is offered for rotors that are known to be there, and for nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog.flight.model import Burst, FlightLog, Stream, TimeLine
from attlog.health.check import Check
from attlog.health.notch import gyro_spectrum, notch_bands, notch_filter
from tests.health.shaken import SECONDS, case, params, shaken, throttle_at
from tests.health.test_spectrum import rotors_of, with_throttle

OFF = {"INS_HNTCH_ENABLE": 0.0, "MOT_THST_HOVER": 0.33, "INS_LOG_BAT_MASK": 0.0}


def asked(log: FlightLog) -> Check:
    (found,) = notch_filter(case(log))
    return found


def offered(log: FlightLog) -> dict[str, float]:
    return {s.name: s.new for s in asked(log).settings}


def test_rotors_that_follow_throttle_get_a_notch_at_hover() -> None:
    """90 Hz at throttle 0.3 are 94 Hz at the hover throttle of 0.33."""
    log = shaken(1000.0, with_throttle(90.0), units=2, lines=params(**OFF))
    found = asked(log)
    assert found.verdict == "warning"
    at_hover = round(90.0 * math.sqrt(0.33 / 0.3))
    assert {s.name: s.new for s in found.settings} == {
        "INS_HNTCH_ENABLE": 1.0,
        "INS_HNTCH_MODE": 1.0,
        "INS_HNTCH_FREQ": pytest.approx(at_hover, abs=1.0),
        "INS_HNTCH_BW": pytest.approx(at_hover / 2, abs=1.0),
        "INS_HNTCH_REF": 0.33,
    }
    assert "reboot first" in found.action
    assert found.ci95 is not None
    (drawn,) = notch_bands(case(log))["proposed"]
    assert drawn[0] == pytest.approx(at_hover, abs=1.0)


def test_what_is_set_is_not_offered_again() -> None:
    fitting = OFF | {"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_MODE": 1.0, "INS_HNTCH_FREQ": 94.0, "INS_HNTCH_BW": 47.0,
                     "INS_HNTCH_REF": 0.33}  # fmt: skip
    found = asked(shaken(1000.0, with_throttle(90.0), lines=params(**fitting)))
    assert (found.verdict, found.settings) == ("ok", [])
    assert "already" in found.text
    elsewhere = fitting | {"INS_HNTCH_FREQ": 200.0, "INS_HNTCH_BW": 40.0}
    changed = offered(shaken(1000.0, with_throttle(90.0), lines=params(**elsewhere)))
    assert set(changed) == {"INS_HNTCH_FREQ", "INS_HNTCH_BW"}


@pytest.mark.parametrize(
    ("why", "log"),
    [
        ("may be one at", lambda: shaken(200.0, 60.0, lines=params(**OFF))),
        ("does not follow throttle", lambda: shaken(1000.0, 90.0, lines=params(**OFF))),
        ("too slow", lambda: shaken(200.0, 60.0, rms_dps=0.0, lines=params(**OFF))),
    ],
)
def test_thin_evidence_is_refused_with_what_to_log(why: str, log: object) -> None:
    found = asked(log())  # type: ignore[operator]
    assert (found.verdict, found.settings) == ("unknown", [])
    assert why in found.text
    assert "INS_LOG_BAT_MASK to 1" in found.action


def test_a_peak_of_one_of_two_sensors_is_not_the_vehicles() -> None:
    log = shaken(1000.0, with_throttle(90.0), units=2, lines=params(**OFF))
    log.imus[1].gyro.x[:] = np.random.default_rng(5).standard_normal(log.imus[1].gyro.x.shape) * np.radians(0.3)
    found = asked(log)
    assert found.settings == []
    assert "not on IMU 1" in found.text


def test_steady_throttle_is_refused() -> None:
    log = shaken(1000.0, 90.0, lines=params(**OFF))
    log.power.throttle = Stream(np.array([0.0, SECONDS]), np.full((2, 1), 0.3), "1", "", "")
    assert "Throttle changed too little" in asked(log).text


def test_measured_rotors_get_a_notch_that_follows_them_even_by_a_slow_stream() -> None:
    log = shaken(200.0, with_throttle(140.0), rpm=rotors_of(140.0), lines=params(**OFF))
    found = offered(log)
    slowest = 140.0 * math.sqrt(0.6)
    assert found["INS_HNTCH_MODE"] == 3.0
    assert found["INS_HNTCH_REF"] == 1.0
    assert found["INS_HNTCH_FREQ"] == pytest.approx(0.9 * slowest, abs=2.0)


PX4 = {"IMU_GYRO_NF0_FRQ": 0.0, "IMU_GYRO_NF0_BW": 20.0, "IMU_GYRO_DNF_EN": 0, "SDLOG_PROFILE": 1}


def px4(frequency: object, values: dict[str, float], **more: object) -> FlightLog:
    log = shaken(1000.0, frequency, firmware="PX4", lines=params(**values), **more)
    small = 0.1 if "rpm" not in more else 0.4
    if "rpm" not in more:  # a static notch holds only what moves little
        log.power.throttle = Stream(
            log.power.throttle.t, throttle_at(log.power.throttle.t, 0.3, small)[:, None], "1", "", ""
        )
    return log


def little(t: np.ndarray) -> np.ndarray:
    return 150.0 * np.sqrt(throttle_at(t, 0.3, 0.1) / 0.3)


def test_px4_gets_its_dynamic_notch_by_what_it_measures() -> None:
    assert offered(px4(with_throttle(90.0), PX4, rpm=rotors_of(90.0))) == {"IMU_GYRO_DNF_EN": 1.0}
    by_fft = PX4 | {"IMU_GYRO_FFT_EN": 1, "IMU_GYRO_FFT_MIN": 30.0, "IMU_GYRO_FFT_MAX": 200.0}
    assert offered(px4(little, by_fft)) == {"IMU_GYRO_DNF_EN": 2.0}


def test_px4_gets_a_fixed_notch_where_nothing_is_measured() -> None:
    found = offered(px4(little, PX4))
    assert found == {"IMU_GYRO_NF0_FRQ": pytest.approx(150.0, abs=2.0)}
    assert offered(px4(little, PX4 | {"IMU_GYRO_NF0_FRQ": 150.0})) == {}
    assert offered(px4(little, {"SDLOG_PROFILE": 1})) == {}


def test_a_notch_that_measures_is_on_already_and_bursts_say_by_how_much_it_helps() -> None:
    on = OFF | {"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_MODE": 4.0, "INS_HNTCH_FREQ": 60.0, "INS_HNTCH_BW": 30.0,
                "INS_HNTCH_REF": 1.0}  # fmt: skip
    rng = np.random.default_rng(0)
    t = np.arange(1024) / 2000.0

    def burst(at: float, rms: float, filtered: bool) -> Burst:
        tone = np.radians(rms * np.sqrt(2.0)) * np.sin(2 * np.pi * 90.0 * t)
        x = np.radians(0.02) * rng.standard_normal((1024, 3)) + tone[:, None]
        return Burst("gyro", 0, at, 2000.0, np.float32(x), filtered, "ISBD:0")

    for rms, verdict in ((0.5, "ok"), (4.0, "warning")):
        bursts = [burst(20.0 + k, 5.0, False) for k in range(8)] + [burst(20.5 + k, rms, True) for k in range(8)]
        found = asked(shaken(50.0, 20.0, lines=params(**on), bursts=bursts))
        assert (found.verdict, found.settings) == (verdict, [])
        assert f"{20 * math.log10(5.0 / rms):.0f} dB" in " ".join([found.text, *found.evidence])


def test_a_slow_log_says_once_that_it_is_slow() -> None:
    log = shaken(50.0, 5.0, lines=params(**OFF))
    (found,) = gyro_spectrum(case(log))
    assert found.verdict == "unknown"
    assert "50 Hz" in found.text
    assert "INS_LOG_BAT_MASK to 1" in found.action
    assert notch_filter(case(log)) == []


def test_a_folded_peak_says_what_it_may_be_and_a_fast_one_what_it_is() -> None:
    (slow,) = gyro_spectrum(case(shaken(200.0, 130.0, lines=params(**OFF))))
    assert slow.verdict == "unknown"
    assert "70 Hz, which may be 130 or 270 Hz" in slow.text
    (fast,) = gyro_spectrum(case(shaken(1000.0, 130.0, lines=params(**OFF))))
    assert (fast.verdict, fast.value) == ("ok", pytest.approx(130.0, abs=0.6))
    (silent,) = gyro_spectrum(case(shaken(1000.0, 130.0, rms_dps=0.0)))
    assert "no peak" in silent.text


@pytest.mark.parametrize("n", [0, 1, 3])
def test_hardly_any_samples_are_unknown(n: int) -> None:
    log = shaken(200.0, 60.0, lines={"INS_HNTCH_ENABLE": TimeLine(np.zeros(0), [], "PARM")})
    for stream in (log.imus[0].gyro, log.imus[0].acc):
        stream.t, stream.x = stream.t[:n], stream.x[:n]
    log.power.throttle = Stream(np.zeros(0), np.zeros((0, 1)), "1", "", "")
    assert notch_filter(case(log)) == []
    assert [a.verdict for a in gyro_spectrum(case(log))] == ["unknown"]
    assert notch_bands(case(log)) == {}
