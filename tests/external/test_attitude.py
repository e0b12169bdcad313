"""An attitude from a file: any spelling of its columns, its clock and axes by physics, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.external import attitude, axes
from attlog.external.read import read_trajectory
from attlog.flight.model import FlightLog, Imu, Stream
from attlog.metrics.metric import Case
from attlog.pipeline import evaluate, prepare
from attlog.result import EstimatorRow
from tests.reference.flights import attitude_at, flight

T = np.arange(0.0, 60.0, 0.02)
Q = attitude_at(T)
TO_ENU = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0])
TO_FLU = np.array([0.0, 1.0, 0.0, 0.0])
ENU_FLU = rotation.multiply(rotation.multiply(TO_ENU, Q), TO_FLU)
EULER, EULER_ENU = np.column_stack(rotation.to_euler(Q).T), rotation.to_euler(ENU_FLU)


@pytest.fixture(scope="module")
def log() -> FlightLog:
    found = flight(60.0)
    found.t0_us = 40_000_000
    found.utc_offset = 1.7e9
    return found


def write(folder: Path, head: str, t: np.ndarray, x: np.ndarray, separator: str = ",") -> Path:
    path = folder / "estimate.csv"
    rows = [separator.join(f"{v:.9f}" for v in (a, *b)) for a, b in zip(t, x, strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def read(path: Path, log: FlightLog, **asked: float | str):
    assert log.replay_imu is not None
    return attitude.read_attitude(path, log, log.replay_imu, asked)


def apart_deg(found) -> float:
    return float(np.degrees(np.max(rotation.total_angle(rotation.earth_error(found.q, attitude_at(found.t))))))


@pytest.mark.parametrize(
    ("head", "t", "x", "frame"),
    [
        ("t,qw,qx,qy,qz", T, Q, "ned-frd"),
        ("time_s,q_w,q_x,q_y,q_z", T, Q, "ned-frd"),
        ("TimeUS,Q1,Q2,Q3,Q4", 1e6 * T, Q, "ned-frd"),
        ("timestamp,q[0],q[1],q[2],q[3]", 1e6 * T, Q, "ned-frd"),
        ("Time (ms),W,X,Y,Z", 1e3 * T, Q, "ned-frd"),
        ("x,y,z,w,t", Q[:, 1], np.column_stack([Q[:, 2], Q[:, 3], Q[:, 0], T]), "ned-frd"),
        ("t,qw,qx,qy,qz", T, ENU_FLU, "enu-flu"),
        ("t,qw,qx,qy,qz", T, rotation.conjugate(Q), "frd-ned"),
        ("t,Roll,Pitch,Yaw", T, np.degrees(EULER), "ned-frd, angles in deg"),
        ("t,roll_rad,pitch_rad,yaw_rad", T, EULER, "ned-frd, angles in rad"),
        ("t,roll [deg],pitch [deg],heading [deg]", T, np.degrees(EULER), "ned-frd, angles in deg"),
        ("t,phi,theta,psi", T, EULER, "ned-frd, angles in rad"),
        ("t,roll_deg,pitch_deg,yaw_deg", T, np.degrees(EULER_ENU), "enu-flu, angles in deg"),
    ],
)
def test_any_usual_spelling_and_frame_is_understood(
    log: FlightLog, tmp_path: Path, head: str, t: np.ndarray, x: np.ndarray, frame: str
) -> None:
    found = read(write(tmp_path, head, t, x), log)
    assert found.quality["frame"] == frame
    assert apart_deg(found) < 0.01
    assert len(found.t) > 0.98 * len(T)


@pytest.mark.parametrize(("shift", "clock"), [(40.0, "since its boot"), (1.7e9, "Unix time"), (0.0, "the log's own")])
def test_the_clock_is_one_that_the_log_knows(log: FlightLog, tmp_path: Path, shift: float, clock: str) -> None:
    found = read(write(tmp_path, "t,qw,qx,qy,qz", T + shift, Q), log)
    assert clock in str(found.quality["clock"])
    assert apart_deg(found) < 0.01


def test_a_short_time_since_boot_is_told_from_the_logs_own_clock_by_the_gyro(tmp_path: Path) -> None:
    log = flight(60.0)
    log.t0_us = 3_000_000
    found = read(write(tmp_path, "t,qw,qx,qy,qz", T + 3.0, Q), log)
    assert "since its boot" in str(found.quality["clock"])
    assert apart_deg(found) < 0.01


def test_an_offset_of_the_users_own_is_added(log: FlightLog, tmp_path: Path) -> None:
    path = write(tmp_path, "t,qw,qx,qy,qz", T + 500.0, Q)
    with pytest.raises(UsageError, match=r"does not overlap the log: its times are 500\.000 to .*offset=SECONDS"):
        read(path, log)
    assert apart_deg(read(path, log, offset=-500.0)) < 0.01


@pytest.mark.parametrize(
    ("head", "x", "why"),
    [
        ("t,qw,qx,qy,qz", attitude_at(T - 3.0), "turns otherwise than the gyro"),
        ("t,qw,qx,qy,qz", np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1)), "turns otherwise than the gyro"),
        ("t,a,b,c,d", Q, "no attitude among its columns t, a, b, c, d"),
        ("n,qw,qx,qy,qz", Q, "no time among its columns"),
        ("t_s,roll_deg,pitch_rad,yaw_deg,z", np.column_stack([EULER, T]), "in two units, deg and rad"),
        ("t,qw,qx,qy,qz", np.full((len(T), 4), np.nan), "0 usable attitudes"),
    ],
)
def test_what_is_no_attitude_of_the_log_is_refused_with_the_reason(
    log: FlightLog, tmp_path: Path, head: str, x: np.ndarray, why: str
) -> None:
    with pytest.raises(UsageError, match=why):
        read(write(tmp_path, head, T, x), log)


def test_a_frame_that_is_asked_for_must_agree_with_gyro_and_gravity_too(log: FlightLog, tmp_path: Path) -> None:
    path = write(tmp_path, "t,qw,qx,qy,qz", T, ENU_FLU)
    assert apart_deg(read(path, log, frame="enu-flu")) < 0.01
    with pytest.raises(UsageError, match="ned-frd: turns otherwise than the gyro"):
        read(path, log, frame="ned-frd")


def test_rows_without_numbers_and_times_that_do_not_rise_are_left_out(log: FlightLog, tmp_path: Path) -> None:
    path = write(tmp_path, "t,qw,qx,qy,qz", T, Q)
    lines = path.read_text().splitlines()
    lines[100] = "1.98,,,,"
    lines[200] = lines[150]
    path.write_text("\n".join([*lines, "garbage"]))
    found = read(path, log)
    assert apart_deg(found) < 0.01
    assert len(found.t) == len(T[T <= float(log.imus[0].gyro.t[-1])]) - 2


# Truth and replays of a flight, written as a user would and read back as rows.

FLIGHTS = ("px4/px4_steps.ulg", "ardupilot/copter_steps_stabilize.bin")


def written(path: Path, head: str, t: np.ndarray, x: np.ndarray) -> str:
    rows = [",".join(f"{v:.9f}" for v in (a, *b)) for a, b in zip(t, x, strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return str(path)


def rows(case: Case, *specs: str) -> dict[str, EstimatorRow]:
    return {row.name: row for row in evaluate(case, ",".join(specs)).estimators}


@pytest.mark.parametrize("name", FLIGHTS)
def test_truth_as_a_file_has_no_lag_and_what_is_late_in_it_is_told(corpus: Path, tmp_path: Path, name: str) -> None:
    case = prepare(corpus / "sitl" / name)
    t, q = case.reference.t, case.reference.q
    files = [
        written(tmp_path / "quaternion.csv", "t,qw,qx,qy,qz", t, q),
        written(tmp_path / "euler.csv", "t,roll,pitch,yaw", t, np.degrees(rotation.to_euler(q))),
        written(tmp_path / "late.csv", "t,qw,qx,qy,qz", t + 0.02, q),
    ]
    found = rows(case, *files, files[2] + ":delay=20")
    for row, lag in {"quaternion": 0.0, "euler": 0.0, "late": 20.0, "late:delay=20": 0.0}.items():
        told = found[row].metrics["airborne"]["lag_ms"]
        assert told.value == pytest.approx(lag, abs=0.1)
        assert told.ci95[0] <= lag <= told.ci95[1]
        assert told.ranked
    for row in ("quaternion", "euler"):
        assert found[row].metrics["airborne"]["tilt_rmse_deg"].value < 0.001
        assert found[row].metrics["airborne"]["step_error_deg.0.5s"].value < 0.001


def test_a_replay_as_a_file_is_the_replay(corpus: Path, tmp_path: Path) -> None:
    from attlog.pipeline.replay import run_rows

    case = prepare(corpus / "sitl" / FLIGHTS[1])
    row = run_rows(case, ["mahony"])[0]
    file = written(tmp_path / "again.csv", "time_s,q_w,q_x,q_y,q_z", row.t, row.q)
    delay = 1e3 * case.reference.alignment.input_delay_s
    found = rows(case, "mahony", f"{file}:delay={delay}")
    own, again = found["mahony"].metrics, found[f"again:delay={delay:g}"].metrics
    for window, metric in (
        ("airborne", "lag_ms"),
        ("airborne", "tilt_rmse_deg"),
        ("airborne", "heading_rmse_deg"),
        ("airborne", "step_error_deg.0.5s"),
        ("rest", "noise_tilt_deg"),
        ("cruise", "noise_tilt_deg"),
    ):
        assert again[window][metric].value == pytest.approx(own[window][metric].value, rel=1e-3), metric


# Times of a column that names no unit: the one that makes a rate of attitudes, the longest where two do.


@pytest.mark.parametrize(("step", "unit_s"), [(0.02, 1.0), (20.0, 1e-3), (500.0, 1e-3), (5000.0, 1e-6), (2e7, 1e-9)])
def test_a_time_without_a_unit_has_the_one_that_makes_a_rate(tmp_path: Path, step: float, unit_s: float) -> None:
    path = tmp_path / "a.csv"
    t = step * np.arange(30)
    path.write_text("\n".join(["t,qw,qx,qy,qz", *(f"{x},1,0,0,0" for x in t)]) + "\n")
    assert read_trajectory(path).t == pytest.approx(unit_s * t)


# By which turns an attitude is told to be the gyro's.


def test_what_a_filter_adds_in_slow_turns_does_not_count_where_fast_ones_tell() -> None:
    """Two thirds turn at 40 deg/s as the gyro does; the rest at 4, where the filter adds as much."""
    t = np.arange(0.0, 60.0, 0.01)
    fast = t < 40.0
    gyro = np.radians(np.where(fast, 40.0, 4.0))[:, None] * [1.0, 0.0, 0.0]
    own = np.where(fast, 1.0, 2.0)[:, None] * gyro
    turned = np.concatenate([[0.0], np.cumsum(own[1:, 0] * 0.01)])
    unit = Imu(0, Stream(t, gyro, "rad/s", "FRD", "IMU"), Stream(t, 0.0 * gyro, "m/s^2", "FRD", "IMU"))
    q = rotation.from_euler(turned, 0.0 * t, 0.0 * t)
    assert axes._rate_difference(t, q, unit) == pytest.approx(0.0, abs=0.01)
