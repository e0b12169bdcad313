"""Test ratios, times of receipt and reception of simulated flights against pyulog and pymavlink, record by record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog import flight

pytestmark = pytest.mark.slow


def test_ulog_ratios_and_reception(corpus: Path) -> None:
    from pyulog import ULog

    path = corpus / "sitl" / "px4" / "px4_steps.ulg"
    log, oracle = flight.read(path), ULog(str(path))
    status = oracle.get_dataset("estimator_status").data
    ratios = {one.aid: one.ratio for one in log.innovation_tests}
    for aid, column in (("compass", "hdg_test_ratio"), ("velocity", "vel_test_ratio"), ("height", "hgt_test_ratio")):
        np.testing.assert_array_equal(ratios[aid], status[column].astype(np.float64))
    gnss, reception = oracle.get_dataset("vehicle_gps_position").data, log.gnss[0].reception
    assert reception is not None
    np.testing.assert_array_equal(reception.satellites, gnss["satellites_used"])
    np.testing.assert_allclose(reception.hdop, gnss["hdop"])


def test_dataflash_ratios_and_times_of_receipt(corpus: Path) -> None:
    from pymavlink.DFReader import DFReader_binary

    path = corpus / "sitl" / "ardupilot" / "copter_aggressive.bin"
    log, oracle = flight.read(path), DFReader_binary(str(path))
    rows: dict[str, list[tuple[float, ...]]] = {"XKF4": [], "GPA": []}
    while (m := oracle.recv_match(type=["XKF4", "GPA"])) is not None:
        rows[m.get_type()].append((m.SV, m.SM) if m.get_type() == "XKF4" else (m.TimeUS, m.SMS))
    ratios = {one.aid: one.ratio for one in log.innovation_tests}
    expected = np.array(rows["XKF4"])
    np.testing.assert_allclose(ratios["velocity"], expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(ratios["compass"], expected[:, 1], atol=1e-9)
    written, came = np.array(rows["GPA"]).T
    receiver = log.gnss[0]
    assert receiver.received is not None
    np.testing.assert_allclose(receiver.received + 1e-6 * log.t0_us, 1e-3 * came, atol=1e-6)
    assert np.all(receiver.t - receiver.received < 1e-6 * written.max())


def test_telemetry_ratios(corpus: Path) -> None:
    from pymavlink import mavutil

    path = corpus / "sitl" / "ardupilot" / "plane_fbwa_cruise.tlog"
    log, oracle = flight.read(path), mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    sent = []
    while (m := oracle.recv_match(type="EKF_STATUS_REPORT")) is not None:
        sent.append((m.velocity_variance, m.compass_variance))
    ratios = {one.aid: one.ratio for one in log.innovation_tests}
    np.testing.assert_allclose(np.column_stack([ratios["velocity"], ratios["compass"]]), np.array(sent), rtol=1e-6)
