"""What firmwares are told of their aids: names, ranges, units, and what cannot be known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import flight as attlog_flight
from attlog.flight import aiding
from attlog.flight.aiding import DelayParameter
from attlog.flight.model import Firmware, FlightLog, Gnss, TimeLine
from tests.health.made_flight import flight


def test_without_the_time_of_receipt_the_parameter_says_nothing() -> None:
    for params in ({"GPS_DELAY_MS": 90.0, "AHRS_EKF_TYPE": 3.0}, {"EK2_GPS_DELAY": 220.0, "AHRS_EKF_TYPE": 2.0}):
        log = flight(firmware="ArduPilot", params=params)
        assert "GPA.SMS" in str(aiding.gnss_delay_parameter(log, log.gnss[0], 5.0))


# Names, ranges and numbers of parameters of aids are those of the firmwares' tables, receiver by receiver.


def receiver(index: int = 0, received: bool = True) -> Gnss:
    n = np.zeros(3)
    found = Gnss(index, n, f"GPS:{index}", n, n, n, np.zeros((3, 3)), n, n, n, np.full(3, 3))
    found.received = n if received else None
    return found


def log(firmware: str, receivers: int = 1, hardware: str = "", **params: float) -> FlightLog:
    made = FlightLog(Path("made"), "made", 0, 0, Firmware(firmware), "quadrotor")
    made.parameters.lines = {name: TimeLine(np.zeros(1), [value], "made") for name, value in params.items()}
    made.gnss = [receiver(k) for k in range(receivers)]
    texts: Any = [(0.0, 6, hardware)]
    made.texts = texts if hardware else []
    return made


NOISE = [
    ("PX4", "estimator_status", "compass", "EKF2_MAG_NOISE", "EKF2_MAG_GATE", (0.001, 1.0)),
    ("PX4", "estimator_status", "velocity", "EKF2_GPS_V_NOISE", "EKF2_GPS_V_GATE", (0.01, 5.0)),
    ("PX4", "estimator_status", "position", "EKF2_GPS_P_NOISE", "EKF2_GPS_P_GATE", (0.01, 10.0)),
    ("PX4", "estimator_status", "height", "EKF2_BARO_NOISE", "EKF2_BARO_GATE", (0.01, 15.0)),
    *(
        (f"ArduPilot {k}", f"{family}F4:0", aid, f"EK{k}_{own}_M_NSE", f"EK{k}_{gate}_I_GATE", limits)
        for k, family in ((2, "NK"), (3, "XK"))
        for aid, own, gate, limits in (
            ("compass", "MAG", "MAG", (0.01, 0.5)),
            ("velocity", "VELNE", "VEL", (0.05, 5.0)),
            ("position", "POSNE", "POS", (0.1, 10.0)),
            ("height", "ALT", "HGT", (0.1, 10.0 if k == 2 else 100.0)),
        )
    ),
]


@pytest.mark.parametrize(("firmware", "source", "aid", "name", "gate", "limits"), NOISE)
def test_the_noise_of_an_aid_has_the_name_range_and_gate_of_its_firmware(
    firmware: str, source: str, aid: str, name: str, gate: str, limits: tuple[float, float]
) -> None:
    found = aiding.noise_parameter(log(firmware.split()[0], **{name: 0.3, gate: 500.0}), aid, source)
    sigmas = 500.0 if firmware == "PX4" else 5.0
    assert found == aiding.NoiseParameter(name, 0.3, *limits, pytest.approx(sigmas))
    for bad in ({name: 0.3}, {gate: 500.0}, {name: 0.0, gate: 5.0}, {name: 0.3, gate: -1.0}, {name: np.inf, gate: 1.0}):
        assert aiding.noise_parameter(log(firmware.split()[0], **bad), aid, source) is None


def of(made: FlightLog, index: int = 0) -> DelayParameter | str:
    return aiding.gnss_delay_parameter(made, made.gnss[index], 1.0)


def test_a_delay_of_px4_is_that_of_the_receiver_else_of_the_first_one_alone() -> None:
    both = {"SENS_GPS1_DELAY": 90.0, "EKF2_GPS_DELAY": 110.0}
    for index, name, ms in ((0, "EKF2_GPS_DELAY", 110.0), (1, "SENS_GPS1_DELAY", 90.0)):
        found = of(log("PX4", 2, **both), index)
        assert found == DelayParameter(name, ms, ms, ms, 300.0, f"{name} says {ms:.0f} ms")
    assert "no delay parameter" in str(of(log("PX4", 2, EKF2_GPS_DELAY=110.0), 1))
    assert "blends" in str(of(log("PX4", 2, SENS_GPS_MASK=7.0, **both)))
    assert isinstance(of(log("PX4", 1, SENS_GPS_MASK=7.0, **both)), DelayParameter)
    assert isinstance(of(log("PX4", 2, SENS_GPS_MASK=0.0, **both)), DelayParameter)


@pytest.mark.parametrize(
    ("hardware", "ms"),
    [("0004", 220.0), ("0007", 120.0), ("0008", 120.0), ("0019", 120.0), ("000A", 120.0), ("0001", None), (None, None)],
)
def test_where_ardupilots_delay_is_0_the_drivers_number_counts_by_the_hardware(
    hardware: str | None, ms: float | None
) -> None:
    text = "" if hardware is None else f"u-blox 1 HW: {hardware}0000 SW: EXT CORE"
    found = of(log("ArduPilot", 1, text, GPS_DELAY_MS=0.0, AHRS_EKF_TYPE=3.0))
    assert isinstance(found, DelayParameter)
    assert (found.old, found.most) == (0.0, 250.0)
    assert (found.low, found.high) == ((50.0, 220.0) if ms is None else (ms, ms))


def test_a_delay_of_ardupilot_is_named_by_era_and_receiver() -> None:
    for names, index in (("GPS_DELAY_MS", 0), ("GPS_DELAY_MS2", 1), ("GPS1_DELAY_MS", 0), ("GPS2_DELAY_MS", 1)):
        found = of(log("ArduPilot", 2, AHRS_EKF_TYPE=2.0, **{names: 80.0}), index)
        assert isinstance(found, DelayParameter)
        assert (found.name, found.low, found.high, found.most) == (names, 80.0, 80.0, 250.0)
    old = of(log("ArduPilot", 1, EK2_GPS_DELAY=220.0, AHRS_EKF_TYPE=2.0))
    assert old == DelayParameter("EK2_GPS_DELAY", 220.0, 220.0, 220.0, 250.0, "EK2_GPS_DELAY says 220 ms")


@pytest.mark.parametrize(
    ("params", "index", "word"),
    [
        ({"GPS_DELAY_MS": 80.0}, 0, "No EKF flew"),
        ({"GPS_DELAY_MS": 80.0, "AHRS_EKF_TYPE": 0.0}, 0, "No EKF flew"),
        ({"GPS_DELAY_MS": 80.0, "EK2_GPS_DELAY": 220.0, "AHRS_EKF_TYPE": 2.0}, 0, "has both"),
        ({"EK2_GPS_DELAY": 220.0, "AHRS_EKF_TYPE": 3.0}, 0, "no delay parameter"),
        ({"EK2_GPS_DELAY": 220.0, "AHRS_EKF_TYPE": 2.0}, 1, "has both"),
        ({"AHRS_EKF_TYPE": 3.0}, 0, "no delay parameter"),
        ({"GPS_DELAY_MS": float("nan"), "AHRS_EKF_TYPE": 3.0}, 0, "no delay parameter"),
    ],
)
def test_what_does_not_say_which_delay_counted_is_a_sentence(params: dict[str, float], index: int, word: str) -> None:
    assert word in str(of(log("ArduPilot", 2, **params), index))


def test_compass_and_buffer_have_their_ranges() -> None:
    assert aiding.of_compass(log("ArduPilot"), 1.0) == DelayParameter("", 60.0, 0.0, 60.0, 0.0, "the EKF takes 60 ms")
    found = aiding.of_compass(log("PX4", EKF2_MAG_DELAY=35.0), 1.0)
    assert found == DelayParameter("EKF2_MAG_DELAY", 35.0, 35.0, 35.0, 300.0, "EKF2_MAG_DELAY says 35 ms")
    found = aiding.buffer(log("PX4", EKF2_DELAY_MAX=200.0), 1.0)
    assert found == DelayParameter("EKF2_DELAY_MAX", 200.0, 200.0, 200.0, 1000.0, "")
    assert aiding.buffer(log("PX4"), 1.0) is None


# Test ratios, times of receipt and reception of simulated flights against pyulog and pymavlink, record by record.


@pytest.mark.slow
def test_ulog_ratios_and_reception(corpus: Path) -> None:
    from pyulog import ULog

    path = corpus / "sitl" / "px4" / "px4_steps.ulg"
    log, oracle = attlog_flight.read(path), ULog(str(path))
    status = oracle.get_dataset("estimator_status").data
    ratios = {one.aid: one.ratio for one in log.estimator.innovation_tests}
    for aid, column in (("compass", "hdg_test_ratio"), ("velocity", "vel_test_ratio"), ("height", "hgt_test_ratio")):
        np.testing.assert_array_equal(ratios[aid], status[column].astype(np.float64))
    gnss, reception = oracle.get_dataset("vehicle_gps_position").data, log.gnss[0].reception
    assert reception is not None
    np.testing.assert_array_equal(reception.satellites, gnss["satellites_used"])
    np.testing.assert_allclose(reception.hdop, gnss["hdop"])


@pytest.mark.slow
def test_dataflash_ratios_and_times_of_receipt(corpus: Path) -> None:
    from pymavlink.DFReader import DFReader_binary

    path = corpus / "sitl" / "ardupilot" / "copter_aggressive.bin"
    log, oracle = attlog_flight.read(path), DFReader_binary(str(path))
    rows: dict[str, list[tuple[float, ...]]] = {"XKF4": [], "GPA": []}
    while (m := oracle.recv_match(type=["XKF4", "GPA"])) is not None:
        rows[m.get_type()].append((m.SV, m.SM) if m.get_type() == "XKF4" else (m.TimeUS, m.SMS))
    ratios = {one.aid: one.ratio for one in log.estimator.innovation_tests}
    expected = np.array(rows["XKF4"])
    np.testing.assert_allclose(ratios["velocity"], expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(ratios["compass"], expected[:, 1], atol=1e-9)
    written, came = np.array(rows["GPA"]).T
    receiver = log.gnss[0]
    assert receiver.received is not None
    np.testing.assert_allclose(receiver.received + 1e-6 * log.t0_us, 1e-3 * came, atol=1e-6)
    assert np.all(receiver.t - receiver.received < 1e-6 * written.max())
