"""A truth that was brought: found on the log's clock and axes within its own sigma, whatever it was written in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog import segments
from attlog.core import rotation
from attlog.core.errors import LogUnreadable, UsageError
from attlog.external import attitude
from attlog.external.read import check_truth, parse_truth
from attlog.flight import read
from attlog.flight.model import Attitude, FlightLog, Gnss, Stream, TruthFit
from attlog.reference import (
    Reference,
    ReferenceOptions,
    choose,
    heading_references,
    meaning,
    onboard_check,
    onboard_rows,
    own_sigma_deg,
)
from attlog.reference.model import ReferenceSigma
from attlog.reference.smoother import with_true_heading
from tests.external.files import BODY, OFFSET, SAME, WORLD, Made, euroc, made, tum
from tests.reference.flights import attitude_at, compared, estimate, flight, sampled
from tests.segments.flights import imu_log


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return flight(120.0)


def brought(log: FlightLog, given: object) -> Attitude:
    found = attitude.attach_truth(log, str(given)).truth
    assert found is not None
    assert found.fit is not None
    return found


def tilt_deg(found: Attitude) -> float:
    error = rotation.tilt_angle(rotation.earth_error(found.q, attitude_at(found.t)))
    return float(np.degrees(np.sqrt(np.mean(error**2))))


def heading_deg(found: Attitude) -> np.ndarray:
    return np.degrees(rotation.heading_angle(rotation.earth_error(found.q, attitude_at(found.t))))


def test_clock_and_axes_are_found_within_their_sigma(log: FlightLog, tmp_path: Path) -> None:
    found = brought(log, tum(tmp_path, made(0)))
    fit = found.fit
    assert abs(fit.offset_s - OFFSET) < 4.0 * fit.offset_sigma_s < 1e-2
    assert fit.drift_ppm == 0.0
    assert fit.drift_sigma_ppm < 50.0
    assert tilt_deg(found) < 2.0 * fit.sigma_tilt_deg < 1.0
    assert fit.body_deg == pytest.approx(np.degrees(rotation.to_euler(BODY)), abs=0.3)
    assert fit.correlation > 0.95
    assert fit.north == "none"
    spread = heading_deg(found)
    assert np.std(spread) < 2.0 * fit.sigma_heading_deg < 1.0


def test_a_drift_is_found(log: FlightLog, tmp_path: Path) -> None:
    fit = brought(log, tum(tmp_path, made(drift_ppm=300.0, noise_deg=0.02))).fit
    assert fit.drift_ppm == pytest.approx(300.0, abs=4.0 * fit.drift_sigma_ppm)
    assert 0.0 < fit.drift_sigma_ppm < 40.0
    assert abs(fit.offset_s - OFFSET) < 2e-3


def test_euroc_reads_as_tum(log: FlightLog, tmp_path: Path) -> None:
    m = made(3)
    one, other = brought(log, tum(tmp_path, m)), brought(log, euroc(tmp_path, m))
    assert np.allclose(one.t, other.t, atol=one.fit.offset_sigma_s)  # times differ in their last digit
    assert np.degrees(np.max(rotation.total_angle(rotation.earth_error(one.q, other.q)))) < one.fit.sigma_tilt_deg
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
    assert np.degrees(rotation.total_angle(rotation.earth_error(turned, half))) < 0.1


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
    assert brought(log, tum(tmp_path, replace(m, p=rotation.rotate(WORLD, way)))).fit.north == "none"
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


def test_one_jump_does_not_refuse_a_truth(log: FlightLog, tmp_path: Path) -> None:
    m = made(rate=10.0, noise_deg=0.05)
    q = m.q.copy()
    q[500] = rotation.multiply(q[500], rotation.from_euler(0.0, 2.5, 1.0))  # the markers are mixed up once
    found = brought(log, tum(tmp_path, replace(m, q=q)))
    assert abs(found.fit.offset_s - OFFSET) < 4.0 * found.fit.offset_sigma_s
    assert tilt_deg(found) < 2.0 * found.fit.sigma_tilt_deg
    assert len(found.t) == len(m.t) - 1


def test_a_pose_repeated_while_the_vehicle_turns_is_a_gap_and_at_rest_a_pose(log: FlightLog, tmp_path: Path) -> None:
    m = made(noise_deg=0.05)
    q = m.q.copy()
    flown, still = slice(3000, 3150), slice(100, 250)  # 65 to 68 s, 7 to 10 s
    q[flown], q[still] = q[flown.start - 1], q[still.start - 1]
    found = brought(log, tum(tmp_path, replace(m, q=q)))
    times = m.t + OFFSET
    assert not np.any((found.t > times[flown][0]) & (found.t < times[flown][-1]))
    assert np.any((found.t > times[still][0]) & (found.t < times[still][-1]))
    assert tilt_deg(found) < 2.0 * found.fit.sigma_tilt_deg


def test_a_heading_that_wanders_slowly_as_vision_does_enters_sigma(log: FlightLog, tmp_path: Path) -> None:
    """By 2 deg with a period of 60 s; the flight's gyro is exact but for noise."""
    m = made()
    wander = np.radians(2.0) * np.sin(2.0 * np.pi * m.t / 60.0)
    up = np.column_stack([np.zeros((len(m.t), 2)), wander]) @ rotation.to_matrix(WORLD).T
    seen = replace(m, q=rotation.multiply(rotation.from_rotvec(up), m.q))
    fit = brought(log, tum(tmp_path, seen)).fit
    assert fit.sigma_heading_deg == pytest.approx(np.degrees(np.std(wander)), rel=0.25)
    assert fit.sigma_tilt_deg < 0.3


def test_noise_is_told(log: FlightLog, tmp_path: Path) -> None:
    quiet, loud = (brought(log, tum(tmp_path, made(noise_deg=x), f"{x}.txt")).fit for x in (0.02, 0.3))
    assert loud.sigma_heading_deg == pytest.approx(0.3, rel=0.25)
    assert quiet.sigma_heading_deg < 0.2
    assert loud.noise_heading_deg == pytest.approx(0.3, rel=0.1)
    assert loud.noise_tilt_deg == pytest.approx(0.3 * np.sqrt(2.0), rel=0.1)


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
    apart = rotation.earth_error(found.q, rotation.slerp(t[good], own, found.t))
    tilt = np.degrees(np.sqrt(np.nanmean(rotation.tilt_angle(apart) ** 2)))
    assert tilt < (0.7 if name.startswith("V2") else 0.2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sitl/px4/px4_aggressive.ulg", "sitl/ardupilot/copter_aggressive.bin"])
def test_the_truth_of_a_simulator_comes_back_as_it_was(corpus: Path, tmp_path: Path, name: str) -> None:
    log = read(corpus / name)
    assert log.truth is not None
    own = log.truth
    m = Made(own.t + 1.5e9, rotation.normalize(own.q), np.full((len(own.t), 3), np.nan))
    found = brought(log, f"{tum(tmp_path, m)}:north=true")
    apart = rotation.earth_error(found.q, rotation.slerp(own.t, own.q, found.t))
    assert np.degrees(np.sqrt(np.nanmean(rotation.tilt_angle(apart) ** 2))) < 0.2
    assert abs(found.fit.offset_s + 1.5e9 + log.imus[log.imu].gyro.delay) < 0.02
    other = brought(log, corpus / name)
    assert abs(other.fit.offset_s) < 0.02
    assert other.fit.north == "file"
    assert other.fit.sigma_tilt_deg < 0.1


# What is refused as a truth, with the reason and what to do.


@pytest.fixture(scope="module")
def refused_log() -> FlightLog:
    return flight(120.0)


def refused(log: FlightLog, given: object) -> str:
    with pytest.raises(UsageError) as error:
        attitude.attach_truth(log, str(given))
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


def test_another_flight(refused_log: FlightLog, tmp_path: Path) -> None:
    said = refused(refused_log, tum(tmp_path, wandering(0)))
    assert "is it of this flight" in said or "offset=" in said or "how it is mounted" in said


def test_another_flight_of_the_same_mission_is_refused(refused_log: FlightLog, tmp_path: Path) -> None:
    """The same turns, but for 0.7 deg of wind about each axis within a few seconds."""
    m = made(noise_deg=0.1)
    rng = np.random.default_rng(5)
    smooth = np.hanning(101) / np.sqrt(np.sum(np.hanning(101) ** 2))
    wind = np.column_stack([np.convolve(x, smooth, "same") for x in rng.normal(size=(3, len(m.t)))])
    other = replace(m, q=rotation.multiply(m.q, rotation.from_rotvec(np.radians(0.7) * wind)))
    assert "another flight of this mission" in refused(refused_log, tum(tmp_path, other))


def test_a_constant_attitude(refused_log: FlightLog, tmp_path: Path) -> None:
    m = made(noise_deg=0.0)
    said = refused(refused_log, tum(tmp_path, replace(m, q=np.broadcast_to(m.q[0], m.q.shape))))
    assert "correlation 0.00" in said


def test_a_flight_without_motion(tmp_path: Path) -> None:
    still = flight(19.0)
    said = refused(still, tum(tmp_path, made(begin=0.0, end=19.0)))
    assert "the log turns by 0 deg/s" in said


def test_too_short_a_file(refused_log: FlightLog, tmp_path: Path) -> None:
    assert "shares no 10 s" in refused(refused_log, tum(tmp_path, made(begin=40.0, end=47.0)))


def test_a_wrong_offset(refused_log: FlightLog, tmp_path: Path) -> None:
    said = refused(refused_log, f"{tum(tmp_path, made(offset=0.0))}:offset=7")
    assert "do not follow the gyro" in said or "how it is mounted" in said


def test_a_topic_that_is_not_there_lists_what_is(refused_log: FlightLog) -> None:
    assert "it holds ATT" in refused(refused_log, "vehicle_mocap_odometry")


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(LogUnreadable, match="no such file"):
        check_truth("nowhere/mocap.txt:north=true")
    check_truth("vehicle_mocap_odometry")


def test_no_numbers(refused_log: FlightLog, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("nothing here\n")
    assert "no time" in refused(refused_log, path)


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
    found = parse_truth(given)
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
        check_truth(given)


# A truth that the user brought: taken before all others, wrong by its own sigma, with or without a north.

FIT = TruthFit(
    "mocap.tum", 12.5, 4e-4, 0.0, 1.5, (180.0, 0.0, 0.0), (180.0, 0.0, 90.0), 0.99, 0.4, 5000, 50.0, 0.3, 0.4, "file"
)


def log_with(north: str = "file", turned_deg: float = 0.0, tilt_deg: float = 0.0, name: str = "mocap.tum"):
    """A log with a brought truth whose earth is turned by a heading and whose body is tilted about its x axis."""
    log = flight()
    truth = sampled(50.0, source=name)
    q = rotation.multiply(truth.q, rotation.from_rotvec(np.radians([tilt_deg, 0.0, 0.0])))
    q = rotation.turn_about_down(q, np.radians(turned_deg))
    log.truth = replace(truth, q=q, fit=replace(FIT, north=north, name=name))
    return log


def reference_of(log, **options) -> Reference:
    """The reference of a log."""
    return choose(log, segments.build(log), ReferenceOptions(**{"declination": 0.0} | options))


def test_it_is_taken_whatever_speaks_against_it_and_that_is_told():
    tilted = log_with(tilt_deg=25.0)
    reference = reference_of(tilted)
    assert (reference.kind, reference.source) == ("truth", "mocap.tum")
    assert "gravity" in reference.faults.doubt
    tilted.truth = replace(tilted.truth, fit=None)  # the log's own truth is refused for the same
    assert reference_of(tilted).kind == "onboard"


def test_every_step_of_its_alignment_is_told_with_its_number():
    steps = {s.name: s for s in reference_of(log_with()).alignment.steps}
    assert (steps["truth_clock"].value, steps["truth_clock"].unit) == (12.5, "s")
    assert "0.4 ms" in steps["truth_clock"].text
    assert not steps["truth_drift"].applied
    assert steps["truth_body"].value == pytest.approx(180.0)
    assert steps["truth_world"].value == pytest.approx(180.0)  # half a turn about the line between north and east
    assert steps["truth_residual"].value == 0.4
    assert steps["own_sigma"].value == 0.3


def test_without_a_north_rows_are_turned_to_it_and_their_changes_compared():
    row, reference, _ = compared(log_with("none", turned_deg=70.0), estimate(heading_deg=5.0))
    assert reference.heading.by == "relative"
    assert row.heading_offset_deg == pytest.approx(-65.0, abs=0.1)
    assert np.abs(row.errors.heading).max() < 0.1
    assert own_sigma_deg(reference, "heading") == pytest.approx(0.4)
    assert "only changes of heading" in meaning(reference)


def test_with_its_own_north_a_wrong_heading_stays_wrong():
    row, reference, _ = compared(log_with("file"), estimate(heading_deg=5.0))
    assert reference.heading.by == "own"
    assert row.heading_offset_deg is None
    assert np.median(row.errors.heading) == pytest.approx(5.0, abs=0.1)


def test_without_a_north_it_is_no_heading_for_the_compass_and_accuses_no_heading():
    log = log_with("none", turned_deg=70.0)
    found = segments.build(log)
    reference = choose(log, found, ReferenceOptions(declination=0.0))
    assert "truth" not in heading_references(log, found, reference_of(flight()))
    assert log.truth_with_north is None
    assert not any(step.name == "declination_seen" for step in reference.alignment.steps)
    judged = onboard_check.compare_onboard(log, found, reference)
    assert judged is not None
    assert set(judged.sizes) == {"tilt"}


def test_a_small_difference_is_no_error_of_the_onboard_attitude_where_the_truth_is_unsure():
    sure, unsure = log_with(tilt_deg=4.0), log_with(tilt_deg=4.0)
    unsure.truth = replace(unsure.truth, fit=replace(unsure.truth.fit, sigma_tilt_deg=2.0))
    found = segments.build(sure)
    assert onboard_check.compare_onboard(sure, found, reference_of(sure)).sigmas["tilt"].max() == pytest.approx(0.3)
    assert onboard_check.compare_onboard(unsure, found, reference_of(unsure)).errors == []


def test_a_message_of_the_log_that_is_the_truth_is_no_row():
    log = log_with(name="vehicle_mocap_odometry")
    log.attitudes["vehicle_mocap_odometry"] = sampled(50.0, source="vehicle_mocap_odometry")
    found = segments.build(log)
    names = [row.name for row in onboard_rows(log, found, choose(log, found))]
    assert names == ["onboard"]


def test_a_heading_alone_goes_with_the_tilt_of_the_smoother():
    """The smoother's own heading is 20 deg off and wanders; a receiver with two antennas knows it to 0.5 deg."""
    log = flight()
    t = np.arange(0.0, 60.0, 0.01)
    own = rotation.turn_about_down(estimate(t).q, np.radians(20.0 + 3.0 * np.sin(0.2 * t)))
    smoother = smoother_of(log, t, own)
    at = np.arange(1.0, 59.0, 0.2)
    true = rotation.to_euler(estimate(at).q)[:, 2] + np.radians(np.random.default_rng(1).normal(0.0, 0.5, len(at)))
    found = with_true_heading(smoother, Stream(at, rotation.wrap(true)[:, None], "rad", "NED", "dual-antenna yaw"))
    inside = (found.t > 2.0) & (found.t < 58.0)
    apart = rotation.earth_error(found.q, estimate(found.t).q)[inside]
    assert np.degrees(np.abs(rotation.heading_angle(apart))).max() < 1.0
    assert np.degrees(rotation.tilt_angle(apart)).max() < 1e-3
    assert own_sigma_deg(found, "heading") == pytest.approx(0.5, abs=0.1)
    assert "dual-antenna yaw" in next(s.text for s in found.alignment.steps if s.name == "heading_by")
    assert "the heading is external" in meaning(found).lower()


def smoother_of(log, t, q) -> Reference:
    """A smoother's attitude that is sure of its tilt and knows nothing of north."""
    found = reference_of(log)
    zero = np.zeros(len(t), np.int64)
    sigma = np.full(len(t), 0.1)
    return replace(
        found, kind="smoother", t=t, q=q, gap_segment=zero, segment=zero, sigma=ReferenceSigma(sigma, 90 * sigma)
    )
