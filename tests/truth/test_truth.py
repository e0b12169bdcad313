"""A truth that was brought: found on the log's clock and axes within its own sigma, whatever it was written in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog import truth
from attlog.base import rotation
from attlog.flight import read
from attlog.flight.model import Attitude, FlightLog, Gnss
from tests.reference.flights import attitude_at, flight, imu_log
from tests.truth.files import BODY, OFFSET, SAME, WORLD, Made, euroc, made, tum


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return flight(120.0)


def brought(log: FlightLog, given: object) -> Attitude:
    found = truth.brought(log, str(given)).truth
    assert found is not None
    assert found.fit is not None
    return found


def tilt_deg(found: Attitude) -> float:
    error = rotation.inclination_angle(rotation.error(found.q, attitude_at(found.t)))
    return float(np.degrees(np.sqrt(np.mean(error**2))))


def heading_deg(found: Attitude) -> np.ndarray:
    return np.degrees(rotation.heading_angle(rotation.error(found.q, attitude_at(found.t))))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_clock_and_axes_are_found_within_their_sigma(log: FlightLog, tmp_path: Path, seed: int) -> None:
    found = brought(log, tum(tmp_path, made(seed)))
    fit = found.fit
    assert abs(fit.offset_s - OFFSET) < 4.0 * fit.offset_sigma_s < 1e-2
    assert fit.drift_ppm == 0.0
    assert fit.drift_sigma_ppm < 50.0
    assert tilt_deg(found) < 2.0 * fit.sigma_tilt_deg < 1.0
    assert fit.body_deg == pytest.approx(np.degrees(rotation.to_euler(BODY)), abs=0.3)
    assert fit.correlation > 0.95
    assert fit.north == "nobody"
    spread = heading_deg(found)
    assert np.std(spread) < 2.0 * fit.sigma_heading_deg < 1.0


def test_the_log_itself_stays_as_it_was(log: FlightLog, tmp_path: Path) -> None:
    brought(log, tum(tmp_path, made()))
    assert log.truth is None


def test_a_drift_is_found(log: FlightLog, tmp_path: Path) -> None:
    fit = brought(log, tum(tmp_path, made(drift_ppm=300.0, noise_deg=0.02))).fit
    assert fit.drift_ppm == pytest.approx(300.0, abs=4.0 * fit.drift_sigma_ppm)
    assert 0.0 < fit.drift_sigma_ppm < 40.0
    assert abs(fit.offset_s - OFFSET) < 2e-3


def test_euroc_reads_as_tum(log: FlightLog, tmp_path: Path) -> None:
    m = made(3)
    one, other = brought(log, tum(tmp_path, m)), brought(log, euroc(tmp_path, m))
    assert np.allclose(one.t, other.t, atol=one.fit.offset_sigma_s)  # times differ in their last digit
    assert np.degrees(np.max(rotation.total_angle(rotation.error(one.q, other.q)))) < one.fit.sigma_tilt_deg
    assert (one.fit.reading, other.fit.reading) == ("as TUM, scalar last", "as EuRoC, scalar first")


def test_the_inverse_rotation_is_seen(log: FlightLog, tmp_path: Path) -> None:
    m = made()
    path = tmp_path / "inverse.csv"
    rows = np.column_stack([m.t, rotation.conjugate(m.q)])
    path.write_text("time_s,qw,qx,qy,qz\n" + "\n".join(",".join(f"{x:.9f}" for x in r) for r in rows))
    found = brought(log, path)
    assert found.fit.reading == "earth to body"
    assert tilt_deg(found) < 2.0 * found.fit.sigma_tilt_deg


def test_angles_in_a_table_are_read_by_their_unit(log: FlightLog, tmp_path: Path) -> None:
    m = made(body=SAME, world=SAME)
    path = tmp_path / "angles.csv"
    rows = np.column_stack([m.t, np.degrees(rotation.to_euler(m.q))])
    path.write_text("time_s,roll_deg,pitch_deg,yaw_deg\n" + "\n".join(",".join(f"{x:.9f}" for x in r) for r in rows))
    found = brought(log, f"{path}:north=true")
    assert tilt_deg(found) < 2.0 * found.fit.sigma_tilt_deg
    assert found.fit.north == "file"
    assert np.abs(np.mean(heading_deg(found))) < 2.0 * found.fit.sigma_heading_deg + 0.05


@pytest.mark.parametrize("enu", [False, True])
def test_north_of_the_file_is_kept_where_it_is_said_to_have_one(log: FlightLog, tmp_path: Path, enu: bool) -> None:
    to_enu = np.array([0.0, 0.5**0.5, 0.5**0.5, 0.0])
    m = made(world=to_enu if enu else SAME, body=np.array([0.0, 1.0, 0.0, 0.0]) if enu else SAME)
    found = brought(log, f"{tum(tmp_path, m)}:north=true")
    assert np.abs(np.mean(heading_deg(found))) < 0.1
    turned = rotation.from_euler(*np.radians(found.fit.body_deg))
    half = np.array([0.0, 1.0, 0.0, 0.0]) if enu else SAME
    assert np.degrees(rotation.total_angle(rotation.error(turned, half))) < 0.1


def test_positions_take_motion_out_of_gravity_and_tell_north_by_gnss(tmp_path: Path) -> None:
    """0.3 m/s^2 northwest all the time tilt the mean force by 1.8 deg; GNSS saw the same way over ground."""
    log = flight(120.0)
    push = 0.3 * np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0])
    at = log.imus[0].acc.t
    log.imus[0].acc.x += rotation.rotate_inverse(attitude_at(at), push)
    t = np.arange(0.0, 120.0, 0.2)
    nothing = np.full(len(t), np.nan)
    place = np.column_stack([nothing, nothing, nothing])
    log.gnss = [
        Gnss(0, t, "GPS", *place.T, t[:, None] * push, *place.T, np.full(len(t), 3, np.int64))  # degrees unknown
    ]
    m = made()
    way = 0.5 * (m.t + OFFSET)[:, None] ** 2 * push
    found = brought(log, tum(tmp_path, replace(m, p=rotation.rotate(WORLD, way))))
    assert tilt_deg(found) < 0.3
    assert found.fit.north == "gnss"
    assert abs(np.mean(heading_deg(found))) < 0.3
    log.gnss = []
    assert brought(log, tum(tmp_path, replace(m, p=rotation.rotate(WORLD, way)))).fit.north == "nobody"
    assert tilt_deg(brought(log, tum(tmp_path, m))) > 1.0  # neither tells the motion


def test_damage_gaps_and_signs_change_nothing(log: FlightLog, tmp_path: Path) -> None:
    m = made(4)
    rng = np.random.default_rng(4)
    q = m.q * np.where(rng.random(len(m.q)) < 0.5, 1.0, -1.0)[:, None]
    q[100:110] = np.nan
    t = m.t.copy()
    t[200:205] = t[200]
    kept = np.ones(len(t), bool)
    kept[1500:1700] = False
    found = brought(log, tum(tmp_path, Made(t[kept], q[kept], m.p[kept])))
    assert abs(found.fit.offset_s - OFFSET) < 4.0 * found.fit.offset_sigma_s
    assert tilt_deg(found) < 2.0 * found.fit.sigma_tilt_deg
    assert (np.diff(found.t) > 0).all()
    assert np.diff(found.t).max() > 3.9


def test_noise_is_told(log: FlightLog, tmp_path: Path) -> None:
    quiet, loud = (brought(log, tum(tmp_path, made(noise_deg=x), f"{x}.txt")).fit for x in (0.02, 0.3))
    assert loud.sigma_heading_deg == pytest.approx(0.3, rel=0.25)
    assert quiet.sigma_heading_deg < 0.2


def test_a_delay_that_is_known_of_the_gyro_is_not_the_clock_s(tmp_path: Path) -> None:
    late = flight(120.0, gyro_late=0.03)
    late.imus[0].gyro.delay = 0.03
    found = brought(late, tum(tmp_path, made()))
    assert abs(found.fit.offset_s - OFFSET) < 4.0 * found.fit.offset_sigma_s
    moving = heading_deg(found)[found.t > 30.0]  # it turns by 23 deg/s: 30 ms are 0.7 deg
    still = heading_deg(found)[found.t < 15.0]
    assert abs(np.mean(moving) - np.mean(still)) < 0.1


def test_samples_beyond_the_log_are_dropped(log: FlightLog, tmp_path: Path) -> None:
    found = brought(log, tum(tmp_path, made(begin=-30.0, end=150.0)))
    assert found.t[0] >= 0.0
    assert found.t[-1] <= 120.0
    assert abs(found.fit.offset_s - OFFSET) < 5e-3


def test_a_given_offset_spares_the_search(log: FlightLog, tmp_path: Path) -> None:
    found = brought(log, f"{tum(tmp_path, made())}:offset={OFFSET + 0.3:.3f}")
    assert abs(found.fit.offset_s - OFFSET) < 4.0 * found.fit.offset_sigma_s


def test_a_pose_of_the_log_is_levelled_and_its_lateness_found(log: FlightLog) -> None:
    m = made(offset=0.12, world=WORLD, body=SAME)
    posed = replace(log, poses={"VISP": Attitude(m.t, m.q, "VISP")})
    found = brought(posed, "VISP")
    assert abs(found.fit.offset_s - 0.12) < 4.0 * found.fit.offset_sigma_s
    assert tilt_deg(found) < 2.0 * found.fit.sigma_tilt_deg
    assert found.fit.name == "VISP"


def test_evo_reads_the_same_file_alike(tmp_path: Path) -> None:
    """An independent reader of TUM files, of the people who use them."""
    interface = pytest.importorskip("evo.tools.file_interface")
    from attlog.truth import trajectory

    path = tum(tmp_path, made(5))
    theirs, ours = interface.read_tum_trajectory_file(str(path)), trajectory.read(path)
    q = ours.quaternions["as TUM, scalar last"]
    assert np.allclose(ours.t, theirs.timestamps)
    assert np.allclose(np.abs(np.sum(q * theirs.orientations_quat_wxyz, axis=1)), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["MH_04_difficult", "V1_02_medium", "V2_01_easy", "V2_03_difficult"])
def test_real_flights_with_a_large_gyro_bias(corpus: Path, tmp_path: Path, name: str) -> None:
    """EuRoC: Leica and Vicon truth, a gyro off by 4.6 deg/s. The Vicon room of V2 is itself not level by 0.5 deg."""
    d = np.load(corpus / "euroc" / f"{name}.npz")
    t = d["t"]
    imu = imu_log(t, d["gyr"].astype(float), d["acc"].astype(float))
    good = np.isfinite(d["quat"]).all(axis=1)
    own = rotation.normalize(d["quat"][good].astype(float))
    p = rotation.rotate(WORLD, d["pos"][good].astype(float))
    m = Made(t[good] - OFFSET, rotation.multiply(WORLD, rotation.multiply(own, BODY)), p)
    found = brought(imu, tum(tmp_path, m))
    assert abs(found.fit.offset_s - OFFSET) < 3e-3
    assert found.fit.correlation > 0.98
    assert found.fit.body_deg == pytest.approx(np.degrees(rotation.to_euler(BODY)), abs=0.3)
    apart = rotation.error(found.q, rotation.slerp(t[good], own, found.t))
    tilt = np.degrees(np.sqrt(np.nanmean(rotation.inclination_angle(apart) ** 2)))
    assert tilt < (0.7 if name.startswith("V2") else 0.2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sitl/px4/px4_aggressive.ulg", "sitl/ardupilot/copter_aggressive.bin"])
def test_the_truth_of_a_simulator_comes_back_as_it_was(corpus: Path, tmp_path: Path, name: str) -> None:
    log = read(corpus / name)
    assert log.truth is not None
    own = log.truth
    m = Made(own.t + 1.5e9, rotation.normalize(own.q), np.full((len(own.t), 3), np.nan))
    found = brought(log, f"{tum(tmp_path, m)}:north=true")
    apart = rotation.error(found.q, rotation.slerp(own.t, own.q, found.t))
    assert np.degrees(np.sqrt(np.nanmean(rotation.inclination_angle(apart) ** 2))) < 0.2
    assert abs(found.fit.offset_s + 1.5e9 + log.imus[log.imu].gyro.delay) < 0.02
    other = brought(log, corpus / name)
    assert abs(other.fit.offset_s) < 0.02
    assert other.fit.north == "file"
    assert other.fit.sigma_tilt_deg < 0.1
