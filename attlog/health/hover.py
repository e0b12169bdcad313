"""Checks of the motors of a multirotor in hover: thrust reserve, balance of yaw and of load.

All of them are notes. They show how hard the motors work and never name a broken part: before a motor failed, another
one had worked hardest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from attlog.core.sorting import median
from attlog.core.spans import Span, inside
from attlog.flight.drive import MotorOutputs
from attlog.flight.model import Array
from attlog.flight.vehicle import VehicleKind
from attlog.health.check import Check, HealthCase, unknown
from attlog.story.motor_faults import MARGIN_S, NO_FLIGHT_OUTPUTS, NO_OUTPUTS, Motion, flown_spans

# A second of hover: largest tilt, mean rates and climb rate; least number of them.
MAX_TILT_DEG, MAX_RATE_DPS, MAX_CLIMB_M_S, MIN_SECONDS = 12.0, 20.0, 1.0, 20
# Thrust runs out: level of the last fifth, its rise from the first, and the time between them.
HIGH_LEVEL, RISE, APART_S, FIFTHS = 0.65, 0.05, 60.0, 5
# Overpowered: level of hover, or output of a motor in so much of the flight.
LOW_LEVEL, AT_FLOOR, FLOOR_SHARE = 0.15, 0.02, 0.5
# Mean of counter-clockwise less clockwise motors, and what one motor works above the second.
MIN_YAW_BIAS, MIN_UNEVEN = 0.12, 0.09
LIMITS = {
    "hover_thrust": "note: hover at 65 % and more and rising, or at 15 % and less",
    "yaw_bias": "note: 12 % between the two senses of rotation in hover",
    "uneven_motors": "note: one motor 9 % above the second in hover",
}
SOURCE = "attlog, tried on logs with known faults"


class Hover(NamedTuple):
    """Outputs ``x`` (n, motors) averaged over the seconds ``t`` (n,) of hover; ``work`` (motors,): their medians."""

    t: Array
    x: Array

    @property
    def work(self) -> Array:
        """Median output of each motor."""
        found: Array = median(self.x, axis=0)
        return found

    @property
    def level(self) -> float:
        """Mean output of all motors."""
        return float(np.mean(self.work))


def hover_seconds(outputs: MotorOutputs, motion: Motion, spans: Sequence[Span]) -> Hover:
    """Return the seconds of hover within spans."""
    t, rates = motion.rates
    driven = np.isfinite(outputs.x).all(axis=1)  # NaN is off
    output_t, output_x = outputs.t[driven], outputs.x[driven]
    speed = np.abs(rates)
    times, means = [], []
    for a, b in spans:
        edges = a + np.arange(int(b - a) + 1.0)
        if len(edges) < 2:
            continue
        counts, rate = _mean_by_second(edges, t, speed)
        known, x = _mean_by_second(edges, output_t, output_x)
        middle = edges[:-1] + 0.5
        climb = np.array([motion.climb_at(float(m)) for m in middle])
        calm = (
            (motion.tilt_at(middle) < MAX_TILT_DEG)
            & (rate < MAX_RATE_DPS).all(axis=1)
            & (np.abs(climb) < MAX_CLIMB_M_S)
        )
        keep = calm & (counts > 0) & (known > 0)
        times.append(middle[keep])
        means.append(x[keep])
    if not times:
        return Hover(np.zeros(0), np.zeros((0, outputs.motors)))
    return Hover(np.concatenate(times), np.concatenate(means))


def _mean_by_second(edges: Array, t: Array, x: Array) -> tuple[Array, Array]:
    """Return counts (n,) and means (n, k) of samples between successive edges (n + 1,)."""
    at = np.searchsorted(t, edges)
    own, at = x[at[0] : at[-1]], at - at[0]  # one flight of many, so that a day's log takes no square of its time
    total = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(own, axis=0)])
    count = np.diff(at)
    return count, (total[at[1:]] - total[at[:-1]]) / np.maximum(count, 1)[:, None]


def hover_checks(case: HealthCase) -> list[Check]:
    """Check thrust, turn and load in hover; nothing without a flight of a multirotor."""
    log = case.log
    spans = flown_spans(case.segments, MARGIN_S) if "airborne" not in case.segments.unknown else []
    if log.kind is not VehicleKind.MULTIROTOR or not spans:
        return []
    outputs, motion = log.power.outputs, Motion(log)
    if outputs is None or not outputs.scaled:
        why = NO_OUTPUTS if outputs is None else "The log holds no output limits."
        return [_unknown(question, why) for question in LIMITS]
    if not inside(outputs.t, spans).any():
        return [_unknown(question, NO_FLIGHT_OUTPUTS) for question in LIMITS]
    if not len(motion.heights[0]) or not len(motion.rates[0]) or not len(motion.tilts[0]):
        return [_unknown(question, "Hover needs attitude, gyro and height.") for question in LIMITS]
    hover = hover_seconds(outputs, motion, spans)
    if len(hover.t) < MIN_SECONDS:
        return [
            _unknown(question, f"It hovered for {len(hover.t)} s; {MIN_SECONDS} s is needed.") for question in LIMITS
        ]
    found = [_thrust_check(outputs, hover, spans)]
    load = _load_check(outputs, hover) if outputs.motors == 4 else None
    spin = None if outputs.geometry is None else outputs.geometry.spin
    if spin is None:
        found.append(_unknown("yaw_bias", "The positions of the motors are unknown."))
    elif (spin > 0).any() and (spin < 0).any():
        found.append(_yaw_check(hover, spin, load is not None and load.is_trouble))
    return found if load is None else [*found, load]


def _unknown(question: str, why: str) -> Check:
    return unknown(question, why, LIMITS[question], source=SOURCE)


def _check(question: str, noted: bool, text: str, value: float, hover: Hover) -> Check:
    check = Check(question, "warning" if noted else "ok", text, round(100.0 * value, 1), "%", LIMITS[question])
    check.source, check.n, check.seconds = SOURCE, len(hover.t), float(len(hover.t))
    return check


def _thrust_check(outputs: MotorOutputs, hover: Hover, spans: Sequence[Span]) -> Check:
    """Check the level of hover, its rise, and motors at their floor."""
    count = max(len(hover.t) // FIFTHS, 1)
    first, last = (float(np.mean(median(x, axis=0))) for x in (hover.x[:count], hover.x[-count:]))
    apart = float(median(hover.t[-count:]) - median(hover.t[:count]))
    if last >= HIGH_LEVEL and last - first >= RISE and apart >= APART_S:
        text = f"Hover took {100.0 * last:.0f} % of motor output at the end, {100.0 * first:.0f} % at the start: "
        text += "little reserve."
        check = _check("hover_thrust", True, text, last, hover)
        check.cause, check.action = "A discharging battery, or hot or weak motors.", "Land earlier or fly lighter."
        return check
    flown = outputs.x[inside(outputs.t, spans)]
    floor = np.mean(flown <= AT_FLOOR, axis=0)
    motor = int(np.argmax(floor))
    if hover.level <= LOW_LEVEL or floor[motor] >= FLOOR_SHARE:
        text = f"Hover takes {100.0 * hover.level:.0f} % of motor output"
        often = f", {outputs.title(motor)} at its floor in {100.0 * floor[motor]:.0f} % of the flight"
        text += (often if floor[motor] >= FLOOR_SHARE else "") + ": overpowered, little control at low thrust."
        check = _check("hover_thrust", True, text, hover.level, hover)
        check.action = "Add weight or fit smaller propellers; a lower minimum output of the motors helps too."
        return check
    return _check(
        "hover_thrust", False, f"Hover takes {100.0 * hover.level:.0f} % of motor output.", hover.level, hover
    )


def _yaw_check(hover: Hover, spin: Array, uneven: bool) -> Check:
    """Check the difference between counter-clockwise and clockwise motors; ``uneven``: one motor explains it."""
    bias = float(np.mean(hover.work[spin > 0]) - np.mean(hover.work[spin < 0]))
    noted = abs(bias) >= MIN_YAW_BIAS and not uneven
    which = ("Counter-clockwise", "clockwise") if bias > 0 else ("Clockwise", "counter-clockwise")
    text = f"{which[0]} motors work {100.0 * abs(bias):.0f} % of full output harder than {which[1]} ones"
    check = _check("yaw_bias", noted, f"{text}{': a constant yaw torque.' if noted else '.'}", bias, hover)
    if noted:
        check.cause, check.action = "A tilted motor or unequal propellers.", "Check motors and arms for tilt and twist."
    return check


def _load_check(outputs: MotorOutputs, hover: Hover) -> Check:
    """Check whether one motor of four works harder than the others."""
    order = np.argsort(hover.work)
    most, rest = int(order[-1]), hover.work[order[:-1]]
    more = float(hover.work[most] - rest[-1])
    noted = more >= max(MIN_UNEVEN, float(np.ptp(rest)))
    name = outputs.title(most)
    text = f"{name.capitalize()} works at {100.0 * hover.work[most]:.0f} % in hover, "
    text += f"the others at {100.0 * np.mean(rest):.0f} %."
    check = _check("uneven_motors", noted, text, more, hover)
    if noted:
        check.cause = "A worn propeller or weak motor, or a load off centre."
        check.action = "Check its propeller and motor, and the balance of the load."
    return check
