"""Clock and axes of a truth by closed forms: planted offsets, drifts and turns, another about each axis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.core.kinematics import BodyRates
from attlog.external import axes, clock
from attlog.external.clock import FileClock, file_clocks
from attlog.external.read import Trajectory, make_trajectory, read_trajectory
from attlog.flight.model import Firmware, FlightLog, Gnss, Imu, Stream
from attlog.segments.increments import GyroIncrements

T = np.arange(0.0, 60.0, 0.01)
BIAS = np.radians([0.6, -0.3, 0.9])
TURN = rotation.to_matrix(rotation.from_euler(0.2, -0.4, 1.1)[None])[0]
"""From the truth's body to the IMU's."""


def body_rates(t: np.ndarray) -> np.ndarray:
    """Rates (n, 3) rad/s of the truth: not periodic, and of another size about each axis."""
    size = np.array([0.9, 0.5, 0.3]) * (1.0 + 0.3 * np.sin(0.05 * t))[:, None]
    return size * np.sin(np.outer(t, [1.7, 2.3, 0.9]) + 0.01 * t[:, None] ** 2)


def gyro() -> GyroIncrements:
    return GyroIncrements(T, body_rates(T) @ TURN.T + BIAS)


def truth(offset: float = 0.0, drift: float = 0.0, begin: float = 5.0, end: float = 55.0) -> BodyRates:
    """Mean rates over 0.1 s on a clock that is ``offset`` early, and runs otherwise by ``drift`` about 30 s."""
    start = np.arange(begin, end, 0.05)
    exact = GyroIncrements(T, body_rates(T))
    rate = exact.between(start, start + 0.1) / 0.1
    own = [x - offset - drift * (x - 30.0) for x in (start, start + 0.1)]
    return BodyRates(own[0], own[1], rate)


def test_rates_of_attitudes_are_means_over_a_span_in_body_axes() -> None:
    t = np.arange(0.0, 5.0, 0.02)
    q = rotation.multiply(
        rotation.from_euler(0.3, 0.2, -1.0)[None], rotation.from_rotvec(t[:, None] * [0.3, -0.2, 0.5])
    )
    found = clock.attitude_rates(t, q)
    np.testing.assert_allclose(found.rate, np.tile([0.3, -0.2, 0.5], (len(found.rate), 1)), atol=1e-9)
    np.testing.assert_allclose(found.end - found.start, 0.08, atol=1e-9)
    assert len(found.start) == len(t) - 4
    holed = (t < 2.0) | (t > 3.0)
    found = clock.attitude_rates(t[holed], q[holed])
    assert not np.any((found.start < 2.0) & (found.end > 3.0))
    assert len(clock.attitude_rates(t[:3], q[:3]).start) == 0


@pytest.mark.parametrize("offset", [0.0, 0.4])
def test_the_turn_between_the_bodies_and_the_bias_are_those_that_were_planted(offset: float) -> None:
    found = clock.fit_turn(truth(offset), gyro(), offset)
    assert found is not None
    np.testing.assert_allclose(found.turn, TURN, atol=1e-4)
    np.testing.assert_allclose(found.bias, BIAS, atol=1e-4)
    assert found.correlation > 0.9999
    wrong = clock.fit_turn(truth(offset), gyro(), offset + 0.3)
    assert wrong is not None
    assert wrong.correlation < 0.97
    assert wrong.misfit > 100.0 * found.misfit


def test_gross_errors_of_a_truth_do_not_turn_it() -> None:
    one = truth()
    one.rate[100:104] += 40.0
    found = clock.fit_turn(one, gyro())
    assert found is not None
    np.testing.assert_allclose(found.turn, TURN, atol=1e-3)
    assert found.n == len(one.start) - 4


@pytest.mark.parametrize("offset", [0.0, 12.34, -7.77, 1000.0])
def test_the_offset_is_among_the_first_candidates_and_refined_to_a_millisecond(offset: float) -> None:
    found = clock.clock_candidates(truth(offset), gyro(), None, 0.0)
    assert min(abs(x - offset) for x in found) < 0.06
    assert all(abs(a - b) > 0.5 for k, a in enumerate(found) for b in found[:k])
    fine = clock.refine_offset(truth(offset), gyro(), min(found, key=lambda x: abs(x - offset)))
    assert fine is not None
    assert fine[0] == pytest.approx(offset, abs=2e-4)


@pytest.mark.parametrize("drift", [0.0, 80e-6])
def test_offset_drift_and_turn_come_back_together(drift: float) -> None:
    one, start = truth(1.5, drift), clock.fit_turn(truth(1.5), gyro(), 1.5)
    assert start is not None
    middle = 30.0 - 1.5
    found = clock.fit_clock(one, gyro(), 1.502, middle, start)
    assert found is not None
    assert found.offset == pytest.approx(1.5, abs=2e-4)
    assert found.drift == pytest.approx(drift, abs=8e-6)
    np.testing.assert_allclose(found.turn, TURN, atol=2e-4)
    assert found.offset_sigma < 5e-4


def level(velocity: Any = None, world: Any = None) -> tuple[Imu, np.ndarray, np.ndarray]:
    """An IMU that feels gravity and a velocity's change, and attitudes to a world that NED is turned into."""
    q = rotation.from_euler(0.4 * np.sin(0.9 * T), 0.3 * np.sin(0.6 * T + 1.0), 0.5 * np.sin(0.2 * T))
    a = np.zeros((len(T), 3)) if velocity is None else np.gradient(velocity, T, axis=0)
    acc = rotation.rotate_inverse(q, a + np.array([0.0, 0.0, -9.81])) + np.array([0.1, -0.05, 0.08])
    if world is not None:
        q = rotation.multiply(np.tile(world, (len(T), 1)), q)
    zero = np.zeros((len(T), 3))
    return Imu(0, Stream(T, zero, "rad/s", "FRD", "I"), Stream(T, acc, "m/s^2", "FRD", "I")), T, q


def test_down_is_found_in_any_world_in_spite_of_a_bias() -> None:
    for angles in ((0.0, 0.0, 0.0), (0.5, -0.7, 1.0), (3.0, 0.1, -2.0)):
        world = rotation.from_euler(*angles)
        imu, t, q = level(world=world)
        found = axes.fit_vertical(imu, t, q, None)
        assert found is not None
        np.testing.assert_allclose(found.down, rotation.rotate(world, np.array([0.0, 0.0, 1.0])), atol=3e-3)
        assert found.gravity == pytest.approx(9.81, abs=0.03)
        assert found.sigma < 0.01


def test_a_velocity_takes_motion_out_of_gravity() -> None:
    velocity = np.column_stack([0.1 * T**2, -0.02 * T**2, 0.0 * T])
    imu, t, q = level(velocity)
    with_motion, without = axes.fit_vertical(imu, t, q, velocity), axes.fit_vertical(imu, t, q, None)
    assert with_motion is not None
    assert without is not None
    np.testing.assert_allclose(with_motion.down, [0.0, 0.0, 1.0], atol=3e-3)
    assert abs(without.down[0]) > 0.01


def test_less_than_four_blocks_of_two_seconds_tell_no_vertical() -> None:
    imu, t, q = level()
    for seconds, told in ((6.5, False), (8.5, True)):
        few = t < seconds
        assert (axes.fit_vertical(imu, t[few], q[few], None) is not None) is told


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_world_is_levelled_by_the_least_turn_from_its_nearest_axis(axis: int, sign: float) -> None:
    down = np.full(3, 0.1)
    down[axis] = sign
    down /= np.linalg.norm(down)
    q = axes.level_world(down)
    np.testing.assert_allclose(rotation.rotate(q, down), [0.0, 0.0, 1.0], atol=1e-12)
    exact = np.zeros(3)
    exact[axis] = sign
    plain = axes.level_world(exact)
    np.testing.assert_allclose(rotation.rotate(plain, exact), [0.0, 0.0, 1.0], atol=1e-12)
    apart = float(rotation.total_angle(rotation.earth_error(q, plain)))
    assert apart == pytest.approx(np.arccos(abs(down[axis])), abs=1e-9)
    assert float(rotation.total_angle(rotation.earth_error(axes.level_world(down, 0.2), plain))) == pytest.approx(
        0.0, abs=1e-9
    )
    assert np.linalg.det(Rotation.from_quat(np.roll(q, -1)).as_matrix()) == pytest.approx(1.0)


def test_the_usual_body_axes_are_taken_within_three_sigmas_about_each_axis() -> None:
    sigma = np.radians([1.0, 2.0, 0.5])
    for half in ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)):
        for axis in range(3):
            for factor, taken in ((2.9, True), (-2.9, True), (3.1, False), (-3.1, False)):
                vector = np.zeros(3)
                vector[axis] = factor * sigma[axis]
                turned = rotation.multiply(np.array(half), rotation.from_rotvec(vector))
                found = axes.snap_to_usual(turned, sigma)
                assert (float(rotation.total_angle(rotation.earth_error(found, np.array(half)))) < 1e-9) is taken


def receiver(t: np.ndarray, velocity: np.ndarray, fix: int = 3) -> Gnss:
    zero = np.zeros(len(t))
    return Gnss(0, t, "GPS", zero, zero, zero, velocity, zero, zero, zero, np.full(len(t), fix))


def log_with(*receivers: Gnss) -> FlightLog:
    log = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "quadrotor")
    log.gnss = list(receivers)
    return log


@pytest.mark.parametrize(("heading", "late"), [(0.7, 0.0), (-2.5, 0.2)])
def test_north_is_where_both_velocities_go_the_same_way(heading: float, late: float) -> None:
    def flown(t: np.ndarray) -> np.ndarray:
        course = 0.5 * t + 0.8 * np.sin(1.1 * t)
        return np.column_stack([5.0 * np.cos(course), 5.0 * np.sin(course), 0.0 * t])

    own = rotation.rotate(rotation.from_rotvec([0.0, 0.0, -heading]), flown(T))
    at = np.arange(1.0, 59.0, 0.2)
    found = axes.north_by_gnss(log_with(receiver(at, flown(at - late))), T, own)
    assert found is not None
    assert found.heading == pytest.approx(heading, abs=3e-3)
    assert found.sigma < 3e-3
    assert axes.north_by_gnss(log_with(receiver(at, flown(at), fix=2)), T, own) is None
    assert axes.north_by_gnss(log_with(receiver(at, 0.15 * flown(at))), T, own) is None
    assert axes.north_by_gnss(log_with(receiver(at, flown(-at))), T, own) is None


# Which clock and which axes a file has: planted offsets and half turns, asymmetric in every axis.

FILE_T = np.arange(0.0, 60.0, 0.02)
PATH = Path("made.csv")


def motion(t: np.ndarray) -> np.ndarray:
    """Attitudes (n, 4) that swing about each axis by another angle, at another pace."""
    return rotation.from_euler(0.5 * np.sin(1.1 * t), 0.3 * np.sin(0.7 * t + 1.0), 1.2 * np.sin(0.4 * t) + 0.6)


def unit(t: np.ndarray = FILE_T) -> Imu:
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


def file_at(t: np.ndarray) -> Trajectory:
    return make_trajectory("made.csv", t, {"": np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))})


def inside(found: FileClock) -> np.ndarray:
    return found.t[found.inside]


@pytest.mark.parametrize(
    ("shift", "said"), [(0.0, "the log's own"), (-137.5, "the autopilot's"), (-1.6e9, "Unix time"), (12.25, "added")]
)
def test_times_of_a_file_come_to_lie_on_the_logs_clock(shift: float, said: str) -> None:
    offset = shift if said == "added" else 0.0
    (found,) = file_clocks(file_at(FILE_T - shift), log(137_500_000, 1.6e9), offset)
    assert said in found.name
    assert np.count_nonzero(found.inside) >= len(FILE_T) - 1  # the last may lie a rounding behind the end
    np.testing.assert_allclose(found.t, FILE_T, atol=1e-6)


def test_where_two_clocks_overlap_both_are_told() -> None:
    found = file_clocks(file_at(FILE_T + 5.0), log(8_000_000), 0.0)
    assert [inside(one)[0] for one in found] == pytest.approx([5.0, 0.0], abs=0.021)


@pytest.mark.parametrize(
    ("t", "ok"),
    [
        (FILE_T + 29.0, True),
        (FILE_T + 31.0, False),
        (FILE_T[:500] + 54.0, True),  # 10 s, of which six lie before the log's end
        (FILE_T[:500] + 56.0, False),
    ],
)
def test_half_of_the_shorter_of_file_and_log_must_lie_in_the_other(t: np.ndarray, ok: bool) -> None:
    if ok:
        (found,) = file_clocks(file_at(t), log(), 0.0)
        assert (inside(found)[0], inside(found)[-1]) == (pytest.approx(t[0]), pytest.approx(FILE_T[-1], abs=0.02))
    else:
        with pytest.raises(UsageError, match="does not overlap"):
            file_clocks(file_at(t), log(), 0.0)


def test_rows_whose_time_does_not_rise_or_without_an_attitude_are_left_out() -> None:
    t = FILE_T.copy()
    t[[10, 20]] = np.nan, 0.1
    t[30] = t[29]
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    q[40] = np.nan
    found = make_trajectory("made.csv", t, {"": q})
    np.testing.assert_array_equal(found.t, np.delete(t, [10, 20, 30, 40]))
    assert found.left_out == 4
    with pytest.raises(UsageError, match="1 usable attitudes in rising time"):
        file_at(np.array([5.0, 4.0, np.nan]))


HALF = {"frd": Rotation.identity(), "flu": Rotation.from_euler("x", 180, degrees=True)}
EARTH = {"ned": Rotation.identity(), "enu": Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])}


@pytest.mark.parametrize("body", list(HALF))
@pytest.mark.parametrize("earth", list(EARTH))
@pytest.mark.parametrize("inverse", [False, True])
def test_each_convention_is_found_by_gyro_and_gravity(body: str, earth: str, inverse: bool) -> None:
    """The file is made by scipy from attitudes body FRD to earth NED."""
    q = motion(FILE_T)
    given = EARTH[earth].inv() * Rotation.from_quat(np.roll(q, -1, axis=1)) * HALF[body]
    stored = np.roll((given.inv() if inverse else given).as_quat(), 1, axis=1)
    found = axes.choose_frame(PATH, FILE_T, axes.possible_frames({"": stored}), unit())
    assert found.name == (f"{body}-{earth}" if inverse else f"{earth}-{body}")
    assert np.degrees(np.max(rotation.total_angle(rotation.earth_error(found.q, q)))) < 1e-6
    assert found.quality["gravity_off_deg"] == pytest.approx(0.0, abs=0.01)
    assert (found.rate_difference or 0.0) < 0.02


@pytest.mark.parametrize(("factor", "fits"), [(1.4, True), (0.6, True), (1.6, False)])
def test_an_attitude_that_turns_otherwise_by_more_than_half_is_another(factor: float, fits: bool) -> None:
    t = FILE_T
    roll = 0.5 * np.sin(2.0 * t)
    level = np.zeros(len(t))
    gyro = np.column_stack([np.cos(2.0 * t), level, level])
    acc = rotation.rotate_inverse(rotation.from_euler(roll, level, level), np.array([0.0, 0.0, -9.81]))
    imu = Imu(0, Stream(t, gyro, "rad/s", "FRD", "IMU"), Stream(t, acc, "m/s^2", "FRD", "IMU"))
    one = [axes.Frame("ned-frd", rotation.from_euler(factor * roll, level, level))]
    if fits:
        assert axes.choose_frame(PATH, t, one, imu).rate_difference == pytest.approx(0.4, abs=0.02)
    else:
        with pytest.raises(UsageError, match="turns otherwise than the gyro by 60 %"):
            axes.choose_frame(PATH, t, one, imu)


def test_the_mean_force_may_lie_20_deg_from_the_vertical() -> None:
    for tilt, fits in ((19.0, True), (21.0, False)):
        q = rotation.multiply(rotation.from_euler(0.0, np.radians(tilt), 0.0), motion(FILE_T))
        one = [axes.Frame("ned-frd", q)]
        if fits:
            assert axes.choose_frame(PATH, FILE_T, one, unit()).quality["gravity_off_deg"] == pytest.approx(
                tilt, abs=0.3
            )
        else:
            with pytest.raises(UsageError, match="gravity off by 21 deg"):
                axes.choose_frame(PATH, FILE_T, one, unit())


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
    path.write_text("\n".join([f"{head},qw,qx,qy,qz", *(f"{300 * k},1,0,0,0" for k in range(30))]) + "\n")
    assert read_trajectory(path).t == pytest.approx(unit_s * 300.0 * np.arange(30))


def test_angles_keep_their_axes_whatever_the_order_of_the_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"30;{k};20;7;10;9;8" for k in range(30)]
    path.write_text("\n".join(["yaw_deg;t_s;pitch_deg;px;roll_deg;pz;py", *rows, "31;30;21;7;x;9;8"]) + "\n")
    read = read_trajectory(path)
    ((name, q),) = read.readings.items()
    assert name == "angles in deg"
    np.testing.assert_allclose(np.degrees(rotation.to_euler(q)), [[10.0, 20.0, 30.0]] * 30)
    np.testing.assert_array_equal(read.position, [[7.0, 8.0, 9.0]] * 30)
    assert read.t.tolist() == list(range(30))


def test_a_quaternion_named_x_y_z_is_no_position_and_scalar_first(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["t_s,x,y,z,w", *(f"{k},0.1,0.2,0.3,0.9" for k in range(30))]) + "\n")
    read = read_trajectory(path)
    np.testing.assert_allclose(read.readings[""][0], np.array([0.9, 0.1, 0.2, 0.3]) / np.sqrt(0.95))
    assert read.position is None
