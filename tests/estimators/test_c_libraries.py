"""A filter in C through ctypes, as docs/filter_in_c shows it: as steps, and as whole segments."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import attlog
from attlog.core import rotation
from attlog.core.errors import PluginError
from attlog.estimators import Aids, Measurements, get, not_compiled, parse
from attlog.estimators.batch import estimate_batch
from attlog.pipeline import replay
from attlog.testing import Noise, about, check_estimator, flight, motion, swing
from attlog.testing.motions import FIELD_T, Motion, heading_deg, total_deg
from tests.conftest import SAMPLES

C_EXAMPLE = Path(__file__).parents[2] / "docs" / "filter_in_c"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library, built, with ``steps.py`` and ``segments.py`` beside it."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    made = tmp_path_factory.mktemp("c")
    for name in ("complementary.c", "steps.py", "segments.py"):
        shutil.copy(C_EXAMPLE / name, made)
    arguments = ["-O2", "-Wall", "-Werror", "-shared", "-fPIC", "complementary.c", "-o", "complementary.so", "-lm"]
    subprocess.run([compiler, *arguments], cwd=made, check=True)
    return made


@pytest.mark.parametrize(
    "name", [pytest.param("steps.py", marks=pytest.mark.slow), pytest.param("segments.py", marks=pytest.mark.slow)]
)
def test_a_filter_in_c_passes_every_check(folder: Path, name: str) -> None:
    failed = [f"{o.name}: {o.message}" for o in check_estimator(str(folder / name)) if not o.passed]
    assert not failed


@pytest.mark.slow
def test_both_forms_give_what_the_same_filter_gives_in_python(folder: Path) -> None:
    m = swing(10.0)
    wanted = attlog.estimate("mahony:kp=0.6,ki=0", *m.sensors, q0=m.q[0])
    steps = attlog.estimate(str(folder / "steps.py"), *m.sensors, q0=m.q[0])
    assert np.abs(steps.q - wanted.q).max() < 1e-9
    whole = attlog.estimate(str(folder / "segments.py"), *m.sensors)
    again = attlog.estimate("mahony:kp=0.6,ki=0,init=first", *m.sensors)
    assert np.abs(whole.q - again.q).max() < 1e-9


def test_a_step_in_c_is_told_to_be_slow_and_why(folder: Path) -> None:
    steps, whole = get(str(folder / "steps.py")), get(str(folder / "segments.py"))
    assert "uses ctypes, a module" in not_compiled(steps)
    assert not_compiled(whole) == ""
    assert not_compiled(get("mahony")) == ""
    assert "plain Python" in about(steps)[0]
    assert "whole segments" in about(whole)[0]
    assert about("mahony") == []


def test_a_batch_of_a_step_in_c_equals_runs_one_by_one(folder: Path) -> None:
    m = swing(2.0)
    steps = get(str(folder / "steps.py"))
    for one, kp in zip(estimate_batch(steps, [{"kp": 0.5}, {"kp": 2.0}], *m.sensors), (0.5, 2.0), strict=True):
        assert np.array_equal(one.q, attlog.estimate(steps, *m.sensors, kp=kp).q)


def test_an_analysis_says_that_a_step_in_c_is_slow(folder: Path) -> None:
    log = Path(__file__).parents[2] / "sample_logs" / "copter_yaw_turns.bin"
    result = attlog.analyze(log, {"estimators": ["gyro", *(str(folder / n) for n in ("steps.py", "segments.py"))]})
    notes = [p.text for p in result.findings if p.kind == "estimator_not_compiled"]
    assert len(notes) == 1
    assert notes[0].startswith("steps: its step runs in plain Python")
    assert {r.name: r.status for r in result.estimators}["steps"] == "ok"


# A firmware's estimator library in C++, as docs/filter_in_cpp shows it, against a dense filter with scipy.

Array = NDArray[np.float64]
CPP_EXAMPLE = Path(__file__).parents[2] / "docs" / "filter_in_cpp"
BUILD = "-std=c++17 -O2 -shared -fPIC firmware_ekf.cpp replay.cpp -o firmware_ekf.so"
STRICT = ["-Wall", "-Wextra", "-Werror"]
GRAVITY = 9.80665


def built(folder: Path) -> str:
    """The filter's file in a folder, beside the library made of the sources there."""
    compiler = shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        pytest.skip("there is no C++ compiler")
    subprocess.run([compiler, *STRICT, *BUILD.split()], cwd=folder, check=True)
    return str(folder / "firmware_ekf.py")


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> str:
    return built(Path(shutil.copytree(CPP_EXAMPLE, tmp_path_factory.mktemp("cpp") / "built")))


@pytest.mark.slow
def test_the_library_passes_every_check(example: str) -> None:
    failed = [f"{o.name}: {o.message}" for o in check_estimator(example) if not o.passed]
    assert not failed


def test_defaults_are_those_of_the_header(example: str) -> None:
    text = (CPP_EXAMPLE / "firmware_ekf.hpp").read_text()
    header = {name: float(x) for name, x in re.findall(r"float (\w+) = ([\d.e-]+)f;", text)}
    declared = {p.name: p.default for p in get(example).own}
    assert declared == {name: header[name] for name in declared}
    assert set(header) - set(declared) == {"declination"}


def fused(P: Array, dx: Array, H: Array, innovation: Array, variance: float) -> tuple[Array, Array]:
    """Covariance (Joseph's form) and errors after a measurement of the errors by H (k, 9)."""
    noise = variance * np.eye(len(H))
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + noise)
    left = np.eye(9) - K @ H
    return left @ P @ left.T + K @ noise @ K.T, dx + K @ (innovation - H @ dx)


def angle(field: Array) -> float:
    return float(np.arctan2(field[1], field[0]))


def twin(m: Motion, mag: Measurements, gnss: Measurements) -> tuple[Array, Array, Array]:
    """Attitudes (n, 4) from the alignment on, biases and sigmas of heading, with the library's defaults."""
    R, v, b = Rotation.identity(), np.zeros(3), np.zeros(3)
    P = np.diag(np.square([0.3, 0.3, np.pi, 2, 2, 2, 0.05, 0.05, 0.05]))
    Q = np.diag(np.repeat(np.square([0.005, 0.5, 2e-4]), 3))
    force, summed, known, last_mag, last_fix, held = np.zeros(3), 0.0, False, -1, -1, -1.0
    rows = []
    for k in range(1, len(m.t)):
        t, dt = m.t[k], m.t[k] - m.t[k - 1]
        w, dx = np.zeros(3), np.zeros(9)
        aligning = summed < 0.2
        if aligning:
            force, summed = force + m.acc[k] * dt, summed + dt
            if summed < 0.2:
                continue
            roll, pitch = np.arctan2(-force[1], -force[2]), np.arctan2(force[0], np.hypot(force[1], force[2]))
            R = Rotation.from_euler("ZYX", [0.0, pitch, roll])
        else:
            w = m.gyr[k] - b
            gained = R.apply(dt * m.acc[k] + 0.5 * dt**2 * np.cross(w, m.acc[k]))
            v = v + gained + [0.0, 0.0, GRAVITY * dt]
            F = np.eye(9)
            F[:3, 6:] = -dt * R.as_matrix()
            F[3:6, :3] = np.cross(np.eye(3), -gained)
            P = F @ P @ F.T + dt * Q
            R = R * Rotation.from_rotvec(w * dt)
            acceleration = gained / dt + [0.0, 0.0, GRAVITY]
        newest = int(np.searchsorted(mag.t, t, side="right")) - 1
        if newest > last_mag:
            last_mag = newest
            field = R.apply(mag.x[newest] + (t - mag.t[newest]) * np.cross(mag.x[newest], w))
            if known:
                steps = [Rotation.from_rotvec(1e-6 * axis).apply(field) for axis in np.eye(3)]
                H = np.zeros((1, 9))
                H[0, :3] = [(angle(s) - angle(field)) / 1e-6 for s in steps]
                P, dx = fused(P, dx, H, np.array([-angle(field)]), 0.15**2)
            else:
                R, known = Rotation.from_euler("z", -angle(field)) * R, True
                P[2, :], P[:, 2] = 0.0, 0.0
                P[2, 2] = 0.5**2
            R, v, b, dx = Rotation.from_rotvec(dx[:3]) * R, v + dx[3:6], b + dx[6:], np.zeros(9)
        newest = int(np.searchsorted(gnss.t, t, side="right")) - 1
        speed = np.eye(9)[3:6]
        if not aligning and newest > last_fix:
            last_fix, late = newest, t - gnss.t[newest]
            P, dx = fused(P, dx, speed, gnss.x[newest] + late * acceleration - v, 0.3**2)
        elif not aligning and last_fix < 0 and t >= held + 0.1:
            P, dx, held = *fused(P, dx, speed, -v, 3.0**2), t
        R, v, b = Rotation.from_rotvec(dx[:3]) * R, v + dx[3:6], b + dx[6:]
        rows.append(np.r_[R.as_quat()[[3, 0, 1, 2]], b, np.sqrt(P[2, 2])])
    found = np.array(rows)
    return found[:, :4], found[:, 4:7], found[:, 7]


def test_it_equals_a_dense_filter(example: str) -> None:
    """IMU at 64 Hz, field at 10 Hz, GNSS at 5 Hz from the second second on, each at its own times."""
    m = flight(12.0, 64.0, noise=Noise(gyro=1e-4, acc=1e-3, mag=1e-7, bias=(0.01, -0.02, 0.015)))
    times = np.arange(0.013, 11.9, 0.1)
    field = rotation.rotate_inverse(rotation.slerp(m.t, m.q, times), np.array(FIELD_T))
    fixes = np.arange(1.031, 11.9, 0.2)
    # the motion's own velocity: integrals of its accelerations 2 sin 2.1 t, 3 sin(1.3 t + 1), sin 3.1 t
    velocity = np.stack(
        [-2.0 / 2.1 * np.cos(2.1 * fixes), -3.0 / 1.3 * np.cos(1.3 * fixes + 1.0), -np.cos(3.1 * fixes) / 3.1], axis=1
    )
    mag, gnss = Measurements(times, field), Measurements(fixes, velocity)
    got = attlog.estimate(example, m.t, m.gyr, m.acc, aids=Aids(velocity=gnss, mag=mag))
    q, bias, sigma = twin(m, mag, gnss)
    n = len(q)
    assert n > 700
    assert total_deg(got.q[-n:], q).max() < 1e-3  # single precision
    assert got.bias is not None
    assert np.abs(got.bias[-n:] - bias).max() < 3e-6
    assert got.aux["sigma_heading"][-n:] == pytest.approx(sigma, rel=1e-3)
    assert total_deg(got.q[-64:], m.q[-64:]).max() < 1.5


def test_a_field_counts_at_its_own_time(example: str) -> None:
    """At 90 deg/s and 25 Hz a field that is taken 36 ms too late is 3.2 deg off."""
    m = motion(lambda t: (0.0 * t, 0.0 * t, np.pi / 2 * t), 60.0, 25.0)
    times = m.t[:-1:5] + 0.004
    yaw = np.pi / 2 * times
    field = rotation.rotate_inverse(rotation.from_euler(0.0 * yaw, 0.0 * yaw, yaw), np.array(FIELD_T))
    own = attlog.estimate(example, m.t, m.gyr, m.acc, aids=Aids(mag=Measurements(times, field)))
    placed = attlog.estimate(example, m.t, m.gyr, m.acc, attlog.estimators.place(m.t, times, field))
    assert np.abs(heading_deg(own.q[-500:], m.q[-500:])).max() < 0.1
    assert np.abs(heading_deg(placed.q[-500:], m.q[-500:]) + 3.24).max() < 0.1


def test_two_runs_share_nothing(example: str) -> None:
    """A run between two equal ones changes nothing: the library has no global state."""
    a, b = flight(5.0), flight(5.0, seed=3)
    first = attlog.estimate(example, *a.sensors).q
    attlog.estimate(example, *b.sensors, heading_noise=1.0)
    assert np.array_equal(attlog.estimate(example, *a.sensors).q, first)


@pytest.mark.slow
def test_a_library_that_crashes_costs_its_own_row(example: str, tmp_path: Path) -> None:
    broken = Path(shutil.copytree(CPP_EXAMPLE, tmp_path / "broken"))
    text = (broken / "replay.cpp").read_text()
    planted = text.replace("filter.update();", "filter.update();\n        if (i == 90) *(volatile int *)nullptr = 1;")
    assert planted != text
    (broken / "replay.cpp").write_text(planted)
    file = built(broken)
    m = flight(2.0)
    with pytest.raises(PluginError, match=r"crashed \(SIGSEGV\)"):
        attlog.estimate(file, *m.sensors)


@pytest.mark.slow
@pytest.mark.parametrize("log", ["copter_yaw_turns.bin", "px4_steps.ulg"])
def test_on_a_simulated_flight_it_is_as_good_as_the_onboard_filter(example: str, log: str) -> None:
    result = attlog.analyze(SAMPLES / log, {"estimators": [example]})
    tilt = {r.kind: r.metrics["all"]["tilt_rmse_deg"].value for r in result.estimators}
    assert tilt["replay"] is not None
    assert tilt["onboard"] is not None
    assert tilt["replay"] < 1.5 * tilt["onboard"]


@pytest.mark.slow
def test_a_sweep_hands_over_what_an_analysis_does(example: str) -> None:
    """The magnetometer at its own times included: at the IMU's, this log's attitudes are others."""
    case = attlog.prepare(SAMPLES / "px4_steps.ulg")
    imu = case.log.replay_imu
    assert imu is not None
    assert case.log.mag is not None
    told = [f(case, next(iter(case.imus))) for f in (replay.log_facts, replay.aids_of)]
    of_sweep = replay.batch(case, imu, case.log.mags[case.log.mag], parse(example), [{}], *told)
    of_analysis = replay.run_rows(case, [example])
    assert np.array_equal(of_sweep[0].q, of_analysis[0].q)
