"""Xu: which gain of Mahony's filter, judged by how much the attitude oscillates; and a gain that adapts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from attlog.reproduce.bench import AXES, COST_METHOD, run_each, run_seeds, time_updates
from attlog.reproduce.page import filter_lines, points_line, truth_lines
from attlog.reproduce.paper import (
    Claim,
    FigureLine,
    Paper,
    PaperFigure,
    PaperNumber,
    PaperOptions,
    PaperSetting,
    PaperTable,
    Verdict,
    above,
    below,
    combine_verdicts,
    geometric_mean,
    mean,
    numbers_text,
    put_first,
    ratio,
    smallest_and_largest,
)
from attlog.reproduce.xu_runs import (
    ADAPTIVE,
    BAND_HZ,
    COSTED,
    FIXED,
    ROWS,
    SWEPT,
    Flights,
    GainRun,
    air_span,
    best_gain,
    flown,
    gain,
    one_seed,
    oscillation_on_log,
)
from attlog.words.numbers import counted, listed, number, quantity


def slow_claim(missions: Flights) -> Claim:
    """Judge the slow error below the best gain."""
    smallest, next_one = SWEPT[0], SWEPT[1]
    best = best_gain(missions, "tilt")
    slow = "slow error of roll and pitch"
    grown, printed = (
        _over(missions, f"{slow}, kp {kp:g} over {next_one:g}", "slow", None, gain(kp), gain(next_one))
        for kp in (smallest, 0.6)
    )
    sizes = [
        mean(f"{slow}, kp {kp:g}, {missions.called}", missions.values("slow", gain(kp)), "deg")
        for kp in (smallest, next_one, 0.6)
    ]
    return Claim(
        "slow",
        "A gain that is too small lets slow errors of the gyro in.",
        "section 4",
        f"RMS error of roll and pitch averaged over {1.0 / BAND_HZ[0]:g} s, in the air. Holds if it grows from kp "
        f"{next_one:g} down to {smallest:g}: the interval of the ratio is above 1.",
        (grown, printed, *sizes, best.over),
        above(grown, 1.0),
        f"Too small is far below the paper's gains: in our simulation kp {best.kp:g} errs least in tilt. The slow "
        f"error with 0.6 is {numbers_text([printed])} that with {next_one:g}. Lasting accelerations are slow too.",
    )


def cost_claim(spent: dict[str, list[float]]) -> Claim:
    """Judge the time per update; ``spent`` of :func:`time_updates`."""
    quaternion, matrix = COSTED
    one = ratio("time per update, rotation matrix over quaternion", spent[matrix], spent[quaternion])
    each = [
        mean(f"time per update, {name}", spent[row], "ns")
        for name, row in (("quaternion (mahony)", quaternion), ("matrix (mahony_dcm)", matrix))
    ]
    return Claim(
        "cost",
        "The quaternion needs less computation than the direction cosine matrix.",
        "section 0.1",
        f"{COST_METHOD} The same filter and gains in both forms. Holds if the interval of the ratio is above 1.",
        (one, *each),
        above(one, 1.0),
        "The matrix is renormalised, and a quaternion is made of it for the output. Times are of this machine.",
    )


CALLED = {row: f"kp {kp:g}" for kp, row in FIXED.items()} | {ADAPTIVE: "adaptive (our law)"}


def paper_figures(sets: Sequence[Flights], seed: int = 0) -> tuple[PaperFigure, ...]:
    """Draw the mission, its errors, oscillation and error against the gain."""
    s = flown(seed)
    return (
        PaperFigure(
            "mission",
            "fig. 1 to 3",
            "A waypoint mission",
            "The first seed, between take-off and landing.",
            "time, s",
            tuple(f"{a}, deg" for a in AXES),
            (*truth_lines(s, air_span()), *filter_lines(s, CALLED, span=air_span())),
            height=480,
        ),
        PaperFigure(
            "errors",
            "fig. 1 to 3",
            "How far off",
            "The same mission: what was found minus the truth.",
            "time, s",
            tuple(f"{a} error, deg" for a in AXES),
            tuple(filter_lines(s, CALLED, errors=True, span=air_span())),
            height=480,
        ),
        PaperFigure(
            "oscillation",
            "fig. 1 to 3",
            "How much it oscillates, by gain",
            "Geometric means over flights with their intervals, 0.2 to 5 Hz: of the error in simulation, on logs of "
            "what the filter pushes in beyond the gyro alone.",
            "kp, 1/s",
            tuple(f"{a}, deg" for a in AXES),
            tuple(_gain_line(flights, "rms", axis, axis) for flights in sets for axis in range(3)),
            "points",
            height=480,
            x_log=True,
        ),
        PaperFigure(
            "best",
            "section 4",
            "How far off, by gain",
            "Geometric means of RMS errors over flights with their intervals; logs against their reference.",
            "kp, 1/s",
            ("tilt, deg", "heading, deg"),
            tuple(
                _gain_line(flights.complete("heading"), what, None, panel)
                for flights in map(Flights.complete, sets)
                for panel, what in enumerate(("tilt", "heading"))
                if flights.complete("heading").runs
            ),
            "points",
            height=400,
            x_log=True,
        ),
    )


def _gain_line(flights: Flights, what: str, axis: int | None, panel: int) -> FigureLine:
    numbers = [geometric_mean(flights.values(what, gain(kp), axis)) for kp in SWEPT]
    return points_line(flights.called, SWEPT, numbers, panel)


def oscillation_table(sets: Sequence[Flights]) -> PaperTable:
    """Return oscillation and errors of the paper's gains and of the adaptive one."""
    measures = (*(("rms", axis) for axis in range(3)), ("tilt", None), ("heading", None))
    rows = []
    for row, name in CALLED.items():
        for flights in sets:
            cells = [geometric_mean(flights.values(what, row, axis)) for what, axis in measures]
            called = flights.called.removeprefix("simulated ")
            rows.append((f"{name}, {called}", *(quantity(n.value, "deg") for n in cells)))
    head = ("gain", *(f"{a}, 0.2 to 5 Hz" for a in AXES), "error of tilt", "error of heading")
    return PaperTable("Oscillation and error", head, tuple(rows), "Geometric means over flights of RMS values.")


# Flights of the source tree; an installed package has none.
SAMPLE_LOGS = Path(__file__).parents[2] / "sample_logs"
BAND = f"{BAND_HZ[0]:g} to {BAND_HZ[1]:g} Hz"
PAIRS = ((1.1, 0.6), (2.0, 1.1))
FREQUENCIES = {"crossing": "zero crossings", "hz": "dominant frequency"}
# A gain below those of the paper.
CALMER = 0.3
# Less than 10 % more is no fluctuation that begins.
LITTLE_RATIO = 1.1
BETTER_RATIO = 0.98


def paper(options: PaperOptions) -> Paper:
    """Measure Xu's claims on simulated missions and on logs."""
    missions = Flights("simulated missions", run_seeds("missions", one_seed, options))
    paths = options.logs or tuple(sorted(p for p in SAMPLE_LOGS.glob("*") if p.suffix in (".ulg", ".bin")))
    logs = run_each("logs", oscillation_on_log, [(path, ROWS) for path in paths], options)
    used = [log for log in logs if not log.why_not]
    runs = [missions, *([Flights("logs", used)] if used else [])]
    return Paper(
        "xu",
        "Attitude by the Mahony filter and its application",
        "Xu Ensong, Lu Wenhua, Liu Yunfei, Li Baolei, Feng Wang, Shanghai University of Engineering Science "
        "(in Chinese)",
        _settings(len(used)),
        (
            _oscillation_claim(runs),
            _heading_claim(runs),
            _best_gain_claim(runs),
            slow_claim(missions),
            cost_claim(time_updates(COSTED)),
            _adaptive_claim(runs),
        ),
        paper_figures(runs),
        (oscillation_table(runs),),
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


def _notes(logs: Sequence[GainRun]) -> tuple[str, ...]:
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


def _over(runs: Flights, what: str, field: str, axis: int | None, row: str, other: str) -> PaperNumber:
    """Return the ratio of a field of two rows."""
    return ratio(f"{what}, {runs.called}", runs.values(field, row, axis), runs.values(field, other, axis))


def _step(runs: Flights, axis: int, high: float, low: float) -> PaperNumber:
    return _over(runs, f"{AXES[axis]} in the band, kp {high:g} over {low:g}", "rms", axis, gain(high), gain(low))


def _frequency(runs: Flights, field: str, axis: int, high: float, low: float) -> PaperNumber:
    what = f"{FREQUENCIES[field]} of {AXES[axis]}, kp {high:g} over {low:g}"
    return _over(runs, what, field, axis, gain(high), gain(low))


def _verdict(runs: Sequence[Flights], parts: Mapping[str, list[Verdict]]) -> Verdict:
    """Combine the verdicts on simulated missions, and on logs where there are enough for an interval."""
    return combine_verdicts([v for r in runs if r is runs[0] or len(r.runs) > 1 for v in parts[r.called]])


def _oscillation_claim(runs: Sequence[Flights]) -> Claim:
    steps = {r.called: [_frequency(r, "crossing", axis, *pair) for axis in (0, 1) for pair in PAIRS] for r in runs}
    peaks = {r.called: [_frequency(r, "hz", axis, 2.0, 0.6) for axis in (0, 1)] for r in runs}
    each = [
        mean(f"{kind} of {AXES[axis]}, kp {kp:g}, {r.called}", r.values(field, row, axis), "1/s")
        for field, kind in FREQUENCIES.items()
        for r in runs
        for axis in (0, 1)
        for kp, row in FIXED.items()
    ]
    size = [_step(r, axis, 2.0, 0.6) for r in runs for axis in (0, 1)]
    low, high = smallest_and_largest([n for numbers in steps.values() for n in numbers])
    dominant = [n.value for n in each if n.value is not None and n.what.startswith(FREQUENCIES["hz"])]
    first = [steps[r.called][0] for r in runs]
    judged = [n for found in (steps, peaks) for r in runs for n in found[r.called]]
    return Claim(
        "oscillates",
        "The frequency at which roll and pitch oscillate grows with the gain.",
        "fig. 1 to 3, section 4",
        f"Zero crossings (upwards) per second of roll and pitch from {BAND} at kp 0.6, 1.1 and 2. Beside them the "
        "frequency with most power per octave (dominant). Holds if the intervals of all ratios are above 1.",
        (*put_first((*first, peaks[runs[0].called][0]), judged), *each, *size),
        _verdict(runs, {r.called: [above(n, 1.0) for n in (*steps[r.called], *peaks[r.called])] for r in runs}),
        f"A step changes the zero crossings by {number(low.value, 'ratio')} to {quantity(high.value, 'ratio')}. The "
        f"dominant frequency is {min(dominant):.2f} to {max(dominant):.2f} Hz with every gain. With ki = 0 the filter "
        f"has none of its own. The size grows more: from kp 0.6 to 2 the RMS of roll is {numbers_text(size[:1])}.",
        paper="kp 0.6, 1.1, 2",
        shown=len(first) + 1,
    )


def _heading_claim(runs: Sequence[Flights]) -> Claim:
    grows = {r.called: [_step(r, 2, *pair) for pair in PAIRS] for r in runs}
    calm = {r.called: _step(r, 2, 0.6, CALMER) for r in runs}
    parts = {r.called: [*(above(n, 1.0) for n in grows[r.called]), below(calm[r.called], LITTLE_RATIO)] for r in runs}
    first = runs[0].called
    return Claim(
        "heading",
        "Heading fluctuates strongly from a gain of 1.1 on.",
        "fig. 1 to 3, section 4",
        f"RMS of heading from {BAND}. It must grow from 0.6 to 1.1 to 2: all intervals above 1. From {CALMER:g} to 0.6 "
        f"it must grow by less than {100 * (LITTLE_RATIO - 1):.0f} %.",
        tuple(n for r in runs for n in (*grows[r.called], calm[r.called])),
        _verdict(runs, parts),
        f"On {first} the steps from 0.6 over 1.1 to 2 are {numbers_text(grows[first])}. Nothing need begin there: the "
        f"step from {CALMER:g} to 0.6 is {numbers_text([calm[first]])}.",
        paper="from kp 1.1 on",
        shown=3,
    )


def _best_gain_claim(runs: Sequence[Flights]) -> Claim:
    measured = [r for r in runs if r.complete().runs]
    three = {
        r.called: [
            _over(r, f"error of tilt, kp {kp:g} over 0.6", "tilt", None, gain(kp), gain(0.6)) for kp in (1.1, 2.0)
        ]
        for r in measured
    }
    best = {r.called: [best_gain(r, what) for what in ("tilt", "heading")] for r in measured}
    parts: dict[str, list[Verdict]] = {}
    for called, found in best.items():
        parts[called] = [above(n, 1.0) for n in three[called]]
        parts[called] += ["holds" if b.any_within(0.6, 1.1) else "does not hold" for b in found if b.decides]
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


def _adaptive_claim(runs: Sequence[Flights]) -> Claim:
    numbers: dict[str, list[PaperNumber]] = {}
    for r in runs:
        tilt, roll = (
            _over(r, f"{name}, adaptive over fixed 0.6", what, axis, ADAPTIVE, gain(0.6))
            for name, what, axis in (("error of tilt", "tilt", None), ("roll in the band", "rms", 0))
        )
        numbers[r.called] = [n for n in (tilt, roll) if n.value is not None]
    complete = [f"{numbers_text(found[:1])} on {called}" for called, found in numbers.items()]
    return Claim(
        "adaptive",
        "A gain that adapts is better than a fixed one.",
        "abstract",
        "The paper prints no law, so this judges ours. Error of tilt and RMS of roll in the band over those of the "
        f"fixed gain 0.6. Holds if the intervals are below {BETTER_RATIO:g}.",
        tuple(n for found in numbers.values() for n in found),
        _verdict(runs, {called: [below(n, BETTER_RATIO) for n in found] for called, found in numbers.items()}),
        f"Over the fixed gain's the error of tilt is {listed(complete)}. The law sees the size of the "
        "specific force alone. Accelerations across gravity pass it up to 0.46 g, where the size is 10 % off.",
        shown=2,
    )
