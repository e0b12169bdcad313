"""Every value of every undamaged log equals the reading of pyulog, pymavlink or rosbags."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import formats
from tests.conftest import SAMPLES, corpus_logs
from tests.formats.reference import differences, read_reference

# pymavlink reads a megabyte in seconds.
MAX_QUICK_BYTES = {".ulg": 3_000_000}
# Of other loggers, damaged on purpose, of two firmwares, or a TypeError in pymavlink.
NOT_COMPARABLE = ("px4log", "made_", "two_boots", "nofmt", "octo_pm", "tradheli", "encrypted", "garbage", "4.0_aux")


def _comparable() -> list[Any]:
    paths = [p for p in corpus_logs() if not any(word in p.name for word in NOT_COMPARABLE)]
    return [
        pytest.param(
            p,
            id=p.name,
            marks=[pytest.mark.slow] if p.stat().st_size > MAX_QUICK_BYTES.get(p.suffix.lower(), 150_000) else [],
        )
        for p in paths
    ]


@pytest.mark.parametrize("path", _comparable())
def test_every_value_equals_the_official_reading(path: Path) -> None:
    assert differences(path) == []
    assert sum(map(len, formats.open(path).values())) > 100


@pytest.mark.parametrize(
    ("name", "size"), [("copter_steps_stabilize.bin", 400_001), ("copter_steps_stabilize.tlog", 150_001)]
)
def test_the_head_of_a_sample_equals_the_official_reading(name: str, size: int, tmp_path: Path) -> None:
    head = tmp_path / name
    head.write_bytes((SAMPLES / name).read_bytes()[:size])
    assert differences(head) == []


def test_planted_differences_are_found() -> None:
    path = SAMPLES / "px4_steps.ulg"
    theirs = read_reference(path)
    gyro = theirs["sensor_combined", 0]
    gyro["gyro_rad[1]"] = gyro["gyro_rad[1]"].copy()
    gyro["gyro_rad[1]"][[5, 77]] += np.float32(1e-3)
    mag = theirs["vehicle_magnetometer", 0]
    theirs["vehicle_magnetometer", 0] = {name: np.delete(column, 3) for name, column in mag.items()}
    del theirs["vehicle_attitude", 0]["q[3]"]
    del theirs["battery_status", 0]
    found = differences(path, theirs)
    assert f"sensor_combined:0.gyro_rad[1]: 2 of {len(gyro['timestamp'])} values differ" in found
    assert "vehicle_attitude:0.q[3]: only one reader has this field" in found
    assert "battery_status:0: only attlog reads it" in found
    assert {line.partition(".")[0] for line in found} == {
        "battery_status:0: only attlog reads it",
        "sensor_combined:0",
        "vehicle_attitude:0",
        "vehicle_magnetometer:0",
    }


def test_a_short_mavlink_1_packet_behind_one_of_mavlink_2_is_no_difference(tmp_path: Path) -> None:
    from pymavlink.dialects.v20 import ardupilotmega

    sender = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
    packets: list[bytes] = []
    for k in range(30):
        for message, old in [
            (ardupilotmega.MAVLink_attitude_message(10 * k, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0), False),
            (ardupilotmega.MAVLink_param_request_list_message(1, 1), True),
            (ardupilotmega.MAVLink_mission_ack_message(1, 1, 0), True),
            (ardupilotmega.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3), k % 2 == 0),
        ]:
            stamp = (1_700_000_000_000_000 + len(packets)).to_bytes(8, "big")
            packets.append(stamp + message.pack(sender, force_mavlink1=old))
    path = tmp_path / "mixed.tlog"
    path.write_bytes(b"".join(packets))
    assert differences(path) == []
    assert sum(map(len, formats.open(path).values())) == 120
