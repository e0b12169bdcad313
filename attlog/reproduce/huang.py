"""Huang: Mahony's filter on the rotation matrix and a nested PI-PID controller, flown and timed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from attlog.reproduce.bench import AXES, COST_METHOD, COST_UPDATES, angles, flight_samples, rise_s, run_seeds
from attlog.reproduce.huang_runs import (
    BESIDE_SEEDS,
    DCM,
    EKF,
    FLOWN_ON,
    HOVER,
    LEVEL_AT,
    LEVEL_EVERY_S,
    LEVEL_S,
    LEVEL_WITHIN_DEG,
    LEVELS,
    MORE_WIND_M_S,
    NEW_EKF,
    PHASES,
    STAND,
    STAND_AT,
    STAND_EVERY_S,
    TILTED_S,
    TRACK_AT,
    TRACK_EVERY_S,
    TRACK_S,
    TRACKS,
    WIND_M_S,
    WITHIN_DEG,
    axis_of,
    fly_stand,
    huang_scenario,
    huang_seed,
    microseconds,
    time_numpy,
)
from attlog.reproduce.page import Span, curve_line, filter_lines
from attlog.reproduce.paper import (
    TRUTH_LINE,
    Claim,
    FigureLine,
    Paper,
    PaperFigure,
    PaperNumber,
    PaperOptions,
    PaperSetting,
    PaperTable,
    Seeds,
    above,
    below,
    combine_verdicts,
    mean,
    mean_text,
    put_first,
    ratio,
    share_of_seeds,
    smallest_and_largest,
)
from attlog.simulate.controller import margins, rise_and_overshoot
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.onboard import TRUE_ATTITUDE
from attlog.words.numbers import number, quantity

PRINTED_MAHONY_S = (0.9995, 0.9880, 1.0023, 1.0029, 0.9851, 1.1822, 1.3897, 1.1918, 1.0115)
PRINTED_EKF_S = (1.8698, 1.8520, 1.8568, 2.2022, 2.0360, 1.9098, 2.1788, 2.4898, 1.8645)
FILTER_WORDS = {TRUE_ATTITUDE: "the true attitude", DCM: "Huang's filter", EKF: "Fan's EKF", NEW_EKF: "mekf"}


def times_table(spent: dict[str, list[float]]) -> PaperTable:
    """Return table 1 as printed and as measured here."""
    rows = [
        (str(k + 1), f"{a:.4f} s", f"{b:.4f} s", f"{b / a:.2f}", quantity(c, "us"), quantity(d, "us"), f"{d / c:.2f}")
        for k, (a, b, c, d) in enumerate(zip(PRINTED_MAHONY_S, PRINTED_EKF_S, spent[DCM], spent[EKF], strict=True))
    ]
    total = [float(np.mean(x)) for x in (PRINTED_MAHONY_S, PRINTED_EKF_S, spent[DCM], spent[EKF])]
    a, b, c, d = total
    rows.append(
        ("mean", f"{a:.4f} s", f"{b:.4f} s", f"{b / a:.2f}", quantity(c, "us"), quantity(d, "us"), f"{d / c:.2f}")
    )
    head = ("run", "paper: Mahony", "EKF", "ratio", "here: Mahony", "EKF", "ratio")
    return PaperTable(f"{COST_UPDATES:,} updates (table 1)", head, tuple(rows), "Here: a field at every update.")


def filter_table(found: Seeds) -> PaperTable:
    """Return the same flight on each filter."""
    rows = []
    for row in FLOWN_ON:
        crashed = found.of("crashed", row)
        tilts = [
            [math.hypot(*both) for both in zip(*(found.of("flown", row, phase, k) for k in (0, 1)), strict=True)]
            for phase in PHASES
        ]
        cells = [mean_text(found.of("most", row), "deg"), *(mean_text(tilt, "deg") for tilt in tilts)]
        cells += [mean_text(found.of("left", row, len(LEVELS) - 1), "deg"), mean_text(found.of("delay", row, 0), "ms")]
        rows.append((FILTER_WORDS[row], f"{sum(crashed):.0f} of {len(crashed)}", *cells))
    head = (
        "flown on",
        "crashed",
        "largest angle in hover",
        "tilt error, hover",
        "moves",
        f"left of {LEVELS[-1][0]:g} deg",
        "delay",
    )
    return PaperTable(
        "The same flight on other filters",
        head,
        tuple(rows),
        f"Means over seeds; of EKFs over the first {BESIDE_SEEDS}.",
    )


def loop_table(found: Seeds) -> PaperTable:
    """Return the transfer function beside the flight on the true attitude."""
    axis = axis_of(0)
    limits = margins(axis)
    t = np.linspace(0.0, 4.0, 4001)
    _, over = rise_and_overshoot(t, axis.step(t))
    back = axis.step(t + TILTED_S) - axis.step(t)
    fall = 1e3 * rise_s(t, back, 0.0, float(back[0]), 0.0)
    falls = [1e3 * x for x in found.of("fall", TRUE_ATTITUDE, 0)]
    rows = [
        ("phase margin", f"{limits.phase_deg:.0f} deg at {limits.phase_at:.0f} rad/s", ""),
        ("gain margin", f"{limits.gain:.1f}", ""),
        ("delay margin", f"{1e3 * limits.delay_s:.0f} ms", ""),
        ("90 to 10 % of 20 deg", quantity(fall, "ms"), mean_text(falls, "ms")),
        ("overshoot of a step", f"{100 * over:.1f} %", ""),
    ]
    for k, (size, period, name) in enumerate(TRACKS):
        answer = axis.response(2.0 * math.pi / period)
        late = -float(np.angle(answer)) * period / (2.0 * math.pi) * 1e3
        sine = f"{name}, {size:g} deg at {period:g} s"
        rows.append((f"delay, {sine}", quantity(late, "ms"), mean_text(found.of("delay", TRUE_ATTITUDE, k), "ms")))
        rows.append((f"gain, {sine}", f"{abs(answer):.2f}", mean_text(found.of("gain", TRUE_ATTITUDE, k), "1")))
    return PaperTable(
        "The loop: transfer function and flight on the true attitude",
        ("", "linear", "flown"),
        tuple(rows),
        "Rotor lag, inertia, gains and the time that sampling and holding take; means over seeds.",
    )


def cost_claim(
    spent: dict[str, list[float]], slow: dict[str, list[float]], numpy: tuple[list[float], list[float]]
) -> Claim:
    printed = ratio("the paper's own: EKF over Mahony", PRINTED_EKF_S, PRINTED_MAHONY_S)
    own = ratio("EKF over Mahony, compiled, a field at every update", spent[EKF], spent[DCM])
    rare = ratio("EKF over Mahony, compiled, a field at every 8th update", slow[EKF], slow[DCM])
    arrays = ratio("EKF with 7 states over Mahony, both plain numpy arrays", numpy[1], numpy[0])
    each = [
        mean(f"{COST_UPDATES:,} updates of {name}", spent[row], "us")
        for row, name in ((DCM, "Mahony"), (EKF, "the EKF"))
    ]
    compiled = (each[0].value or 0.0) / COST_UPDATES
    interpreted = [
        mean(f"an update of {name} in numpy", [1e-3 * ns for ns in found], "us")
        for name, found in zip(("Mahony", "the EKF"), numpy, strict=True)
    ]
    return Claim(
        "cost",
        "It takes less time than the EKF, about half.",
        "table 1",
        f"{COST_METHOD} mahony_dcm@huang and ekf12@fan, 12 states in blocks. Beside them the same filter and a dense "
        "EKF of 7 states as numpy arrays. Holds if all intervals of the ratio are above 1.",
        (own, arrays, rare, *each, *interpreted, printed),
        combine_verdicts([above(n, 1.0) for n in (own, arrays, rare)]),
        f"The direction holds, the number is the implementation's: {_ratio_text((own, rare))} compiled, "
        f"{quantity(arrays.value, 'ratio')} in numpy. The paper's 0.27 ms an update is interpreted code: in numpy "
        f"Mahony's takes {quantity(interpreted[0].value, 'us')}, compiled {quantity(compiled, 'us')}. "
        "Times are of this machine.",
        paper="1.084 s and 2.029 s, ratio 1.87",
        shown=2,
    )


def _ratio_text(numbers: Sequence[PaperNumber]) -> str:
    low, high = smallest_and_largest(numbers)
    return f"{number(low.value, 'ratio')} to {quantity(high.value, 'ratio')}"


Array = NDArray[np.float64]
OWN, WANTED, LINEAR = "Huang's filter", "set-point", "transfer function"
AXIS_TITLES = ("roll, deg", "pitch, deg", "heading, deg")
SINCE: Span = (HOVER[0], np.inf)


def paper_figures(
    spent: dict[str, list[float]], printed_mahony: Sequence[float], printed_ekf: Sequence[float], seed: int = 0
) -> tuple[PaperFigure, ...]:
    """Draw filter against truth and EKF, cost, return to level, hover, tracking."""
    flight = fly(huang_scenario(DCM), seed)
    return (
        _truth_figure(flight),
        _ekf_figure(flight),
        _cost_figure(spent, printed_mahony, printed_ekf),
        _level_figure(flight, seed),
        _hover_figure(flight),
        _tracking_figure(flight),
    )


def _truth_figure(flight: Flight) -> PaperFigure:
    return PaperFigure(
        "truth",
        "fig. 3",
        "The filter in the loop against the truth",
        "Hover, then three returns to level and two sines. Where the filter leaves the truth the vehicle has been "
        "tilted and gathers speed.",
        "time, s",
        AXIS_TITLES,
        _both(flight, len(AXIS_TITLES), SINCE),
        height=480,
    )


def _ekf_figure(flight: Flight) -> PaperFigure:
    rows = {DCM: OWN, EKF: "Fan's EKF", NEW_EKF: "mekf"}
    return PaperFigure(
        "ekf",
        "fig. 4",
        "The filter and EKFs over the same samples, errors",
        "Errors against the truth, because the angles themselves could hardly be distinguished.",
        "time, s",
        tuple(f"error of {name}" for name in AXIS_TITLES),
        tuple(filter_lines(flight_samples(flight), rows, errors=True, span=SINCE)),
        height=480,
    )


def _cost_figure(spent: dict[str, list[float]], mahony: Sequence[float], ekf: Sequence[float]) -> PaperFigure:
    run_of = np.arange(1.0, len(mahony) + 1.0)
    lines = (
        FigureLine("the paper", run_of, np.array(ekf) / np.array(mahony)),
        FigureLine("here", run_of, np.array(spent[EKF]) / np.array(spent[DCM])),
    )
    return PaperFigure(
        "cost",
        "table 1",
        "Time of the EKF over time of Mahony's filter",
        "4,000 updates, nine runs.",
        "run",
        ("ratio",),
        lines,
        kind="points",
        height=260,
    )


def _level_figure(flight: Flight, seed: int) -> PaperFigure:
    """Draw the three returns: true angle and the filter's, on the stand, and the linear loop."""
    lines: list[FigureLine] = []
    held = fly_stand(seed)
    shown = np.linspace(-TILTED_S, LEVEL_S, 701)
    for k, (angle, axis) in enumerate(LEVELS):
        column = ("roll", "pitch").index(axis)
        since = LEVEL_AT + k * LEVEL_EVERY_S + TILTED_S
        beside = STAND_AT + k * STAND_EVERY_S + TILTED_S
        step = axis_of(column).step
        linear = angle * (step(shown + TILTED_S) - step(shown))
        lines += [
            FigureLine(
                TRUTH_LINE, shown, np.interp(since + shown, flight.truth.t, angles(flight.truth.q)[:, column]), k
            ),
            FigureLine(OWN, shown, np.interp(since + shown, flight.onboard.t, _known(flight)[:, column]), k),
            FigureLine(
                "truth on the stand", shown, np.interp(beside + shown, held.truth.t, angles(held.truth.q)[:, column]), k
            ),
            FigureLine(LINEAR, shown, linear, k),
        ]
    panels = tuple(f"{axis} from {angle:g} deg, deg" for angle, axis in LEVELS)
    return PaperFigure(
        "level",
        "fig. 6",
        "From an angle back to level",
        "At 0 s the set-point becomes level. In free flight the filter is level and the vehicle is not.",
        "time, s",
        panels,
        tuple(lines),
        height=480,
    )


def _hover_figure(flight: Flight) -> PaperFigure:
    return PaperFigure(
        "hover",
        "fig. 8",
        "Hover",
        "Roll and pitch with the position held; the paper's bound is +-5 deg.",
        "time, s",
        AXIS_TITLES[:2],
        _both(flight, 2, HOVER),
    )


def _tracking_figure(flight: Flight) -> PaperFigure:
    lines = []
    for k, (_, _, axis) in enumerate(TRACKS):
        column = ("roll", "pitch").index(axis)
        begin = TRACK_AT + k * TRACK_EVERY_S
        for name, t, y in (
            (TRUTH_LINE, flight.truth.t, angles(flight.truth.q)),
            (OWN, flight.onboard.t, _known(flight)),
            (WANTED, flight.onboard.t, angles(flight.onboard.q_setpoint)),
        ):
            lines.append(curve_line(name, t - begin, y[:, column], k, (0.0, TRACK_S)))
    panels = tuple(f"{axis}, sine of {period:g} s, deg" for _, period, axis in TRACKS)
    return PaperFigure(
        "tracking",
        "fig. 9",
        "Angles that follow a set-point",
        "The angle comes a fifth of a second later.",
        "time since the begin, s",
        panels,
        tuple(lines),
    )


def _both(flight: Flight, axes: int, span: Span) -> tuple[FigureLine, ...]:
    """Return truth and onboard filter, axis by axis."""
    both = ((TRUTH_LINE, flight.truth.t, angles(flight.truth.q)), (OWN, flight.onboard.t, _known(flight)))
    return tuple(curve_line(name, t, y[:, axis], axis, span) for axis in range(axes) for name, t, y in both)


def _known(flight: Flight) -> Array:
    """Return the filter's angles (n, 3) at all times, NaN before its start."""
    q = flight.onboard.q
    found = np.full((len(q), 3), np.nan)
    known = np.isfinite(q[:, 0])
    found[known] = angles(q[known])
    return found


# Errors up to which an attitude can be flown on.
TILT_DEG, HEADING_DEG = 2.0, 5.0
NO_WORSE = 1.1
# Gain of -3 dB, the usual limit of following.
HALF_POWER = math.sqrt(0.5)
PHASE_NAMES = {"hover": "hover", "moving": "returns and sines"}


def paper(options: PaperOptions) -> Paper:
    """Measure Huang's claims."""
    found = Seeds(run_seeds("flights", huang_seed, options))
    spent, slow, numpy = microseconds(), microseconds(every=8), time_numpy()
    timed = cost_claim(spent, slow, numpy)
    return Paper(
        "huang",
        "Mahony Filter Applied to Attitude Estimation and Control of Quadrotor",
        "Huang Po, Ma Yan, Yang Wankou, 2014, 1009-3044(2014)07-1611-07, Southeast University (in Chinese)",
        _settings(),
        (
            _follow_claim(found),
            _ekf_claim(found),
            timed,
            _level_claim(found),
            _hover_claim(found),
            _tracking_claim(found),
        ),
        paper_figures(spent, PRINTED_MAHONY_S, PRINTED_EKF_S),
        (times_table(spent), filter_table(found), loop_table(found)),
        (
            "Fig. 5 is the controller's block diagram, fig. 7 the hardware: there is nothing to run again.",
            "Figures 3, 4, 8 and 9 do not say which flights they show. Tables 2 and 3 hold the controller's gains of "
            "roll and pitch; none are printed for yaw.",
            "Which EKF the paper compares with is not stated. Here it is Fan's with 12 states (ekf12@fan). Beside it "
            "is one that estimates biases and expects accelerations (mekf).",
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
        PaperSetting("wind", f"turbulence {WIND_M_S:g} m/s (1 sigma per axis)", "ours"),
        PaperSetting("flight", f"hover 30 s, back to level from {_listed([a for a, _ in LEVELS])} deg, sines", "ours"),
        PaperSetting("stand", "the same returns with so much drag that the vehicle does not gather speed", "ours"),
    )


def _follow_claim(found: Seeds) -> Claim:
    numbers = [
        found.mean(f"RMS error of {axis}, {name}", "deg", "flown", DCM, phase, k)
        for phase, name in PHASE_NAMES.items()
        for k, axis in enumerate(AXES)
    ]
    stand = [
        found.mean(f"RMS error of {axis}, same returns on the stand", "deg", "error", STAND, k)
        for k, axis in enumerate(AXES[:2])
    ]
    limits = (TILT_DEG, TILT_DEG, HEADING_DEG)
    verdicts = [below(n, limits[k % 3]) for k, n in enumerate(numbers)] + [below(n, TILT_DEG) for n in stand]
    words = [quantity(max(n.value or 0.0 for n in part), "deg") for part in (numbers[:2], numbers[3:5], stand)]
    return Claim(
        "follows",
        "The attitude of the filter follows the true attitude.",
        "fig. 3",
        "RMS error of what is flown on against the truth, in hover and from there on. Holds if the whole interval is "
        f"below {TILT_DEG:g} deg (roll, pitch) and {HEADING_DEG:g} deg (heading).",
        put_first((numbers[0], numbers[3]), (*numbers, *stand)),
        combine_verdicts(verdicts),
        f"Roll and pitch err by up to {words[0]} in hover, {words[1]} in free flight, {words[2]} on the stand. The "
        "filter takes the accelerometer for gravity. A tilted quadrotor that gathers speed feels its thrust alone: to "
        "the filter it is level.",
        shown=2,
    )


def _ekf_claim(found: Seeds) -> Claim:
    places = [(phase, k, name) for phase, name in PHASE_NAMES.items() for k in range(3)]
    numbers = [
        found.ratio(
            f"error of {AXES[k]}, Huang's over EKF's, {name}", ("replayed", DCM, phase, k), ("replayed", EKF, phase, k)
        )
        for phase, k, name in places
    ]
    verdicts = [below(n, NO_WORSE) for n in numbers]
    numbers += [
        found.mean(f"RMS of {AXES[k]} between the two, {name}", "deg", "apart", DCM, phase, k)
        for phase, k, name in places
    ]
    roll = found.ratio(
        "error of roll, Huang's over mekf's, returns and sines",
        ("replayed", DCM, "moving", 0),
        ("replayed", NEW_EKF, "moving", 0),
    )
    best, worst = smallest_and_largest(numbers[:6])
    return Claim(
        "ekf",
        "It gives the attitude of an extended Kalman filter.",
        "fig. 4",
        "Both over the samples of the same flight, errors against the truth. Holds if the whole interval of each "
        f"ratio of errors is below {NO_WORSE:g}.",
        put_first((best, worst), (*numbers, roll)),
        combine_verdicts(verdicts),
        f"Its error is {quantity(best.value, 'ratio')} ({_axis(best.what)}) to {quantity(worst.value, 'ratio')} "
        f"({_axis(worst.what)}) that of Fan's EKF. Another EKF, mekf, expects accelerations and estimates biases. In "
        f"the moves the error of roll is {quantity(roll.value, 'ratio')} that of mekf.",
        shown=2,
    )


def _level_claim(found: Seeds) -> Claim:
    numbers, verdicts = [], []
    largest, lasting, settled, times = [], [], [], []
    for place, row in (("free flight", DCM), ("stand", STAND)):
        rest = []
        for k, (angle, axis) in enumerate(LEVELS):
            after = f"from {angle:g} deg of {axis}, {place}"
            seen = found.of("settling", row, k)
            left = found.mean(f"true {axis} that is left, {after}", "deg", "left", row, k)
            there = share_of_seeds(f"settled as the filter sees it, {after}", list(map(math.isfinite, seen)))
            time = mean(f"settling time as the filter sees it, {after}", seen, "s")
            numbers += [left, there, time, found.mean(f"overshoot, {after}", "deg", "overshoot", row, k)]
            if row == STAND:
                verdicts.append(below(left, LEVEL_WITHIN_DEG))
            rest.append(left.value or 0.0)
            lasting.append(left)
            settled.append(there.value or 0.0)
            times.append(math.nan if time.value is None else time.value)
        largest.append(max(rest))
    return Claim(
        "level",
        "From an initial angle the controller brings the vehicle back to level.",
        "fig. 6",
        f"Tilted for {TILTED_S:g} s, then the set-point is level. Settled: within {LEVEL_WITHIN_DEG:g} deg "
        "for good. The figure simulates the attitude loop, which is our stand. Holds if there the whole intervals of "
        f"the true angle left are below {LEVEL_WITHIN_DEG:g} deg.",
        put_first((lasting[-1], max(lasting[:3], key=lambda n: n.value or 0.0)), numbers),
        combine_verdicts(verdicts),
        f"To the filter the vehicle is level in {_at_least(min(settled))} of the returns, after "
        f"{quantity(float(np.nanmin(times)), 's')} to {quantity(float(np.nanmax(times)), 's')}. Up to "
        f"{quantity(largest[0], 'deg')} are truly left in free flight, {quantity(largest[1], 'deg')} on the stand. "
        "What is left is the error of the filter, not of the controller.",
        shown=2,
    )


def _hover_claim(found: Seeds) -> Claim:
    def largest(wind: float, *key: str | float) -> tuple[PaperNumber, PaperNumber]:
        """Return the largest angle, and the share of flights within the bound."""
        most, turbulence = found.of(*key), f"turbulence {wind:g} m/s"
        share = f"flights within {WITHIN_DEG:g} deg{' all the time' if wind == WIND_M_S else f', {turbulence}'}"
        inside = share_of_seeds(share, [m < WITHIN_DEG for m in most])
        return mean(f"largest roll or pitch, {turbulence}", most, "deg"), inside

    size, inside = largest(WIND_M_S, "most", DCM)
    windy = [number for wind in MORE_WIND_M_S for number in largest(wind, "windy", wind)]
    scatter = found.mean("standard deviation of roll", "deg", "spread", DCM)
    reach = found.mean("farthest from the mean place", "m", "drift", DCM)
    return Claim(
        "hover",
        f"In hover roll and pitch stay within +-{WITHIN_DEG:g} deg.",
        "fig. 8",
        "Largest true roll or pitch in 30 s of hover on Huang's filter with GNSS and barometer. "
        f"Holds if its whole interval is below {WITHIN_DEG:g} deg.",
        (size, inside, scatter, reach, *windy),
        below(size, WITHIN_DEG),
        f"{quantity(inside.value, 'pct')} of the flights stay within. With turbulence of "
        f"{MORE_WIND_M_S[-1]:g} m/s the largest angle is {quantity(windy[-2].value, 'deg')}; "
        f"{quantity(windy[-1].value, 'pct')} of the flights stay within.",
        paper="+-5 deg",
    )


def _tracking_claim(found: Seeds) -> Claim:
    numbers, verdicts, words = [], [], []
    for k, (size, period, axis) in enumerate(TRACKS):
        name = f"{axis}, {size:g} deg at {period:g} s"
        gain = found.mean(f"gain, {name}", "1", "gain", DCM, k)
        delay = found.mean(f"delay, {name}", "ms", "delay", DCM, k)
        straight = found.mean(f"delay flown on the truth, {name}", "ms", "delay", TRUE_ATTITUDE, k)
        numbers += [delay, gain, straight]
        verdicts.append(above(gain, HALF_POWER))
        w = 2.0 * math.pi / period
        answer = axis_of(0 if axis == "roll" else 1).response(w)
        words.append(
            f"At a period of {period:g} s the gain is {number(gain.value, '1')}, the delay "
            f"{quantity(delay.value, 'ms', False)}. On the true attitude it is "
            f"{quantity(straight.value, 'ms', False)}, by the transfer function "
            f"{quantity(-float(np.angle(answer)) / w * 1e3, 'ms', False)}."
        )
    return Claim(
        "tracks",
        "The angle follows a moving set-point, with a delay.",
        "fig. 9",
        "Fundamental of the true angle against that of the set-point's sine. It follows where the whole interval of "
        f"the gain is above {HALF_POWER:.3f} (-3 dB).",
        put_first((numbers[0], numbers[1], numbers[4]), numbers),
        combine_verdicts(verdicts),
        f"{' '.join(words)} The delay is the loop's own, about 1 over the outer gain of 4.5/s. Nothing in the "
        "controller looks ahead.",
        shown=3,
    )


def _at_least(pct: float) -> str:
    return "all" if pct >= 100.0 else f"at least {quantity(pct, 'pct')}"


def _axis(what: str) -> str:
    """Return axis and part of the flight of an EKF number."""
    return what.removeprefix("error of ").replace(", Huang's over EKF's", "")


def _listed(values: list[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)
