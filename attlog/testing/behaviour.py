"""Checks of what a filter does: it follows motion, finds the attitude, and needs no luck for it."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.base import rotation
from attlog.estimators import Estimate, Parameter, not_compiled
from attlog.estimators.base import AIDS
from attlog.testing.extras import aids_in_place
from attlog.testing.motion import CONSUMER, FIELD_T, Array, Motion, Noise, flight, motion, one_turn, still, swing
from attlog.testing.subject import (
    CheckFailed,
    Subject,
    heading_deg,
    inclination_deg,
    require,
    require_attitudes,
    total_deg,
)

AXES = ("roll", "pitch", "yaw")
EXACT = 1e-6
"""Agreement in deg of runs that differ in rounding only."""
EXACT_RUN, TURNED_RUN = 0.01, 0.5
"""The same of whole runs: libraries compute in single precision, and correct along one earth axis after the other."""


def gives_unit_quaternions(s: Subject) -> None:
    """Finite unit quaternions at every sample of a noisy flight."""
    m = flight(20.0)
    require_attitudes(s.run(m), m.t)


def follows_a_turn(s: Subject, axis: int) -> None:
    """A turn by +30 deg about one axis is seen as +30 deg about that axis: sign and unit of the gyro."""
    m = one_turn(axis)
    euler = np.rad2deg(rotation.to_euler(s.run(m).q))
    seen = (rotation.wrap(np.deg2rad(euler[-1] - euler[250]))) * 180.0 / np.pi
    for i, name in enumerate(AXES):
        wanted = 30.0 if i == axis else 0.0
        require(abs(seen[i] - wanted) < 6.0, f"a turn of 30 deg in {AXES[axis]} gives {seen[i]:.1f} deg of {name}")


def corrects_an_offset(s: Subject, axis: int) -> None:
    """A start attitude that is 20 deg off about one axis gets better, on both sides: sign of the correction."""
    m = still(40.0, yaw=0.7)
    for offset in (20.0, -20.0):
        turn = np.zeros(3)
        turn[axis] = np.deg2rad(offset)
        error = total_deg(s.run(m, q0=rotation.multiply(m.q[0], rotation.from_rotvec(turn))).q, m.q)
        require(error.max() < 24.0, f"an error of {offset:g} deg in {AXES[axis]} grows to {error.max():.1f} deg")
        require(error[-1] < 12.0, f"an error of {offset:g} deg in {AXES[axis]} is still {error[-1]:.1f} deg after 40 s")


def converges_from_170_deg(s: Subject) -> None:
    """From 170 deg off in tilt (and in heading with a magnetometer) it comes back to 3 deg within 4 minutes."""
    m = still(240.0, 50.0, yaw=0.7)
    turns = {"tilt": (np.deg2rad(170.0), 0.0, 0.0)} | (
        {"heading": (0.0, 0.0, np.deg2rad(170.0))} if s.corrects_heading else {}
    )
    for name, turn in turns.items():
        q = s.run(m, q0=rotation.multiply(m.q[0], rotation.from_rotvec(turn))).q
        left = (heading_deg if name == "heading" else inclination_deg)(q[-1:], m.q[-1:])[0]
        require(abs(left) < 3.0, f"170 deg off in {name} at the start, {left:.1f} deg are left after 240 s")


def finds_the_attitude_at_rest(s: Subject) -> None:
    """Tilted at rest with sensor noise, tilt is found to 1 deg and heading to 3 deg."""
    m = still(30.0, roll=np.deg2rad(30.0), pitch=np.deg2rad(-40.0), yaw=-2.0, noise=CONSUMER)
    q = s.run(m).q[-500:]
    tilt = np.sqrt(np.mean(inclination_deg(q, m.q[-500:]) ** 2))
    require(tilt < 1.0, f"tilt is off by {tilt:.2f} deg at rest")
    if s.uses_mag:
        heading = np.sqrt(np.mean(heading_deg(q, m.q[-500:]) ** 2))
        require(heading < 3.0, f"heading is off by {heading:.2f} deg at rest")


def starts_in_motion(s: Subject) -> None:
    """Switched on in a swing, at 5 m/s^2 of acceleration, it is right within 5 deg a minute later."""

    def fading(t: Array) -> Array:
        return np.outer(np.exp(-t), (3.0, 4.0, 0.0))

    m = motion(lambda t: (0.6 * np.sin(t), 0.4 * np.sin(0.7 * t), np.sin(0.4 * t)), 90.0, acceleration=fading)
    q = s.run(m).q[-2000:]
    tilt = np.sqrt(np.mean(inclination_deg(q, m.q[-2000:]) ** 2))
    require(tilt < 5.0, f"tilt is off by {tilt:.1f} deg a minute after a start in motion")
    if s.uses_mag:
        heading = np.sqrt(np.mean(heading_deg(q, m.q[-2000:]) ** 2))
        require(heading < 5.0, f"heading is off by {heading:.1f} deg a minute after a start in motion")


def works_at_every_heading(s: Subject) -> None:
    """North, east, south or west: heading and tilt are as good."""
    for yaw in (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi):
        m = swing(40.0, yaw=yaw)
        worst = total_deg(s.run(m).q[-500:], m.q[-500:]).max()
        require(worst < 4.0, f"around heading {np.rad2deg(yaw):g} deg the error is {worst:.1f} deg")


def turns_with_the_earth(s: Subject) -> None:
    """Yaw equivariance: a declination or a start turned about the vertical turns the result by just that."""
    m, angle = flight(20.0), np.deg2rad(40.0)
    if s.uses_mag:
        limit = EXACT if s.steps else TURNED_RUN
        _require_turned(s.run(m).q, s.run(m, declination=40.0).q, angle, "a declination of 40 deg", limit)
    if s.steps and "mag" not in s.estimator.needs:
        plain = s.on(m.t, m.gyr, m.acc, q0=m.q[0]).q
        turned = s.on(m.t, m.gyr, m.acc, q0=rotation.turn_about_down(m.q[0], angle)).q
        _require_turned(plain, turned, angle, "a start heading that is 40 deg larger")


def _require_turned(plain: Array, turned: Array, angle: float, what: str, limit: float = EXACT) -> None:
    off = total_deg(turned, rotation.turn_about_down(plain, angle)).max()
    require(off < limit, f"{what} does not turn the result by 40 deg, it is {off:.2g} deg away")


def takes_the_field_in_any_unit(s: Subject) -> None:
    """Tesla, gauss or microtesla: only the direction of the field counts."""
    m = flight(20.0)
    plain = s.run(m).q
    for unit, factor in (("gauss", 1e4), ("microtesla", 1e6)):
        off = total_deg(s.on(m.t, m.gyr, m.acc, factor * m.mag).q, plain).max()
        require(off < (EXACT if s.steps else EXACT_RUN), f"the field in {unit} changes the attitude by {off:.2g} deg")


def finds_the_gyro_bias(s: Subject) -> None:
    """A bias that is reported goes the way of the true one, in rad/s, and not beyond."""
    true = (0.01, -0.006, 0.004 if s.uses_mag else 0.0)
    m = still(200.0, 50.0, noise=Noise(bias=true))
    bias = s.run(m).bias
    if bias is None or not np.isfinite(bias).all():
        raise CheckFailed("the reported bias is not finite")
    for i, (seen, wanted) in enumerate(zip(bias[-1], true, strict=True)):
        low, high = sorted((-0.1 * wanted, 1.5 * wanted))
        require(low - 1e-6 <= seen <= high + 1e-6, f"{AXES[i]} bias {seen:.4f} rad/s for a true one of {wanted:.4f}")


def works_without_magnetometer(s: Subject) -> None:
    """Without magnetometer tilt is as good; a filter that needs one refuses with a sentence."""
    m = swing(30.0, noise=CONSUMER)
    e = s.on(m.t, m.gyr, m.acc)
    require_attitudes(e, m.t)
    if s.uses_acc:
        tilt = np.sqrt(np.mean(inclination_deg(e.q[-1000:], m.q[-1000:]) ** 2))
        require(tilt < 3.0, f"without magnetometer tilt is off by {tilt:.1f} deg")


def works_with_a_slow_magnetometer(s: Subject) -> None:
    """With a field sample every half second heading is within 3 deg of what every sample gives, gyro bias or not."""
    m = swing(60.0, noise=Noise(bias=(0.0, 0.0, 0.01)))
    slow = np.full_like(m.mag, np.nan)
    slow[::50] = m.mag[::50]
    full = np.sqrt(np.mean(heading_deg(s.run(m).q[2000:], m.q[2000:]) ** 2))
    e = s.on(m.t, m.gyr, m.acc, slow)
    thin = np.sqrt(np.mean(heading_deg(e.q[2000:], m.q[2000:]) ** 2))
    require(thin < full + 3.0, f"heading RMSE is {thin:.1f} deg at 2 Hz and {full:.1f} deg with every sample")


def does_not_depend_on_the_sampling_rate(s: Subject) -> None:
    """The same motion sampled at 50 and 400 Hz: tilt differs by less than 2 deg while an offset of 15 deg fades."""
    slow, fast = swing(10.0, 50.0), swing(10.0, 400.0)
    q0 = rotation.multiply(slow.q[0], rotation.from_rotvec((0.2, 0.15, 0.0)))
    a = s.run(slow, q0=q0).q
    b = s.run(fast, q0=q0).q[::8]
    n = min(len(a), len(b))
    off = np.abs(inclination_deg(a[25:n], slow.q[25:n]) - inclination_deg(b[25:n], slow.q[25:n])).max()
    require(off < 2.0, f"sampled at 50 and at 400 Hz tilt differs by {off:.1f} deg")


def looks_back_only(s: Subject) -> None:
    """What comes later does not change what was said before."""
    m = flight(20.0)
    later = m.part(slice(None))
    half = len(m.t) // 2
    gyr, acc, mag = (np.concatenate([x[:half], -x[half:]]) for x in (later.gyr, later.acc, later.mag))
    a = s.run(m).q[:half]
    b = s.on(m.t, gyr, acc, mag if s.uses_mag else None).q[:half]
    require(np.array_equal(a, b), f"later samples change earlier attitudes by up to {total_deg(a, b).max():.2g} deg")


def keeps_its_norm(s: Subject) -> None:
    """After 200,000 steps the quaternion is of unit length to rounding and the attitude still right.

    20,000 of a step that runs in plain Python.
    """
    steps = 20_000 if not_compiled(s.estimator) else 200_000
    m = swing(steps / 200.0, 200.0)
    e = s.run(m)
    require_attitudes(e, m.t)
    off = np.abs(np.sum(e.q**2, axis=1) - 1.0).max()
    require(off < 1e-9, f"the quaternion's length drifts by {off:.2g}")
    worst = inclination_deg(e.q[-2000:], m.q[-2000:]).max()
    require(worst < 3.0, f"after {steps} steps tilt is off by {worst:.1f} deg")


def uses_every_parameter(s: Subject) -> None:
    """Every declared parameter changes the result in some setting, else it is a setting that sets nothing.

    Tried in lively motion, and at rest; a filter that takes aids runs with and without.
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
        m = swing(60.0, noise=CONSUMER)
        _try_parameters(s, m, unused, {"aids": aids_in_place(m)})
    require(not unused, f"changing {', '.join(sorted(unused))} never changes the result")


def _try_parameters(s: Subject, m: Motion, unused: dict[str, Parameter], given: dict[str, Any]) -> None:
    """Take out of ``unused`` every parameter that changes the attitudes of this motion, or their sigmas."""
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
            values = parameter.choices or (parameter.low, parameter.high, _near(parameter))
            for value in values:
                option = {**base, name: value}
                if _differs(s.run(m, **start, **option), plain) or _differs(s.run(m, **given, **option), plain_cold):
                    del unused[name]
                    break


def _differs(a: Estimate, b: Estimate) -> bool:
    """Whether attitudes or their own sigmas are others."""
    sigmas = [name for name in a.aux if name.startswith("sigma_")]
    return not np.array_equal(a.q, b.q) or any(n not in b.aux or not np.array_equal(a.aux[n], b.aux[n]) for n in sigmas)


def _near(parameter: object) -> float:
    """A value inside the range that is not the default."""
    default, low, high = (float(getattr(parameter, n)) for n in ("default", "low", "high"))
    return min(max(2.0 * default if default else 0.1 * high, low), high)
