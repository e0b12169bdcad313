"""Wrong units are warned of, right ones never, on simulated flights with and without turns."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import attlog
from attlog.estimators.unit_checks import UnitWarning, unit_doubts
from tests.conftest import SAMPLES

LOGS = ("px4_steps.ulg", "copter_steps_stabilize.bin", "px4_hover.ulg")


@pytest.fixture(scope="module", params=LOGS)
def samples(request: pytest.FixtureRequest) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    imu = attlog.read(SAMPLES / request.param).replay_imu
    assert imu is not None
    return imu.gyro.t, imu.gyro.x, imu.acc.x


def test_samples_in_si_units_are_not_doubted(samples) -> None:
    assert unit_doubts(*samples) == []


@pytest.mark.parametrize(
    ("t", "gyr", "acc", "named"),
    [
        (1e6, 1.0, 1.0, "us"),
        (1e3, 1.0, 1.0, "ms"),
        (1e9, 1.0, 1.0, "ns"),
        (1.0, 180 / np.pi, 1.0, "deg/s"),
        (1.0, 1.0, 1 / 9.80665, "like g;"),
        (1.0, 1.0, 1e3 / 9.80665, "mg"),
        (1.0, np.array([1.0, -1.0, -1.0]), np.array([1.0, -1.0, -1.0]), "FLU"),
    ],
)
def test_each_wrong_unit_is_named(samples, t, gyr, acc, named: str) -> None:
    found = unit_doubts(samples[0] * t, samples[1] * gyr, samples[2] * acc)
    assert len(found) == 1
    assert named in found[0]


@pytest.mark.parametrize("bank_deg", [0.0, 30.0, 45.0])
def test_a_plane_that_circles_all_the_time_is_not_taken_for_degrees(bank_deg: float) -> None:
    """In its own axes the force keeps its direction, as in a body that does not turn."""
    t, bank = np.arange(0.0, 120.0, 0.02), np.radians(bank_deg)
    rate = 9.80665 * np.tan(bank) / 15.0
    gyr = np.tile([0.0, rate * np.sin(bank), rate * np.cos(bank)], (len(t), 1))
    acc = np.tile([0.0, 0.0, -9.80665 / np.cos(bank)], (len(t), 1))
    assert unit_doubts(t, gyr, acc) == []


def test_aerobatics_in_rad_per_s_are_not_taken_for_degrees() -> None:
    """Rolls at 360 deg/s, every two seconds, with thrust along the body's axis."""
    t = np.arange(0.0, 60.0, 0.005)
    roll = 2 * np.pi * np.floor(t / 2) + np.clip(t % 2, 0, 1) * 2 * np.pi
    gyr = np.column_stack([np.gradient(roll, t), np.zeros_like(t), np.zeros_like(t)])
    assert unit_doubts(t, gyr, np.tile([0.0, 0.0, -9.80665], (len(t), 1))) == []


def test_samples_that_are_too_few_broken_or_zero_are_not_judged() -> None:
    t = np.arange(200) * 0.01
    zero, broken = np.zeros((200, 3)), np.full((200, 3), np.nan)
    assert unit_doubts(t[:10] * 1e6, zero[:10], zero[:10]) == []
    assert unit_doubts(t, zero, zero) == unit_doubts(t, broken, broken) == unit_doubts(t, zero, None) == []


@pytest.mark.parametrize("late", [np.arange(55.0, 57.0, 0.01), np.array([1.7e9]), np.array([1e300])])
@pytest.mark.parametrize("scale", [1.0, 180.0 / np.pi])
def test_a_gap_or_a_stray_time_at_the_end_keeps_the_verdict(late: np.ndarray, scale: float) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 40.0, 0.005)
    turn = 1.5 * np.sin(2.0 * t)
    gyr = np.column_stack([turn, 0.1 * rng.normal(size=(len(t), 2))])
    angle = 0.75 * (1.0 - np.cos(2.0 * t))
    acc = -9.80665 * np.column_stack([0.0 * t, np.sin(angle), np.cos(angle)])
    rest = np.zeros((len(late), 3))
    found = unit_doubts(np.r_[t, late], np.r_[scale * gyr, rest], np.r_[acc, rest - [0.0, 0.0, 9.8]])
    assert ["deg/s" in text for text in found] == ([] if scale == 1.0 else [True])


def test_estimate_warns_at_the_line_of_the_caller_and_runs() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    gyr, acc = np.zeros((len(t), 3)), np.tile([0.0, 0.0, -1.0], (len(t), 1))
    with pytest.warns(UnitWarning, match=r"acc \* 9\.80665") as told:
        found = attlog.estimate("mahony", t, gyr, acc)
    assert told[0].filename == __file__
    assert found.q.shape == (len(t), 4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        attlog.estimate("mahony", t, gyr, 9.80665 * acc)
