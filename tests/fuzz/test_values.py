"""Whatever the columns of a log hold, what reaches the flight is finite where it must be, in order, and possible."""

from __future__ import annotations

import functools
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from attlog import flight, formats
from attlog.base.errors import AttlogError
from attlog.flight import physics
from attlog.flight.model import FlightLog, Stream
from attlog.formats.base import Messages
from tests.conftest import SAMPLES, few
from tests.fuzz.values import hostile

LOGS = ("px4_hover.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog")


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
            ("throttle", log.throttle, physics.THROTTLE),
            ("rpm", log.rpm, physics.RPM),
            ("rates", log.rate_setpoints, physics.RATE_SETPOINT),
            ("acc bias", log.acc_bias, physics.ACC_BIAS),
            ("gyro bias", log.onboard_gyro_bias, physics.GYRO_BIAS),
            ("vibration", log.onboard_vibration, physics.VIBRATION),
        )
        if s is not None
    ]
    found += [(n, s.x, q) for n, s, q in streams]
    if log.declination_param is not None:
        found.append(("declination", np.array(log.declination_param), physics.Quantity("", -180, 180, "deg", "")))
    if log.utc_offset is not None:
        found.append(("date", np.array(1e6 * log.utc_offset + log.t0_us), physics.UTC_US))
    return found


def streams(log: FlightLog) -> list[tuple[str, np.ndarray, float]]:
    """The times of everything, and how fast it may be."""
    some: list[Stream | None] = [log.airspeed, log.throttle, log.rpm, log.battery, log.rate_setpoints, *log.baro]
    found = [(s.source, s.t, physics.FUSED_HZ) for s in some if s is not None]
    found += [(i.gyro.source, i.gyro.t_best, physics.RAW_HZ) for i in log.imus]
    found += [(m.field.source, m.field.t, physics.FUSED_HZ) for m in log.mags]
    found += [(name, a.t, physics.FUSED_HZ) for name, a in log.attitudes.items()]
    return [*found, *((g.source, g.t, physics.AIDING_HZ) for g in log.gnss)]


@pytest.mark.slow
@pytest.mark.parametrize("name", few(LOGS, 1))
def test_only_what_is_possible_reaches_the_flight(name: str) -> None:
    told = 0
    for seed in range(60):
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


@pytest.mark.parametrize("name", LOGS)
def test_a_seed_gives_the_same_columns_again(name: str) -> None:
    for seed in range(3):
        one, two = hostile(opened(name), seed), hostile(opened(name), seed)
        assert list(one) == list(two)
        for key, table in one.items():
            for column in list(table.fields)[:3]:
                np.testing.assert_array_equal(table[column], two[key][column])
