"""Fan: accelerometer and magnetometer alone, a Kalman filter with 12 states, a complementary filter, side by side.

The paper prints no noise values, and the Kalman filter's bandwidth follows from them: every claim about its angles is
judged with ours and with random walks three and ten times as large.

All run over the samples of a minute at rest, and of turns by hand to 45 deg both ways about each axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.estimators import get
from attlog.reproduce.bench import (
    AXES,
    COST_METHOD,
    FLOWN_ON_TRUTH,
    FilterOutput,
    FlightSamples,
    count_spikes,
    crossing_s,
    detrended_std,
    flight_samples,
    quick_errors,
    rise_s,
    rms,
    run_filter,
    run_seeds,
    time_updates,
)
from attlog.reproduce.page import filter_lines, points_line, truth_lines
from attlog.reproduce.paper import (
    Claim,
    Measures,
    Paper,
    PaperFigure,
    PaperNumber,
    PaperOptions,
    PaperSetting,
    PaperTable,
    Seeds,
    Verdict,
    above,
    below,
    combine_readings,
    combine_verdicts,
    mean,
    mean_text,
    put_first,
    range_text,
    ratio,
    settings,
    smallest_and_largest,
)
from attlog.simulate.fly import fly
from attlog.simulate.scenario import PrescribedMotion, Scenario, load_scenario
from attlog.simulate.sensor_settings import ImuSettings, MagSettings, SensorSettings
from attlog.words.numbers import listed, quantity

Array = NDArray[np.float64]

RAW, EKF, FILTER = "accel_mag", "ekf12@fan-printed", "complementary@fan"
# Ours, for comparison: the gyro's sample before the vectors turn.
AHEAD = "ekf12@fan"
# Factors on our random walks of gravity and field: the paper leaves the filter's bandwidth open.
WIDER = (1.0, 3.0, 10.0)
REST_S, SETTLED_S, MOVED_S = 60.0, 20.0, 10.0
SPIKE_DEG = 0.5
SENSORS = SensorSettings(imu=(ImuSettings(rate_hz=200.0),), mag=(MagSettings(rate_hz=50.0),))
# From the pivot of a hand's turn to the sensors.
ARM_M = (0.2, 0.0, 0.0)


def wider(factor: float) -> str:
    """Return the Kalman filter with larger random walks of gravity and field."""
    values = {p.name: p.default for p in get("ekf12").parameters}
    walks = (f"{name}={float(values[name]) * factor:g}" for name in ("gravity_noise", "field_noise"))
    return EKF if factor == 1.0 else f"{EKF}:{','.join(walks)}"


EKFS = tuple(map(wider, WIDER))
ROWS = (RAW, FILTER, *EKFS)


def at_rest(seed: int) -> FlightSamples:
    """Return samples of a minute at rest on a table."""
    return flight_samples(
        fly(
            Scenario(name="fan", seconds=REST_S, motion=PrescribedMotion(), sensors=SENSORS, estimator=FLOWN_ON_TRUTH),
            seed,
        )
    )


def turns() -> Scenario:
    """Return the library's rotation about a point 20 cm away, as by a hand."""
    scenario = load_scenario("rotation")
    assert scenario.motion is not None
    return scenario.changed(motion=replace(scenario.motion, arm_m=ARM_M), sensors=SENSORS, estimator=FLOWN_ON_TRUTH)


def hand_turns(seed: int) -> FlightSamples:
    """Return samples of the board turned about each axis."""
    return flight_samples(fly(turns(), seed))


def heading_moves() -> list[tuple[float, float, float, float]]:
    """Return begin, end [s], start and goal [deg] of each turn of the heading."""
    scenario = turns()
    assert scenario.motion is not None
    now, heading, found = 0.0, scenario.place.heading_deg, []
    for move in scenario.motion.move:
        if move.heading_deg is not None:
            found.append((now, now + move.seconds, heading, move.heading_deg))
            heading = move.heading_deg
        now += move.seconds
    return found


def one_seed(seed: int) -> Measures:
    """Run both experiments for one seed.

    By row: ``spread`` of each axis and RMS angle to the true attitude (``rest off``) at rest; of the turns RMS
    ``error`` of each axis, ``turn off``, number of ``spikes`` (errors more than 0.5 deg from their median of 2 s) and
    the largest (``peak``), all in deg; ``delay`` and ``rise`` of heading beyond the true one's in ms.
    """
    still, moved = at_rest(seed), hand_turns(seed)
    found: Measures = {}
    for row in ROWS:
        one = run_filter(row, still)
        late = one.t >= SETTLED_S
        found["rest off", row] = _off(one, SETTLED_S)
        for axis in range(len(AXES)):
            found["spread", row, axis] = detrended_std(one.t[late], one.angles[late, axis])
    for row in (*ROWS, AHEAD):
        one = run_filter(row, moved)
        late = one.t >= MOVED_S
        errors = one.errors[late]
        t, quick = quick_errors(one.t[late], errors)
        count, peak = count_spikes(t, np.asarray(np.max(np.abs(quick), axis=1)), SPIKE_DEG)
        delay, rise = _heading(one)
        found |= {("error", row, axis): rms(errors[:, axis]) for axis in range(len(AXES))}
        found |= {("turn off", row): _off(one, MOVED_S), ("spikes", row): float(count), ("peak", row): peak}
        found |= {("delay", row): delay, ("rise", row): rise}
    return found


def _off(found: FilterOutput, since: float) -> float:
    """Return the RMS angle from the true attitude from ``since`` on."""
    late = found.t >= since
    angle = rotation.total_angle(rotation.earth_error(found.q[late], found.truth[late]))
    return rms(np.asarray(np.degrees(angle)))


def _heading(found: FilterOutput) -> tuple[float, float]:
    """Return delay at half of the way and rise time beyond the true heading's, in ms, means of the turns."""
    truth = np.degrees(np.unwrap(np.arctan2(*_direction(found.truth))))
    own = truth + found.heading_error
    delays, rises = [], []
    for begin, end, start, goal in heading_moves():
        part = (found.t >= begin - 0.5) & (found.t < end + 1.5)
        t = found.t[part]
        answers = []
        for y in (truth[part], own[part]):
            answers.append((crossing_s(t, y, begin, start, goal, 0.5), rise_s(t, y, begin, start, goal)))
        delays.append(answers[1][0] - answers[0][0])
        rises.append(answers[1][1] - answers[0][1])
    return 1e3 * float(np.mean(delays)), 1e3 * float(np.mean(rises))


def _direction(q: Array) -> tuple[Array, Array]:
    """Return east and north of the body's x axis."""
    w, x, y, z = q.T
    return np.asarray(2.0 * (x * y + w * z)), np.asarray(1.0 - 2.0 * (y * y + z * z))


CALLED = {RAW: "raw", FILTER: "complementary filter"} | {
    wider(f): "Kalman filter" if f == 1.0 else f"Kalman filter, walks x {f:g}" for f in WIDER
}
# Claim about the Kalman filter, and its verdict with each of the random walks.
Judged = tuple[Claim, list[Verdict]]


def spreads(found: Seeds, row: str, over: str, axis: int) -> PaperNumber:
    """Return the ratio of two filters' spread of one axis at rest."""
    what = f"spread of {AXES[axis]} at rest, {CALLED[row]} over {CALLED[over]}"
    return found.ratio(what, ("spread", row, axis), ("spread", over, axis))


def by_walk(verdicts: Sequence[Verdict]) -> str:
    """Return with which random walks a claim holds, and with which it is not significant."""
    held, unclear = (
        [f"{f:g}" for f, v in zip(WIDER, verdicts, strict=True) if v == which]
        for which in ("holds", "cannot be judged")
    )
    if len(unclear) == len(WIDER):
        return "with none of the random walks significantly"
    if len(held) in (0, len(WIDER)):
        words = "with every random walk" if held else "with none of the random walks"
    else:
        words = "with our random walks alone" if held == ["1"] else f"with random walks {listed(held)} times ours"
    if not unclear:
        return words
    return f"{words}; not significant with {'ours' if unclear == ['1'] else f'{listed(unclear)} times ours'}"


def exact_claim(found: Seeds) -> Judged:
    """Judge the error of the attitude, at rest and in rotation."""
    wheres = (("at rest", "rest off"), ("in rotation", "turn off"))
    numbers = [
        [
            found.ratio(
                f"error of the attitude {where}, {CALLED[row]} over complementary filter", (key, row), (key, FILTER)
            )
            for where, key in wheres
        ]
        for row in EKFS
    ]
    verdicts = [combine_verdicts([below(n, 1.0) for n in pair]) for pair in numbers]
    own = [
        found.mean(f"error of the attitude {where}, complementary filter", "deg", key, FILTER) for where, key in wheres
    ]
    pairs = [n for pair in numbers for n in pair]
    claim = Claim(
        "exact",
        "The Kalman filter's attitude is the more exact one.",
        "section 6",
        "RMS of the whole angle to the true attitude, Kalman over complementary filter. Holds if the intervals at rest "
        "and in rotation are below 1.",
        put_first(smallest_and_largest(pairs), (*pairs, *own)),
        combine_readings(verdicts),
        f"It holds {by_walk(verdicts)}. The ratios are {range_text(pairs, 'ratio')}. The Kalman filter has no gyro "
        "bias among its states: with a narrow band a bias tilts it. The complementary filter's gain of 3 leaves little "
        "of it.",
        shown=2,
    )
    return claim, verdicts


def cost_claim(spent: dict[str, list[float]]) -> Claim:
    """Judge the time per update; ``spent`` of :func:`time_updates`."""
    one = ratio("time per update, Kalman over complementary filter", spent[EKF], spent[FILTER])
    each = [mean(f"time per update, {CALLED[row]}", spent[row], "ns") for row in (EKF, FILTER)]
    return Claim(
        "dearer",
        "The Kalman filter needs many matrix operations, the complementary filter little computation.",
        "sections 5, 6",
        f"{COST_METHOD} Holds if the interval of the ratio is above 1.",
        (one, *each),
        above(one, 1.0),
        f"An update takes {quantity(each[0].value, 'ns')} and {quantity(each[1].value, 'ns')}. The sparse blocks of "
        "(11) are used: with dense matrices the ratio would be larger. Times are of this machine.",
    )


AXIS_TITLES = tuple(f"{axis}, deg" for axis in AXES)


def paper_figures(found: Seeds, called: Mapping[str, str], seed: int = 0) -> tuple[PaperFigure, ...]:
    """Draw rest, rotation, its errors, and the spread at rest over all seeds."""
    still, moved = at_rest(seed), hand_turns(seed)
    rows = {row: called[row] for row in (RAW, FILTER, EKF)}
    return (
        PaperFigure(
            "rest",
            "fig. 4a, 5a",
            "At rest",
            "The first seed. Hide the raw angles to see the others.",
            "time, s",
            AXIS_TITLES,
            (*truth_lines(still), *filter_lines(still, rows)),
            height=460,
        ),
        PaperFigure(
            "turned",
            "fig. 4b, 5b",
            "By hand to 45 deg both ways about each axis",
            "The first seed.",
            "time, s",
            AXIS_TITLES,
            (*truth_lines(moved), *filter_lines(moved, rows)),
            height=460,
        ),
        PaperFigure(
            "errors",
            "fig. 5b",
            "How far off in rotation",
            "What was found minus the truth.",
            "time, s",
            tuple(f"{axis} error, deg" for axis in AXES),
            tuple(filter_lines(moved, rows, errors=True)),
            height=460,
        ),
        _spread_figure(found, called),
    )


def _spread_figure(found: Seeds, called: Mapping[str, str]) -> PaperFigure:
    lines = []
    for row in ROWS[1:]:
        spreads = [found.mean("", "deg", "spread", row, axis) for axis in range(len(AXES))]
        lines.append(points_line(called[row], range(len(AXES)), spreads))
    return PaperFigure(
        "spread",
        "fig. 5a",
        "Spread at rest by axis and by the Kalman filter's random walks",
        "Means over seeds with their intervals; raw angles (several times as much) are in the table.",
        "",
        ("standard deviation, deg",),
        tuple(lines),
        "points",
        AXES,
        300,
    )


# Small: less than half of the raw angles' spread.
SMALL = 0.5


def paper(options: PaperOptions) -> Paper:
    """Measure Fan's claims."""
    found = Seeds(run_seeds("bench", one_seed, options))
    spent = time_updates((FILTER, EKF, AHEAD))
    judged = [_small_claim(found), _yaw_claim(found), _spikes_claim(found), _sooner_claim(found), exact_claim(found)]
    return Paper(
        "fan",
        "Attitude by extended Kalman filter and by complementary filter, compared",
        "Fan Dongsheng, Zhang Xu, Ren Wei, Huang Longliang, Chen Qi, 2021 (in Chinese), "
        "DOI 10.12252/j.issn.2096-6261.2021.12.538",
        _settings(),
        (_raw_claim(found), *(claim for claim, _ in judged), cost_claim(spent)),
        paper_figures(found, CALLED),
        (_table(found),),
        (
            "The paper gives no noise values for its Kalman filter. They decide how fast it follows accelerometer "
            "and magnetometer: with ours (the defaults of ekf12) 0.14 rad/s. So each claim is judged with random walks "
            "of gravity and field 1, 3 and 10 times ours.",
            _jointly([verdicts for _, verdicts in judged]),
            "The complementary filter compares the whole field vector, as printed. So the magnetometer's noise reaches "
            "roll and pitch.",
        ),
        seeds=options.seeds,
    )


def _settings() -> tuple[PaperSetting, ...]:
    return settings(
        paper={
            "complementary filter": "kp 3, ki 0.01 (per second), first-order step",
            "Kalman filter": "12 states: rate, its derivative, gravity, field; order of (10)",
            "start of the Kalman filter": "q = (1, 0, 0, 0), printed for the other filter",
        },
        ours={
            "start of the complementary filter": (
                "the first vectors: from q = (1, 0, 0, 0) its integral would keep a wrong heading for kp / ki = 300 s"
            ),
            "noise of the Kalman filter": (
                "per sqrt(Hz): gyro 2e-4 rad/s, accelerometer 0.5 m/s^2, field 5 %; "
                "walks per sqrt(s): gravity 0.07 m/s^2, field 0.75 %"
            ),
            "at rest": f"{REST_S:g} s; standard deviation from {SETTLED_S:g} s on, straight line removed",
            "rotation": f"45 deg both ways about each axis in 1.5 s, by hand about a point {100 * ARM_M[0]:g} cm away",
            "sensors": (
                "IMU 200 Hz: 0.006 deg/s/sqrt(Hz), 150 ug/sqrt(Hz), gyro bias 0.1 deg/s (1 sigma); "
                "magnetometer 50 Hz: 0.05 uT/sqrt(Hz)"
            ),
        },
    )


def _jointly(verdicts: Sequence[Sequence[Verdict]]) -> str:
    """Return the number of claims that hold with one and the same random walks."""
    counts = [sum(one[k] == "holds" for one in verdicts) for k in range(len(WIDER))]
    parts = [
        f"{count} with {CALLED[wider(f)].partition(', ')[2] or 'ours'}" for f, count in zip(WIDER, counts, strict=True)
    ]
    most = f"No set gives all {len(verdicts)}" if max(counts) < len(verdicts) else f"One gives all {len(verdicts)}"
    return f"Claims that hold at once: {listed(parts)}. {most}."


def _raw_claim(found: Seeds) -> Claim:
    rest = [spreads(found, RAW, row, axis) for row in (FILTER, *EKFS) for axis in range(3)]
    turned = [
        found.ratio(f"largest quick error in rotation, raw over {CALLED[row]}", ("peak", RAW), ("peak", row))
        for row in (FILTER, *EKFS)
    ]
    return Claim(
        "raw",
        "Angles from accelerometer and magnetometer alone are the worst, at rest and in rotation.",
        "fig. 4, section 5",
        "Ratio of standard deviations at rest by axis, and of the largest quick errors in rotation. A quick error is "
        "the error's distance from its own median of 2 s. Holds if all intervals are above 1.",
        put_first((smallest_and_largest(rest)[0], smallest_and_largest(turned)[0]), (*rest, *turned)),
        combine_verdicts([above(n, 1.0) for n in (*rest, *turned)]),
        f"At rest they scatter {range_text(rest, 'ratio')} as much. Their largest quick errors in rotation are "
        f"{range_text(turned, 'ratio')} as large.",
        shown=2,
    )


def _small_claim(found: Seeds) -> Judged:
    own = [spreads(found, FILTER, RAW, axis) for axis in range(len(AXES))]
    numbers = [[spreads(found, row, RAW, axis) for axis in range(len(AXES))] for row in EKFS]
    verdicts = [combine_verdicts([below(n, SMALL) for n in (*own, *three)]) for three in numbers]
    every = [n for three in (own, *numbers) for n in three]
    claim = Claim(
        "small",
        "At rest the angles of both filters scatter little.",
        "fig. 5a",
        "Ratio of standard deviations at rest, each filter's over the raw angles', by axis. Little is below "
        f"{SMALL:g}: holds if all intervals are.",
        put_first(
            (smallest_and_largest(own)[1], smallest_and_largest([n for three in numbers for n in three])[1]), every
        ),
        combine_readings(verdicts),
        f"It holds {by_walk(verdicts)}. The complementary filter has {range_text(own, 'ratio')} of the raw spread, the "
        f"Kalman filter {range_text([n for three in numbers for n in three], 'ratio')}.",
        shown=2,
    )
    return claim, verdicts


def _yaw_claim(found: Seeds) -> Judged:
    numbers = [spreads(found, row, FILTER, 2) for row in EKFS]
    verdicts = [above(n, 1.0) for n in numbers]
    claim = Claim(
        "yaw",
        "At rest the Kalman filter's heading scatters slightly more than the complementary filter's.",
        "fig. 5a",
        "Ratio of standard deviations of heading at rest, Kalman over complementary filter. Holds if the interval is "
        "above 1.",
        tuple(numbers),
        combine_readings(verdicts),
        f"It holds {by_walk(verdicts)}. Its spread is {quantity(numbers[0].value, 'ratio')} with ours, "
        f"{range_text(numbers[1:], 'ratio')} with wider ones.",
        shown=len(numbers),
    )
    return claim, verdicts


def _spikes_claim(found: Seeds) -> Judged:
    peaks = [
        found.ratio(
            f"largest quick error in rotation, complementary filter over {CALLED[row]}", ("peak", FILTER), ("peak", row)
        )
        for row in EKFS
    ]
    counts = [found.mean(f"spikes in rotation, {CALLED[row]}", "", "spikes", row) for row in (FILTER, *EKFS)]
    verdicts = [above(n, 1.0) for n in peaks]
    own = found.mean("largest quick error, complementary filter", "deg", "peak", FILTER)
    claim = Claim(
        "spikes",
        "In rotation the complementary filter shows spikes that the Kalman filter does not.",
        "fig. 5b",
        f"A spike is an error {SPIKE_DEG:g} deg off its own median of 2 s. Spikes are counted, the largest is kept. "
        "Holds if the ratio of the largest values is above 1.",
        (*peaks, *counts, own),
        combine_readings(verdicts),
        f"It holds {by_walk(verdicts)}. The complementary filter has {counts[0].value:.1f} spikes of up to "
        f"{quantity(own.value, 'deg')}. The Kalman filter has {listed([f'{n.value:.1f}' for n in counts[1:]])} with "
        "walks 1, 3 and 10 times ours. The faster a filter follows the accelerometer, the more it takes the hand's "
        "acceleration for a tilt.",
        shown=len(peaks),
    )
    return claim, verdicts


def _sooner_claim(found: Seeds) -> Judged:
    delays = [
        found.difference(
            f"heading half way, {CALLED[row]} after complementary filter", "ms", ("delay", row), ("delay", FILTER)
        )
        for row in EKFS
    ]
    rises = [
        found.mean(f"rise (10 to 90 %) beyond the true one's, {CALLED[row]}", "ms", "rise", row)
        for row in (FILTER, *EKFS)
    ]
    order = "heading half way, printed order after the gyro's sample first (ekf12@fan)"
    ahead = found.difference(order, "ms", ("delay", EKF), ("delay", AHEAD))
    verdicts = [below(n, 0.0) for n in delays]
    claim = Claim(
        "sooner",
        "The Kalman filter's heading answers a turn a little sooner.",
        "fig. 5b",
        "When heading has gone half of each of three turns (45 and 90 deg). Holds if the interval of the difference is "
        "below 0.",
        (*delays, ahead, *rises),
        combine_readings(verdicts),
        f"It holds {by_walk(verdicts)}. The difference is {quantity(delays[0].value, 'ms')} with ours, "
        f"{range_text(delays[1:], 'ms')} with wider ones. As printed the vectors turn by the rate of the sample "
        f"before. That alone costs {quantity(ahead.value, 'ms')}, one sample.",
        shown=len(delays),
    )
    return claim, verdicts


def _table(found: Seeds) -> PaperTable:
    rows = []
    for row in (RAW, FILTER, *EKFS):
        cells = [mean_text(found.of(key, row, axis), "deg") for key in ("spread", "error") for axis in range(3)]
        rows.append((CALLED[row], *cells))
    head = ("filter", *(f"{a}, at rest" for a in AXES), *(f"{a}, error in rotation" for a in AXES))
    return PaperTable(
        "Spread at rest and error in rotation",
        head,
        tuple(rows),
        "Means over seeds: standard deviation at rest about a straight line, RMS error in rotation.",
    )
