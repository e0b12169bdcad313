"""``verify`` finds no difference in undamaged logs, and finds every difference that is there."""

from __future__ import annotations

import importlib.util
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.core.errors import NotALog
from attlog.formats import oracle
from attlog.formats.verify import verify
from tests.conftest import SAMPLES, corpus_logs

SMALL = 150_000
REFUSED = ("encrypted", "nofmt", "tiny")
UNREADABLE_BY_PYMAVLINK = ("octo_pm", "tradheli")


@pytest.fixture(scope="module")
def short_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four seconds of the DataFlash sample: pymavlink takes seconds for all of it."""
    spec = importlib.util.spec_from_file_location("cut", SAMPLES / "cut.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    path = tmp_path_factory.mktemp("short") / "short.bin"
    script.cut(SAMPLES / "copter_steps_stabilize.bin", path, 30.0, 34.0)
    return path


def test_samples_agree_with_the_official_libraries(short_log: Path) -> None:
    for path, library in [
        (SAMPLES / "px4_steps.ulg", "pyulog"),
        (short_log, "pymavlink"),
        (SAMPLES / "copter_steps_stabilize.tlog", "pymavlink"),
    ]:
        result = verify(path)
        assert result.agrees, result.differences
        assert result.oracle.startswith(library)
        assert result.records > 1000
        assert result.values > 10 * result.records / 2


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(p, id=p.name, marks=[] if p.stat().st_size < SMALL else [pytest.mark.slow])
        for p in corpus_logs()
        if not any(word in p.name for word in REFUSED) and p.suffix != ".ulg" and p.stat().st_size < 1e6
    ],
)
def test_every_log_in_hand_agrees(path: Path) -> None:
    result = verify(path)
    if any(word in path.name for word in UNREADABLE_BY_PYMAVLINK):
        assert "cannot read this log (TypeError" in result.text
    else:
        assert result.differences == []
        assert result.records > 100


def test_a_wrong_value_a_missing_record_and_a_missing_field_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    path = SAMPLES / "px4_steps.ulg"
    true = oracle.read_by_oracle(path, "ulog")
    columns = true["sensor_combined", 0]
    columns["gyro_rad[1]"] = columns["gyro_rad[1]"].copy()
    columns["gyro_rad[1]"][[5, 77]] += np.float32(1e-3)
    mag = true["vehicle_magnetometer", 0]
    true["vehicle_magnetometer", 0] = {name: np.delete(c, 3) for name, c in mag.items()}
    del true["vehicle_attitude", 0]["q[3]"]
    del true["battery_status", 0]
    monkeypatch.setattr(oracle, "read_by_oracle", lambda *_: true)
    result = verify(path)
    assert not result.agrees
    found = "\n".join(result.differences)
    n = len(columns["timestamp"])
    assert f"sensor_combined:0.gyro_rad[1]: 2 of {n} values differ" in found
    assert "vehicle_magnetometer:0: 1 records only attlog reads, 0 only pyulog" in found
    assert "vehicle_attitude:0.q[3]: only attlog has this field" in found
    assert "battery_status:0: only attlog reads it" in found
    assert len(result.differences) == 4


@pytest.mark.slow
def test_on_a_damaged_log_it_tells_what_each_reader_lost(tmp_path: Path) -> None:
    raw = bytearray((SAMPLES / "px4_hover.ulg").read_bytes()[:1_000_000])
    raw[500_000:504_096] = bytes(4096)
    (tmp_path / "damage.ulg").write_bytes(raw)
    result = verify(tmp_path / "damage.ulg")
    assert result.agrees
    assert "damaged" in result.text
    assert any("records only" in line for line in result.explained)


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.bin").write_bytes(b"\x55" * 5000)
    with pytest.raises(NotALog):
        verify(tmp_path / "x.bin")


def test_the_oracles_print_nothing(short_log: Path, capfd: pytest.CaptureFixture[str]) -> None:
    damaged = short_log.with_name("noisy.bin")
    raw = short_log.read_bytes()
    damaged.write_bytes(raw[: len(raw) // 2] + b"\xff" * 300 + raw[len(raw) // 2 :])
    verify(damaged)
    assert capfd.readouterr() == ("", "")


def test_a_short_packet_of_the_first_version_behind_one_of_the_second_is_no_difference(tmp_path: Path) -> None:
    """Telling from the packet before, the library's parser would take the beginning of the next stamp with it."""
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
    result = verify(path)
    assert (result.agrees, result.records, result.differences) == (True, 120, [])


@pytest.mark.slow
def test_a_library_that_never_ends_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, attlog: Any) -> None:
    monkeypatch.setattr(oracle, "VERIFY_S", 0.0)
    monkeypatch.setattr(oracle, "VERIFY_S_PER_BYTE", 0.0)
    path = tmp_path / "long.tlog"
    path.write_bytes(20 * (SAMPLES / "copter_steps_stabilize.tlog").read_bytes())
    found = verify(path)
    assert (found.agrees, found.late) == (None, True)  # no difference was found
    assert found.text == "it is not done after 1 s of CPU time"
    done = attlog("info", "--verify", path)
    assert done.code == 75
    assert "Not compared with pymavlink: it is not done after" in done.out


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGXCPU"), reason="no limit of CPU time on this system")
def test_time_in_which_the_library_does_not_run_is_not_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit on the clock called a log different because the machine was busy: here its process waits 3 s of 2."""
    monkeypatch.setattr(oracle, "VERIFY_S", 2.0)
    monkeypatch.setattr(oracle, "VERIFY_S_PER_BYTE", 0.0)
    slow = tmp_path / "python"
    slow.write_text(f'#!/bin/sh\nsleep 3\nexec {sys.executable} "$@"\n')
    slow.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(slow))
    assert verify(SAMPLES / "px4_hover.ulg").agrees


def test_records_that_only_one_reader_has_are_told_with_who_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    path = SAMPLES / "px4_steps.ulg"
    true = oracle.read_by_oracle(path, "ulog")
    del true["battery_status", 0]
    monkeypatch.setattr(oracle, "read_by_oracle", lambda *_: true)
    missing = verify(path)
    assert f"leaves out {missing.only_ours} records that stand in the file" in missing.text
    assert "framed by its own definitions from the first byte to the last" in missing.text
    assert "please report" not in missing.text
    true["made_up", 0] = {"timestamp": np.arange(7)}
    more = verify(path)
    assert more.only_theirs == 7
    assert "attlog leaves out 7 records and found no damage" in more.text
    gyro = true["sensor_combined", 0]
    gyro["gyro_rad[1]"] = gyro["gyro_rad[1]"] + np.float32(1.0)
    assert f"Of {len(gyro['timestamp'])} values both readers have a reading each" in verify(path).text
