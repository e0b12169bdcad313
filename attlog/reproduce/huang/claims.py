"""Huang: Mahony's filter on the rotation matrix and a nested PI-PID controller, flown and timed."""

from __future__ import annotations

import math

import numpy as np

from attlog.present.numbers import number, quantity
from attlog.reproduce.huang import plain, runs
from attlog.reproduce.huang.cost import costs_less
from attlog.reproduce.huang.figures import figures
from attlog.reproduce.huang.runs import DCM, EKF, LEVELS, NEW_EKF, TRACKS, WITHIN_DEG, HuangSeed, LevelReturn
from attlog.reproduce.huang.tables import PRINTED_EKF_S, PRINTED_MAHONY_S, by_filter, linear, times
from attlog.reproduce.judge import above, below, ends, led, mean, ratio, share, together
from attlog.reproduce.paper import Claim, Paper, PaperNumber, PaperOptions, PaperSetting
from attlog.reproduce.samples import AXES
from attlog.reproduce.seeds import each_seed
from attlog.simulate.autopilot.onboard import TRUTH

TILT_DEG, HEADING_DEG = 2.0, 5.0
"""An attitude that is this close is one that can be flown on."""
NO_WORSE = 1.1
HALF_POWER = math.sqrt(0.5)
"""Gain of -3 dB: up to there a loop is said to follow."""
PHASES = ("hover", "moving")


def paper(options: PaperOptions) -> Paper:
    """Huang's claims, measured."""
    found = each_seed("flights", runs.seed_of, options)
    spent, slow, numpy = runs.microseconds(), runs.microseconds(every=8), plain.nanoseconds()
    timed = costs_less(spent, slow, numpy)
    return Paper(
        "huang",
        "Mahony Filter Applied to Attitude Estimation and Control of Quadrotor",
        "Huang Po, Ma Yan, Yang Wankou, 2014, 1009-3044(2014)07-1611-07, Southeast University (in Chinese)",
        _settings(),
        (_follows(found), _like_an_ekf(found), timed, _level(found), _hover(found), _tracks(found)),
        figures(spent, PRINTED_MAHONY_S, PRINTED_EKF_S),
        (times(spent), by_filter(found), linear(found)),
        (
            "Fig. 5 is the controller's block diagram, fig. 7 the hardware: there is nothing to run again.",
            "Figures 3, 4, 8 and 9 do not say which flights they show. Tables 2 and 3 hold the controller's gains of "
            "roll and pitch; none are printed for yaw.",
            "Which EKF the paper compares with is not said. Here it is Fan's with 12 states (ekf12@fan). Beside it "
            "stands one that estimates biases and expects accelerations (mekf).",
            "The filter's equations are those that `attlog estimators mahony_dcm` shows.",
        ),
        seeds=options.seeds,
    )


def _settings() -> tuple[PaperSetting, ...]:
    return (
        PaperSetting("filter", "kp 0.3, ki 0.01 (fig. 3), 400 Hz", "paper"),
        PaperSetting("outer loop, roll and pitch", "PI on angle, 4.5 and 0.35 (table 2)", "paper"),
        PaperSetting("inner loop, roll and pitch", "PID on rate, 0.14, 0.015, 0.0025 (table 3), 400 Hz", "paper"),
        PaperSetting("GNSS", "5 Hz", "paper"),
        PaperSetting("unit of the inner loop", "1 moves the rotors of a side by half of their thrust", "ours"),
        PaperSetting("yaw", "2.5 on angle, 0.6 and 0.1 on rate", "ours"),
        PaperSetting("vehicle", "1.5 kg, 0.45 m across, rotors with 25 ms lag", "ours"),
        PaperSetting("sensors", "Pixhawk class; magnetometer 50 Hz", "ours"),
        PaperSetting("wind", f"turbulence {runs.WIND_M_S:g} m/s (1 sigma per axis)", "ours"),
        PaperSetting("flight", f"hover 30 s, back to level from {_listed([a for a, _ in LEVELS])} deg, sines", "ours"),
        PaperSetting("stand", "the same returns with so much drag that the vehicle does not gather speed", "ours"),
    )


def _follows(found: list[HuangSeed]) -> Claim:
    own = [s.flown[DCM].errors for s in found]
    numbers = [
        mean(
            f"RMS error of {axis}, {'hover' if phase == 'hover' else 'returns and sines'}",
            [getattr(e, phase)[k] for e in own],
            "deg",
        )
        for phase in PHASES
        for k, axis in enumerate(AXES)
    ]
    stand = [
        mean(f"RMS error of {axis}, same returns on the stand", [s.stand_errors[k] for s in found], "deg")
        for k, axis in enumerate(AXES[:2])
    ]
    limits = (TILT_DEG, TILT_DEG, HEADING_DEG)
    verdicts = [below(n, limits[k % 3]) for k, n in enumerate(numbers)] + [below(n, TILT_DEG) for n in stand]
    said = [quantity(max(n.value or 0.0 for n in part), "deg") for part in (numbers[:2], numbers[3:5], stand)]
    return Claim(
        "follows",
        "The attitude of the filter follows the true attitude.",
        "fig. 3",
        "RMS error of what is flown on against the truth, in hover and from there on. Holds if the whole interval is "
        f"below {TILT_DEG:g} deg (roll, pitch) and {HEADING_DEG:g} deg (heading).",
        led((numbers[0], numbers[3]), (*numbers, *stand)),
        together(verdicts),
        f"Roll and pitch err by up to {said[0]} in hover, {said[1]} in free flight, {said[2]} on the stand. The "
        "filter takes the accelerometer for gravity. A tilted quadrotor that gathers speed feels its thrust alone: to "
        "the filter it is level.",
        shown=2,
    )


def _like_an_ekf(found: list[HuangSeed]) -> Claim:
    numbers: list[PaperNumber] = []
    verdicts = []
    for phase in PHASES:
        name = "hover" if phase == "hover" else "returns and sines"
        for k, axis in enumerate(AXES):
            one = ratio(
                f"error of {axis}, Huang's over EKF's, {name}",
                [getattr(s.replayed.errors[DCM], phase)[k] for s in found],
                [getattr(s.replayed.errors[EKF], phase)[k] for s in found],
            )
            numbers.append(one)
            verdicts.append(below(one, NO_WORSE))
    for phase in PHASES:
        name = "hover" if phase == "hover" else "returns and sines"
        for k, axis in enumerate(AXES):
            apart = [getattr(s.replayed.apart, phase)[k] for s in found]
            numbers.append(mean(f"RMS of {axis} between the two, {name}", apart, "deg"))
    roll = ratio(
        "error of roll, Huang's over mekf's, returns and sines",
        [s.replayed.errors[DCM].moving[0] for s in found],
        [s.replayed.errors[NEW_EKF].moving[0] for s in found],
    )
    best, worst = ends(numbers[:6])
    return Claim(
        "ekf",
        "It gives the attitude of an extended Kalman filter.",
        "fig. 4",
        "Both over the samples of the same flight, errors against the truth. Holds if the whole interval of each "
        f"ratio of errors is below {NO_WORSE:g}.",
        led((best, worst), (*numbers, roll)),
        together(verdicts),
        f"Its error is {quantity(best.value, 'ratio')} ({_axis(best.what)}) to {quantity(worst.value, 'ratio')} "
        f"({_axis(worst.what)}) that of Fan's EKF. Another EKF, mekf, expects accelerations and estimates biases. In "
        f"the moves the error of roll is {quantity(roll.value, 'ratio')} that of mekf.",
        shown=2,
    )


def _level(found: list[HuangSeed]) -> Claim:
    numbers, verdicts = [], []
    largest, lasting, settled, times = [], [], [], []
    for place in ("free flight", "stand"):
        rest = []
        for k, (angle, axis) in enumerate(LEVELS):
            after = f"from {angle:g} deg of {axis}, {place}"
            seen: list[LevelReturn] = [(s.stand if place == "stand" else s.flown[DCM].returned)[k] for s in found]
            left = mean(f"true {axis} that is left, {after}", [abs(r.left_deg) for r in seen], "deg")
            there = share(f"settled as the filter sees it, {after}", [math.isfinite(r.settling_s) for r in seen])
            time = mean(f"settling time as the filter sees it, {after}", [r.settling_s for r in seen], "s")
            numbers += [left, there, time, mean(f"overshoot, {after}", [r.overshoot_deg for r in seen], "deg")]
            if place == "stand":
                verdicts.append(below(left, runs.LEVEL_WITHIN_DEG))
            rest.append(left.value or 0.0)
            lasting.append(left)
            settled.append(there.value or 0.0)
            times.append(math.nan if time.value is None else time.value)
        largest.append(max(rest))
    return Claim(
        "level",
        "From an initial angle the controller brings the vehicle back to level.",
        "fig. 6",
        f"Tilted for {runs.TILTED_S:g} s, then the set-point is level. Settled: within {runs.LEVEL_WITHIN_DEG:g} deg "
        "for good. The figure simulates the attitude loop, which is our stand. Holds if there the whole intervals of "
        f"the true angle left are below {runs.LEVEL_WITHIN_DEG:g} deg.",
        led((lasting[-1], max(lasting[:3], key=lambda n: n.value or 0.0)), numbers),
        together(verdicts),
        f"To the filter the vehicle is level in {_at_least(min(settled))} of the returns, after "
        f"{quantity(float(np.nanmin(times)), 's')} to {quantity(float(np.nanmax(times)), 's')}. Up to "
        f"{quantity(largest[0], 'deg')} are truly left in free flight, {quantity(largest[1], 'deg')} on the stand. "
        "What is left is the error of the filter, not of the controller.",
        shown=2,
    )


def _hover(found: list[HuangSeed]) -> Claim:
    most = [max(s.flown[DCM].most_deg) for s in found]
    size = mean(f"largest roll or pitch, turbulence {runs.WIND_M_S:g} m/s", most, "deg")
    inside = share(f"flights within {WITHIN_DEG:g} deg all the time", [m < WITHIN_DEG for m in most])
    windy = []
    for wind in runs.MORE_WIND_M_S:
        values = [max(s.windy[wind]) for s in found]
        windy.append(mean(f"largest roll or pitch, turbulence {wind:g} m/s", values, "deg"))
        windy.append(
            share(f"flights within {WITHIN_DEG:g} deg, turbulence {wind:g} m/s", [v < WITHIN_DEG for v in values])
        )
    scatter = mean("standard deviation of roll", [s.flown[DCM].spread_deg[0] for s in found], "deg")
    reach = mean("farthest from the mean place", [s.flown[DCM].drift_m for s in found], "m")
    return Claim(
        "hover",
        f"In hover roll and pitch stay within +-{WITHIN_DEG:g} deg.",
        "fig. 8",
        "Largest true roll or pitch in 30 s of hover on Huang's filter with GNSS and barometer. "
        f"Holds if its whole interval is below {WITHIN_DEG:g} deg.",
        (size, inside, scatter, reach, *windy),
        below(size, WITHIN_DEG),
        f"{quantity(inside.value, 'pct')} of the flights stay within. With turbulence of "
        f"{runs.MORE_WIND_M_S[-1]:g} m/s the largest angle is {quantity(windy[-2].value, 'deg')}; "
        f"{quantity(windy[-1].value, 'pct')} of the flights stay within.",
        paper="+-5 deg",
    )


def _tracks(found: list[HuangSeed]) -> Claim:
    numbers, verdicts, said = [], [], []
    for k, (size, period, axis) in enumerate(TRACKS):
        name = f"{axis}, {size:g} deg at {period:g} s"
        gain = mean(f"gain, {name}", [s.flown[DCM].tracked[k].gain for s in found], "1")
        delay = mean(f"delay, {name}", [s.flown[DCM].tracked[k].delay_ms for s in found], "ms")
        straight = mean(f"delay flown on the truth, {name}", [s.flown[TRUTH].tracked[k].delay_ms for s in found], "ms")
        numbers += [delay, gain, straight]
        verdicts.append(above(gain, HALF_POWER))
        w = 2.0 * math.pi / period
        told = runs.axis_of(0 if axis == "roll" else 1).response(w)
        said.append(
            f"At a period of {period:g} s the gain is {number(gain.value, '1')}, the delay "
            f"{quantity(delay.value, 'ms', False)}. On the true attitude it is "
            f"{quantity(straight.value, 'ms', False)}, by the transfer function "
            f"{quantity(-float(np.angle(told)) / w * 1e3, 'ms', False)}."
        )
    return Claim(
        "tracks",
        "The angle follows a moving set-point, with a delay.",
        "fig. 9",
        "Fundamental of the true angle against that of the set-point's sine. It follows where the whole interval of "
        f"the gain is above {HALF_POWER:.3f} (-3 dB).",
        led((numbers[0], numbers[1], numbers[4]), numbers),
        together(verdicts),
        f"{' '.join(said)} The delay is the loop's own, about 1 over the outer gain of 4.5/s. Nothing in the "
        "controller looks ahead.",
        shown=3,
    )


def _at_least(pct: float) -> str:
    return "all" if pct >= 100.0 else f"at least {quantity(pct, 'pct')}"


def _axis(what: str) -> str:
    """Which axis and part of the flight a number of the EKF claim is about."""
    return what.removeprefix("error of ").replace(", Huang's over EKF's", "")


def _listed(values: list[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)
