"""Lyu: a complementary filter whose integral fades where the error is large, against one with a fixed integral.

The board rests, is lifted and dropped, starts with a wrong angle, and flies: with the traditional filter (fixed
integral) and the one with variable integral, ki per second and per sample; without a magnetometer, as in the paper.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.reproduce import bench
from attlog.reproduce.bench import (
    COST_METHOD,
    FLOWN_ON_TRUTH,
    FilterOutput,
    FlightSamples,
    angles,
    detrended_std,
    flight_samples,
    gravity_error,
    overshoot_of,
    rms,
    run_filter,
    run_seeds,
    time_updates,
)
from attlog.reproduce.page import curve_line, truth_lines
from attlog.reproduce.paper import (
    TRUTH_LINE,
    Claim,
    FigureLine,
    Measures,
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
    settings,
    smallest_and_largest,
)
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.scenario import Command, EstimatorChoice, Move, PrescribedMotion, Scenario
from attlog.simulate.sensor_settings import AccelerometerSettings, GyroSettings, ImuSettings, SensorSettings
from attlog.words.numbers import below as bound
from attlog.words.numbers import quantity

Array = NDArray[np.float64]

RATE_HZ = 200.0
# InvenSense PS-MPU-6000A: 0.005 deg/s/sqrt(Hz), 400 ug/sqrt(Hz); ranges, rate and remaining bias are ours.
MPU6050 = ImuSettings(
    rate_hz=RATE_HZ,
    gyro=GyroSettings(noise_dps_rthz=0.005, bias_spread_dps=0.1, range_dps=500.0, step_dps=500.0 / 32768),
    acc=AccelerometerSettings(noise_ug_rthz=400.0, range_g=4.0, step_mg=4000.0 / 32768),
)
READINGS = ("second", "sample")
ERR1, ERR2 = 0.3, 0.8
# Angle in deg and the gyro's range in deg/s: a drop of 60 deg in 0.3 s turns at up to 375 deg/s.
DROPS = ((20.0, 500.0), (40.0, 500.0), (60.0, 500.0), (60.0, 250.0))
WRONG_DEG = (20.0, 40.0, 60.0)
REST_S, SETTLED_S = 60.0, 20.0
# RMS of rotor vibration on each axis of the accelerometer: the mean |e| is above err1.
SHAKEN_M_S2 = 3.0
STILL_S, LIFT_S, HOLD_S, DROP_S, AFTER_S = 10.0, 1.0, 4.0, 0.3, 30.0
DROP_AT = STILL_S + LIFT_S + HOLD_S
DROP_WITHIN_DEG, WRONG_WITHIN_DEG = 0.25, 1.0


def fixed(reading: str) -> str:
    """Return the row of the traditional filter."""
    return f"complementary@lyu-fixed:ki_per={reading}"


def variable(reading: str) -> str:
    """Return the row of the filter with variable integral."""
    return f"variable_integral@lyu:ki_per={reading}"


def stopped(reading: str) -> str:
    """Return our variant for comparison, which fades the input of the integral."""
    return f"variable_integral@lyu:ki_per={reading},freeze=input"


# Without any integral.
NO_INTEGRAL = "complementary@lyu-fixed:ki=0"
ROWS = tuple(kind(reading) for reading in READINGS for kind in (fixed, variable, stopped))


def board(seconds: float, motion: PrescribedMotion, range_dps: float = 500.0) -> Scenario:
    """Return Lyu's board, moved by hand or at rest on a table, rotors off."""
    gyro = replace(MPU6050.gyro, range_dps=range_dps, step_dps=range_dps / 32768)
    return Scenario(
        name="lyu",
        seconds=seconds,
        motion=motion,
        sensors=SensorSettings(imu=(replace(MPU6050, gyro=gyro),), mag=()),
        estimator=FLOWN_ON_TRUTH,
    )


def lifted(angle: float) -> PrescribedMotion:
    """Return rest, a lift about one edge, a hold, a drop within 0.3 s."""
    moves = (
        Move(seconds=STILL_S),
        Move(seconds=LIFT_S, roll_deg=angle),
        Move(seconds=HOLD_S),
        Move(seconds=DROP_S, roll_deg=0.0, shock_m_s2=20.0),
    )
    return PrescribedMotion(arm_m=(0.0, -0.15, 0.0), move=moves)


def tilted(seed: int) -> PrescribedMotion:
    """Return a table tilted by 1 to 3 deg in a random direction."""
    draw = np.random.default_rng([seed, 24])
    size, where = draw.uniform(1.0, 3.0), draw.uniform(0.0, 2.0 * np.pi)
    return PrescribedMotion(roll_deg=float(size * np.cos(where)), pitch_deg=float(size * np.sin(where)))


def at_rest(seed: int) -> FlightSamples:
    """Return samples of the board on its tilted table."""
    return flight_samples(fly(board(REST_S, tilted(seed)), seed), mag=False)


def shaken(s: FlightSamples, seed: int) -> FlightSamples:
    """Return the samples with vibration, white at 200 Hz."""
    noise = np.random.default_rng([seed, 25]).standard_normal(s.acc.shape)
    return replace(s, acc=s.acc + SHAKEN_M_S2 * noise)


def drop(seed: int, angle: float, range_dps: float) -> FlightSamples:
    """Return samples of the board lifted and dropped."""
    return flight_samples(fly(board(DROP_AT + DROP_S + AFTER_S, lifted(angle), range_dps), seed), mag=False)


def wrong_start(row: str, s: FlightSamples, angle: float) -> FilterOutput:
    """Run a row over samples at rest from a start ``angle`` deg off in roll."""
    return run_filter(row, s, q0=rotation.multiply(s.q[0], rotation.from_euler(np.radians(angle), 0.0, 0.0)))


def bench_seed(seed: int) -> Measures:
    """Run all experiments on the bench for one seed.

    By row: ``spread`` at rest, ``shaken`` (roll 0, pitch 1; deg), and of a drop or a wrong start the ``settling``
    time of roll (s), its ``overshoot`` (deg), ``error`` of tilt (RMS, deg), ``above``: time with |e| above err1
    (%). ``equal``: variable and fixed integral to the last bit. ``largest e``: at rest; ``shaken e``: its mean.
    """
    still = at_rest(seed)
    rest = {row: run_filter(row, still) for row in ROWS}
    found = _spread("spread", rest) | _spread("spread", {NO_INTEGRAL: run_filter(NO_INTEGRAL, still)})
    found["largest e",] = max(float(gravity_error(still, one).max()) for one in rest.values())
    found["equal",] = float(all(np.array_equal(rest[fixed(r)].q, rest[variable(r)].q) for r in READINGS))
    shaking = shaken(still, seed)
    under = {kind(r): run_filter(kind(r), shaking) for r in READINGS for kind in (fixed, variable)}
    found |= _spread("shaken", under)
    found["shaken e",] = float(gravity_error(shaking, under[fixed("second")]).mean())
    for angle, range_dps in DROPS:
        s = drop(seed, angle, range_dps)
        for row in ROWS:
            found |= _dropped(s, run_filter(row, s), (row, angle, range_dps))
    for angle in WRONG_DEG:
        for row in ROWS:
            one = wrong_start(row, still, angle)
            roll, begin = one.errors[:, 0], float(one.t[0])
            found["settling", row, angle] = bench.settling_s(one.t, roll, begin, WRONG_WITHIN_DEG)
            found["overshoot", row, angle] = overshoot_of(one.t, roll, begin, angle, 0.0)
    return found


def _spread(what: str, found: Mapping[str, FilterOutput]) -> Measures:
    """Return standard deviations of roll (0) and pitch (1) in deg by row, straight line removed."""
    return {
        (what, row, axis): detrended_std(one.t[one.t >= SETTLED_S], one.angles[one.t >= SETTLED_S, axis])
        for row, one in found.items()
        for axis in (0, 1)
    }


def _dropped(s: FlightSamples, found: FilterOutput, where: tuple[str, float, float]) -> Measures:
    error, late = found.errors[:, 0], DROP_AT + DROP_S
    end = float(np.mean(error[found.t >= found.t[-1] - 5.0]))
    moving = (found.t >= STILL_S) & (found.t < late + 5.0)
    return {
        ("settling", *where): bench.settling_s(found.t, error - end, late, DROP_WITHIN_DEG),
        ("error", *where): rms(found.tilt_error[moving]),
        ("above", *where): 100.0 * float(np.mean(gravity_error(s, found)[moving] >= ERR1)),
    }


# Section 2 calls a vehicle beyond 45 deg unstable.
IN_CONTROL_DEG = 45.0
TRACK_S, SECONDS = 20.0, 32.0
AMPLITUDE_DEG, PERIOD_S = 15.0, 3.0


def flight_scenario(row: str) -> Scenario:
    """Return take-off, hover, a sine in roll; Lyu's board without magnetometer."""
    commands = (
        Command(t=11.0, do="arm"),
        Command(t=12.0, do="takeoff", up_m=5.0),
        Command(t=TRACK_S, do="track", amplitude_deg=AMPLITUDE_DEG, period_s=PERIOD_S),
    )
    return Scenario(
        name="lyu",
        seconds=SECONDS,
        command=commands,
        sensors=SensorSettings(imu=(MPU6050,), mag=()),
        estimator=EstimatorChoice(row),
    )


def fly_row(row: str, seed: int) -> Flight:
    """Fly on one filter's attitude."""
    return fly(flight_scenario(row), seed)


def flight_seed(seed: int) -> Measures:
    """Fly all rows of one seed.

    By row: RMS ``error`` of tilt and ``tracking`` error of roll (deg), ``most``: largest true tilt (deg), ``kept``:
    in control, ``e``: largest |e|, ``equal`` to the flight on the traditional filter to the last bit.
    """
    found: Measures = {}
    for reading in READINGS:
        traditional, other = fly_row(fixed(reading), seed), fly_row(variable(reading), seed)
        found |= _flown(traditional, fixed(reading)) | _flown(other, variable(reading))
        found["equal", variable(reading)] = float(np.array_equal(traditional.truth.q, other.truth.q))
    return found


def _flown(flown: Flight, row: str) -> Measures:
    on, truth = flown.onboard, flown.truth
    true = rotation.slerp(truth.t, truth.q, np.minimum(on.t, truth.t[-1]))
    air, tracking = on.t >= 12.0, on.t >= TRACK_S + 1.0
    tilt = np.degrees(rotation.tilt_angle(rotation.earth_error(on.q, true)))[air]
    roll = np.degrees(rotation.to_euler(true)[:, 0] - rotation.to_euler(on.q_setpoint)[:, 0])[tracking]
    s = flight_samples(flown, mag=False)
    most = float(np.degrees(rotation.tilt_angle(truth.q))[truth.t >= 12.0].max())
    landed = bool(truth.ground[truth.t >= TRACK_S].any())
    return {
        ("error", row): rms(tilt),
        ("tracking", row): rms(roll),
        ("most", row): most,
        ("kept", row): float(not landed and most < IN_CONTROL_DEG),
        ("e", row): float(gravity_error(s, run_filter(row, s))[s.t >= 12.0].max()),
    }


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


MAX_COST_RATIO = 1.5


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
        f"{COST_METHOD} Hardly more is less than half more: holds if the ratio's interval is below {MAX_COST_RATIO:g}.",
        (one, *each),
        below(one, MAX_COST_RATIO),
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
MAX_QUIETER_RATIO = 0.98
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
    return settings(
        paper={
            "kp": "0.5",
            "ki": "0.001, per second and per sample",
            "err1, err2": "0.3, 0.8 (sine of the error: 17 and 53 deg)",
            "sensor": "MPU6050",
            "magnetometer": "none: heading is free",
        },
        ours={
            "noise of the sensor": "0.005 deg/s/sqrt(Hz), 400 ug/sqrt(Hz), from its data sheet",
            "sampling": "200 Hz; gyro range 500 deg/s, once 250; gyro bias left 0.1 deg/s (1 sigma)",
            "vibration": f"{SHAKEN_M_S2:g} m/s^2 RMS an axis, white, at rest",
            "at rest": "60 s on a table tilted by 1 to 3 deg; spread from 20 s on, straight line removed",
            "drop": "up about an edge 15 cm away in 1 s, held 4 s, dropped in 0.3 s, a blow of 2 g",
            "flight": (
                f"take-off, hover, roll on a sine of {AMPLITUDE_DEG:g} deg and "
                f"{PERIOD_S:g} s, on the filter's attitude, by Huang's controller"
            ),
        },
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
        f"interval of the ratio is below {MAX_QUIETER_RATIO:g}.",
        (
            *numbers,
            equal,
            spread,
            none,
            *shaken,
            PaperNumber("largest |e| at rest, of 1", largest, ""),
            PaperNumber("mean |e| under vibration, of 1", shaken_e, ""),
        ),
        combine_verdicts([below(n, MAX_QUIETER_RATIO) for n in numbers]),
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
