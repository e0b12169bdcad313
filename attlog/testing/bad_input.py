"""Checks of what a filter survives: real logs hold gaps, jumps, dead and saturated sensors."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.base.errors import AttlogError
from attlog.estimators import Aids, Estimate, Measurements
from attlog.testing.motion import CONSUMER, Array, Motion, still, swing
from attlog.testing.subject import Subject, inclination_deg, require, require_attitudes, total_deg

EXACT = 1e-6
"""Agreement in deg of runs that differ in rounding only."""


def _counted(skipped: dict[str, int], reason: str, least: int = 1) -> None:
    require(skipped.get(reason, 0) >= least, f"{reason} should be counted at least {least} times: {skipped}")


def _run(s: Subject, t: Any, gyr: Any, acc: Any, mag: Any) -> Estimate:
    return s.on(t, gyr, acc, mag if s.uses_mag else None)


def _tilt_stays(s: Subject, q: Array, m: Motion, what: str) -> None:
    if s.uses_acc:
        worst = inclination_deg(q[-500:], m.q[-500:]).max()
        require(worst < 5.0, f"after {what} tilt is off by {worst:.1f} deg")


def refuses_without_magnetometer(s: Subject) -> None:
    """A filter that needs a magnetometer says so instead of running without."""
    m = still(2.0)
    try:
        s.on(m.t, m.gyr, m.acc)
    except AttlogError as error:
        require("mag" in str(error), f"the refusal does not name the magnetometer: {error}")
    else:
        require(False, "it needs a magnetometer and runs without")


def refuses_without_gnss(s: Subject) -> None:
    """A filter that needs GNSS velocity says so instead of running without; position alone is none."""
    m = still(2.0)
    place = Measurements(np.array([0.5]), np.array([[60.0, 10.0, 100.0]]))
    for aids in (None, Aids(position=place)):
        try:
            s.run(m, aids=aids)
        except AttlogError as error:
            require("gnss" in str(error), f"the refusal does not name GNSS: {error}")
        else:
            require(False, "it needs GNSS and runs without")


def survives_nan(s: Subject) -> None:
    """NaN in any sensor is left out and counted; nothing of it reaches the attitude."""
    m = swing(30.0, noise=CONSUMER)
    gyr, acc, mag = m.gyr.copy(), m.acc.copy(), m.mag.copy()
    gyr[300], gyr[1001, 1], acc[500:510], acc[777, 2], mag[600:700] = np.nan, np.nan, np.nan, np.nan, np.nan
    e = _run(s, m.t, gyr, acc, mag)
    require_attitudes(e)
    _counted(e.skipped, "nan", 2)
    _tilt_stays(s, e.q, m, "NaN")


def bridges_a_short_gap(s: Subject) -> None:
    """0.3 s without samples: one segment, the turn in between is not lost."""
    m = swing(30.0)
    kept = m.part(np.r_[0:1000, 1030:3000])
    e = s.run(kept)
    require_attitudes(e, kept.t)
    _counted(e.skipped, "gap_bridged")
    require(e.segment is not None and e.segment[-1] == 0, "a gap of 0.3 s is no restart")
    worst = inclination_deg(e.q[990:1100], kept.q[990:1100]).max()
    require(worst < 8.0, f"over a gap of 0.3 s tilt goes off by {worst:.1f} deg")


def restarts_after_a_long_gap(s: Subject) -> None:
    """After 5 s without samples a new segment begins, from the sensors."""
    m = swing(40.0)
    kept = m.part(np.r_[0:1000, 1500:4000])
    e = s.run(kept)
    require_attitudes(e, kept.t)
    _counted(e.skipped, "restart")
    require(e.segment is not None and e.segment[0] == 0 and e.segment[-1] == 1, "a gap of 5 s begins a new segment")
    _tilt_stays(s, e.q, kept, "a gap of 5 s")


def survives_a_time_jump(s: Subject) -> None:
    """A clock that jumps by eleven days costs no time and no attitude; its zero does not matter."""
    m = swing(20.0)
    t = m.t.copy()
    t[1000:] += 1e6
    e = _run(s, t, m.gyr, m.acc, m.mag)
    require_attitudes(e)
    _tilt_stays(s, e.q, m, "a jump of the clock")
    later = _run(s, m.t + 1e5, m.gyr, m.acc, m.mag)
    off = total_deg(later.q, s.run(m).q).max()
    require(off < 0.2, f"times that begin at 100,000 s change the attitude by {off:.2g} deg")


def drops_times_that_do_not_rise(s: Subject) -> None:
    """Doubled samples and one from the past are left out and counted; the rest is as if they were not there."""
    m = swing(10.0)
    order = np.r_[0:400, 399:700, 650, 700:1000]
    m2 = m.part(order)
    e = s.run(m2)
    _counted(e.skipped, "time_not_rising", 2)
    require_attitudes(e, m.t)
    off = total_deg(e.q, s.run(m).q).max()
    require(off < EXACT, f"samples that do not rise in time change the attitude by {off:.2g} deg")


def drops_impossible_values(s: Subject) -> None:
    """Rates and accelerations beyond any sensor (a stuck or damaged one, infinity) are left out and counted."""
    m = swing(30.0)
    gyr, acc = m.gyr.copy(), m.acc.copy()
    gyr[700], gyr[1200, 2] = 1e4, np.inf
    acc[900:905], acc[1500, 0] = 1e6, -np.inf
    e = _run(s, m.t, gyr, acc, m.mag)
    require_attitudes(e)
    _counted(e.skipped, "saturated", 6 if s.uses_acc else 1)
    _tilt_stays(s, e.q, m, "impossible values")


def survives_dead_sensors(s: Subject) -> None:
    """Sensors that read nothing but zero give finite attitudes and are counted."""
    m = swing(5.0)
    zero = np.zeros_like(m.gyr)
    for name, gyr, acc, mag in (
        ("accelerometer", m.gyr, zero, m.mag),
        ("magnetometer", m.gyr, m.acc, zero),
        ("gyro", zero, m.acc, m.mag),
        ("all sensors", zero, zero, zero),
    ):
        e = _run(s, m.t, gyr, acc, mag)
        require_attitudes(e, m.t)
        if name in ("accelerometer", "all sensors"):
            _counted(e.skipped, "zero_vector")


def takes_few_samples(s: Subject) -> None:
    """No sample gives no attitude, one gives one."""
    m = still(1.0)
    for n in (0, 1, 2):
        e = s.run(m.part(slice(0, n)))
        require(len(e.t) == n, f"{n} samples give {len(e.t)} attitudes")
        require_attitudes(e)


def takes_any_array(s: Subject) -> None:
    """float32, read-only, strided and Fortran-ordered arrays give what plain ones give."""
    m = swing(10.0)
    plain = s.run(m).q
    single = [x.astype(np.float32) for x in (m.gyr, m.acc, m.mag)]
    off = total_deg(_run(s, m.t, *single).q, plain).max()
    require(off < 0.2, f"float32 input changes the attitude by {off:.2g} deg")
    locked = [x.copy() for x in (m.t, m.gyr, m.acc, m.mag)]
    for x in locked:
        x.flags.writeable = False
    strided = [np.repeat(x, 2, axis=0)[::2] for x in (m.t, m.gyr, m.acc, m.mag)]
    fortran = [np.asfortranarray(x) for x in (m.t, m.gyr, m.acc, m.mag)]
    for kind, arrays in (("read-only", locked), ("strided", strided), ("Fortran-ordered", fortran)):
        require(np.array_equal(_run(s, *arrays).q, plain), f"{kind} arrays give another attitude")


def leaves_its_input_alone(s: Subject) -> None:
    """The arrays it is given are the same afterwards."""
    m = swing(5.0)
    given = [x.copy() for x in (m.t, m.gyr, m.acc, m.mag)]
    given[3][::7] = np.nan
    before = [x.copy() for x in given]
    _run(s, *given)
    for name, a, b in zip(("t", "gyr", "acc", "mag"), given, before, strict=True):
        require(np.array_equal(a, b, equal_nan=True), f"it changes its input {name}")


def repeats_itself(s: Subject) -> None:
    """The same samples give the same bits, however often."""
    m = swing(5.0, noise=CONSUMER)
    first, second = s.run(m), s.run(m)
    require(np.array_equal(first.q, second.q), "two runs on the same samples differ")
