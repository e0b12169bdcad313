"""The ways to break a log are repeatable, bounded, and do break it."""

from __future__ import annotations

import contextlib
import functools
import itertools
import random
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from attlog import flight, formats, pipeline
from attlog.core import rotation
from attlog.core.errors import AttlogError, LogUnusable
from attlog.flight import limits as physics
from attlog.flight.model import Attitude, FlightLog, Stream
from attlog.formats.table import Messages
from attlog.health import HealthCase, answerable, run_checks
from attlog.metrics.metric import Case
from attlog.reference import smoother
from tests.conftest import SAMPLES, few
from tests.fuzz import campaign
from tests.fuzz.campaign import Trial, run, trials
from tests.fuzz.mutate import LARGEST, WAYS, Way, mutated
from tests.fuzz.values import AXES, FAULTS, any_fault, faulty, hostile, without_truth

RAW = (SAMPLES / "px4_hover.ulg").read_bytes()[:200_000]


@pytest.mark.parametrize("way", WAYS, ids=lambda w: w.__name__)
def test_a_way_gives_the_same_bytes_for_a_seed_and_mostly_others_than_before(way: Way) -> None:
    once = [way(RAW, random.Random(seed)) for seed in range(20)]
    assert once == [way(RAW, random.Random(seed)) for seed in range(20)]
    assert sum(broken != RAW for broken in once) >= 15
    assert all(len(broken) < LARGEST for broken in once)


@pytest.mark.parametrize("length", [1, 3, 17])
def test_almost_nothing_can_be_broken_too(length: int) -> None:
    assert all(isinstance(mutated(RAW[:length], seed), bytes) for seed in range(200))
    assert len({mutated(RAW, seed) for seed in range(40)}) > 35


# Whatever the columns of a log hold, what reaches the flight is finite where it must be, in order, and possible.

VALUE_LOGS = ("px4_hover.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog")


@functools.cache
def opened(name: str) -> Messages:
    return formats.open(SAMPLES / name)


def of_hostile(name: str, seed: int) -> FlightLog | None:
    broken = hostile(opened(name), seed)
    with mock.patch.object(formats, "open", return_value=broken):
        try:
            return flight.read(Path(name))
        except AttlogError:
            return None


def limits(log: FlightLog) -> list[tuple[str, np.ndarray, physics.Quantity]]:
    """Every number that a flight consists of, beside what it may be."""
    found: list[tuple[str, np.ndarray, physics.Quantity]] = []
    for imu in log.imus:
        found += [("gyro", imu.gyro.x, physics.GYRO), ("acc", imu.acc.x, physics.ACC)]
        found += [] if imu.temperature is None else [("temperature", imu.temperature.x, physics.TEMPERATURE)]
        found += [("delay", np.array([imu.gyro.delay, imu.acc.delay]), physics.Quantity("", 0.0, 0.25, "s", ""))]
    found += [("field", mag.field.x, physics.FIELD) for mag in log.mags]
    for g in log.gnss:
        found += [
            ("lat", g.lat, physics.LATITUDE),
            ("lon", g.lon, physics.LONGITUDE),
            ("alt", g.alt, physics.HEIGHT),
            ("velocity", g.vel_ned, physics.SPEED),
            ("h_acc", g.h_acc, physics.PLACE_ACCURACY),
            ("v_acc", g.v_acc, physics.PLACE_ACCURACY),
            ("s_acc", g.s_acc, physics.SPEED_ACCURACY),
        ]
    streams = [("baro", b, physics.BARO) for b in log.baro]
    streams += [
        (n, s, q)
        for n, s, q in (
            ("airspeed", log.airspeed, physics.AIRSPEED),
            ("throttle", log.power.throttle, physics.THROTTLE),
            ("rpm", log.power.rpm, physics.RPM),
            ("rates", log.setpoints.rates, physics.RATE_SETPOINT),
            ("acc bias", log.estimator.acc_bias, physics.ACC_BIAS),
            ("gyro_bias", log.estimator.gyro_bias, physics.GYRO_BIAS),
            ("vibration", log.vibration.level, physics.VIBRATION),
        )
        if s is not None
    ]
    found += [(n, s.x, q) for n, s, q in streams]
    if log.parameters.declination is not None:
        found.append(("declination", np.array(log.parameters.declination), physics.Quantity("", -180, 180, "deg", "")))
    if log.utc_offset is not None:
        found.append(("date", np.array(1e6 * log.utc_offset + log.t0_us), physics.UTC_US))
    return found


def streams(log: FlightLog) -> list[tuple[str, np.ndarray, float]]:
    """The times of everything, and how fast it may be."""
    some: list[Stream | None] = [
        log.airspeed,
        log.power.throttle,
        log.power.rpm,
        log.power.battery,
        log.setpoints.rates,
        *log.baro,
    ]
    found = [(s.source, s.t, physics.FUSED_HZ) for s in some if s is not None]
    found += [(i.gyro.source, i.gyro.t_best, physics.RAW_HZ) for i in log.imus]
    found += [(m.field.source, m.field.t, physics.FUSED_HZ) for m in log.mags]
    found += [(name, a.t, physics.FUSED_HZ) for name, a in log.attitudes.items()]
    return [*found, *((g.source, g.t, physics.AIDING_HZ) for g in log.gnss)]


@pytest.mark.slow
@pytest.mark.parametrize("name", few(VALUE_LOGS, 1))
def test_only_what_is_possible_reaches_the_flight(name: str) -> None:
    told = 0
    for seed in range(40):
        log = of_hostile(name, seed)
        if log is None:
            continue
        where = f"{name}, seed {seed}"
        for what, x, quantity in limits(log):
            assert not np.isinf(x).any(), (where, what)
            assert not quantity.outside(x).any(), (where, what, quantity.limits)
        for source, t, fastest in streams(log):
            assert (np.diff(t) > 0).all(), (where, source, "times rise")
            assert len(t) == 0 or np.abs(t).max() < 4 * 86_400, (where, source, "a flight is no month")
            if len(t) > physics.ENOUGH_FOR_A_RATE and t[-1] - t[0] < 1.0:
                assert (len(t) - 1) / (t[-1] - t[0]) <= fastest * (1 + 1e-9), (where, source, "rate")
        for attitude in log.attitudes.values():
            np.testing.assert_allclose(np.linalg.norm(attitude.q, axis=1), 1.0, atol=1e-9)
        assert all(np.isfinite(t) and abs(t) < 4 * 86_400 for t, _, _ in log.texts), where
        assert all(p.t is None or abs(p.t) < 4 * 86_400 for p in log.problems), where
        told += any(p.code == "values_out_of_range" for p in log.problems)
    assert told > 5, "the damage was seen"


# A sensor that fails in a way that only physics shows: what then judges the others is right.

PX4, COPTER, TELEMETRY = "px4_steps.ulg", "copter_steps_stabilize.bin", "copter_steps_stabilize.tlog"
SENSOR_LOGS = (PX4, COPTER, TELEMETRY)
TILT_DEG, SIGMAS = 3.0, 4.0
"""So far a reference may be from truth (RMS), or so many of its own sigmas."""
CHEAP = (
    (PX4, "gyro", "radians"),
    (PX4, "gyro", "one axis reversed"),
    (PX4, "gyro", "stopped"),
    (COPTER, "gyro", "half as much again"),
    (COPTER, "gyro", "late"),
    (COPTER, "attitude", "swapped"),
    (TELEMETRY, "gyro", "swapped"),
    (PX4, "attitude", "backwards"),
    (PX4, "accelerometer", "in g"),
    (COPTER, "accelerometer", "zero"),
)
TOLD = (
    (PX4, "compass", "reversed", "compass_orientation", "mirrored axes"),
    (TELEMETRY, "compass", "one axis reversed", "compass_orientation", "mirrored axes"),
    (COPTER, "compass", "swapped", "compass_orientation", "mirrored axes"),
    (COPTER, "gyro", "spiked", "gyro_spikes", "jumps 9 times for a single sample"),
    (PX4, "accelerometer", "reversed", "accelerometer_axes", "the accelerometer's axes are wrong"),
    (COPTER, "accelerometer", "late", "accelerometer_delay", "taken 4.5 s later"),
)
"""What the audit says of faults that misled the smoother, or that nobody told of."""
# Every fault of every sensor, on the logs in turn; ``make fuzz`` draws from all.
EVERY = [
    (SENSOR_LOGS[k % len(SENSOR_LOGS)], *pair) for k, pair in enumerate((s, fault) for s in AXES for fault in FAULTS)
]


@functools.cache
def truth(name: str) -> tuple[float, Attitude]:
    log = flight.flight_in(opened(name))
    assert log.truth is not None
    return log.t0_us * 1e-6, log.truth


def prepared(messages: Messages) -> Case:
    return pipeline.prepare(flight.flight_in(without_truth(messages)), {"estimators": ["gyro"]})


def off_deg(case: Case, name: str) -> float:
    """How far (deg RMS) down by the reference is from down by the truth."""
    reference, (begin, true) = case.reference, truth(name)
    t = reference.t + case.log.t0_us * 1e-6 - begin
    used = (t > true.t[0]) & (t < true.t[-1]) & (reference.t >= reference.scoring.start)
    nearest = np.clip(np.searchsorted(true.t, t[used]), 0, len(true.t) - 1)
    tilt = rotation.tilt_angle(rotation.earth_error(reference.q[used], true.q[nearest]))
    return float(np.degrees(np.sqrt(np.mean(tilt**2)))) if used.any() else 0.0


def honest(name: str, sensor: str, fault: str) -> None:
    case = prepared(faulty(opened(name), sensor, fault))
    if case.reference.kind == "onboard" and sensor == "attitude":
        return  # nothing else was there to judge by; agreement with it is called agreement
    off, own = off_deg(case, name), smoother.sigma_deg(case.reference, "tilt")
    assert case.reference.kind == "none" or off <= max(TILT_DEG, SIGMAS * own)


@pytest.mark.parametrize(("name", "sensor", "fault"), few(CHEAP, 4))
def test_what_judges_after_a_fault_of_a_sensor_is_right(name: str, sensor: str, fault: str) -> None:
    honest(name, sensor, fault)


@pytest.mark.parametrize(("name", "sensor", "fault", "check", "said"), TOLD)
def test_a_fault_that_would_mislead_a_smoother_is_told_and_none_is_made(
    name: str, sensor: str, fault: str, check: str, said: str
) -> None:
    case = prepared(faulty(opened(name), sensor, fault))
    told = {c.question: c for c in run_checks(HealthCase(case.log, case.segments, case.reference))}
    assert told[check].verdict == "fault"
    assert said in told[check].text
    assert case.reference.kind == "onboard"
    assert said in case.reference.faults.refused["smoother"]
    assert off_deg(case, name) < TILT_DEG


@pytest.mark.slow
def test_what_is_left_to_say_with_an_accelerometer_in_wrong_axes() -> None:
    """The field tells that it is not the attitude that flew: filters are compared with that, and all is led by it."""
    log = flight.flight_in(without_truth(faulty(opened(PX4), "accelerometer", "reversed")))
    result = pipeline.analyze(log, {"estimators": ["mahony", "eskf"]})
    assert result.reference is not None
    assert result.reference.choice == "onboard"
    assert all(verdict.notes[0].startswith("The accelerometer is wrong") for verdict in result.verdicts)
    codes = {problem.kind for problem in result.findings}
    assert "accelerometer_axes" in codes
    assert not codes & {"attitude", "mounting"}, "the attitude is right"


def test_sound_sensors_are_not_accused() -> None:
    for name in SENSOR_LOGS:
        assert prepared(opened(name)).reference.faults.sensors == {}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "sensor", "fault"), EVERY)
def test_what_judges_after_any_fault_of_a_sensor_is_right(name: str, sensor: str, fault: str) -> None:
    with contextlib.suppress(LogUnusable):  # refused is honest
        honest(name, sensor, fault)


@pytest.mark.slow
def test_what_info_foresees_of_a_gyro_that_is_wrong_is_what_analyze_does() -> None:
    case = prepared(faulty(opened(PX4), "gyro", "one axis reversed"))
    assert case.reference.kind == "onboard"
    assert "no smoother: the logged gyro" in smoother.expected_reference(case.log, case.segments, case.reference)
    assert not any(answer.can for answer in answerable(case.log, case))
    sound = prepared(opened(PX4))
    assert any(answer.can for answer in answerable(sound.log, sound))


def test_a_fault_changes_all_axes_and_nothing_else() -> None:
    whole, broken = opened(COPTER), faulty(opened(COPTER), "gyro", "half")
    for axis in "XYZ":
        assert broken["IMU", 0][f"Gyr{axis}"] == pytest.approx(0.5 * whole["IMU", 0][f"Gyr{axis}"], rel=1e-6)
    assert (broken["IMU", 0]["AccX"] == whole["IMU", 0]["AccX"]).all()
    assert any_fault(whole, 3).tables.keys() == whole.tables.keys()
    assert faulty(opened(PX4), "gyro", "swapped").path == Path(opened(PX4).path)


# Broken logs through the whole of attlog: documented exit codes, sound JSON, no impossible number, time and memory.

CUTS = {"px4_steps.ulg": 500_000, "copter_yaw_turns.bin": 300_000, "copter_steps_stabilize.tlog": 250_000}
RUNS = 21


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The first seconds of the samples: an analysis of them takes a fraction of a second."""
    campaign.warm()
    folder = tmp_path_factory.mktemp("cut")
    for name, length in CUTS.items():
        (folder / name).write_bytes((SAMPLES / name).read_bytes()[:length])
    return [folder / name for name in CUTS]


@pytest.mark.slow
def test_broken_logs_end_as_documented(logs: list[Path], tmp_path: Path) -> None:
    commands = ("analyze", "analyze", "analyze", "info", "extract", "report")
    faults = []
    for trial in itertools.islice(trials(logs, 7, commands), RUNS):
        faults += [f"{trial}: {fault}" for fault in run(trial, tmp_path).faults]
    assert faults == []


@pytest.mark.slow
def test_whole_logs_have_no_fault(logs: list[Path], tmp_path: Path) -> None:
    for log in logs:
        outcome = run(Trial(log, "whole", 0, "analyze"), tmp_path)
        assert (outcome.code, outcome.faults) == (0, [])


@pytest.mark.parametrize(
    ("document", "says"),
    [
        ({"rate_hz": 250_000.0}, ".rate_hz"),
        ({"checks": [{"value": 1e34, "unit": "uT"}]}, ".checks[0].value"),
        ({"delay_ms": 1e42}, ".delay_ms"),
        ({"place": {"alt_m": -23_889.0}}, ".place.alt_m"),
        ({"segments": [{"t1": 1e12}]}, ".segments[0].t1"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_the_judge_sees_what_no_flight_has(document: dict[str, object], says: str) -> None:
    assert [x.partition(" ")[0] for x in campaign.unphysical(document)] == [says]
    assert list(campaign.unphysical({"rate_hz": 250.0, "params": {"X": 1e38}, "value": 3.0, "unit": "deg"})) == []
    assert campaign.wrong('{"x": NaN}') == ["no JSON: NaN in a result"]


@pytest.mark.slow
def test_a_crash_a_hang_and_a_wrong_exit_code_are_faults(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trial = Trial(logs[1], "whole", 0, "analyze")

    def crash(*args: object) -> tuple[int, list[str]]:
        raise RuntimeError("nobody thought of this")

    def spin(*args: object) -> tuple[int, list[str]]:
        while True:
            pass

    def odd(*args: object) -> tuple[int, list[str]]:
        return 3, []

    monkeypatch.setattr(campaign, "SECONDS", 1.0)
    monkeypatch.setattr(campaign, "SECONDS_PER_MB", 0.0)
    for broken, says in ((crash, "nobody thought of this"), (odd, "exit code 3"), (spin, "more than")):
        monkeypatch.setattr(campaign, "_commanded", broken)
        assert says in "".join(run(trial, tmp_path).faults)
