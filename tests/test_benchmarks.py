"""The benchmark scripts run: at a tiny size, where only their figures of quality can be judged, not speed."""

from __future__ import annotations

import importlib
import runpy
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from attlog import formats
from attlog.core import rotation
from tests.conftest import ROOT, SAMPLES, few

BENCHMARKS = ROOT / "benchmarks"
Script = Callable[[str], ModuleType]
PEERS = [
    "vqf",
    "vqf_offline",
    "vqf_restored",
    "vqf_offline_restored",
    "imufusion",
    "ahrs",
    "qmt_madgwick",
    "qmt_mahony",
    "riann",
    "attipy",
]


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Iterator[Script]:
    """Imports a script as its neighbours do: its folder on the path."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    yield importlib.import_module
    for name in [path.stem for path in BENCHMARKS.glob("*.py")]:
        sys.modules.pop(name, None)


@pytest.mark.parametrize("path", sorted(BENCHMARKS.glob("*.py")), ids=lambda path: path.stem)
def test_asked_for_help_a_script_prints_it_and_runs_nothing(
    path: Path, script: Script, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    script(path.stem)
    assert capsys.readouterr() == ("", ""), "importing it ran something"
    if '"__main__"' not in path.read_text(encoding="utf-8"):
        return
    monkeypatch.setattr(sys, "argv", [path.name, "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(path), run_name="__main__")
    assert not ended.value.code
    assert capsys.readouterr().out.startswith("usage: ")


NAMES = [
    "px4_steps.ulg",
    "px4_hover.ulg",
    "copter_steps_stabilize.bin",
    "copter_yaw_turns.bin",
    "copter_steps_stabilize.tlog",
]


@pytest.mark.parametrize("name", few(NAMES, 1))
def test_a_made_log_is_sound_for_attlog(name: str, script: Script, tmp_path: Path) -> None:
    """Not a byte is damaged, records stand as often as passes were made, times go on rising."""
    made = script("made_logs")
    size = (SAMPLES / name).stat().st_size
    source, log = formats.open(SAMPLES / name), formats.open(made.repeated(SAMPLES / name, tmp_path / name, 3 * size))
    assert abs(log.size - 3 * size) < size
    assert not log.damage
    assert len(log.boots) == 1
    message, clock = {
        "ulog": ("sensor_combined", "timestamp"),
        "dataflash": ("IMU", "TimeUS"),
        "tlog": ("RAW_IMU", "time_usec"),
    }[log.format]
    long, short = log.first(message), source.first(message)
    assert long is not None
    assert short is not None
    assert len(long) % len(short) == 0
    assert len(long) >= 3 * len(short)
    assert (np.diff(long[clock].astype(np.int64)) > 0).all()
    assert len(log.params) == len(source.params)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"])
def test_a_reader_takes_no_more_than_twice_the_file_for_the_columns_of_a_replay(
    name: str, script: Script, tmp_path: Path
) -> None:
    """The limit of docs/formats.md: the file's own bytes, where its records lie, and the wanted records once."""
    path = script("made_logs").repeated(SAMPLES / name, tmp_path / name, 8_000_000)
    readers = script("readers")
    formats.open(path)  # layouts and tables that are made once for a process
    tracemalloc.start()
    try:
        log = formats.open(path)
        readers.columns(log, readers.WANTED[path.suffix])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert 1.0 < peak / path.stat().st_size <= 2.0


def test_measuring_some_filters_again_keeps_the_lines_of_the_others(script: Script, tmp_path: Path) -> None:
    written, file = script("accuracy_file"), tmp_path / "accuracy.csv"
    trial = np.array([3.0, 2.0, 1.0, 50.0])
    groups = ("broad", "sitl/px4", "sitl/ardupilot", "broad_mid")
    written.write({("gyro", g): [trial, 2.0 * trial] for g in groups} | {("mahony@xu-1.1", "broad"): [trial]}, file)
    written.write({("peer vqf", "euroc"): [trial], ("gyro", "broad"): [trial, trial, trial]}, file)
    rows = [line.split(",") for line in file.read_text().splitlines()]
    assert [row[:4] for row in rows[1:]] == [
        ["gyro", "broad", "3", "3"],
        ["gyro", "simulated", "4", "4.5"],  # both firmwares together
        ["mahony@xu-1.1", "broad", "1", "3"],
        ["package vqf", "euroc", "1", "3"],
    ]


def test_the_table_of_the_filters_is_the_one_of_their_file(script: Script) -> None:
    from attlog.estimators.accuracy import read_accuracy

    table = script("accuracy_file").table(read_accuracy())
    assert table in (ROOT / "docs" / "estimators.md").read_text(encoding="utf-8")
    assert len(table.splitlines()) == len(read_accuracy()) + 2


STILL_S, MOVING_S, RATE_HZ = 150.0, 30.0, 50.0


def known_motion() -> tuple[dict[str, NDArray[np.float64]], NDArray[np.float64]]:
    """Gyro, accelerometer, magnetometer FRD, and the attitude FRD to NED: long still, then turned about all axes."""
    t = np.arange(0.0, STILL_S + MOVING_S, 1.0 / RATE_HZ) - STILL_S
    swing = np.sin(2.0 * np.pi * 0.1 * np.maximum(t, 0.0))
    yaw = 20.0 + 260.0 * np.clip(t / 20.0, 0.0, 1.0)
    q = rotation.from_euler(*np.deg2rad([10.0 + 50.0 * swing, -5.0 + 25.0 * swing, yaw]))
    sensors = {
        "gyr": np.vstack([np.zeros(3), rotation.increments(q)]) * RATE_HZ,
        "acc": rotation.rotate_inverse(q, np.array([0.0, 0.0, -9.80665])),
        "mag": rotation.rotate_inverse(q, np.array([2e-5, 0.0, 4.4e-5])),
    }
    return sensors, q


@pytest.mark.slow
@pytest.mark.parametrize("name", PEERS)
def test_a_peer_finds_a_motion_in_closed_form(name: str, script: Script) -> None:
    """Axes, earth frame, order and direction of the quaternion, units and step are right: no other comes so near."""
    peers, accuracy = script("peers"), script("accuracy")
    if reason := peers.why_not(*peers.NEEDS[name]):
        pytest.skip(f"peer {name}: {reason}")
    sensors, q = known_motion()
    t = np.arange(len(q)) / RATE_HZ
    for mag in (sensors["mag"], None):
        trial = accuracy.Trial("", "", t, sensors["gyr"], sensors["acc"], mag, t, q, t > STILL_S)
        found, ns = peers.PEERS[name](trial)
        angles = trial.errors(t, rotation.normalize(found), heading=name not in peers.WITHOUT_HEADING)
        assert np.isnan(angles).tolist() == [mag is None or name == "riann"] * 2 + [False]
        assert np.nanmax(angles) < 1.0
        assert ns > 0.0
