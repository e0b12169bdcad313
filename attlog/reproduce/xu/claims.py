"""Xu: which gain of Mahony's filter, judged by how much the attitude oscillates; and a gain that adapts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from attlog.present.numbers import counted, listed, number, quantity
from attlog.reproduce import cost
from attlog.reproduce.judge import above, below, ends, led, mean, numbers_text, ratio, together
from attlog.reproduce.paper import Claim, Paper, PaperNumber, PaperOptions, PaperSetting, Verdict
from attlog.reproduce.samples import AXES
from attlog.reproduce.seeds import each, each_seed
from attlog.reproduce.xu.best import GainErrors, best_gain
from attlog.reproduce.xu.figures import figures, table
from attlog.reproduce.xu.logs import LogOscillation, on_log
from attlog.reproduce.xu.runs import ADAPTIVE, BAND_HZ, COSTED, FIXED, ROWS, SWEPT, XuSeed, gain, one_seed
from attlog.reproduce.xu.small import dearer, slow

SAMPLES = Path(__file__).parents[3] / "sample_logs"
"""The flights that come with the source; an installed package has none."""
BAND = f"{BAND_HZ[0]:g} to {BAND_HZ[1]:g} Hz"
PAIRS = ((1.1, 0.6), (2.0, 1.1))
FREQUENCIES = {"crossing": "zero crossings", "hz": "dominant frequency"}
CALMER = 0.3
"""A gain below those of the paper."""
LITTLE = 1.1
"""Less than 10 % more is no fluctuation that begins."""
BETTER = 0.98


def paper(options: PaperOptions) -> Paper:
    """Xu's claims, measured on simulated missions and on logs."""
    seeds = each_seed("missions", one_seed, options)
    paths = options.logs or tuple(sorted(p for p in SAMPLES.glob("*") if p.suffix in (".ulg", ".bin")))
    logs = each("logs", on_log, [(path, ROWS) for path in paths], options)
    used = [log for log in logs if not log.why_not]
    runs = [_of_seeds(seeds), *([_of_logs(used)] if used else [])]
    return Paper(
        "xu",
        "Attitude by the Mahony filter and its application",
        "Xu Ensong, Lu Wenhua, Liu Yunfei, Li Baolei, Feng Wang, Shanghai University of Engineering Science "
        "(in Chinese)",
        _settings(len(used)),
        (
            _oscillates(runs),
            _heading(runs),
            _best(runs),
            slow(seeds, runs[0]),
            dearer(cost.nanoseconds(COSTED)),
            _adaptive(runs),
        ),
        figures(seeds, used),
        (table(seeds, used),),
        _notes(logs),
        seeds=options.seeds,
        logs=tuple(log.name for log in used),
    )


def _settings(logs: int) -> tuple[PaperSetting, ...]:
    return (
        PaperSetting("kp", "0.6, 1.1, 2", "paper"),
        PaperSetting("ki", "0: none is printed", "ours"),
        PaperSetting(
            "adaptive gain",
            "kp 0.6, faded where the specific force (low-passed over 0.1 s in earth axes) is "
            "10 to 20 % off g (after Valenti 2015)",
            "ours",
        ),
        PaperSetting(
            "mission",
            "the library's waypoints: a square of 30 m at up to 6 m/s, nose ahead, wind of 3 m/s; flown "
            "on the true attitude, so that no filter changes the flight",
            "ours",
        ),
        PaperSetting(
            "sensors", "IMU 200 Hz with rotor vibration, gyro bias 0.1 deg/s (1 sigma); magnetometer 50 Hz", "ours"
        ),
        PaperSetting(
            "flights", f"the paper has Pixhawk logs; here simulated missions and {counted(logs, 'log')}", "ours"
        ),
        PaperSetting(
            "oscillation",
            f"RMS from {BAND}: in simulation of the error; on logs of what the filter pushes in "
            "beyond the gyro alone, in windows of 10 s within 20 deg of their mean attitude",
            "ours",
        ),
    )


def _notes(logs: Sequence[LogOscillation]) -> tuple[str, ...]:
    left_out = [f"{log.name} ({log.why_not})" for log in logs if log.why_not]
    kinds = {log.reference for log in logs if not log.why_not}
    found = [
        "In section 2 gradient descent turns the accelerometer into a quaternion rate, which is added to the gyro's. "
        "Here mahony's cross product does; the filter with the gradient step is madgwick.",
        "With ki = 0 the filter is of first order and cannot oscillate by itself. With kp grows how much of "
        "accelerations, vibration and field disturbances reaches the attitude.",
        "Which gain errs least depends on the gyro's bias: with ki = 0 it becomes a tilt of bias / kp. "
        "On logs the bias at rest is subtracted first where there is one.",
    ]
    if kinds:
        found.append(f"Errors on logs are against the reference of an analysis: {listed(sorted(kinds))}.")
    if left_out:
        found.append(f"Logs not used: {'; '.join(left_out)}.")
    if not logs:
        found.append("No log was given (--logs) and none came with this installation. So all flights are simulated.")
    return tuple(found)


def _of_seeds(seeds: Sequence[XuSeed]) -> GainErrors:
    return GainErrors(
        "simulated missions",
        {row: [s.rms[row] for s in seeds] for row in ROWS},
        {row: [s.hz[row] for s in seeds] for row in ROWS},
        {row: [s.crossing[row] for s in seeds] for row in ROWS},
        {row: [s.tilt[row] for s in seeds] for row in ROWS},
        {row: [s.heading[row] for s in seeds] for row in ROWS},
    )


def _of_logs(logs: Sequence[LogOscillation]) -> GainErrors:
    nothing = (math.nan, math.nan)
    return GainErrors(
        "logs",
        {row: [log.rms[row] for log in logs] for row in ROWS},
        {row: [log.hz[row] for log in logs] for row in ROWS},
        {row: [log.crossing[row] for log in logs] for row in ROWS},
        {row: [log.errors.get(row, nothing)[0] for log in logs] for row in ROWS},
        {row: [log.errors.get(row, nothing)[1] for log in logs] for row in ROWS},
    )


def _step(runs: GainErrors, axis: int, high: float, low: float) -> PaperNumber:
    what = f"{AXES[axis]} in the band, kp {high:g} over {low:g}, {runs.called}"
    return ratio(what, runs.in_band(gain(high), axis), runs.in_band(gain(low), axis))


def _frequency(runs: GainErrors, field: str, axis: int, high: float, low: float) -> PaperNumber:
    found = getattr(runs, field)
    what = f"{FREQUENCIES[field]} of {AXES[axis]}, kp {high:g} over {low:g}, {runs.called}"
    return ratio(what, [h[axis] for h in found[gain(high)]], [h[axis] for h in found[gain(low)]])


def _verdict(runs: Sequence[GainErrors], parts: Mapping[str, list[Verdict]]) -> Verdict:
    """Over simulated missions, and over logs where there are enough for an interval."""
    return together([v for r in runs if r is runs[0] or r.flights > 1 for v in parts[r.called]])


def _oscillates(runs: Sequence[GainErrors]) -> Claim:
    steps = {r.called: [_frequency(r, "crossing", axis, *pair) for axis in (0, 1) for pair in PAIRS] for r in runs}
    peaks = {r.called: [_frequency(r, "hz", axis, 2.0, 0.6) for axis in (0, 1)] for r in runs}
    each = [
        mean(f"{kind} of {AXES[axis]}, kp {kp:g}, {r.called}", [h[axis] for h in getattr(r, field)[row]], "1/s")
        for field, kind in FREQUENCIES.items()
        for r in runs
        for axis in (0, 1)
        for kp, row in FIXED.items()
    ]
    size = [_step(r, axis, 2.0, 0.6) for r in runs for axis in (0, 1)]
    low, high = ends([n for numbers in steps.values() for n in numbers])
    dominant = [n.value for n in each if n.value is not None and n.what.startswith(FREQUENCIES["hz"])]
    first = [steps[r.called][0] for r in runs]
    judged = [n for found in (steps, peaks) for r in runs for n in found[r.called]]
    return Claim(
        "oscillates",
        "The frequency at which roll and pitch oscillate grows with the gain.",
        "fig. 1 to 3, section 4",
        f"Zero crossings (upwards) per second of roll and pitch from {BAND} at kp 0.6, 1.1 and 2. Beside them the "
        "frequency with most power per octave (dominant). Holds if the intervals of all ratios are above 1.",
        (*led((*first, peaks[runs[0].called][0]), judged), *each, *size),
        _verdict(runs, {r.called: [above(n, 1.0) for n in (*steps[r.called], *peaks[r.called])] for r in runs}),
        f"A step changes the zero crossings by {number(low.value, 'ratio')} to {quantity(high.value, 'ratio')}. The "
        f"dominant frequency is {min(dominant):.2f} to {max(dominant):.2f} Hz with every gain. With ki = 0 the filter "
        f"has none of its own. The size grows more: from kp 0.6 to 2 the RMS of roll is {numbers_text(size[:1])}.",
        paper="kp 0.6, 1.1, 2",
        shown=len(first) + 1,
    )


def _heading(runs: Sequence[GainErrors]) -> Claim:
    grows = {r.called: [_step(r, 2, *pair) for pair in PAIRS] for r in runs}
    calm = {r.called: _step(r, 2, 0.6, CALMER) for r in runs}
    parts = {r.called: [*(above(n, 1.0) for n in grows[r.called]), below(calm[r.called], LITTLE)] for r in runs}
    first = runs[0].called
    return Claim(
        "heading",
        "Heading fluctuates strongly from a gain of 1.1 on.",
        "fig. 1 to 3, section 4",
        f"RMS of heading from {BAND}. It must grow from 0.6 to 1.1 to 2: all intervals above 1. From {CALMER:g} to 0.6 "
        f"it must grow by less than {100 * (LITTLE - 1):.0f} %.",
        tuple(n for r in runs for n in (*grows[r.called], calm[r.called])),
        _verdict(runs, parts),
        f"On {first} the steps from 0.6 over 1.1 to 2 are {numbers_text(grows[first])}. Nothing need begin there: the "
        f"step from {CALMER:g} to 0.6 is {numbers_text([calm[first]])}.",
        paper="from kp 1.1 on",
        shown=3,
    )


def _best(runs: Sequence[GainErrors]) -> Claim:
    measured = [r for r in runs if r.measured]
    three = {
        r.called: [
            ratio(f"error of tilt, kp {kp:g} over 0.6, {r.called}", r.tilt[gain(kp)], r.tilt[gain(0.6)])
            for kp in (1.1, 2.0)
        ]
        for r in measured
    }
    best = {r.called: [best_gain(r, r.tilt, "tilt"), best_gain(r, r.heading, "heading")] for r in measured}
    parts: dict[str, list[Verdict]] = {}
    for called, found in best.items():
        parts[called] = [above(n, 1.0) for n in three[called]]
        parts[called] += ["holds" if b.any_within(0.6, 1.1) else "does not hold" for b in found if b.tells]
    first = measured[0].called
    errors = [f"On {called} {b.words}." for called, found in best.items() for b in found]
    return Claim(
        "best",
        "The best gain lies between 0.6 and 1.1.",
        "section 4",
        f"RMS error of tilt and heading in the air for gains from {SWEPT[0]:g} to {SWEPT[-1]:g}. In tilt 0.6 must beat "
        "1.1 and 2. A gain between 0.6 and 1.1 must be best or not significantly different.",
        tuple(n for called, found in best.items() for n in (found[0].over, *three[called], found[1].over)),
        _verdict(measured, parts),
        f"Tilt errors with 1.1 and 2 are {numbers_text(three[first])} that of 0.6 on {first}. {' '.join(errors)}",
        paper="kp 0.6 to 1.1",
        shown=2,
    )


def _adaptive(runs: Sequence[GainErrors]) -> Claim:
    fixed = gain(0.6)
    numbers: dict[str, list[PaperNumber]] = {}
    for r in runs:
        tilt = ratio(f"error of tilt, adaptive over fixed 0.6, {r.called}", r.tilt[ADAPTIVE], r.tilt[fixed])
        own, other = r.in_band(ADAPTIVE, 0), r.in_band(fixed, 0)
        roll = ratio(f"roll in the band, adaptive over fixed 0.6, {r.called}", own, other)
        numbers[r.called] = [n for n in (tilt, roll) if n.value is not None]
    told = [f"{numbers_text(found[:1])} on {called}" for called, found in numbers.items()]
    return Claim(
        "adaptive",
        "A gain that adapts is better than a fixed one.",
        "abstract",
        "The paper prints no law, so this judges ours. Error of tilt and RMS of roll in the band over those of the "
        f"fixed gain 0.6. Holds if the intervals are below {BETTER:g}.",
        tuple(n for found in numbers.values() for n in found),
        _verdict(runs, {called: [below(n, BETTER) for n in found] for called, found in numbers.items()}),
        f"Over the fixed gain's the error of tilt is {listed(told)}. The law sees the size of the "
        "specific force alone. Accelerations across gravity pass it up to 0.46 g, where the size is 10 % off.",
        shown=2,
    )
