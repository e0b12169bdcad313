"""The checks of the estimator contract: motion and attitude, damaged samples, aids.

Real logs hold gaps, jumps, dead and saturated sensors; a filter must survive them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.estimators import Aids, Estimate, LogFacts, LogInfo, Measurements, Parameter, not_compiled
from attlog.estimators.interface import AIDS
from attlog.testing.motions import (
    CONSUMER_NOISE,
    FIELD_T,
    IN_PLACE,
    Array,
    CheckFailed,
    Motion,
    Noise,
    Subject,
    flight,
    heading_deg,
    motion,
    one_turn,
    require,
    require_attitudes,
    still,
    swing,
    tilt_deg,
    total_deg,
)

AXES = ("roll", "pitch", "yaw")
# Agreement in deg of runs that differ in rounding only.
MAX_ROUNDING_DEG = 1e-6
# Agreement in deg of whole-segment runs: libraries compute in single precision and correct one earth axis at a time.
MAX_LIBRARY_DEG, MAX_TURNED_DEG = 0.01, 0.5


def _rms(angle: Array) -> float:
    return float(np.sqrt(np.mean(angle**2)))


def _require_refusal(run: Callable[[], object], key: str, sensor: str) -> None:
    """Raise CheckFailed unless ``run`` refuses with a sentence that holds ``key``."""
    try:
        run()
    except AttlogError as error:
        require(key in str(error), f"the refusal does not name {sensor}: {error}")
    else:
        require(False, f"it needs {sensor} and runs without")


# Motion and attitude.


def gives_unit_quaternions(s: Subject) -> None:
    """Every sample of a noisy flight has a finite unit quaternion."""
    m = flight(20.0)
    require_attitudes(s.run(m), m.t)


def follows_a_turn(s: Subject, axis: int) -> None:
    """Follow a turn of 30 deg: sign and unit of the gyro."""
    m = one_turn(axis)
    euler = np.rad2deg(rotation.to_euler(s.run(m).q))
    seen = (rotation.wrap(np.deg2rad(euler[-1] - euler[250]))) * 180.0 / np.pi
    for i, name in enumerate(AXES):
        wanted = 30.0 if i == axis else 0.0
        require(abs(seen[i] - wanted) < 6.0, f"a turn of 30 deg in {AXES[axis]} gives {seen[i]:.1f} deg of {name}")


def corrects_an_offset(s: Subject, axis: int) -> None:
    """Improve a start attitude 20 deg off: sign of the correction."""
    m = still(40.0, yaw=0.7)
    for offset in (20.0, -20.0):
        turn = np.zeros(3)
        turn[axis] = np.deg2rad(offset)
        error = total_deg(s.run(m, q0=rotation.multiply(m.q[0], rotation.from_rotvec(turn))).q, m.q)
        require(error.max() < 24.0, f"an error of {offset:g} deg in {AXES[axis]} grows to {error.max():.1f} deg")
        require(error[-1] < 12.0, f"an error of {offset:g} deg in {AXES[axis]} is still {error[-1]:.1f} deg after 40 s")


def converges_from_170_deg(s: Subject) -> None:
    """From 170 deg off 3 deg are reached within 4 minutes.

    In tilt, and in heading with a magnetometer.
    """
    m = still(240.0, 50.0, yaw=0.7)
    turns = {"tilt": (np.deg2rad(170.0), 0.0, 0.0)} | (
        {"heading": (0.0, 0.0, np.deg2rad(170.0))} if s.corrects_heading else {}
    )
    for name, turn in turns.items():
        q = s.run(m, q0=rotation.multiply(m.q[0], rotation.from_rotvec(turn))).q
        left = (heading_deg if name == "heading" else tilt_deg)(q[-1:], m.q[-1:])[0]
        require(abs(left) < 3.0, f"170 deg off in {name} at the start, {left:.1f} deg are left after 240 s")


def finds_the_attitude_at_rest(s: Subject) -> None:
    """At rest tilt is found to 1 deg, heading to 3 deg.

    Tilted, with sensor noise.
    """
    m = still(30.0, roll=np.deg2rad(30.0), pitch=np.deg2rad(-40.0), yaw=-2.0, noise=CONSUMER_NOISE)
    q = s.run(m).q[-500:]
    tilt = _rms(tilt_deg(q, m.q[-500:]))
    require(tilt < 1.0, f"tilt is off by {tilt:.2f} deg at rest")
    if s.uses_mag:
        heading = _rms(heading_deg(q, m.q[-500:]))
        require(heading < 3.0, f"heading is off by {heading:.2f} deg at rest")


def starts_in_motion(s: Subject) -> None:
    """Reach errors below 5 deg a minute after a start in motion.

    The start is at 5 m/s^2 of acceleration in a swing.
    """

    def fading(t: Array) -> Array:
        return np.outer(np.exp(-t), (3.0, 4.0, 0.0))

    m = motion(lambda t: (0.6 * np.sin(t), 0.4 * np.sin(0.7 * t), np.sin(0.4 * t)), 90.0, acceleration=fading)
    q = s.run(m).q[-2000:]
    tilt = _rms(tilt_deg(q, m.q[-2000:]))
    require(tilt < 5.0, f"tilt is off by {tilt:.1f} deg a minute after a start in motion")
    if s.uses_mag:
        heading = _rms(heading_deg(q, m.q[-2000:]))
        require(heading < 5.0, f"heading is off by {heading:.1f} deg a minute after a start in motion")


def works_at_every_heading(s: Subject) -> None:
    """Heading and tilt are as good to the north, east, south and west."""
    for yaw in (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi):
        m = swing(40.0, yaw=yaw)
        worst = total_deg(s.run(m).q[-500:], m.q[-500:]).max()
        require(worst < 4.0, f"around heading {np.rad2deg(yaw):g} deg the error is {worst:.1f} deg")


def turns_with_the_earth(s: Subject) -> None:
    """Yaw equivariance: a declination turns the result by its angle.

    So does a start turned about the vertical.
    """
    m, angle = flight(20.0), np.deg2rad(40.0)
    if s.uses_mag:
        limit = MAX_ROUNDING_DEG if s.steps else MAX_TURNED_DEG
        _require_turned(s.run(m).q, s.run(m, declination=40.0).q, angle, "a declination of 40 deg", limit)
    if s.steps and "mag" not in s.estimator.needs:
        plain = s.on(m.t, m.gyr, m.acc, q0=m.q[0]).q
        turned = s.on(m.t, m.gyr, m.acc, q0=rotation.turn_about_down(m.q[0], angle)).q
        _require_turned(plain, turned, angle, "a start heading that is 40 deg larger")


def _require_turned(plain: Array, turned: Array, angle: float, what: str, limit: float = MAX_ROUNDING_DEG) -> None:
    off = total_deg(turned, rotation.turn_about_down(plain, angle)).max()
    require(off < limit, f"{what} does not turn the result by 40 deg, it is {off:.2g} deg away")


def takes_the_field_in_any_unit(s: Subject) -> None:
    """Only the direction of the field counts, in tesla, gauss or microtesla."""
    m = flight(20.0)
    plain = s.run(m).q
    for unit, factor in (("gauss", 1e4), ("microtesla", 1e6)):
        off = total_deg(s.on(m.t, m.gyr, m.acc, factor * m.mag).q, plain).max()
        require(
            off < (MAX_ROUNDING_DEG if s.steps else MAX_LIBRARY_DEG),
            f"the field in {unit} changes the attitude by {off:.2g} deg",
        )


def finds_the_gyro_bias(s: Subject) -> None:
    """Approach the true bias, in rad/s, without overshoot."""
    true = (0.01, -0.006, 0.004 if s.uses_mag else 0.0)
    m = still(200.0, 50.0, noise=Noise(bias=true))
    bias = s.run(m).bias
    if bias is None or not np.isfinite(bias).all():
        raise CheckFailed("the reported bias is not finite")
    for i, (seen, wanted) in enumerate(zip(bias[-1], true, strict=True)):
        low, high = sorted((-0.1 * wanted, 1.5 * wanted))
        require(low - 1e-6 <= seen <= high + 1e-6, f"{AXES[i]} bias {seen:.4f} rad/s for a true one of {wanted:.4f}")


def works_without_magnetometer(s: Subject) -> None:
    """Tilt without magnetometer is as good."""
    m = swing(30.0, noise=CONSUMER_NOISE)
    e = s.on(m.t, m.gyr, m.acc)
    require_attitudes(e, m.t)
    if s.uses_acc:
        tilt = _rms(tilt_deg(e.q[-1000:], m.q[-1000:]))
        require(tilt < 3.0, f"without magnetometer tilt is off by {tilt:.1f} deg")


def works_with_a_slow_magnetometer(s: Subject) -> None:
    """Heading from a slow magnetometer is as good within 3 deg.

    With a field sample every half second and a gyro bias.
    """
    m = swing(60.0, noise=Noise(bias=(0.0, 0.0, 0.01)))
    slow = np.full_like(m.mag, np.nan)
    slow[::50] = m.mag[::50]
    full = _rms(heading_deg(s.run(m).q[2000:], m.q[2000:]))
    e = s.on(m.t, m.gyr, m.acc, slow)
    thin = _rms(heading_deg(e.q[2000:], m.q[2000:]))
    require(thin < full + 3.0, f"heading RMSE is {thin:.1f} deg at 2 Hz and {full:.1f} deg with every sample")


def does_not_depend_on_the_sampling_rate(s: Subject) -> None:
    """Tilt at 50 and 400 Hz differs by less than 2 deg.

    While an offset of 15 deg decays.
    """
    slow, fast = swing(10.0, 50.0), swing(10.0, 400.0)
    q0 = rotation.multiply(slow.q[0], rotation.from_rotvec((0.2, 0.15, 0.0)))
    a = s.run(slow, q0=q0).q
    b = s.run(fast, q0=q0).q[::8]
    n = min(len(a), len(b))
    off = np.abs(tilt_deg(a[25:n], slow.q[25:n]) - tilt_deg(b[25:n], slow.q[25:n])).max()
    require(off < 2.0, f"sampled at 50 and at 400 Hz tilt differs by {off:.1f} deg")


def looks_back_only(s: Subject) -> None:
    """Later samples do not change earlier attitudes."""
    m = flight(20.0)
    later = m.part(slice(None))
    half = len(m.t) // 2
    gyr, acc, mag = (np.concatenate([x[:half], -x[half:]]) for x in (later.gyr, later.acc, later.mag))
    a = s.run(m).q[:half]
    b = s.on(m.t, gyr, acc, mag if s.uses_mag else None).q[:half]
    require(np.array_equal(a, b), f"later samples change earlier attitudes by up to {total_deg(a, b).max():.2g} deg")


def keeps_its_norm(s: Subject) -> None:
    """After 200,000 steps norm and attitude are still right.

    20,000 steps in plain Python.
    """
    steps = 20_000 if not_compiled(s.estimator) else 200_000
    m = swing(steps / 200.0, 200.0)
    e = s.run(m)
    require_attitudes(e, m.t)
    off = np.abs(np.sum(e.q**2, axis=1) - 1.0).max()
    require(off < 1e-9, f"the quaternion's length drifts by {off:.2g}")
    worst = tilt_deg(e.q[-2000:], m.q[-2000:]).max()
    require(worst < 3.0, f"after {steps} steps tilt is off by {worst:.1f} deg")


def uses_every_parameter(s: Subject) -> None:
    """Every declared parameter changes the result in some setting.

    Settings are tried in lively motion and at rest; a filter with aids runs with and without them.
    """
    lively = motion(
        lambda t: (0.8 * np.sin(1.5 * t), 0.6 * np.sin(1.1 * t), 2.0 * np.sin(0.5 * t)),
        12.0,
        acceleration=lambda t: np.stack([6.0 * np.sin(2.0 * t), 5.0 * np.cos(1.7 * t), 3.0 * np.sin(t)], axis=-1),
        noise=Noise(gyro=1e-3, acc=0.05, mag=0.05 * FIELD_T[2], bias=(0.02, -0.01, 0.01)),
    )
    aided = bool(s.estimator.uses & AIDS)
    unused = {p.name: p for p in s.estimator.own}
    for m in (lively, still(12.0, noise=Noise(mag=0.05 * FIELD_T[2], bias=(0.02, -0.01, 0.01)))):
        _try_parameters(s, m, unused, {})
        if aided:
            _try_parameters(s, m, unused, {"aids": aids_in_place(m)})
    if aided and unused:
        m = swing(60.0, noise=CONSUMER_NOISE)
        _try_parameters(s, m, unused, {"aids": aids_in_place(m)})
    require(not unused, f"changing {', '.join(sorted(unused))} never changes the result")


def _try_parameters(s: Subject, m: Motion, unused: dict[str, Parameter], given: dict[str, Any]) -> None:
    """Remove from ``unused`` the parameters that change this motion's result.

    Attitudes or their sigmas.
    """
    q0 = rotation.multiply(m.q[0], rotation.from_rotvec((0.9, -0.6, 1.2)))
    start = given | ({"q0": q0} if s.steps else {})
    settings: list[dict[str, float | str]] = [{}, *(dict(p) for p in s.estimator.presets.values())]
    settings += [{p.name: c} for p in s.estimator.own for c in p.choices]
    for base in settings:
        if not unused:
            break
        plain = s.run(m, **start, **base)
        plain_cold = s.run(m, **given, **base)
        for name, parameter in list(unused.items()):
            values = parameter.choices or (parameter.low, parameter.high, _inner_value(parameter))
            for value in values:
                option = {**base, name: value}
                if _differs(s.run(m, **start, **option), plain) or _differs(s.run(m, **given, **option), plain_cold):
                    del unused[name]
                    break


def _differs(a: Estimate, b: Estimate) -> bool:
    """Return whether attitudes or their own sigmas differ."""
    sigmas = [name for name in a.aux if name.startswith("sigma_")]
    return not np.array_equal(a.q, b.q) or any(n not in b.aux or not np.array_equal(a.aux[n], b.aux[n]) for n in sigmas)


def _inner_value(parameter: object) -> float:
    """Return a value inside the range that is not the default."""
    default, low, high = (float(getattr(parameter, n)) for n in ("default", "low", "high"))
    return min(max(2.0 * default if default else 0.1 * high, low), high)


# Damaged samples.


def _require_counted(skipped: dict[str, int], reason: str, least: int = 1) -> None:
    require(skipped.get(reason, 0) >= least, f"{reason} should be counted at least {least} times: {skipped}")


def _run_arrays(s: Subject, t: Any, gyr: Any, acc: Any, mag: Any) -> Estimate:
    return s.on(t, gyr, acc, mag if s.uses_mag else None)


def _require_tilt(s: Subject, q: Array, m: Motion, what: str) -> None:
    if s.uses_acc:
        worst = tilt_deg(q[-500:], m.q[-500:]).max()
        require(worst < 5.0, f"after {what} tilt is off by {worst:.1f} deg")


def refuses_without_magnetometer(s: Subject) -> None:
    """Refuse to run without a magnetometer where it is needed."""
    m = still(2.0)
    _require_refusal(lambda: s.on(m.t, m.gyr, m.acc), "mag", "a magnetometer")


def refuses_without_gnss(s: Subject) -> None:
    """Refuse to run without GNSS velocity where it is needed.

    Position alone does not suffice.
    """
    m = still(2.0)
    place = Aids(position=Measurements(np.array([0.5]), np.array([[60.0, 10.0, 100.0]])))
    for aids in (None, place):
        _require_refusal(partial(s.run, m, aids=aids), "gnss", "GNSS")


def survives_nan(s: Subject) -> None:
    """NaN in any sensor is left out, counted, without effect."""
    m = swing(30.0, noise=CONSUMER_NOISE)
    gyr, acc, mag = m.gyr.copy(), m.acc.copy(), m.mag.copy()
    gyr[300], gyr[1001, 1], acc[500:510], acc[777, 2], mag[600:700] = np.nan, np.nan, np.nan, np.nan, np.nan
    e = _run_arrays(s, m.t, gyr, acc, mag)
    require_attitudes(e)
    _require_counted(e.skipped, "nan", 2)
    _require_tilt(s, e.q, m, "NaN")


def bridges_a_short_gap(s: Subject) -> None:
    """0.3 s without samples stay one segment with its rotation."""
    m = swing(30.0)
    kept = m.part(np.r_[0:1000, 1030:3000])
    e = s.run(kept)
    require_attitudes(e, kept.t)
    _require_counted(e.skipped, "gap_bridged")
    require(e.segment is not None and e.segment[-1] == 0, "a gap of 0.3 s is no restart")
    worst = tilt_deg(e.q[990:1100], kept.q[990:1100]).max()
    require(worst < 8.0, f"over a gap of 0.3 s tilt goes off by {worst:.1f} deg")


def restarts_after_a_long_gap(s: Subject) -> None:
    """After 5 s without samples a new segment begins, from the sensors."""
    m = swing(40.0)
    kept = m.part(np.r_[0:1000, 1500:4000])
    e = s.run(kept)
    require_attitudes(e, kept.t)
    _require_counted(e.skipped, "restart")
    require(e.segment is not None and e.segment[0] == 0 and e.segment[-1] == 1, "a gap of 5 s begins a new segment")
    _require_tilt(s, e.q, kept, "a gap of 5 s")


def survives_a_time_jump(s: Subject) -> None:
    """Lose no attitude to a clock that jumps by eleven days.

    Nor does its zero matter.
    """
    m = swing(20.0)
    t = m.t.copy()
    t[1000:] += 1e6
    e = _run_arrays(s, t, m.gyr, m.acc, m.mag)
    require_attitudes(e)
    _require_tilt(s, e.q, m, "a jump of the clock")
    later = _run_arrays(s, m.t + 1e5, m.gyr, m.acc, m.mag)
    off = total_deg(later.q, s.run(m).q).max()
    require(off < 0.2, f"times that begin at 100,000 s change the attitude by {off:.2g} deg")


def drops_times_that_do_not_rise(s: Subject) -> None:
    """Repeated and past samples are left out, counted, without effect."""
    m = swing(10.0)
    order = np.r_[0:400, 399:700, 650, 700:1000]
    m2 = m.part(order)
    e = s.run(m2)
    _require_counted(e.skipped, "time_not_rising", 2)
    require_attitudes(e, m.t)
    off = total_deg(e.q, s.run(m).q).max()
    require(off < MAX_ROUNDING_DEG, f"samples that do not rise in time change the attitude by {off:.2g} deg")


def drops_impossible_values(s: Subject) -> None:
    """Rates and accelerations beyond any sensor, and infinity, are left out and counted."""
    m = swing(30.0)
    gyr, acc = m.gyr.copy(), m.acc.copy()
    gyr[700], gyr[1200, 2] = 1e4, np.inf
    acc[900:905], acc[1500, 0] = 1e6, -np.inf
    e = _run_arrays(s, m.t, gyr, acc, m.mag)
    require_attitudes(e)
    _require_counted(e.skipped, "saturated", 6 if s.uses_acc else 1)
    _require_tilt(s, e.q, m, "impossible values")


def survives_dead_sensors(s: Subject) -> None:
    """Sensors that read zero give finite attitudes and are counted."""
    m = swing(5.0)
    zero = np.zeros_like(m.gyr)
    for name, gyr, acc, mag in (
        ("accelerometer", m.gyr, zero, m.mag),
        ("magnetometer", m.gyr, m.acc, zero),
        ("gyro", zero, m.acc, m.mag),
        ("all sensors", zero, zero, zero),
    ):
        e = _run_arrays(s, m.t, gyr, acc, mag)
        require_attitudes(e, m.t)
        if name in ("accelerometer", "all sensors"):
            _require_counted(e.skipped, "zero_vector")


def takes_few_samples(s: Subject) -> None:
    """No sample gives no attitude, one gives one."""
    m = still(1.0)
    for n in (0, 1, 2):
        e = s.run(m.part(slice(0, n)))
        require(len(e.t) == n, f"{n} samples give {len(e.t)} attitudes")
        require_attitudes(e)


def takes_any_array(s: Subject) -> None:
    """float32, read-only, strided and Fortran-ordered arrays give the result of plain ones."""
    m = swing(10.0)
    plain = s.run(m).q
    single = [x.astype(np.float32) for x in (m.gyr, m.acc, m.mag)]
    off = total_deg(_run_arrays(s, m.t, *single).q, plain).max()
    require(off < 0.2, f"float32 input changes the attitude by {off:.2g} deg")
    locked = [x.copy() for x in (m.t, m.gyr, m.acc, m.mag)]
    for x in locked:
        x.flags.writeable = False
    strided = [np.repeat(x, 2, axis=0)[::2] for x in (m.t, m.gyr, m.acc, m.mag)]
    fortran = [np.asfortranarray(x) for x in (m.t, m.gyr, m.acc, m.mag)]
    for kind, arrays in (("read-only", locked), ("strided", strided), ("Fortran-ordered", fortran)):
        require(np.array_equal(_run_arrays(s, *arrays).q, plain), f"{kind} arrays give another attitude")


def leaves_its_input_alone(s: Subject) -> None:
    """Input arrays are not modified."""
    m = swing(5.0)
    given = [x.copy() for x in (m.t, m.gyr, m.acc, m.mag)]
    given[3][::7] = np.nan
    before = [x.copy() for x in given]
    _run_arrays(s, *given)
    for name, a, b in zip(("t", "gyr", "acc", "mag"), given, before, strict=True):
        require(np.array_equal(a, b, equal_nan=True), f"it changes its input {name}")


def repeats_itself(s: Subject) -> None:
    """Give the same bits for the same samples."""
    m = swing(5.0, noise=CONSUMER_NOISE)
    first, second = s.run(m), s.run(m)
    require(np.array_equal(first.q, second.q), "two runs on the same samples differ")


# Aids, and parameters from a log.

# Known of a log: nothing, no rest, everything.
LOG_INFOS = (
    LogInfo(),
    LogInfo(declination_deg=-12.5, imu_rate_hz=200.0, mag_rate_hz=10.0),
    LogInfo(3.0, 1000.0, 80.0, gyro_noise=1e-4, acc_noise=2e-3, rest_s=30.0),
)


def aids_in_place(m: Motion, seed: int = 0) -> Aids:
    """Return noisy aids of a motion that turns in place.

    Each sensor has its own rate.
    """
    random = np.random.default_rng(seed)

    def clock(rate: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.arange(m.t[0] + 0.003, m.t[-1], 1.0 / rate)

    fixes, heights, speeds = clock(5.0), clock(20.0), clock(10.0)
    place = np.array([60.0, 10.0, 100.0]) + random.standard_normal((len(fixes), 3)) * [1e-5, 2e-5, 2.0]
    return Aids(
        position=Measurements(fixes, place, np.tile([1.0, 2.0], (len(fixes), 1))),
        velocity=Measurements(fixes, 0.1 * random.standard_normal((len(fixes), 3)), np.full(len(fixes), 0.1)),
        baro=Measurements(heights, 100.0 + 0.2 * random.standard_normal(len(heights))),
        airspeed=Measurements(speeds, np.abs(0.3 * random.standard_normal(len(speeds)))),
        at_rest=np.empty((0, 2)),
    )


def works_with_aids(s: Subject) -> None:
    """GNSS, barometer and airspeed of a vehicle in place do not worsen tilt."""
    m = swing(60.0, noise=CONSUMER_NOISE)
    plain, aided = s.run(m), s.run(m, aids=aids_in_place(m))
    require_attitudes(aided, m.t)
    if s.uses_acc:
        off = [_rms(tilt_deg(e.q[-2000:], m.q[-2000:])) for e in (plain, aided)]
        require(off[1] < off[0] + 1.0, f"with aids tilt is off by {off[1]:.1f} deg, without by {off[0]:.1f} deg")


def survives_few_aids(s: Subject) -> None:
    """Attitudes are finite with single, ending or absent aids."""
    m = swing(20.0)
    full = aids_in_place(m)
    cases: dict[str, Aids] = {f"{n} alone": Aids(**{n: getattr(full, n)}) for n in ("position", "velocity", "baro")}
    cases |= {"airspeed alone": Aids(airspeed=full.airspeed), "rest alone": Aids(at_rest=np.array([[2.0, 4.0]]))}
    cases |= {"aids that end": full.between(0.0, 5.0), "aids of another time": full.between(-2.0, -1.0)}
    for what, aids in cases.items():
        if s.needs_gnss and aids.velocity is None:
            aids = replace(aids, velocity=IN_PLACE.velocity)
        e: Estimate = s.run(m, aids=aids)
        require_attitudes(e, m.t)
        worst = tilt_deg(e.q[-500:], m.q[-500:]).max() if s.uses_acc else 0.0
        require(worst < 5.0, f"with {what} tilt is off by {worst:.1f} deg")


def takes_aids_when_they_come(s: Subject) -> None:
    """Later aids do not change earlier attitudes."""
    m = swing(20.0)
    aids = aids_in_place(m)
    half = len(m.t) // 2
    q = [s.run(m, aids=a).q[:half] for a in (aids, aids.between(0.0, float(m.t[half])))]
    require(np.array_equal(q[0], q[1]), "later aids change earlier attitudes")


def takes_parameters_from_a_log(s: Subject) -> None:
    """``from_log`` returns known parameters within their ranges for any log and repeats itself."""
    names = {p.name for p in s.estimator.parameters}
    known: dict[str, float] = {}
    for info in LOG_INFOS:
        try:
            first = s.estimator.values_of(LogFacts(MappingProxyType(known), info), names)
            second = s.estimator.values_of(LogFacts(MappingProxyType(known), info), names)
        except AttlogError as error:
            require(False, f"from_log fails on a log without parameters, of which is known {info}: {error}")
            return
        require(first == second, f"from_log says {first} and then {second} of the same log")
