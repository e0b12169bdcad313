"""The script that cuts sample logs keeps definitions, parameters and every record in the window."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from tests.conftest import SAMPLES

CLOCKS = {"ulog": "timestamp", "dataflash": "TimeUS", "tlog": "_t_us"}


@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"])
def test_a_cut_log_holds_the_window_and_all_parameters(name: str, tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("cut", SAMPLES / "cut.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    whole = formats.open(SAMPLES / name)
    script.cut(SAMPLES / name, tmp_path / name, 20.0, 30.0)
    short = formats.open(tmp_path / name)
    clock = CLOCKS[whole.format]
    zero = min(int(t[clock].astype(np.int64).min()) for t in whole.values() if clock in t)
    assert short.size < whole.size / 2
    assert [(p.name, p.value) for p in short.params] == [(p.name, p.value) for p in whole.params]
    assert len(short.texts) == len(whole.texts)
    imu = {"ulog": "sensor_combined", "dataflash": "IMU", "tlog": "RAW_IMU"}[whole.format]
    before, after = whole.first(imu), short.first(imu)
    assert before is not None
    assert after is not None
    seconds = (before[clock].astype(np.int64) - zero) / 1e6
    inside = (seconds >= 20) & (seconds < 30)
    assert inside.sum() > 400
    for field in before.fields:
        assert np.array_equal(before[field][inside], after[field]), field
