"""Lyu: a complementary filter whose integral fades where the error is large, against the one with a fixed integral."""

from __future__ import annotations

import math

from attlog.present.numbers import below as bound
from attlog.present.numbers import quantity
from attlog.reproduce import cost
from attlog.reproduce.judge import below, difference, ends, led, mean, mean_text, ratio, share, span, together
from attlog.reproduce.lyu import flight as lyu_flight
from attlog.reproduce.lyu import runs
from attlog.reproduce.lyu.conclusion import dearer, flies, reach
from attlog.reproduce.lyu.figures import figures
from attlog.reproduce.lyu.runs import DROPS, ERR1, READINGS, WRONG_DEG, BenchResult, fixed, stopped, variable
from attlog.reproduce.paper import Claim, Paper, PaperNumber, PaperOptions, PaperSetting, PaperTable
from attlog.reproduce.seeds import each_seed

QUIETER = 0.98
"""A ratio of spreads that a person could see in a figure: 2 %."""
SOONER_S, CLOSER_DEG = -0.1, -0.1
"""Differences that a person could see in a figure."""


def paper(options: PaperOptions) -> Paper:
    """Lyu's claims, measured."""
    found = each_seed("bench", runs.bench, options)
    flown = each_seed("flights", lyu_flight.one_seed, options)
    spent = cost.nanoseconds((variable("second"), fixed("second")), every=None)
    return Paper(
        "lyu",
        "Improved method for the complementary filtering attitude of the four-rotor aircraft",
        "Lyu Chunsheng, Qingdao University of Science and Technology (in Chinese)",
        _settings(),
        (_at_rest(found), _follows(found), _settles(found), flies(flown), dearer(spent)),
        figures(),
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
        PaperSetting("vibration", f"{runs.SHAKEN_M_S2:g} m/s^2 RMS an axis, white, at rest", "ours"),
        PaperSetting(
            "at rest", "60 s on a table tilted by 1 to 3 deg; spread from 20 s on, straight line removed", "ours"
        ),
        PaperSetting("drop", "up about an edge 15 cm away in 1 s, held 4 s, dropped in 0.3 s, a blow of 2 g", "ours"),
        PaperSetting(
            "flight",
            f"take-off, hover, roll on a sine of {lyu_flight.AMPLITUDE_DEG:g} deg and "
            f"{lyu_flight.PERIOD_S:g} s, on the filter's attitude, by Huang's controller",
            "ours",
        ),
    )


def _at_rest(found: list[BenchResult]) -> Claim:
    numbers, verdicts = [], []
    for reading in READINGS:
        for axis, name in enumerate(("roll", "pitch")):
            one = ratio(
                f"spread of {name}, variable over fixed integral, ki per {reading}",
                [b.spread[variable(reading)][axis] for b in found],
                [b.spread[fixed(reading)][axis] for b in found],
            )
            numbers.append(one)
            verdicts.append(below(one, QUIETER))
    equal = share("seeds in which both filters are equal to the last bit", [all(b.equal.values()) for b in found])
    largest = max(b.largest_e for b in found)
    spread = mean("spread of roll, both filters, ki per second", [b.spread[fixed("second")][0] for b in found], "deg")
    shaken = [
        ratio(
            f"spread of {name} under {runs.SHAKEN_M_S2:g} m/s^2 of vibration, variable over fixed, ki per {reading}",
            [b.shaken[variable(reading)][axis] for b in found],
            [b.shaken[fixed(reading)][axis] for b in found],
        )
        for reading in READINGS
        for axis, name in enumerate(("roll", "pitch"))
    ]
    shaken_e = sum(b.shaken_e for b in found) / len(found)
    none = ratio(
        "spread of roll, no integral at all over fixed integral, ki per second",
        [b.without[0] for b in found],
        [b.spread[fixed("second")][0] for b in found],
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
        together(verdicts),
        f"The two are equal to the last bit in {quantity(equal.value, 'pct')} of the seeds. The integral fades above "
        f"|e| = {ERR1:g}; at rest |e| stays below {math.ceil(100 * largest) / 100:g}. Without any integral the spread "
        f"is {quantity(none.value, 'ratio')} as large. With {runs.SHAKEN_M_S2:g} m/s^2 (RMS) of vibration the mean "
        f"|e| is {shaken_e:.2f}. Then the variable integral's spread is {span(shaken[2:], 'ratio')} as large with ki "
        f"per sample, {span(shaken[:2], 'ratio')} with ki per second. The paper's motors may have run.",
    )


def _each_drop(found: list[BenchResult], what: str, field: str, unit: str) -> list[PaperNumber]:
    """Differences (variable minus fixed) of a field by reading and drop."""
    return [
        difference(
            f"{what} after {_named(angle, span)}, variable minus fixed, ki per {reading}",
            [getattr(b.dropped[variable(reading), angle, span], field) for b in found],
            [getattr(b.dropped[fixed(reading), angle, span], field) for b in found],
            unit,
        )
        for reading in READINGS
        for angle, span in DROPS
    ]


def _each_start(found: list[BenchResult], what: str, field: str, unit: str, ours: bool = False) -> list[PaperNumber]:
    """Differences (variable, or ours, minus fixed) of a field by reading and angle of the wrong start."""
    kind, name = (stopped, "input stopped") if ours else (variable, "variable")
    return [
        difference(
            f"{what} after a start {angle:g} deg off, {name} minus fixed, ki per {reading}",
            [getattr(b.started[kind(reading), angle], field) for b in found],
            [getattr(b.started[fixed(reading), angle], field) for b in found],
            unit,
        )
        for reading in READINGS
        for angle in WRONG_DEG
    ]


def _named(angle: float, span: float) -> str:
    return f"{angle:g} deg" if span > 300.0 else f"{angle:g} deg, gyro range {span:g} deg/s"


def _follows(found: list[BenchResult]) -> Claim:
    numbers = _each_drop(found, "RMS error of tilt", "error_deg", "deg")
    above = [
        mean(
            f"time with |e| above err1, {_named(angle, span)}",
            [b.dropped[variable("second"), angle, span].above_pct for b in found],
            "pct",
        )
        for angle, span in DROPS
    ]
    most = bound(max(n.value or 0.0 for n in above), "pct")
    return Claim(
        "follow",
        "Lifted and dropped, the improved filter follows the movement more closely.",
        "fig. 5",
        "RMS error of tilt from the lift to 5 s after the drop (20, 40, 60 deg). Holds if the whole interval of "
        f"the difference is below {CLOSER_DEG:g} deg.",
        led(ends(numbers), (*numbers, *above)),
        together([below(n, CLOSER_DEG) for n in numbers]),
        f"The error differs by {reach(numbers, 'deg')}. The filters differ only while |e| is above {ERR1:g}: less "
        f"than {most} of the time. That is in the blow, and where the gyro's range is too small for the drop.",
        shown=2,
    )


def _settles(found: list[BenchResult]) -> Claim:
    drops = _each_drop(found, "settling time", "settling_s", "s")
    starts = _each_start(found, "settling time", "settling_s", "s")
    ours = _each_start(found, "settling time", "settling_s", "s", ours=True)
    return Claim(
        "settle",
        "After a large error the improved filter is back at the true angle sooner.",
        "fig. 5",
        f"After a drop: time until the error of roll stays within {runs.DROP_WITHIN_DEG:g} deg of where it ends. "
        f"After a wrong start: time until it stays within {runs.WRONG_WITHIN_DEG:g} deg. Holds if the whole interval "
        f"of the difference is below {SOONER_S:g} s.",
        led(ends((*drops, *starts)), (*drops, *starts, *ours)),
        together([below(n, SOONER_S) for n in (*drops, *starts)]),
        f"After a drop it differs by {reach(drops, 's')}. After a wrong start it differs by {reach(starts, 's')}. "
        "Equation (16) "
        "goes on summing while nothing is put out; the sum then drives the angle too far. With the sum stopped "
        f"instead, it differs by {reach(ours, 's')}.",
        shown=2,
    )


def _table(found: list[BenchResult]) -> PaperTable:
    """Means of settling time and overshoot by row."""
    kinds = (("fixed", fixed), ("variable, as printed", variable), ("variable, input stopped", stopped))
    rows = []
    for reading in READINGS:
        for name, kind in kinds:
            cells = [
                mean_text([getattr(b.started[kind(reading), a], f) for b in found], u)
                for a in WRONG_DEG
                for f, u in (("settling_s", "s"), ("overshoot_deg", "deg"))
            ]
            rows.append((f"{name}, ki per {reading}", *cells))
    head = ("integral", *(f"{a:g} deg: {w}" for a in WRONG_DEG for w in ("settles", "overshoots")))
    return PaperTable(
        "From a start with a wrong angle",
        head,
        tuple(rows),
        f"Means over seeds; settled: the error of roll stays within {runs.WRONG_WITHIN_DEG:g} deg.",
    )
