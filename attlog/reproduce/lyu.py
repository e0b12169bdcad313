"""Lyu: a complementary filter whose integral fades where the error is large, against one with a fixed integral."""

from __future__ import annotations

import math

import numpy as np

from attlog.reproduce.bench import COST_METHOD, angles, run_filter, run_seeds, time_updates
from attlog.reproduce.lyu_runs import (
    AMPLITUDE_DEG,
    DROP_AT,
    DROP_WITHIN_DEG,
    DROPS,
    ERR1,
    IN_CONTROL_DEG,
    NO_INTEGRAL,
    PERIOD_S,
    READINGS,
    ROWS,
    SHAKEN_M_S2,
    STILL_S,
    TRACK_S,
    WRONG_DEG,
    WRONG_WITHIN_DEG,
    at_rest,
    bench_seed,
    drop,
    fixed,
    flight_seed,
    fly_row,
    stopped,
    variable,
    wrong_start,
)
from attlog.reproduce.page import curve_line, truth_lines
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
    below,
    combine_verdicts,
    mean,
    mean_text,
    put_first,
    range_text,
    ratio,
    smallest_and_largest,
)
from attlog.words.numbers import below as bound
from attlog.words.numbers import quantity

NAMES = {
    kind(reading): f"{name}, ki per {reading}"
    for reading in READINGS
    for kind, name in ((fixed, "fixed"), (variable, "variable"), (stopped, "input stopped"))
}
DRAWN = [row for row in ROWS if row not in (stopped("second"), stopped("sample"))]


def paper_figures(seed: int = 0) -> tuple[PaperFigure, ...]:
    """Draw rest, drop, wrong start and flight."""
    return _rest_figure(seed), _drop_figure(seed), _start_figure(seed), _flight_figure(seed)


def _rest_figure(seed: int) -> PaperFigure:
    s = at_rest(seed)
    lines = [FigureLine(TRUTH_LINE, s.t[[0, -1]], angles(s.q)[[0, -1], axis], axis) for axis in (0, 1)]
    for row in DRAWN:
        found = run_filter(row, s)
        lines += [curve_line(NAMES[row], found.t, found.angles[:, axis], axis) for axis in (0, 1)]
    return PaperFigure(
        "rest",
        "fig. 4",
        "At rest on a tilted table",
        "Lines of the variable integral lie exactly on those of the fixed one. How far they are from the truth is the "
        "gyro's bias over kp and the accelerometer's own.",
        "time, s",
        ("roll, deg", "pitch, deg"),
        tuple(lines),
    )


def _drop_figure(seed: int) -> PaperFigure:
    s = drop(seed, 60.0, 500.0)
    span = (STILL_S - 1.0, DROP_AT + 15.0)
    lines = truth_lines(s, span, axes=1)
    for row in DRAWN:
        found = run_filter(row, s)
        lines += [
            curve_line(NAMES[row], found.t, found.angles[:, 0], 0, span),
            curve_line(NAMES[row], found.t, found.errors[:, 0], 1, span),
        ]
    return PaperFigure(
        "drop",
        "fig. 5",
        "Lifted to 60 deg and dropped",
        "The gyro sees the whole movement; the blow disturbs.",
        "time, s",
        ("roll, deg", "error of roll, deg"),
        tuple(lines),
    )


def _start_figure(seed: int) -> PaperFigure:
    s = at_rest(seed)
    shown = 25.0
    lines = [FigureLine(TRUTH_LINE, [0.0, shown], [0.0, 0.0])]
    for row in ROWS:
        found = wrong_start(row, s, 60.0)
        lines.append(curve_line(NAMES[row], found.t, found.errors[:, 0], span=(0.0, shown)))
    return PaperFigure(
        "start",
        "fig. 5",
        "An error of 60 deg",
        "The board rests, the filter starts 60 deg off in roll: nowhere else do the filters differ so much.",
        "time, s",
        ("error of roll, deg",),
        tuple(lines),
        height=300,
    )


def _flight_figure(seed: int) -> PaperFigure:
    lines: list[FigureLine] = []
    for row in (fixed("second"), variable("second")):
        flight = fly_row(row, seed)
        on, truth = flight.onboard, flight.truth
        late = on.t >= TRACK_S - 4.0
        t, found = on.t[late], angles(on.q)[late, 0]
        true = np.interp(t, truth.t, angles(truth.q)[:, 0])
        if not lines:
            lines += [curve_line(TRUTH_LINE, t, true), curve_line("set-point", t, angles(on.q_setpoint)[late, 0])]
        lines += [curve_line(NAMES[row], t, found), curve_line(NAMES[row], t, found - true, 1)]
    return PaperFigure(
        "flight",
        "section 3.2",
        "In flight, roll on a sine",
        "Each filter flies its own flight; the truth is that of the first.",
        "time, s",
        ("roll, deg", "error of roll, deg"),
        tuple(lines),
    )


HARDLY = 1.5


def flight_claim(found: Seeds) -> Claim:
    """Judge that no flight is out of control."""
    kept, most = [], []
    for name, kind in (("variable integral", variable), ("fixed integral", fixed)):
        tilts = [x for r in READINGS for x in found.of("most", kind(r))]
        most.append(mean(f"largest true tilt, {name}", tilts, "deg"))
        kept.append(found.share(f"flights in control, {name}", *(("kept", kind(r)) for r in READINGS)))
    numbers = [
        found.difference(f"{what}, variable minus fixed, ki per {r}", "deg", (key, variable(r)), (key, fixed(r)))
        for r in READINGS
        for what, key in (("error of tilt", "error"), ("distance of roll from its set-point", "tracking"))
    ]
    size = found.mean("error of tilt, fixed integral, ki per second", "deg", "error", fixed("second"))
    largest = max(x for r in READINGS for kind in (fixed, variable) for x in found.of("e", kind(r)))
    e = PaperNumber("largest |e| in flight, of 1", largest, "")
    equal = found.share("flights that are equal to the last bit", *(("equal", variable(r)) for r in READINGS))
    lost = any(n.value != 100.0 for n in kept)
    return Claim(
        "flight",
        "Flown on the improved filter the vehicle is stable and does not lose control.",
        "section 3.2",
        "Largest true tilt from take-off on; the set-point of roll swings by "
        f"{AMPLITUDE_DEG:g} deg. Out of control: beyond {IN_CONTROL_DEG:g} deg, or on the ground. Holds if "
        f"no flight is, and the interval of the tilt is below {IN_CONTROL_DEG:g} deg.",
        (kept[0], most[0], kept[1], most[1], size, *numbers, equal, e),
        "does not hold" if lost else combine_verdicts([below(n, IN_CONTROL_DEG) for n in most]),
        f"Both filters {'do not keep every flight' if lost else 'keep every flight'} in control. They differ by "
        f"{range_words(numbers, 'deg')}; the error of tilt is {quantity(size.value, 'deg')}. "
        f"{quantity(equal.value, 'pct')} of the pairs of flights are equal to the last bit: |e| reaches {largest:.2f}.",
        shown=2,
    )


def cost_claim(spent: dict[str, list[float]]) -> Claim:
    """Judge the time per update; ``spent`` of :func:`time_updates`."""
    new, old = variable("second"), fixed("second")
    one = ratio("time per update, variable over fixed integral", spent[new], spent[old])
    each = [
        mean(f"time per update, {name} integral", spent[row], "ns") for name, row in (("variable", new), ("fixed", old))
    ]
    more = (each[0].value or 0.0) - (each[1].value or 0.0)
    return Claim(
        "cost",
        "The improved filter costs the processor hardly more.",
        "section 4",
        f"{COST_METHOD} Hardly more is less than half more: holds if the interval of the ratio is below {HARDLY:g}.",
        (one, *each),
        below(one, HARDLY),
        f"The size of the error and the ratio of (17) add {quantity(more, 'ns')} to {quantity(each[1].value, 'ns')}. "
        "Times are of this machine.",
    )


def range_words(numbers: list[PaperNumber], unit: str) -> str:
    """Return the range of numbers in words, or that all are too small to see."""
    values = [n.value for n in numbers if n.value is not None]
    largest = max(map(abs, values))
    if largest < {"s": 0.05, "deg": 0.05}[unit]:
        return f"less than {bound(largest, unit)} either way"
    return f"{quantity(min(values), unit, True)} to {quantity(max(values), unit, True)}"


# Ratio of spreads visible in a figure: 2 %.
QUIETER = 0.98
# Differences visible in a figure.
SOONER_S, CLOSER_DEG = -0.1, -0.1


def paper(options: PaperOptions) -> Paper:
    """Measure Lyu's claims."""
    found = Seeds(run_seeds("bench", bench_seed, options))
    flown = Seeds(run_seeds("flights", flight_seed, options))
    spent = time_updates((variable("second"), fixed("second")), every=None)
    return Paper(
        "lyu",
        "Improved method for the complementary filtering attitude of the four-rotor aircraft",
        "Lyu Chunsheng, Qingdao University of Science and Technology (in Chinese)",
        _settings(),
        (_rest_claim(found), _follow_claim(found), _settle_claim(found), flight_claim(flown), cost_claim(spent)),
        paper_figures(),
        (_table(found),),
        (
            "The paper prints no numbers: its claims are read off its figures.",
            "It does not say whether ki counts per second or per sample: everything is run both ways. At 200 Hz the "
            "second is 200 times the first.",
            "Equation (16) scales what the integral puts out and goes on summing. With 'input stopped', which is ours, "
            "it scales what is summed.",
            "Less overshoot is a motive of section 2, no result of the paper: the table shows it.",
        ),
        seeds=options.seeds,
    )


def _settings() -> tuple[PaperSetting, ...]:
    return (
        PaperSetting("kp", "0.5", "paper"),
        PaperSetting("ki", "0.001, per second and per sample", "paper"),
        PaperSetting("err1, err2", "0.3, 0.8 (sine of the error: 17 and 53 deg)", "paper"),
        PaperSetting("sensor", "MPU6050", "paper"),
        PaperSetting("its noise", "0.005 deg/s/sqrt(Hz), 400 ug/sqrt(Hz), from its data sheet", "ours"),
        PaperSetting("magnetometer", "none: heading is free", "paper"),
        PaperSetting("sampling", "200 Hz; gyro range 500 deg/s, once 250; gyro bias left 0.1 deg/s (1 sigma)", "ours"),
        PaperSetting("vibration", f"{SHAKEN_M_S2:g} m/s^2 RMS an axis, white, at rest", "ours"),
        PaperSetting(
            "at rest", "60 s on a table tilted by 1 to 3 deg; spread from 20 s on, straight line removed", "ours"
        ),
        PaperSetting("drop", "up about an edge 15 cm away in 1 s, held 4 s, dropped in 0.3 s, a blow of 2 g", "ours"),
        PaperSetting(
            "flight",
            f"take-off, hover, roll on a sine of {AMPLITUDE_DEG:g} deg and "
            f"{PERIOD_S:g} s, on the filter's attitude, by Huang's controller",
            "ours",
        ),
    )


def _rest_claim(found: Seeds) -> Claim:
    def compared(what: str, key: str) -> list[PaperNumber]:
        return [
            found.ratio(what.format(axis=name, reading=r), (key, variable(r), axis), (key, fixed(r), axis))
            for r in READINGS
            for axis, name in enumerate(("roll", "pitch"))
        ]

    numbers = compared("spread of {axis}, variable over fixed integral, ki per {reading}", "spread")
    vibration = f"{SHAKEN_M_S2:g} m/s^2 of vibration"
    shaken = compared(f"spread of {{axis}} under {vibration}, variable over fixed, ki per {{reading}}", "shaken")
    equal = found.share("seeds in which both filters are equal to the last bit", ("equal",))
    largest, mean_e = max(found.of("largest e")), found.of("shaken e")
    shaken_e = sum(mean_e) / len(mean_e)
    at_rest = ("spread", fixed("second"), 0)
    spread = found.mean("spread of roll, both filters, ki per second", "deg", *at_rest)
    none = found.ratio(
        "spread of roll, no integral at all over fixed integral, ki per second", ("spread", NO_INTEGRAL, 0), at_rest
    )
    return Claim(
        "rest",
        "At rest the angles of the improved filter scatter less than those of the traditional one.",
        "fig. 4",
        "Standard deviation of roll and pitch at rest, both filters on the same samples. Holds if the whole "
        f"interval of the ratio is below {QUIETER:g}.",
        (
            *numbers,
            equal,
            spread,
            none,
            *shaken,
            PaperNumber("largest |e| at rest, of 1", largest, ""),
            PaperNumber("mean |e| under vibration, of 1", shaken_e, ""),
        ),
        combine_verdicts([below(n, QUIETER) for n in numbers]),
        f"The two are equal to the last bit in {quantity(equal.value, 'pct')} of the seeds. The integral fades above "
        f"|e| = {ERR1:g}; at rest |e| stays below {math.ceil(100 * largest) / 100:g}. Without any integral the spread "
        f"is {quantity(none.value, 'ratio')} as large. With {SHAKEN_M_S2:g} m/s^2 (RMS) of vibration the mean "
        f"|e| is {shaken_e:.2f}. Then the variable integral's spread is {range_text(shaken[2:], 'ratio')} as large "
        f"with ki per sample, {range_text(shaken[:2], 'ratio')} with ki per second. The paper's motors may have run.",
    )


def _each_drop(found: Seeds, what: str, key: str, unit: str) -> list[PaperNumber]:
    """Return differences (variable minus fixed) of a measure by reading and drop."""
    return [
        found.difference(
            f"{what} after {_named(angle, span)}, variable minus fixed, ki per {reading}",
            unit,
            (key, variable(reading), angle, span),
            (key, fixed(reading), angle, span),
        )
        for reading in READINGS
        for angle, span in DROPS
    ]


def _each_start(found: Seeds, ours: bool = False) -> list[PaperNumber]:
    """Return differences (variable, or ours, minus fixed) of the settling time by reading and wrong start."""
    kind, name = (stopped, "input stopped") if ours else (variable, "variable")
    return [
        found.difference(
            f"settling time after a start {angle:g} deg off, {name} minus fixed, ki per {reading}",
            "s",
            ("settling", kind(reading), angle),
            ("settling", fixed(reading), angle),
        )
        for reading in READINGS
        for angle in WRONG_DEG
    ]


def _named(angle: float, span: float) -> str:
    return f"{angle:g} deg" if span > 300.0 else f"{angle:g} deg, gyro range {span:g} deg/s"


def _follow_claim(found: Seeds) -> Claim:
    numbers = _each_drop(found, "RMS error of tilt", "error", "deg")
    above = [
        found.mean(f"time with |e| above err1, {_named(*place)}", "pct", "above", variable("second"), *place)
        for place in DROPS
    ]
    most = bound(max(n.value or 0.0 for n in above), "pct")
    return Claim(
        "follow",
        "Lifted and dropped, the improved filter follows the movement more closely.",
        "fig. 5",
        "RMS error of tilt from the lift to 5 s after the drop (20, 40, 60 deg). Holds if the whole interval of "
        f"the difference is below {CLOSER_DEG:g} deg.",
        put_first(smallest_and_largest(numbers), (*numbers, *above)),
        combine_verdicts([below(n, CLOSER_DEG) for n in numbers]),
        f"The error differs by {range_words(numbers, 'deg')}. The filters differ only while |e| is above {ERR1:g}: "
        f"less than {most} of the time. That is in the blow, and where the gyro's range is too small for the drop.",
        shown=2,
    )


def _settle_claim(found: Seeds) -> Claim:
    drops = _each_drop(found, "settling time", "settling", "s")
    starts = _each_start(found)
    ours = _each_start(found, ours=True)
    return Claim(
        "settle",
        "After a large error the improved filter is back at the true angle sooner.",
        "fig. 5",
        f"After a drop: time until the error of roll stays within {DROP_WITHIN_DEG:g} deg of where it ends. "
        f"After a wrong start: time until it stays within {WRONG_WITHIN_DEG:g} deg. Holds if the whole interval "
        f"of the difference is below {SOONER_S:g} s.",
        put_first(smallest_and_largest((*drops, *starts)), (*drops, *starts, *ours)),
        combine_verdicts([below(n, SOONER_S) for n in (*drops, *starts)]),
        f"After a drop it differs by {range_words(drops, 's')}. After a wrong start it differs by "
        f"{range_words(starts, 's')}. Equation (16) goes on summing while nothing is put out; the sum then "
        f"drives the angle too far. With the sum stopped instead, it differs by {range_words(ours, 's')}.",
        shown=2,
    )


def _table(found: Seeds) -> PaperTable:
    """Return means of settling time and overshoot by row."""
    kinds = (("fixed", fixed), ("variable, as printed", variable), ("variable, input stopped", stopped))
    rows = []
    for reading in READINGS:
        for name, kind in kinds:
            cells = [
                mean_text(found.of(key, kind(reading), a), unit)
                for a in WRONG_DEG
                for key, unit in (("settling", "s"), ("overshoot", "deg"))
            ]
            rows.append((f"{name}, ki per {reading}", *cells))
    head = ("integral", *(f"{a:g} deg: {w}" for a in WRONG_DEG for w in ("settles", "overshoots")))
    return PaperTable(
        "From a start with a wrong angle",
        head,
        tuple(rows),
        f"Means over seeds; settled: the error of roll stays within {WRONG_WITHIN_DEG:g} deg.",
    )
