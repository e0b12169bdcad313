"""``attlog info``: what is in a log, in words and as JSON."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from attlog import formats
from attlog.flight.parameters import read_parameter_file
from attlog.formats import Recording
from attlog.health.check import Setting
from tests.conftest import ROOT
from tests.health.made import MADE, OFFSET, REFUSED, SILENT, SOUND, asked


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
    assert {c["verdict"] for c in report["checks"]} <= {"ok", "warning", "fault", "unknown"}
    assert {a["question"] for a in report["answerable"]} == {"accuracy", "noise", "lag", "yaw_drift"}
    text = attlog("info", samples / log)
    assert text.code == 0
    assert firmware in text.out
    assert "What can be answered" in text.out


@pytest.mark.parametrize("log", ["px4_steps.ulg", "copter_steps_stabilize.tlog"])
def test_its_checks_are_those_of_health_and_its_headings_those_of_the_docs(attlog, samples, log):
    def verdicts(command: str) -> list[tuple[str, ...]]:
        checks = json.loads(attlog(command, samples / log, "--json").out)["checks"]
        return [tuple(c.get(key) or "" for key in ("sensor", "question", "verdict", "value", "text")) for c in checks]

    assert verdicts("info") == verdicts("health")
    first = (ROOT / "docs" / "first.md").read_text(encoding="utf-8")
    headings = re.findall(r"^- \*\*(.+?)\*\*", first.partition("attlog info")[2].partition("## 3.")[0], re.MULTILINE)
    text = attlog("info", samples / log).out.splitlines()
    assert len(headings) == 3
    assert [line for line in text if line in headings] == headings


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
    done = attlog("info", log, "-v")
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


# ``attlog health``: whether sensors can be trusted, in words, as JSON, as a table and as a file of parameters.

LOG, OTHER = "copter_steps_stabilize.tlog", "copter_yaw_turns.bin"


def test_it_prints_faults_first_folds_the_rest_and_names_what_to_set(attlog, samples, monkeypatch):
    asked(monkeypatch, *MADE)
    done = attlog("health", samples / LOG)
    assert done.code == 0, done.err
    first, _, *lines = done.out.splitlines()
    assert first.startswith(LOG)
    table = [line.split()[0] for line in lines if line.startswith("  ")]
    assert table.index("MAG.1") < table.index("MAG.0") < table.index("ok:") < table.index("no")
    assert "  ok: vibration" in lines
    assert "  no answer: GNSS delay (why: -v)" in lines
    assert lines[-3:] == ["set", "  COMPASS_OFS_X -12 -> 145", "  COMPASS_OFS_Y 4.5 -> -20.25"]
    assert REFUSED.why_no_setting in done.out
    assert SILENT.text not in done.out


@pytest.mark.slow
def test_json_is_one_line_for_each_log_with_everything_that_should_be_set(attlog, samples, monkeypatch):
    asked(monkeypatch, *MADE)
    done = attlog("health", samples / LOG, samples / "px4_hover.ulg", "--json", "-q")
    told = [json.loads(line) for line in done.out.splitlines()]
    assert [one["log"]["name"] for one in told] == [LOG, "px4_hover.ulg"]
    for one in told:
        assert list(one) == ["log", "headline", "checks", "settings", "findings"]
        assert [a["question"] for a in one["checks"]] == [a.question for a in MADE]
        assert [s["name"] for s in one["settings"]] == ["COMPASS_OFS_X", "COMPASS_OFS_Y"]
        assert {"kind": "compass", "severity": "warning"}.items() <= one["findings"][0].items()


def test_a_table_of_several_logs_names_the_log(attlog, samples, monkeypatch):
    asked(monkeypatch, OFFSET, SOUND)
    done = attlog("health", samples / LOG, "--format", "csv", "-q")
    head, *rows = csv.reader(io.StringIO(done.out))
    assert head == ["sensor", "question", "verdict", "value", "to set", "found"]
    assert [row[:3] for row in rows] == [["MAG.0", "compass offset", "warning"], ["IMU.0", "vibration", "ok"]]
    assert attlog("health", samples / LOG, "--format", "csv", "--json").code == 2


@pytest.mark.slow
def test_a_file_of_parameters_is_written_for_a_log_that_has_some_and_read_again(attlog, samples, tmp_path, monkeypatch):
    asked(monkeypatch, *MADE)
    done = attlog("health", samples / LOG, "-o", tmp_path / "new" / "folder")
    file = tmp_path / "new" / "folder" / f"{LOG}.param"
    assert done.out.splitlines()[-1] == f"parameters: {file}"
    assert read_parameter_file(file) == {"COMPASS_OFS_X": 145.0, "COMPASS_OFS_Y": -20.25}
    asked(monkeypatch, SOUND)
    done = attlog("health", samples / LOG, "-o", tmp_path / "new" / "folder")
    assert f"nothing to set; {file} is of an earlier run" in done.out
    assert not (tmp_path / "other").exists()
    attlog("health", samples / LOG, "-o", tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_a_file_of_parameters_takes_the_place_of_no_log_and_of_no_file_that_is_read(
    attlog, samples, tmp_path, monkeypatch
):
    asked(monkeypatch, OFFSET)
    place = tmp_path / f"{LOG}.param"
    shutil.copy(samples / OTHER, place)
    before = place.read_bytes()
    done = attlog("health", samples / LOG, "-o", tmp_path)
    assert (done.code, place.read_bytes()) == (2, before)
    assert "flight log" in done.err
    place.write_text("COMPASS_USE,1\n")
    done = attlog("health", samples / LOG, "-o", tmp_path, "--params", place)
    assert (done.code, place.read_text()) == (2, "COMPASS_USE,1\n")


def test_a_bad_log_costs_no_other_and_exit_codes_are_those_of_all_commands(attlog, samples, tmp_path, monkeypatch):
    asked(monkeypatch, replace(OFFSET, settings=[Setting("A", None, 1.0)]))
    (tmp_path / "bad.ulg").write_bytes(b"x" * 400)
    done = attlog("health", tmp_path / "bad.ulg", samples / LOG, tmp_path / "missing.bin")
    assert done.code == 66
    assert "bad.ulg" in done.err
    assert "missing.bin" in done.err
    assert done.out.splitlines()[-1] == "  A 1"
    assert attlog("health", tmp_path / "bad.ulg").code == 65
    assert attlog("health", samples / LOG, "--params", tmp_path / "none.param").code == 66
