"""``attlog extract``: what is written equals what pyulog and pymavlink read; pandas and pyarrow open it as it is."""

from __future__ import annotations

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pandas
import pytest

from attlog import flight
from attlog.core.errors import OutputError
from attlog.pipeline import extraction


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_ulog_topic_equals_pyulog(attlog, samples, tmp_path, kind):
    from pyulog import ULog

    log = samples / "px4_steps.ulg"
    path = tmp_path / f"attitude.{kind}"
    assert attlog("extract", log, "vehicle_attitude", "--from", "20", "--to", "30", "-o", path).code == 0
    t = (pandas.read_csv(path) if kind == "csv" else pandas.read_parquet(path))["time_s"]
    assert (t.min() >= 20, t.max() <= 30, t.max() - t.min() > 9.5) == (True, True, True)
    assert attlog("extract", log, "vehicle_attitude", "--format", kind, "-o", path).code == 0
    table = pandas.read_csv(path) if kind == "csv" else pandas.read_parquet(path)
    expected = ULog(str(log)).get_dataset("vehicle_attitude").data
    assert table.columns[0] == "time_s"
    assert np.array_equal(table["timestamp"], expected["timestamp"])
    for k in range(4):
        assert np.array_equal(table[f"q[{k}]"].to_numpy(np.float32), expected[f"q[{k}]"])
    dt = np.diff(table["time_s"]) * 1e6
    assert np.allclose(dt, np.diff(expected["timestamp"].astype(np.int64)), atol=1e-3)


def test_a_dataflash_message_equals_pymavlink(attlog, samples, tmp_path):
    from pymavlink import DFReader

    log = samples / "copter_steps_stabilize.bin"
    path = tmp_path / "ATT.csv"
    assert attlog("extract", log, "ATT", "-o", path).code == 0
    table = pandas.read_csv(path)
    reader = DFReader.DFReader_binary(str(log))
    expected = []
    while (m := reader.recv_match(type="ATT")) is not None:
        expected.append((m.TimeUS, m.Roll, m.Pitch, m.Yaw))
    assert np.allclose(table[["TimeUS", "Roll", "Pitch", "Yaw"]], expected, rtol=1e-6, atol=1e-9)


def test_streams_are_si_with_units_in_names_and_metadata(attlog, samples, tmp_path):
    import pyarrow.parquet

    log = samples / "copter_steps_stabilize.bin"
    assert attlog("extract", log, "--streams", "--format", "parquet", "-o", tmp_path).code == 0
    imu = pandas.read_parquet(tmp_path / "imu0.parquet")
    assert list(imu.columns) == ["time_s"] + [f"gyro_{a}_rad_s" for a in "xyz"] + [f"acc_{a}_m_s2" for a in "xyz"]
    assert imu["time_s"].iloc[0] == pytest.approx(0.0, abs=1e-6)
    assert np.linalg.norm(imu.filter(like="acc").to_numpy(), axis=1)[:200].mean() == pytest.approx(9.81, abs=0.3)
    mag = pandas.read_parquet(tmp_path / "mag0.parquet")
    assert 20 < np.linalg.norm(mag.filter(like="mag").to_numpy(), axis=1).mean() < 70
    about = json.loads(pyarrow.parquet.read_schema(tmp_path / "imu0.parquet").metadata[b"attlog"])
    assert about["units"]["gyro_x_rad_s"] == "rad/s"
    assert about["frame"] == "body FRD, earth NED"


def test_estimates_are_unit_quaternions_with_euler_angles_that_match(attlog, samples, tmp_path):
    from scipy.spatial.transform import Rotation

    log = samples / "px4_steps.ulg"
    assert attlog("extract", log, "--estimates", "mahony@xu-0.6", "-o", tmp_path).code == 0
    (path,) = tmp_path.glob("estimate_*.csv")
    table = pandas.read_csv(path)
    q = table[["q_w", "q_x", "q_y", "q_z"]].to_numpy()
    assert np.allclose(np.linalg.norm(q, axis=1), 1, atol=1e-9)
    yaw, pitch, roll = Rotation.from_quat(q, scalar_first=True).as_euler("ZYX", degrees=True).T
    assert np.allclose(table[["roll_deg", "pitch_deg", "yaw_deg"]], np.column_stack([roll, pitch, yaw]), atol=1e-6)


@pytest.mark.parametrize(
    ("log", "message"),
    [
        ("logs/bin_copter_3.2.1_quad_cut.BIN", "GPS"),  # TimeMS is the time of the week there
        ("logs/tlog_mav1_copter_3.2dev.tlog", "GPS_RAW_INT"),  # time_usec is Unix time there
    ],
)
def test_every_message_is_on_the_clock_of_the_flight(corpus, log, message):
    import attlog
    from attlog.pipeline import extraction

    flight = attlog.read(corpus / log)
    (table,) = extraction.messages(flight, [message])
    assert -30 < table.columns["time_s"][0] < table.columns["time_s"][-1] < flight.seconds + 30


def test_one_table_to_standard_output_is_what_the_file_holds(attlog, samples, tmp_path):
    log = samples / "copter_steps_stabilize.bin"
    assert attlog("extract", log, "ATT", "-o", tmp_path / "a.csv").code == 0
    done = subprocess.run([sys.executable, "-m", "attlog", "extract", log, "ATT", "-o", "-"], capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout == (tmp_path / "a.csv").read_bytes()
    for place, words in (("-", "one table, not 2 tables (ATT, IMU"), (tmp_path / "x.csv", "folder")):
        several = attlog("extract", log, "ATT", "IMU", "-o", place)
        assert (several.code, words in several.err) == (2, True)


def test_the_suffix_of_the_file_says_the_format(attlog, samples, tmp_path):
    log = samples / "copter_steps_stabilize.bin"
    assert attlog("extract", log, "ATT", "-o", tmp_path / "a.parquet").code == 0
    assert len(pandas.read_parquet(tmp_path / "a.parquet")) > 1000
    done = attlog("extract", log, "ATT", "-o", tmp_path / "a.parquet", "--format", "csv")
    assert done.code == 2
    assert "parquet" in done.err


def test_a_name_in_any_case_and_one_instance(attlog, corpus, tmp_path):
    from pymavlink import DFReader

    log = corpus / "sitl/ardupilot/copter_hover_rest.bin"
    assert attlog("extract", log, "imu.1", "IMU[1]", "-o", tmp_path / "imu.csv").code == 0
    reader = DFReader.DFReader_binary(str(log))
    expected = []
    while (m := reader.recv_match(type="IMU")) is not None:
        if m.I == 1:
            expected.append(m.TimeUS)
    table = pandas.read_csv(tmp_path / "imu.csv")
    assert table["TimeUS"].tolist() == expected
    assert set(table["I"]) == {1}


@pytest.mark.parametrize(
    ("asked", "told"), [("ATTI", "did you mean ATT"), ("MAG.7", "no instance 7 of MAG"), ("zzz", "it has ")]
)
def test_every_unknown_name_is_told_at_once(attlog, samples, tmp_path, asked, told):
    done = attlog("extract", samples / "copter_steps_stabilize.bin", asked, "BARRO", "-o", tmp_path / "x")
    assert done.code == 2
    assert told in done.err
    assert "did you mean BARO" in done.err


def test_a_range_without_rows_is_told_with_the_times_there_are(attlog, samples, tmp_path):
    log = samples / "copter_steps_stabilize.bin"
    done = attlog("extract", log, "ATT", "--from", "5000", "-o", tmp_path / "a.csv")
    assert done.code == 65
    assert "ATT: no row from 5000 s: its times are 0.0 to" in done.err
    assert not (tmp_path / "a.csv").exists()  # an empty file looks like an answer
    assert attlog("extract", log, "--streams", "--from", "5000", "-o", tmp_path / "all").code == 65
    assert not (tmp_path / "all").exists()
    done = attlog("extract", log, "ATT", "GPS", "--to", "0.1", "-o", tmp_path / "some")
    assert done.code == 0  # what has rows is written
    assert "GPS: no row to 0.1 s" in done.err


def test_without_pyarrow_parquet_is_73_and_says_what_is_needed(attlog, samples, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    done = attlog("extract", samples / "copter_steps_stabilize.bin", "ATT", "-o", tmp_path / "a.parquet")
    assert done.code == 73
    assert "pip install pyarrow" in done.err


def test_a_folder_is_written_whole_or_not_at_all(samples, tmp_path, monkeypatch):
    log = flight.read(samples / "px4_steps.ulg")
    tables = [extraction.Extract(name, {"time_s": np.arange(3.0)}, {}, "") for name in ("first", "second", "third")]
    folder = tmp_path / "out"
    folder.mkdir()
    extraction.write(tables[:1], log, folder, "csv")
    old = (folder / "first.csv").read_text()
    real, asked = extraction._csv, []

    def fails_at_the_third(table):
        asked.append(table.name)
        if len(asked) == 3:
            raise OutputError("no room")
        return real(table)

    monkeypatch.setattr(extraction, "_csv", fails_at_the_third)
    with pytest.raises(OutputError, match="no room"):
        extraction.write(tables, log, folder, "csv")
    assert sorted(path.name for path in folder.iterdir()) == ["first.csv", "first.csv.json"]
    assert (folder / "first.csv").read_text() == old
    monkeypatch.setattr(extraction, "_csv", real)
    written = extraction.write(tables, log, folder, "csv")
    assert [path.name for path in written] == ["first.csv", "second.csv", "third.csv"]
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        [path.name for path in written] + [f"{path.name}.json" for path in written]
    )


def test_fields_are_named_as_on_the_page_and_those_of_a_message_share_its_table(attlog, samples, tmp_path):
    log = samples / "copter_steps_stabilize.bin"
    asked = ("ATT.Roll", "att.DesRoll", "IMU[0].GyrX")
    assert attlog("extract", log, *asked, "-o", tmp_path / "x").code == 0
    files = {path.name: pandas.read_csv(path) for path in (tmp_path / "x").glob("*.csv")}
    assert sorted(files) == ["ATT.csv", "IMU.csv"]
    assert list(files["ATT.csv"].columns) == ["time_s", "Roll", "DesRoll"]
    assert attlog("extract", log, "ATT", "-o", tmp_path / "whole.csv").code == 0
    whole = pandas.read_csv(tmp_path / "whole.csv")
    assert files["ATT.csv"].equals(whole[["time_s", "Roll", "DesRoll"]])
    assert attlog("extract", log, "ATT.Roll", "ATT", "-o", tmp_path / "both.csv").code == 0
    assert pandas.read_csv(tmp_path / "both.csv").equals(whole)
    done = attlog("extract", log, "ATT.Rol", "-o", tmp_path / "none")
    assert (done.code, "no field Rol of ATT; it has TimeUS, DesRoll, Roll" in done.err) == (2, True)


def test_a_name_in_telemetry_is_the_vehicles_own_message():
    """As in the page's picker; other senders have names of their own, and all messages are still all of them."""
    from attlog.pipeline import extraction
    from tests.flight import fake

    heartbeat = {"_t_us": fake.micros(5, 1.0), "type": np.full(5, 2, np.uint8)}
    info = {"system": 1, "systems": {1: {"component": 1}, 255: {"component": None}}}
    opened = fake.messages("tlog", {("HEARTBEAT", 257): heartbeat, ("HEARTBEAT", 65470): heartbeat}, info=info)
    assert list(extraction.select_tables(opened, ["heartbeat"])) == [("HEARTBEAT", 257)]
    assert extraction.select_tables(opened, ["HEARTBEAT[65470].type"]) == {("HEARTBEAT", 65470): ["type"]}
    assert len(extraction.select_tables(opened, [])) == 2
    log = SimpleNamespace(messages=opened)
    assert extraction.other_senders(log, ["heartbeat"]) == [
        "HEARTBEAT: the vehicle's own; others sent HEARTBEAT[65470]"
    ]
