"""The contract of a FlightLog on every log in hand: clock, units and frames, proven by physics.

Expectations that we did not compute with this code stand in the manifests of the
corpus: measured ones for real logs, the simulators' truth for the others.
"""

from __future__ import annotations

import csv
import gzip
import random
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from attlog import analyze, flight
from attlog.core import rotation
from attlog.core.errors import AttlogError, TooLittleMemory, error_message, exit_code
from attlog.core.limits import ACC_LIMIT_M_S2, GYRO_LIMIT_RAD_S, MAG_LIMIT_T
from attlog.flight.model import FlightLog, Stream
from attlog.formats.table import Messages, Table
from attlog.pipeline.inspection import inspect
from tests.conftest import SAMPLES, corpus_logs, corpus_root, few
from tests.flight import physics

HOSTILE = sorted((root / "hostile").glob("*.*")) if (root := corpus_root()) else []
LOGS = corpus_logs() + [path for path in HOSTILE if path.suffix in (".ulg", ".bin", ".log", ".tlog", ".mcap")]


@cache
def opened(path: Path) -> FlightLog | AttlogError:
    """The flight, or the error that says why there is none."""
    try:
        return flight.read(path)
    except AttlogError as error:
        return error


def manifest(name: str) -> list[dict[str, str]]:
    """The rows of a manifest of the corpus, none where there is no corpus."""
    root = corpus_root()
    if root is None or not (root / name).is_file():
        return []
    with (root / name).open() as file:
        return list(csv.DictReader(file))


def row_id(row: dict[str, str]) -> str:
    return row["file"].split("/")[-1] + (f"-{row['source']}" if "source" in row else "")


REAL = [r for r in manifest("logs/MANIFEST.csv") if r["kind"] not in ("ULogExampleWriter", "px4log")]
SIMULATED = manifest("sitl/MANIFEST.csv")


# --- every file -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", LOGS, ids=lambda p: p.name)
def test_every_log_is_a_flight_on_one_clock_or_one_clear_line(path: Path) -> None:
    log = opened(path)
    if isinstance(log, AttlogError):
        assert path.name in str(log)
        assert "\n" not in str(log)
        return
    assert len(log.imus) == len({i.index for i in log.imus})
    for unit in log.imus:
        assert unit.gyro.unit == "rad/s"
        assert unit.acc.unit == "m/s^2"
        rising(unit.gyro, 3)
        rising(unit.acc, 3)
        assert np.abs(unit.gyro.x).max() <= GYRO_LIMIT_RAD_S
        assert np.abs(unit.acc.x).max() <= ACC_LIMIT_M_S2
        assert 0 <= unit.gyro.delay < 0.1
    if log.imu is not None:
        assert log.imus[log.imu].gyro.t[0] == 0.0, "t = 0 is the first sample of the replayed IMU"
        assert log.seconds > 0
    else:
        assert [p for p in log.problems if p.severity == "error"], "no replay needs a reason"
    for mag in log.mags:
        assert mag.field.unit == "T"
        finite = mag.field.x[np.isfinite(mag.field.x).all(axis=1)]
        assert len(finite) == 0 or np.abs(finite).max() <= MAG_LIMIT_T
    for attitude in (*log.attitudes.values(), log.truth, log.setpoints.attitude):
        if attitude is not None:
            np.testing.assert_allclose(np.linalg.norm(attitude.q, axis=1), 1.0, atol=1e-12)
            assert (np.diff(attitude.t) > 0).all()
            assert ((attitude.resets > 0) & (attitude.resets < len(attitude.t))).all()
            if attitude.t_sample is not None:
                assert (np.diff(attitude.t_sample) > 0).all()
    for stream in (log.airspeed, log.setpoints.rates, log.power.throttle, log.power.rpm, log.power.battery, *log.baro):
        if stream is not None:
            rising(stream)
    for gnss in log.gnss:
        assert (np.diff(gnss.t) > 0).all()
        assert np.nanmax(np.abs(np.append(gnss.lat, 0.0))) <= 90
    for line in (log.state.armed, log.state.landed, log.state.mode, log.imu_that_flew, *log.parameters.lines.values()):
        if line is not None:
            assert len(line.t) == len(line.value)
            assert (np.diff(line.t) >= 0).all()
    if not path.name.startswith("made_") and path not in HOSTILE:
        assert "unreadable_message" not in codes(log), "an undamaged log is read without this safety net"
    for problem in log.problems:
        assert problem.severity in ("info", "note", "warning", "error")
        assert problem.text.endswith(".")
        assert "\n" not in problem.text


def rising(stream: Stream, width: int | None = None) -> None:
    """A stream's times rise strictly, its values have one row each and are finite in at least one place."""
    assert stream.t.dtype == np.float64
    assert (np.diff(stream.t) > 0).all()
    assert len(stream.x) == len(stream.t)
    assert width is None or stream.x.shape[1] == width
    assert np.isfinite(stream.x).any(axis=1).all()


# --- simulated flights against the simulators' truth ------------------------------------------------------------


def of(row: dict[str, str], folder: str) -> FlightLog:
    root = corpus_root()
    assert root is not None
    log = opened(root / folder / row["file"])
    assert isinstance(log, FlightLog)
    return log


@pytest.mark.slow
@pytest.mark.parametrize("row", SIMULATED, ids=row_id)
def test_onboard_attitudes_score_against_truth_as_published(row: dict[str, str]) -> None:
    log = of(row, "sitl")
    name = log.onboard if row["source"] == "onboard" else "AHR2"
    scores = physics.scores(log.attitudes[name], log.truth, 15.0)
    for key, value in scores.items():
        assert value == pytest.approx(float(row[key]), abs=0.02), key
    assert log.simulated


@pytest.mark.slow
@pytest.mark.parametrize("row", [r for r in SIMULATED if r["source"] == "onboard"], ids=row_id)
def test_gyro_gravity_and_field_agree_with_truth(row: dict[str, str]) -> None:
    log = of(row, "sitl")
    imu = log.imus[log.imu]
    # gyro = derivative of truth: no wrong unit, sign or axis; scale errors of up to 0.6 % are injected
    assert physics.correlation(imu, log.truth) > 0.98
    slopes = physics.slopes(imu, log.truth)
    np.testing.assert_allclose(slopes[np.isfinite(slopes)], 1.0, atol=0.02)
    # at rest before take-off: bias and gravity as injected
    before = next((t for t, armed in zip(log.state.armed.t, log.state.armed.value, strict=True) if armed), np.inf)
    rest = physics.still(imu) & (imu.gyro.t < before)
    if rest.sum() > imu.gyro.rate:
        bias = np.degrees(np.median(imu.gyro.x[rest], axis=0))
        expected = [float(x) for x in row["checks.gyro_bias_dps"].split()]
        np.testing.assert_allclose(bias, expected, atol=0.04)  # ArduPilot's drifts by 0.05 deg/s a minute
        q = rotation.slerp(log.truth.t, log.truth.q, imu.acc.t[rest])
        known = np.isfinite(q).all(axis=1)
        force = rotation.rotate(q[known], imu.acc.x[rest][known]).mean(axis=0)
        np.testing.assert_allclose(force, [float(x) for x in row["checks.gravity"].split()], atol=0.02)
    # the field rotated by truth points to magnetic north, unless the flight is about a broken compass
    if "magfault" not in row["file"] and "mag_fault" not in row["file"]:
        azimuth = physics.azimuths(log, log.truth)
        assert np.median(azimuth) == pytest.approx(float(row["declination_true"]), abs=0.25)


SAMPLE_SCORES = {
    "px4_hover.ulg": (0.866, 1.133, "-0.358 0.550 0.894"),
    "px4_steps.ulg": (0.887, 1.159, "0.801 0.295 -0.510"),
    "copter_steps_stabilize.bin": (0.665, 2.549, "-0.292 0.527 0.208"),
    "copter_steps_stabilize.tlog": (0.665, 2.590, "-0.265 0.499 0.178"),
}
"""RMS tilt and heading in deg of the onboard attitude against truth, and gyro bias at rest in deg/s, as in the
manifest of the simulated flights: the same proof where only the sample logs are at hand."""


@pytest.mark.parametrize("name", SAMPLE_SCORES)
def test_sample_logs_agree_with_their_truth(name: str) -> None:
    log = opened(SAMPLES / name)
    assert isinstance(log, FlightLog)
    tilt, heading, bias = SAMPLE_SCORES[name]
    scores = physics.scores(log.attitudes[log.onboard], log.truth, 15.0)
    assert scores["rms_tilt"] == pytest.approx(tilt, abs=0.02)
    assert scores["rms_heading"] == pytest.approx(heading, abs=0.02)
    imu = log.imus[log.imu]
    assert physics.correlation(imu, log.truth) > 0.99
    rest = physics.still(imu) & (imu.gyro.t < 12)
    np.testing.assert_allclose(
        np.degrees(np.median(imu.gyro.x[rest], axis=0)), [float(x) for x in bias.split()], atol=0.04
    )


# --- real logs --------------------------------------------------------------------------------------------------

OTHER_CHOICE = {
    "bin_copter_3.6.8_magjump_cut.bin": "COMPASS_PRIMARY is the second compass; the manifest describes the first",
    "made_bin_garbage_and_ff_block.bin": "as magjump, of which it was made",
    "made_bin_two_boots_two_firmwares.bin": "the manifest mixes both boots",
    "ulg_px4_1.16_cuav7nano_quad_cut.ulg": "both compasses are off (SYS_HAS_MAG 0), so none is used",
    "bin_copter_3.3dev_mag66_cut.BIN": "the compass shows its own offsets and is not used",
}
SELDOM_LEVEL = {
    "bin_plane_3.0.4beta3_nomag.BIN": "onboard attitude drifts away at 6.6 deg/s of gyro bias",
    "bin_rover_2.46beta2.BIN": "onboard attitude drifts away at 14 deg/s of gyro bias",
    "bin_copter_3.3dev_27hz_zeromag_upsidedown.BIN": "onboard attitude still turns over to upside down",
    "ulg_px4_1.12_fmuv5_short.ulg": "attitude begins after the rest",
    "made_ulg_4096_zero_block.ulg": "attitude begins after the rest",
    "made_ulg_700B_garbage.ulg": "attitude begins after the rest",
    "ulg_px4_1.6.5_fmuv2_handrotated_cut.ulg": "turned by hand between the rests",
    "bin_copter_3.2.1_quad_cut.BIN": "AHRS_TRIM is inside ATT",
}
"""Logs whose gravity and attitude differ at rest for a reason that lies in the flight."""


def real(*columns: str) -> list[dict[str, str]]:
    """Rows of real logs in which all these columns hold something."""
    return [r for r in REAL if all(r[c] not in ("", "nan") for c in columns)]


@pytest.mark.slow
@pytest.mark.parametrize("row", real("rest_g"), ids=row_id)
def test_gravity_at_rest_is_what_the_manifest_measured(row: dict[str, str]) -> None:
    log = of(row, "logs")
    if log.imu is None or row["file"] in OTHER_CHOICE:
        pytest.skip(OTHER_CHOICE.get(row["file"], "telemetry, too slow to find rest"))
    rest = physics.still(log.imus[log.imu])
    if rest.sum() < log.imus[log.imu].gyro.rate:
        pytest.skip("less than a second of rest by this test's own rule")
    measured = float(np.median(np.linalg.norm(log.imus[log.imu].acc.x[rest], axis=1)))
    assert measured == pytest.approx(float(row["rest_g"]), abs=0.05)
    if row["file"] not in SELDOM_LEVEL and log.onboard is not None:
        angle = physics.tilt_error(log, rest, log.attitudes[log.onboard])
        assert angle < max(3.0, float(row["rest_tilt_err_deg"] or 0) + 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("row", real("gyro_vs_dattitude_slope_xyz"), ids=row_id)
def test_the_attitude_turns_as_the_gyro_says(row: dict[str, str]) -> None:
    log = of(row, "logs")
    if log.imu is None or log.onboard is None:
        pytest.skip("too slow to compare rates")
    slopes = physics.slopes(log.imus[log.imu], log.attitudes[log.onboard], least_dps=10.0)
    slow = log.attitudes[log.onboard].rate < 30
    for slope in slopes[np.isfinite(slopes)]:
        # slow attitudes smear fast motion; instantaneous samples of 2013 alias rotor vibration
        assert slope == pytest.approx(1.0, abs=0.2 if slow else 0.07)


@pytest.mark.slow
@pytest.mark.parametrize("row", real("mag_norm"), ids=row_id)
def test_the_field_has_the_measured_size_in_tesla(row: dict[str, str]) -> None:
    log = of(row, "logs")
    if row["file"] in OTHER_CHOICE or log.mag is None:
        pytest.skip(OTHER_CHOICE.get(row["file"], "no usable magnetometer"))
    norm = float(np.nanmedian(np.linalg.norm(log.mags[log.mag].field.x, axis=1)))
    gauss = float(row["mag_norm"]) * (1e-3 if float(row["mag_norm"]) > 10 else 1.0)
    assert norm == pytest.approx(gauss * 1e-4, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("row", real("mag_declination_std_deg", "mag_norm"), ids=row_id)
def test_the_field_stands_still_in_earth_axes(row: dict[str, str]) -> None:
    log = of(row, "logs")
    if row["file"] in OTHER_CHOICE or log.mag is None or log.onboard is None:
        pytest.skip(OTHER_CHOICE.get(row["file"], "no usable magnetometer"))
    azimuth = np.radians(physics.azimuths(log, log.attitudes[log.onboard]))
    if len(azimuth) < 10:
        pytest.skip("fewer than ten magnetometer samples inside the attitude")
    length = abs(np.mean(np.exp(1j * azimuth)))
    assert np.degrees(np.sqrt(-2 * np.log(length))) <= float(row["mag_declination_std_deg"]) + 1.0


# --- what the corpus is known for -------------------------------------------------------------------------------


@pytest.fixture
def log_named(corpus: Path):
    """Opens one log of the corpus by its name."""
    return lambda name: opened(corpus / "logs" / name)


def codes(log: FlightLog) -> set[str]:
    return {p.code for p in log.problems}


def test_a_quaternion_reset_is_marked(log_named) -> None:
    attitude = log_named("ulg_px4_1.15dev_cubeorange_quad_cut.ulg").attitudes["vehicle_attitude"]
    step = np.degrees(rotation.total_angle(rotation.earth_error(attitude.q[1:], attitude.q[:-1])))
    assert attitude.resets.tolist() == [int(np.argmax(step)) + 1]
    assert step.max() == pytest.approx(21, abs=1)


def test_the_estimator_that_flew_chooses_the_imu(log_named) -> None:
    log = log_named("ulg_px4_1.15dev_cubeorange_quad_cut.ulg")
    assert log.imus[log.imu].index == 2


def test_a_late_record_does_not_stretch_the_flight(log_named) -> None:
    log = log_named("ulg_px4_1.11.2_cubeorange_vtol_latestamp.ulg")
    assert log.seconds == pytest.approx(6.5, abs=0.1)
    assert len(log.imus) == 3
    assert log.vehicle == "VTOL"


def test_the_unix_clock_of_a_simulator_loses_no_resolution(log_named) -> None:
    log = log_named("ulg_px4_1.15dev_sitl_events_epochclock_cut.ulg")
    assert log.t0_us > 1.7e15
    assert np.diff(log.imus[0].gyro.t).std() < 1e-6


def test_dead_and_disabled_compasses_are_told_and_not_used(log_named) -> None:
    for name, code in (
        ("bin_copter_3.3dev_mag66_cut.BIN", "mag_only_offsets"),
        ("bin_copter_3.3dev_27hz_zeromag_upsidedown.BIN", "mag_dead"),
        ("ulg_px4_1.16_cuav7nano_quad_cut.ulg", "mag_disabled"),
    ):
        log = log_named(name)
        assert log.mag is None, name
        assert code in codes(log), name


def test_magnetometer_jumps_are_missing_samples(log_named) -> None:
    field = log_named("bin_copter_3.6.8_magjump_cut.bin").mags[0].field.x
    assert np.isnan(field).any(axis=1).sum() == 2
    assert np.nanmax(np.abs(field)) < 1e-4


def test_equal_times_of_two_logging_tasks_are_dropped(log_named) -> None:
    log = log_named("bin_copter_3.3dev_mag66_cut.BIN")
    assert [p.count for p in log.problems if p.code == "duplicate_times" and p.text.startswith("ATT")] == [190]


def test_hardware_in_the_loop_is_marked_simulated(log_named) -> None:
    assert log_named("ulg_px4_1.10_hitl_cut.ulg").simulated
    assert not log_named("ulg_px4_1.8_typhoon_hexa_cut.ulg").simulated


def test_two_boots_are_separate_flights(corpus: Path) -> None:
    path = corpus / "logs" / "made_bin_two_boots_two_firmwares.bin"
    both = [flight.read(path, boot=k) for k in (0, 1)]
    assert [log.firmware.version for log in both] == ["Copter 3.2.1", "Copter 3.1.3"]
    assert all(log.boots == 2 for log in both)
    assert "several_boots" in codes(both[0])
    (said,) = (p.text for p in both[0].problems if p.code == "several_boots")
    assert f"this is number 0, {both[0].seconds:.0f} s. Number 1 lasts {both[1].seconds:.0f} s." in said
    with pytest.raises(AttlogError, match="boot 2"):
        flight.read(path, boot=2)


def test_a_vehicle_that_is_not_system_one_is_found(log_named) -> None:
    assert log_named("tlog_mav2_plane_3.6.0_sys2_cut.tlog").vehicle == "VTOL", "a fixed wing with Q_ENABLE 1"
    assert log_named("tlog_mav2_sysid0_cut.tlog").vehicle == "quadrotor"


# Damaged files: what is left is used, what is lost is told, and nothing absurd comes through.

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


def test_a_log_in_a_gzip_file_that_ends_early_says_so_first(tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg.gz"
    path.write_bytes(gzip.compress((SAMPLES / "px4_steps.ulg").read_bytes(), 6)[:-200_000])
    log = flight.read(path)
    assert log.imu is not None
    problem = next(p for p in log.problems if p.code == "damage")
    assert "gzip file ends early" in problem.text
    assert "cut_at_end" not in [p.code for p in log.problems]


# A log that the machine cannot hold is refused before the work, in a sentence with numbers.


def log_of(samples: int, name: str = "sensor_combined") -> Messages:
    offsets = np.broadcast_to(np.int64(0), samples)
    table = Table(name, 0, {}, offsets, lambda *_: np.zeros(0))
    return Messages(Path("long.ulg"), "ulog", 2 << 30, {(name, 0): table})


def test_samples_beyond_the_memory_are_refused_with_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight, "available_bytes", lambda: 4_000_000_000)
    flight.check_flight_memory(log_of(4_000_000_000 // flight.FLIGHT_BYTES))
    with pytest.raises(TooLittleMemory, match=r"long.ulg: needs some 5\.1 GB .* 30,000,000 .* 4\.0 GB are free"):
        flight.check_flight_memory(log_of(30_000_000))


@pytest.mark.parametrize("work", [inspect, analyze])
def test_what_is_made_of_a_flight_is_asked_for_too(
    work: Callable[[Path], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flight, "ALWAYS_ALLOWED_SAMPLES", 0)
    samples = len(flight.read(SAMPLES / "px4_hover.ulg").imus[0].gyro.t)
    monkeypatch.setattr(flight, "available_bytes", lambda: samples * flight.FLIGHT_BYTES)  # enough to read it
    with pytest.raises(TooLittleMemory, match=r"px4_hover\.ulg: needs"):
        work(SAMPLES / "px4_hover.ulg")


def test_what_is_short_or_has_no_inertial_samples_or_nobody_tells_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flight, "available_bytes", lambda: 0)
    flight.check_flight_memory(log_of(flight.ALWAYS_ALLOWED_SAMPLES))
    flight.check_flight_memory(log_of(20_000_000, "actuator_outputs"))
    monkeypatch.setattr(flight, "available_bytes", lambda: None)
    flight.check_flight_memory(log_of(20_000_000))


def test_memory_that_runs_out_is_no_bug_of_attlog() -> None:
    error = MemoryError("Unable to allocate 16.8 MiB")
    assert exit_code(error) == exit_code(TooLittleMemory("x")) == 75
    said = error_message(error, "1.0", "long.ulg")
    assert said.startswith("attlog: long.ulg: memory ran out")
    assert "bug" not in said
