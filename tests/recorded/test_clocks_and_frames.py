"""Which clock and which axes a file has: planted offsets and half turns, asymmetric in every axis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.base import rotation
from attlog.base.errors import UsageError
from attlog.flight.model import Firmware, FlightLog, Imu, Stream
from attlog.recorded import columns, frame
from attlog.recorded.clock import on_log
from attlog.recorded.columns import AttitudeColumns

T = np.arange(0.0, 60.0, 0.02)
PATH = Path("made.csv")


def motion(t: np.ndarray) -> np.ndarray:
    """Attitudes (n, 4) that swing about each axis by another angle, at another pace."""
    return rotation.from_euler(0.5 * np.sin(1.1 * t), 0.3 * np.sin(0.7 * t + 1.0), 1.2 * np.sin(0.4 * t) + 0.6)


def unit(t: np.ndarray = T) -> Imu:
    fine = np.arange(t[0] - 0.01, t[-1] + 0.011, 0.001)
    q = motion(fine)
    turn = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / 0.001
    gyro = np.column_stack([np.interp(t, fine[:-1] + 0.0005, turn[:, k]) for k in range(3)])
    acc = rotation.rotate_inverse(motion(t), np.array([0.0, 0.0, -9.81]))
    return Imu(0, Stream(t, gyro, "rad/s", "FRD", "IMU"), Stream(t, acc, "m/s^2", "FRD", "IMU"))


def log(t0_us: int = 0, utc: float | None = None) -> FlightLog:
    made = FlightLog(Path("made.bin"), "made", 0, t0_us, Firmware("made"), "quadrotor", imus=[unit()], imu=0)
    made.t0_us, made.utc_offset = t0_us, utc
    return made


def table(t: np.ndarray) -> AttitudeColumns:
    return AttitudeColumns(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), None, "", "t, q")


@pytest.mark.parametrize(
    ("shift", "said"), [(0.0, "the log's own"), (-137.5, "the autopilot's"), (-1.6e9, "Unix time"), (12.25, "added")]
)
def test_times_of_a_file_come_to_lie_on_the_logs_clock(shift: float, said: str) -> None:
    found = on_log(PATH, table(T - shift), log(137_500_000, 1.6e9), shift if said == "added" else 0.0)
    ((t, rows, told),) = found
    assert said in told
    assert len(rows) >= len(T) - 1  # the last may lie a rounding behind the end
    np.testing.assert_allclose(t, T[rows], atol=1e-6)


def test_where_two_clocks_overlap_both_are_told() -> None:
    found = on_log(PATH, table(T + 5.0), log(8_000_000), 0.0)
    assert [t[0] for t, _, _ in found] == pytest.approx([5.0, 0.0], abs=0.021)


def test_half_of_the_shorter_of_file_and_log_must_lie_in_the_other() -> None:
    for begin, ok in ((29.0, True), (31.0, False)):
        if ok:
            ((t, rows, _),) = on_log(PATH, table(T + begin), log(), 0.0)
            assert (t[0], t[-1]) == (pytest.approx(begin), pytest.approx(T[-1], abs=0.02))
            assert rows[-1] == len(t) - 1
        else:
            with pytest.raises(UsageError, match="does not overlap"):
                on_log(PATH, table(T + begin), log(), 0.0)
    short = T[:500]  # 10 s, of which six lie before the log's end
    ((t, _, _),) = on_log(PATH, table(short + 54.0), log(), 0.0)
    assert t[-1] <= T[-1]
    with pytest.raises(UsageError, match="does not overlap"):
        on_log(PATH, table(short + 56.0), log(), 0.0)


def test_rows_whose_time_does_not_rise_or_is_none_are_left_out() -> None:
    t = T.copy()
    t[[10, 20]] = np.nan, 0.1
    t[30] = t[29]
    ((kept, rows, _),) = on_log(PATH, table(t), log(), 0.0)
    assert sorted(set(range(len(T))) - set(rows.tolist())) == [10, 20, 30]
    np.testing.assert_array_equal(kept, t[rows])
    with pytest.raises(UsageError, match="1 rows whose time rises"):
        on_log(PATH, table(np.array([5.0, 4.0, np.nan])), log(), 0.0)


HALF = {"frd": Rotation.identity(), "flu": Rotation.from_euler("x", 180, degrees=True)}
EARTH = {"ned": Rotation.identity(), "enu": Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])}


@pytest.mark.parametrize("body", list(HALF))
@pytest.mark.parametrize("earth", list(EARTH))
@pytest.mark.parametrize("inverse", [False, True])
def test_each_convention_is_found_by_gyro_and_gravity(body: str, earth: str, inverse: bool) -> None:
    """The file is made by scipy from attitudes body FRD to earth NED."""
    q = motion(T)
    given = EARTH[earth].inv() * Rotation.from_quat(np.roll(q, -1, axis=1)) * HALF[body]
    stored = np.roll((given.inv() if inverse else given).as_quat(), 1, axis=1)
    read = AttitudeColumns(T, stored, None, "", "t, q")
    found = frame.chosen(PATH, T, frame.candidates(read, np.arange(len(T)), "auto", "auto"), unit())
    assert found.name == (f"{body}-{earth}" if inverse else f"{earth}-{body}")
    assert np.degrees(np.max(rotation.total_angle(rotation.error(found.q, q)))) < 1e-6
    assert found.quality["gravity_off_deg"] == pytest.approx(0.0, abs=0.01)
    assert found.apart < 2.0


@pytest.mark.parametrize("degrees", [True, False])
def test_euler_angles_in_degrees_and_radians_are_told_from_each_other(degrees: bool) -> None:
    angles = np.unwrap(rotation.to_euler(motion(T)), axis=0)
    read = AttitudeColumns(T, None, np.degrees(angles) if degrees else angles, "", "t, roll, pitch, yaw")
    found = frame.chosen(PATH, T, frame.candidates(read, np.arange(len(T)), "ned-frd", "auto"), unit())
    assert found.name == f"ned-frd, angles in {'deg' if degrees else 'rad'}"
    assert np.degrees(np.max(rotation.total_angle(rotation.error(found.q, motion(T))))) < 1e-6


@pytest.mark.parametrize(("factor", "fits"), [(1.4, True), (0.6, True), (1.6, False)])
def test_an_attitude_that_turns_otherwise_by_more_than_half_is_another(factor: float, fits: bool) -> None:
    t = T
    roll = 0.5 * np.sin(2.0 * t)
    level = np.zeros(len(t))
    gyro = np.column_stack([np.cos(2.0 * t), level, level])
    acc = rotation.rotate_inverse(rotation.from_euler(roll, level, level), np.array([0.0, 0.0, -9.81]))
    imu = Imu(0, Stream(t, gyro, "rad/s", "FRD", "IMU"), Stream(t, acc, "m/s^2", "FRD", "IMU"))
    one = [frame.FrameCandidate("ned-frd", rotation.from_euler(factor * roll, level, level))]
    if fits:
        assert frame.chosen(PATH, t, one, imu).apart == pytest.approx(40.0, abs=2.0)
    else:
        with pytest.raises(UsageError, match="turns otherwise than the gyro by 60 %"):
            frame.chosen(PATH, t, one, imu)


def test_the_mean_force_may_lie_20_deg_from_the_vertical() -> None:
    for tilt, fits in ((19.0, True), (21.0, False)):
        q = rotation.multiply(rotation.from_euler(0.0, np.radians(tilt), 0.0), motion(T))
        one = [frame.FrameCandidate("ned-frd", q)]
        if fits:
            assert frame.chosen(PATH, T, one, unit()).quality["gravity_off_deg"] == pytest.approx(tilt, abs=0.3)
        else:
            with pytest.raises(UsageError, match="gravity off by 21 deg"):
                frame.chosen(PATH, T, one, unit())


@pytest.mark.parametrize(
    ("head", "unit_s"),
    [
        ("time_ms", 1e-3),
        ("t_us", 1e-6),
        ("timestamp [ns]", 1e-9),
        ("TimeUS", 1e-6),
        ("time (s)", 1.0),
        ("elapsed_sec", 1.0),
    ],
)
def test_the_unit_in_a_columns_name_counts(tmp_path: Path, head: str, unit_s: float) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join([f"{head},qw,qx,qy,qz", *(f"{300 * k},1,0,0,0" for k in range(5))]) + "\n")
    assert columns.read(path).t == pytest.approx(unit_s * 300.0 * np.arange(5))


def test_angles_keep_their_axes_whatever_the_order_of_the_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("yaw_deg;t_s;pitch_deg;px;roll_deg;pz;py\n30;1;20;7;10;9;8\n31;2;21;7;x;9;8\n")
    read = columns.read(path)
    np.testing.assert_array_equal(read.euler, [[10.0, 20.0, 30.0], [np.nan, 21.0, 31.0]])
    np.testing.assert_array_equal(read.position, [[7.0, 8.0, 9.0]] * 2)
    assert (read.angles, read.q) == ("deg", None)
    assert read.t.tolist() == [1.0, 2.0]


def test_a_quaternion_named_x_y_z_is_no_position_and_scalar_first(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t_s,x,y,z,w\n1,0.1,0.2,0.3,0.9\n")
    read = columns.read(path)
    assert read.q is not None
    assert read.q.tolist() == [[0.9, 0.1, 0.2, 0.3]]
    assert read.position is None


def test_angles_in_two_units_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,roll_deg,pitch_rad,yaw\n1,0.1,0.2,0.3\n")
    with pytest.raises(UsageError, match="deg and rad"):
        columns.read(path)
