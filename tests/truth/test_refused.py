"""What is refused as a truth, with the reason and what to do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog import truth
from attlog.base import rotation
from attlog.base.errors import LogUnreadable, UsageError
from attlog.flight.model import FlightLog
from attlog.truth.request import parsed
from tests.reference.flights import flight
from tests.truth.files import Made, made, tum


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return flight(120.0)


def refused(log: FlightLog, given: object) -> str:
    with pytest.raises(UsageError) as error:
        truth.brought(log, str(given))
    return str(error.value)


def wandering(seed: int) -> Made:
    """The attitude of another flight."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 100.0, 0.02)
    rate = np.cumsum(rng.normal(size=(len(t), 3)), axis=0)
    rate -= np.column_stack([np.convolve(x, np.ones(100) / 100, "same") for x in rate.T])
    q = np.empty((len(t), 4))
    q[0] = [1.0, 0.0, 0.0, 0.0]
    for i, turn in enumerate(rotation.from_rotvec(0.02 * 0.2 * rate[:-1])):
        q[i + 1] = rotation.multiply(q[i], turn)
    return Made(t, q, np.zeros((len(t), 3)))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_another_flight(log: FlightLog, tmp_path: Path, seed: int) -> None:
    said = refused(log, tum(tmp_path, wandering(seed)))
    assert "is it of this flight" in said or "offset=" in said or "how it is mounted" in said


def test_a_constant_attitude(log: FlightLog, tmp_path: Path) -> None:
    m = made(noise_deg=0.0)
    said = refused(log, tum(tmp_path, replace(m, q=np.broadcast_to(m.q[0], m.q.shape))))
    assert "correlation 0.00" in said


def test_noise_alone(log: FlightLog, tmp_path: Path) -> None:
    m = made()
    q = rotation.from_rotvec(0.01 * np.random.default_rng(0).normal(size=(len(m.q), 3)))
    assert "do not follow the gyro" in refused(log, tum(tmp_path, replace(m, q=q)))


def test_a_flight_without_motion(tmp_path: Path) -> None:
    still = flight(19.0)
    said = refused(still, tum(tmp_path, made(begin=0.0, end=19.0)))
    assert "the log turns by 0 deg/s" in said


def test_too_short_a_file(log: FlightLog, tmp_path: Path) -> None:
    assert "shares no 10 s" in refused(log, tum(tmp_path, made(begin=40.0, end=47.0)))


def test_a_wrong_offset(log: FlightLog, tmp_path: Path) -> None:
    said = refused(log, f"{tum(tmp_path, made(offset=0.0))}:offset=7")
    assert "do not follow the gyro" in said or "how it is mounted" in said


def test_a_topic_that_is_not_there_lists_what_is(log: FlightLog) -> None:
    assert "it holds ATT" in refused(log, "vehicle_mocap_odometry")


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(LogUnreadable, match="no such file"):
        truth.check("nowhere/mocap.txt:north=true")
    truth.check("vehicle_mocap_odometry")


def test_no_numbers(log: FlightLog, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("nothing here\n")
    assert "no time" in refused(log, path)


@pytest.mark.parametrize(
    ("given", "name", "offset", "north"),
    [
        (r"C:\lab\run 1.txt", r"C:\lab\run 1.txt", None, False),
        (r"C:\lab\run.txt:north=true,offset=-3.5", r"C:\lab\run.txt", -3.5, True),
        ("2024-05-01_12:30:00.tum:offset=1e3", "2024-05-01_12:30:00.tum", 1000.0, False),
        ("VISP", "VISP", None, False),
    ],
)
def test_names_may_hold_colons(given: str, name: str, offset: float | None, north: bool) -> None:
    found = parsed(given)
    assert (found.name, found.offset, found.north) == (name, offset, north)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("a.txt:ofset=1", "did you mean offset=?"),
        ("a.txt:offset=x", "no number of seconds"),
        ("a.txt:north=perhaps", "use true or false"),
        ("a.txt:north=true,north=false", "twice"),
        (":north=true", "name a file"),
    ],
)
def test_keys_that_are_wrong_are_told_before_a_log_is_read(given: str, said: str) -> None:
    with pytest.raises(UsageError, match=said.replace("?", r"\?")):
        truth.check(given)
