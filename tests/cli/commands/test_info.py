"""``attlog info``: what is in a log, in words and as JSON."""

from __future__ import annotations

import json

import numpy as np
import pytest

from attlog import formats
from attlog.formats import Recording


@pytest.mark.parametrize(
    ("log", "firmware", "source"),
    [
        ("px4_steps.ulg", "PX4", "sensor_combined"),
        ("copter_steps_stabilize.bin", "ArduPilot", "IMU"),
        ("copter_steps_stabilize.tlog", "ArduPilot", "RAW_IMU"),
    ],
)
def test_it_names_vehicle_sensors_and_what_can_be_answered(attlog, samples, log, firmware, source):
    done = attlog("info", samples / log, "--json")
    assert done.code == 0, done.err
    report = json.loads(done.out)
    assert report["log"]["firmware"]["name"] == firmware
    assert source in report["log"]["imu"]["source"]
    assert report["log"]["simulated"] is True
    assert {c["verdict"] for c in report["audit"]} <= {"ok", "warning", "fault", "unknown"}
    assert {a["question"] for a in report["answerable"]} == {"accuracy", "noise", "lag", "yaw_drift"}
    text = attlog("info", samples / log)
    assert text.code == 0
    assert firmware in text.out
    assert "What can be answered" in text.out


@pytest.mark.parametrize("log", ["px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"])
@pytest.mark.slow
def test_verify_agrees_with_the_official_reader(attlog, samples, log):
    done = attlog("info", samples / log, "--verify")
    assert done.code == 0, done.out + done.err
    assert "Agrees with" in done.out


def test_a_strangers_log_cannot_write_to_the_terminal(attlog, tmp_path):
    """Escape sequences in the firmware's name are shown as marks; a damaged place is told once."""
    path = tmp_path / "evil.ulg"
    stamps = (1_000_000 + 5000 * np.arange(400)).astype("<u8")
    q = np.tile(np.array([1, 0, 0, 0], "<f4"), (400, 1))
    topics = {("vehicle_attitude", 0): {"timestamp": stamps, "q": q}}
    formats.write(path, Recording(topics, info={"sys_name": "PX4\x1b]0;owned\x07"}))
    path.write_bytes(path.read_bytes()[:-5])
    done = attlog("info", path, "-v", "--no-color")
    assert done.code == 0
    assert "owned" in done.out
    assert "\x1b" not in done.out
    assert done.out.count("at byte") == 1


def test_it_lists_messages_with_the_rates_that_pymavlink_sees(attlog, samples):
    from pymavlink import DFReader

    log = samples / "copter_yaw_turns.bin"
    reader = DFReader.DFReader_binary(str(log))
    times = []
    while (m := reader.recv_match(type="ATT")) is not None:
        times.append(m.TimeUS)
    rate = 1e6 * (len(times) - 1) / (times[-1] - times[0])
    done = attlog("info", log)
    (line,) = [line for line in done.out.splitlines() if line.startswith("  ATT ")]
    assert line.split()[1:5] == [str(len(times)), "records", f"{rate:.2f}", "Hz"]


def test_records_within_one_second_have_no_rate(attlog, tmp_path):
    path = tmp_path / "burst.ulg"
    long, burst = (1_000_000 + step * np.arange(400) for step in (5000, 20))
    q = np.tile(np.array([1, 0, 0, 0], "<f4"), (400, 1))
    stamps = {"vehicle_attitude": long.astype("<u8"), "offboard": burst.astype("<u8")}
    formats.write(path, Recording({(name, 0): {"timestamp": t, "q": q} for name, t in stamps.items()}))
    rates = {m["name"]: m["rate_hz"] for m in json.loads(attlog("info", path, "--json").out)["messages"]}
    assert rates == {"vehicle_attitude": pytest.approx(200.0), "offboard": None}


def test_several_logs_are_told_one_after_the_other_and_a_bad_one_loses_none(attlog, samples, tmp_path):
    (tmp_path / "bad.ulg").write_bytes(b"x" * 400)
    done = attlog("info", samples / "px4_hover.ulg", tmp_path / "bad.ulg", samples / "copter_yaw_turns.bin")
    assert done.code == 65
    assert done.out.index("px4_hover.ulg") < done.out.index("copter_yaw_turns.bin")
    assert "bad.ulg" in done.err
