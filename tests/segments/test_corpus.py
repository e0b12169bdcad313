"""Phases of real logs on which a report once said something false; each truth was found by hand, with other tools."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import formats, segments
from attlog.core import spans
from attlog.core.errors import AttlogError
from attlog.flight.model import PAUSE_S
from attlog.pipeline.summary import describe
from attlog.segments import Segments, increments
from tests.conftest import corpus_logs, corpus_root


@pytest.fixture(scope="module")
def cases() -> Path:
    """The folder of these logs."""
    from tests.conftest import corpus_root

    root = corpus_root()
    if root is None or not (root / "logs" / "cases").is_dir():
        pytest.skip("ATTLOG_CORPUS does not name a folder with logs/cases")
    return root / "logs" / "cases"


def phases(path: Path) -> Segments:
    """The segments of a log."""
    return segments.build(attlog.read(path))


def test_land_complete_maybe_ends_no_flight_and_a_crash_between_flights_is_told(cases):
    """Throttle above half and height above 0.5 m for 208 s; a crash at 165.7 s, 174 deg of tilt, flown on later."""
    found = phases(cases / "copter_3.3dev_118.BIN")
    assert found.seconds("airborne") == pytest.approx(208, abs=12)
    lost = [s for s in found.of("loss_of_control") if s.t0 < 200]
    assert [s.t0 for s in lost] == [pytest.approx(165.7, abs=0.2)]
    assert "4.6 g" in lost[0].why
    assert "turned over to 172 deg" in lost[0].why
    assert all(s.t0 > 300 for s in found.of("impact"))


def test_a_tipped_copter_and_a_pause_of_the_logger_are_no_flight(cases):
    """About 32 s of flight; the land detector's span covers a pause of 59 s and the copter lying at 45 and 178 deg."""
    found = phases(cases / "copter_3.3dev_37.BIN")
    assert found.seconds("airborne") == pytest.approx(32, abs=7)
    assert spans.intersect(found.spans("airborne"), [(28.0, 102.0), (121.5, 157.5)]) == []


def test_a_blow_that_is_followed_by_further_flights_drops_none_of_them(cases):
    """219 s of flight after a bounce at 138 s; ATT roll stayed within -15 to -1 deg, there was no tumble."""
    found = phases(cases / "copter_3.3dev_31.BIN")
    assert found.of("impact") == []
    assert not [s for s in found.of("loss_of_control") if 130 < s.t0 < 145]
    assert spans.seconds(spans.intersect(found.spans("airborne"), [(140, 530)])) == pytest.approx(219, abs=10)


def test_a_hover_as_still_as_a_table_is_no_rest(cases):
    """Simulated without vibration: 1.97 m above the ground with motors at 1595 us, and no record of arming."""
    found = phases(cases / "copter_4.4dev_sitl_swarm.BIN")
    assert spans.intersect(found.spans("rest"), [(4.0, 80.0)]) == []
    assert spans.seconds(spans.intersect(found.spans("hover"), [(6.0, 79.0)])) > 70


def test_a_steady_climb_is_no_rest(cases):
    found = phases(cases / "copter_4.7dev_sitl_climb.BIN")
    assert spans.intersect(found.spans("rest"), [(4.0, 28.0)]) == []
    assert found.spans("airborne")[0] == (pytest.approx(3.2, abs=0.5), pytest.approx(27.5, abs=0.1))


def test_full_throttle_without_height_is_no_flight_and_stopped_motors_are_rest_though_armed(cases):
    """A bench run: the altitude moves under 0.5 m; afterwards 14.6 s still with all outputs at minimum."""
    found = phases(cases / "copter_3.2.1_bench.log")
    assert found.of("airborne") == []
    assert found.of("hover") == []
    assert found.seconds("rest") == pytest.approx(14.6, abs=2.0)
    assert spans.seconds(spans.intersect(found.spans("idle"), [(3.0, 33.5)])) > 28


def test_a_slow_telemetry_imu_still_shows_rest(cases):
    """Disarmed and still from 30 to 440 s; at 1.2 Hz nothing can be replayed, but standing still can be seen."""
    found = phases(cases / "copter_3.5.7_radio.tlog")
    assert spans.seconds(spans.intersect(found.spans("rest"), [(30.0, 440.0)])) > 250
    assert spans.intersect(found.spans("rest"), found.spans("airborne")) == []


def test_a_board_on_the_bench_rests_throughout_and_one_turned_by_hand_never(cases):
    assert phases(cases / "px4_1.6.5_bench.ulg").seconds("rest") == pytest.approx(22.9, abs=1.0)
    assert phases(cases / "px4_1.6.5_hand_rotation.ulg").seconds("rest") == 0.0


def test_unknown_arming_is_not_zero_seconds_of_it(cases):
    log = attlog.read(cases / "copter_4.4dev_sitl_swarm.BIN")
    assert describe(log, segments.build(log))["seconds"]["armed"] is None


@pytest.mark.slow
def test_no_span_runs_through_a_pause_of_the_logger(cases):
    for path in (p for p in sorted(cases.iterdir()) if p.suffix.lower() in (".bin", ".log", ".ulg")):
        found = phases(path)
        pauses = [(s.t0 + 0.1, s.t1 - 0.1) for s in found.of("gap") if s.seconds > PAUSE_S]
        for kind in ("rest", "idle", "armed", "airborne", "hover", "cruise"):
            assert spans.intersect(found.spans(kind), pauses) == [], (path.name, kind)


# On simulated flights segments agree with what was flown, on real logs rest agrees with the flags.

FLIGHTS = corpus_logs(".ulg", ".bin") if corpus_root() else []
SIMULATED = [p for p in FLIGHTS if "sitl" in p.parts]


def readable(path: Path) -> attlog.FlightLog:
    """The log, or a skip where it holds no inertial data."""
    try:
        log = attlog.read(path)
    except AttlogError as error:
        pytest.skip(str(error))
    if log.imu is None:
        pytest.skip("no inertial data")
    return log


def bias_of(path: Path) -> np.ndarray:
    """Gyro offset in deg/s at rest before take-off, as the simulator's makers measured it."""
    with (path.parent.parent / "MANIFEST.csv").open(encoding="utf-8") as table:
        rows = [r for r in csv.DictReader(table) if r["file"].endswith("/" + path.name)]
    return np.array(rows[0]["checks.gyro_bias_dps"].split(), float)


@pytest.mark.slow
@pytest.mark.parametrize("path", SIMULATED, ids=lambda p: p.name)
def test_the_gyro_offset_over_the_rest_before_take_off_is_the_published_one(path):
    log = readable(path)
    found = segments.build(log)
    start = found.spans("armed")[0][0] if found.spans("armed") else np.inf
    before = [s for s in found.spans("rest") if s[1] <= start + 0.1]
    assert before, found.notes["rest"]
    gyro = log.imus[log.imu].gyro
    bias = np.degrees(np.median(gyro.x[spans.inside(gyro.t, before)], axis=0))
    np.testing.assert_allclose(bias, bias_of(path), atol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("path", SIMULATED, ids=lambda p: p.name)
def test_a_simulated_flight_rests_idles_flies_and_rests_again(path):
    found = segments.build(readable(path))
    air, armed, rest = found.spans("airborne"), found.spans("armed"), found.spans("rest")
    assert spans.seconds(air) > 10
    assert spans.seconds(spans.intersect(air, armed)) == pytest.approx(spans.seconds(air), abs=0.1)
    assert spans.intersect(rest, armed) == []
    assert spans.seconds(spans.intersect(found.spans("hover"), air)) == pytest.approx(
        spans.seconds(found.spans("hover"))
    )
    assert found.of("impact") == []
    first, last = found.of("continuous")[0].t0, found.of("continuous")[-1].t1
    ground = spans.complement(armed, first, last)
    assert spans.seconds(rest) > 0.9 * spans.seconds(ground) - 1.5


def true_height(path: Path, t0_us: int) -> tuple[np.ndarray, np.ndarray]:
    """Times in s and true height in m above the start, by the simulator."""
    messages = formats.open(path)
    for name, column, sign, clock in (
        ("SIM", "Alt", 1, "TimeUS"),
        ("vehicle_local_position_groundtruth", "z", -1, "timestamp"),
    ):
        table = messages.first(name)
        if table is not None and column in table:
            t, x = 1e-6 * (np.asarray(table[clock], np.float64) - t0_us), sign * table.value(column)
            return t, x - np.median(x[(t > 0) & (t < 5)])
    pytest.skip("no true height")


@pytest.mark.slow
@pytest.mark.parametrize("path", SIMULATED, ids=lambda p: p.name)
def test_a_simulated_flight_is_airborne_where_the_truth_is_and_never_rests_there(path):
    """Take-off within 2 s, touch-down within 4.5 s (PX4 waits before it says "landed")."""
    log = readable(path)
    t, x = true_height(path, log.t0_us)
    up = t[x > 0.1]
    found = segments.build(log)
    assert len(found.of("airborne")) == 1
    start, end = found.spans("airborne")[0]
    assert up[0] - 2.0 <= start <= up[0] + 0.5
    assert up[-1] - 0.5 <= end <= up[-1] + 4.5
    assert spans.intersect(found.spans("rest"), [(up[0], up[-1])]) == []
    assert found.of("loss_of_control") == []


@pytest.mark.slow
@pytest.mark.parametrize("path", FLIGHTS, ids=lambda p: p.name)
def test_rest_by_the_sensors_alone_is_hardly_ever_in_flight(path):
    """Without any flag the IMU alone finds no rest in flights; flags lag a second or two at take-off and landing.

    The simulated hover of a hardware-in-the-loop log has no vibration at all.
    """
    log = readable(path)
    air = segments.build(log).spans("airborne")
    log.state.armed = log.state.landed = log.power.throttle = log.power.rpm = None
    log.gnss = []
    alone = segments.build(log).spans("rest")
    allowed = 4.0 if log.simulated or "hitl" in path.name else 3.0
    assert spans.seconds(spans.intersect(alone, air)) <= allowed


@pytest.mark.slow
@pytest.mark.parametrize("path", SIMULATED, ids=lambda p: p.name)
def test_resets_are_found_without_the_counter_where_they_exceed_the_limit(path):
    log = readable(path)
    attitude, imu = log.attitudes[log.onboard], log.imus[log.imu]
    told = set(attitude.resets.tolist())
    unexplained = increments.unexplained_deg(attitude, imu)
    assert unexplained is not None
    attitude.resets = np.zeros(0, np.int64)
    found = set(increments.find_resets(attitude, imu)[0].tolist())
    assert {i for i in told if unexplained[0][i - 1] > 1.2} <= found
    in_air = [i for i in found - told if attitude.t[i] > 15]
    assert len(in_air) <= 1
