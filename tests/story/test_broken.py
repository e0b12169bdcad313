"""The story of flights in which a sensor tells nothing or nonsense: told, without an exception or a warning."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from attlog import segments, story
from attlog.flight.model import Clipping, FlightLog, Gnss, Stream
from tests.segments.test_in_air import carried

Fault = Callable[[Any], Any]


def whole() -> FlightLog:
    """A flight from 5 to 35 s of which everything is logged that the story looks at, with a blow at its end."""
    log = carried(0.05)
    log.imus[0].acc.x[3480:3483, 2] = -80.0
    t = np.arange(0.0, 40.0, 0.2)
    up = np.clip(np.minimum(t - 6.0, 34.5 - t), 0.0, 5.0)
    stream = lambda x, unit, source: Stream(t.copy(), np.asarray(x, float).reshape(len(t), -1), unit, "", source)  # noqa: E731
    log.baro = [stream(up, "m", "BARO")]
    log.rangefinder = stream(up + 0.1, "m", "RFND")
    log.rate_setpoints = stream(np.zeros((len(t), 3)), "rad/s", "RATE")
    log.motors = stream(np.tile((up > 0)[:, None] * 0.5, 4), "1", "RCOU")
    log.rpm = stream(np.tile((up > 0)[:, None] * 5000.0, 4), "rpm", "ESC")
    log.onboard_vibration = stream(np.full((len(t), 3), 5.0), "m/s^2", "VIBE")
    log.airspeed = stream(np.zeros(len(t)), "m/s", "ARSP")
    log.battery = stream(np.tile([12.0, 10.0], (len(t), 1)), "V, A", "BAT")
    n = len(t)
    flat = np.zeros(n)
    log.gnss = [
        Gnss(
            0,
            t.copy(),
            "GPS",
            flat + 47.0,
            flat + 8.0,
            up + 400.0,
            np.zeros((n, 3)),
            flat + 1,
            flat + 1,
            flat + 1,
            np.full(n, 3),
        )
    ]
    log.clippings = [Clipping("accelerometer", 0, "VIBE.Clip0", t.copy(), np.zeros(n, np.int64), True)]
    log.texts = [(20.0, 3, "Crash: Disarming"), (21.0, 3, "EKF3 lane switch 1"), (34.0, 6, "Land complete")]
    log.truth = log.attitudes["ATT"]
    return log


STREAMS = (
    "baro",
    "rangefinder",
    "rate_setpoints",
    "motors",
    "rpm",
    "onboard_vibration",
    "airspeed",
    "battery",
    "throttle",
    "gyro",
    "acc",
    "attitude",
    "gnss",
    "clippings",
)


def parts(log: FlightLog, name: str) -> Iterator[tuple[Any, tuple[str, ...]]]:
    """The objects of a quantity with the names of their arrays."""
    if name in ("gyro", "acc"):
        yield getattr(log.imus[0], name), ("x",)
    elif name == "attitude":
        yield log.attitudes["ATT"], ("q",)
    elif name == "gnss":
        yield log.gnss[0], ("alt", "vel_ned", "lat", "lon")
    elif name == "clippings":
        yield log.clippings[0], ()
    else:
        one = getattr(log, name)
        yield (one[0] if isinstance(one, list) else one), ("x",)


def values(of: float) -> Fault:
    """A fault; an attitude that is none is left out when a log is read, so it stays as it is where that is asked."""

    def fault(log: FlightLog, name: str) -> None:
        for thing, arrays in parts(log, name):
            for array in arrays if name != "attitude" or np.isnan(of) else ():
                getattr(thing, array)[:] = of

    return fault


def _half(log: FlightLog, name: str) -> None:
    for thing, arrays in parts(log, name):
        for array in arrays:
            getattr(thing, array)[len(thing.t) // 2 :] = np.nan


def _kept(log: FlightLog, name: str, count: int) -> None:
    """Only the first samples of a quantity; an IMU has as many of both its sensors."""
    names = ("gyro", "acc") if name in ("gyro", "acc") else (name,)
    for each in names:
        for thing, arrays in parts(log, each):
            more = ("new",) if name == "clippings" else ("h_acc", "v_acc", "s_acc", "fix") if name == "gnss" else ()
            for array in (*arrays, *more, "t"):
                setattr(thing, array, getattr(thing, array)[:count].copy())


FAULTS: dict[str, Any] = {
    "nothing but NaN": values(np.nan),
    "zero": values(0.0),
    "infinite": values(np.inf),
    "huge": values(1e30),
    "NaN from the middle on": _half,
    "empty": lambda log, name: _kept(log, name, 0),
    "one sample": lambda log, name: _kept(log, name, 1),
    "two samples": lambda log, name: _kept(log, name, 2),
    "gone": lambda log, name: None if name in ("gyro", "acc") else _gone(log, name),
}


def _gone(log: FlightLog, name: str) -> None:
    if name == "attitude":
        log.attitudes, log.onboard, log.truth = {}, None, None
    else:
        setattr(log, name, [] if isinstance(getattr(log, name), list) else None)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", STREAMS)
def test_a_flight_whose_sensor_fails_has_a_story(name: str, fault: str) -> None:
    """Warnings are errors here."""
    log = whole()
    FAULTS[fault](log, name)
    phases = segments.build(log)
    events = story.events(log, phases)
    said = story.headline(log, phases, events)
    assert 4 <= len(said.split()) <= 30
    assert "nan" not in said.lower().split()
    assert not any("part_failed" in p.code for p in log.problems)
    assert all(np.isfinite(e.t) and (e.t_end is None or np.isfinite(e.t_end)) for e in events)
    assert all(e.value is None or np.isfinite(e.value) for e in events)


def test_the_flight_with_everything_is_told_with_its_blow() -> None:
    log = whole()
    phases = segments.build(log)
    assert [e.kind for e in story.events(log, phases) if e.kind in ("liftoff", "hard_landing")] == [
        "liftoff",
        "hard_landing",
    ]
