"""What firmwares are told of their aids: names, ranges, units, and what cannot be known."""

from __future__ import annotations

import pytest

from attlog.flight.aiding import delays, needs, noise
from tests.health.assessments.onboard.made import flight


def parameter(firmware: str, **params: float) -> delays.DelayParameter | str:
    log = flight(firmware=firmware, params=params)
    log.gnss[0].received = log.gnss[0].t
    return delays.of_receiver(log, log.gnss[0], 5.0)


@pytest.mark.parametrize(
    ("firmware", "params", "name"),
    [
        ("PX4", {"EKF2_GPS_DELAY": 110.0}, "EKF2_GPS_DELAY"),
        ("PX4", {"EKF2_GPS_DELAY": 110.0, "SENS_GPS0_DELAY": 90.0}, "SENS_GPS0_DELAY"),
        ("ArduPilot", {"GPS_DELAY_MS": 90.0, "AHRS_EKF_TYPE": 3.0}, "GPS_DELAY_MS"),
        ("ArduPilot", {"GPS1_DELAY_MS": 90.0, "AHRS_EKF_TYPE": 3.0}, "GPS1_DELAY_MS"),
        ("ArduPilot", {"EK2_GPS_DELAY": 220.0, "AHRS_EKF_TYPE": 2.0}, "EK2_GPS_DELAY"),
    ],
)
def test_each_era_has_its_own_name(firmware: str, params: dict[str, float], name: str) -> None:
    found = parameter(firmware, **params)
    assert isinstance(found, delays.DelayParameter)
    assert (found.name, found.old) == (name, params[name])
    assert found.low == found.high == found.old


@pytest.mark.parametrize(
    ("firmware", "params"),
    [
        ("PX4", {}),
        ("Betaflight", {"EKF2_GPS_DELAY": 110.0}),
        ("ArduPilot", {"GPS_DELAY_MS": 90.0, "AHRS_EKF_TYPE": 0.0}),
        ("ArduPilot", {"GPS_DELAY_MS": 90.0, "EK2_GPS_DELAY": 220.0, "AHRS_EKF_TYPE": 2.0}),
        ("ArduPilot", {"GPS_DELAY_MS": float("nan"), "AHRS_EKF_TYPE": 3.0}),
    ],
)
def test_what_the_log_cannot_tell_is_a_sentence(firmware: str, params: dict[str, float]) -> None:
    found = parameter(firmware, **params)
    assert isinstance(found, str)
    assert found.endswith(".")


def test_without_the_time_of_receipt_the_parameter_says_nothing() -> None:
    for params in ({"GPS_DELAY_MS": 90.0, "AHRS_EKF_TYPE": 3.0}, {"EK2_GPS_DELAY": 220.0, "AHRS_EKF_TYPE": 2.0}):
        log = flight(firmware="ArduPilot", params=params)
        assert "GPA.SMS" in str(delays.of_receiver(log, log.gnss[0], 5.0))


def test_compasses_have_a_parameter_in_one_firmware_and_a_constant_in_the_other() -> None:
    px4 = delays.of_compass(flight(params={"EKF2_MAG_DELAY": 10.0}), 0.0)
    other = delays.of_compass(flight(firmware="ArduPilot"), 0.0)
    assert isinstance(px4, delays.DelayParameter)
    assert isinstance(other, delays.DelayParameter)
    assert (px4.name, px4.old, other.high, other.most) == ("EKF2_MAG_DELAY", 10.0, 60.0, 0.0)
    assert isinstance(delays.of_compass(flight(), 0.0), str)


def test_gates_are_standard_deviations_in_both() -> None:
    px4 = noise.of_aid(flight(params={"EKF2_MAG_NOISE": 0.05, "EKF2_MAG_GATE": 3.0}), "compass", "estimator_status:0")
    other = noise.of_aid(
        flight(firmware="ArduPilot", params={"EK3_VELNE_M_NSE": 0.3, "EK3_VEL_I_GATE": 500.0}), "velocity", "XKF4:0.SV"
    )
    assert px4 is not None
    assert other is not None
    assert (px4.gate, other.gate) == (3.0, 5.0)
    assert noise.of_aid(flight(), "compass", "estimator_status:0") is None


def test_what_is_asked_of_gnss_is_each_firmwares() -> None:
    assert needs.of_gnss(flight()).speed < needs.of_gnss(flight(firmware="ArduPilot")).speed


@pytest.mark.parametrize("aid", ["compass", "velocity", "position", "height"])
def test_ardupilots_gates_are_hundredths_of_a_standard_deviation_and_px4s_whole_ones(aid: str) -> None:
    """docs of EK3_POS_I_GATE and its kin: percent, 500 is 5 sigmas; of EKF2_GPS_P_GATE: SD."""
    for source, firmware, unit in (("XKF4", "ArduPilot", 0.01), ("NKF4", "ArduPilot", 0.01), ("", "PX4", 1.0)):
        name, _, _, gate, _ = noise.PARAMETERS["PX4" if firmware == "PX4" else source[:2]][aid]
        found = noise.of_aid(flight(firmware=firmware, params={name: 0.5, gate: 500.0}), aid, source)
        assert found is not None
        assert (found.old, found.gate) == (0.5, pytest.approx(500.0 * unit))


def test_the_delay_of_the_first_receiver_is_not_that_of_a_second_one() -> None:
    """EKF2_GPS_DELAY was one for all before SENS_GPS1_DELAY: which receiver it fits nobody knows."""
    log = flight(params={"EKF2_GPS_DELAY": 110.0})
    log.gnss[0].index = 1
    assert delays.of_receiver(log, log.gnss[0], 5.0) == "The log holds no delay parameter of this receiver."
    log.params["SENS_GPS1_DELAY"] = flight(params={"SENS_GPS1_DELAY": 70.0}).params["SENS_GPS1_DELAY"]
    found = delays.of_receiver(log, log.gnss[0], 5.0)
    assert isinstance(found, delays.DelayParameter)
    assert (found.name, found.old) == ("SENS_GPS1_DELAY", 70.0)
