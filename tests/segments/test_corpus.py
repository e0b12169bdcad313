"""On simulated flights segments agree with what was flown, on real logs rest agrees with the flags."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import formats, segments
from attlog.base.errors import AttlogError
from attlog.segments import resets, spans
from tests.conftest import corpus_logs, corpus_root

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
    log.armed = log.landed = log.throttle = log.rpm = None
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
    unexplained = resets.unexplained_deg(attitude, imu)
    assert unexplained is not None
    attitude.resets = np.zeros(0, np.int64)
    found = set(resets.find(attitude, imu)[0].tolist())
    assert {i for i in told if unexplained[0][i - 1] > 1.2} <= found
    in_air = [i for i in found - told if attitude.t[i] > 15]
    assert len(in_air) <= 1
