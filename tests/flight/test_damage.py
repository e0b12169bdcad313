"""Damaged files: what is left is used, what is lost is told, and nothing absurd comes through."""

from __future__ import annotations

import gzip
import random
from pathlib import Path

import numpy as np
import pytest

from attlog import flight
from attlog.base.errors import AttlogError
from tests.conftest import SAMPLES, few

NAMES = ("px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog")


def damaged(content: bytes, seed: int) -> bytes:
    """The file with one of four kinds of damage."""
    rng = random.Random(seed)
    data = bytearray(content)
    place = rng.randrange(len(data))
    if seed % 4 == 0:
        return bytes(data[:place])
    if seed % 4 == 1:
        for _ in range(200):
            data[rng.randrange(len(data))] = rng.randrange(256)
    elif seed % 4 == 2:
        length = rng.randrange(1, 5000)
        data[place : place + length] = rng.randbytes(length)
    else:
        del data[place : place + rng.randrange(1, 50_000)]
    return bytes(data)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", few(range(12), 3))
def test_a_damaged_log_keeps_its_clock_and_its_physics(name: str, seed: int, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(damaged((SAMPLES / name).read_bytes(), seed))
    whole = flight.read(SAMPLES / name)
    try:
        log = flight.read(path)
    except AttlogError as error:
        message = str(error)
    else:
        message = ""
    assert "\n" not in message
    if message:
        return
    if log.imu is None:
        assert any(p.severity == "error" for p in log.problems)
        return
    assert log.seconds <= whole.seconds + 0.1, "no false record stretches the flight"
    imu = log.imus[log.imu]
    assert (np.diff(imu.gyro.t) > 0).all()
    limit = np.abs(whole.imus[whole.imu].gyro.x).max()
    outside = np.abs(imu.gyro.x).max(axis=1) > 3 * limit
    assert outside.sum() <= 2, "single damaged values inside the sensor's range may pass, no more"
    for attitude in log.attitudes.values():
        np.testing.assert_allclose(np.linalg.norm(attitude.q, axis=1), 1.0, atol=1e-9)


@pytest.mark.parametrize("content", [b"", b"\0" * 5000, b"not a log\n" * 100, bytes(range(256)) * 40])
def test_what_is_no_log_ends_in_one_line(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "x.bin"
    path.write_bytes(content)
    with pytest.raises(AttlogError) as caught:
        flight.read(path)
    assert "\n" not in str(caught.value)
    assert "x.bin" in str(caught.value)


def test_a_missing_file_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(AttlogError) as caught:
        flight.read(tmp_path / "nowhere.ulg")
    assert caught.value.exit_code == 66


def test_a_log_in_a_gzip_file_that_ends_early_says_so_first(tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg.gz"
    path.write_bytes(gzip.compress((SAMPLES / "px4_steps.ulg").read_bytes(), 6)[:-200_000])
    log = flight.read(path)
    assert log.imu is not None
    problem = next(p for p in log.problems if p.code == "damage")
    assert "gzip file ends early" in problem.text
    assert "cut_at_end" not in [p.code for p in log.problems]
