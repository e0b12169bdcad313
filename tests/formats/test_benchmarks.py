"""The benchmark scripts run: at a tiny size, where only their figures of quality can be judged, not speed."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from attlog import formats
from tests.conftest import ROOT, SAMPLES


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"benchmark_{name}", ROOT / "benchmarks" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_reader_benchmark_runs(capsys: pytest.CaptureFixture[str]) -> None:
    rows = script("readers").main(["--megabytes", "3", "--oracle-megabytes", "2"])
    assert len(rows) == 9
    assert all(row.ratio > 0 for row in rows)
    printed = capsys.readouterr().out
    assert "ULog wanted" in printed
    assert "tlog wanted" in printed


@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"])
def test_the_large_logs_of_the_benchmark_are_sound(name: str, tmp_path: Path) -> None:
    """Repeated records are undamaged, their checksums right, and their times go on rising."""
    path = script("readers").repeated(SAMPLES / name, tmp_path / name, 7_000_000)
    log, source = formats.open(path), formats.open(SAMPLES / name)
    assert abs(log.size - 7_000_000) < 2_000_000
    assert log.damage_bytes < 100
    assert len(log.boots) == 1
    message, clock = {
        "ulog": ("sensor_combined", "timestamp"), "dataflash": ("IMU", "TimeUS"), "tlog": ("RAW_IMU", "time_usec")
    }[log.format]  # fmt: skip
    long, short = log.first(message), source.first(message)
    assert long is not None
    assert short is not None
    assert len(long) % len(short) == 0
    assert len(long) > len(short)
    assert (np.diff(long[clock].astype(np.int64)) > 0).all()


@pytest.mark.slow
def test_salvage_keeps_99_percent_and_under_one_false_record_a_file() -> None:
    for row in script("salvage").main(["--seconds", "4", "--seeds", "1"]):
        if row.reader == "attlog":
            assert row.kept_pct > 99, row
            assert row.false <= row.files, row
