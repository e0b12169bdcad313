"""The four answers and their notes: results made for each situation, and a file of what is said of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from attlog.metrics.gyro_bias import CommonBias
from attlog.metrics.metric import SpanAnswer, missing
from attlog.result import Check, EstimatorRow, Result
from attlog.words.answers import AnswerLine, answer_lines, verdicts
from tests.golden import check_golden
from tests.words.made import (
    DRIFT_AIR,
    DRIFT_REST,
    LAG,
    NOISE,
    TILT,
    Metrics,
    absent,
    drift,
    lag,
    merged,
    noise,
    result,
    row,
    step,
    tilt,
    verdict,
)

GOLDEN = Path(__file__).parent / "golden" / "answers.txt"
Situation = tuple[str, str, Result]


def rows(*values: float) -> list[EstimatorRow]:
    return [row(name, tilt(value)) for name, value in zip(("a", "b", "c", "d"), values, strict=False)]


def each(*metrics: Metrics) -> list[EstimatorRow]:
    return [row(name, found) for name, found in zip("abc", metrics, strict=False)]


def checked(made: Result, *checks: Check, **changes: object) -> Result:
    made.checks = list(checks)
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def tilts() -> Iterator[Situation]:
    q = "accuracy"
    yield "one best, others a range", q, result(rows(0.4, 1.2, 0.9), {TILT: ["a"]})
    yield "one best of two", q, result(rows(0.4, 1.2), {TILT: ["a"]})
    yield "two best", q, result(rows(0.4, 0.5, 3.2), {TILT: ["a", "b"]})
    yield "an uncertain one as good, a sure one worse", q, result(rows(0.4, 1.6, 0.8, 4.3), {TILT: ["a", "b"]})
    yield "two uncertain ones as good, one worse", q, result(rows(0.4, 1.5, 1.6, 0.8), {TILT: ["a", "b", "c"]})
    yield "none significantly better", q, result(rows(0.4, 0.5, 0.6))
    yield "one filter, with its interval", q, result(rows(0.5))
    unsettled = row("b", absent(TILT, "airborne", "not_converged", "did not settle"))
    yield "one ranked of two is no winner", q, result([*rows(0.5), unsettled])
    diverged = result([*rows(0.3, 1.2), row("c", tilt(31.0), status="diverged")])
    diverged.ranked = {}
    yield "not ranked, and one diverged", q, diverged
    yield "all ranked, one diverged", q, result([*rows(0.4, 0.5, 0.6), row("e", tilt(5.0), status="diverged")])
    yield "all diverged", q, result([row(name, tilt(50.0), status="diverged") for name in ("a", "b")])
    yield "the gyro alone", q, result([row("gyro", tilt(1.0))])
    yield "no value is ranked", q, result(each(tilt(0.4, ranked=False), tilt(0.7, ranked=False)))
    made = result(rows(1.0, 2.0), reference="smoother")
    assert made.reference is not None
    made.reference.sigma_tilt_deg, made.reference.heading_by = 0.12, "onboard"
    made.reference.text, made.reference.caveat = "Own sigma 0.12 deg.", "in doubt: own tilt sigma 1.8 deg; no heading"
    made.estimators = [replace(r, uses_mag=False) for r in made.estimators]
    yield "a smoother in doubt, no compass", q, made


def noises() -> Iterator[Situation]:
    q = "noise"
    yield "in hover", q, result(each(noise(0.01, "hover"), noise(0.03, "hover")), {NOISE: ["a"]})
    quiet = [merged(noise(v, "hover", gyro_share=0.3), noise(v, "cruise")) for v in (0.1, 0.2)]
    yield "below the gyro's own noise", q, result(each(*quiet))
    yield "no filter", q, result([])
    few = absent(NOISE, "rest", "rest_too_short", "rest too short")
    nan = row("nan", few, status="failed", reason="returned NaN from 0.0 s on")
    yield "a filter failed", q, result([nan])
    yield "a filter failed beside another", q, result([nan, row("a", noise(0.01))])
    bad = Check("gyro_bias", "fault", "At rest -24.34, -23.28, 2.62 deg/s about x, y, z.")
    taken = [CommonBias("rest", "rest", dps=[-24.2, -24.1, 2.5])]
    yield "the gyro is wrong", q, checked(result(each(noise(0.01))), bad)
    yield "its bias was subtracted", q, checked(result(each(noise(0.01))), bad, gyro_bias=taken)
    unjudged = result(each(noise(0.01)))
    unjudged.estimators[0].status = "not_judged"
    yield "subtracted, but filters were not judged", q, checked(unjudged, bad, gyro_bias=taken)
    yield "a warning of the gyro", q, checked(result(each(noise(0.01))), replace(bad, verdict="warning"))


def lags() -> Iterator[Situation]:
    q = "lag"
    yield "one late", q, result(each(lag(40), lag(0), lag(3, floor=5.0)))
    yield "none late", q, result(each(lag(0), lag(1)))
    yield "one early", q, result(each(lag(-40), lag(0)))
    yield "all ahead of onboard", q, result(each(lag(-7), lag(-6), lag(-7)))
    yield "no step", q, result(each(absent(LAG, "airborne", "no_events", "no step in flight; fly some")))
    short = each(merged(lag(0), step(8.0, -30.0)), merged(lag(0), step(0.1, 1.0)))
    yield "one short of the step", q, result(short)
    yield "two off", q, result([short[0], row("b", merged(lag(0), step(0.1, 12.0)))])
    for ms, grade in ((21.0, "warning"), (80.0, "fault"), (21.0, "ok"), (-9.0, "warning")):
        imu = Check("imu_delay", grade, "x", ms, "ms")
        yield f"IMU late by {ms:g} ms, {grade}", q, checked(result(each(lag(0))), imu)
    for ms in (11.0, 0.2):
        made = result(each(lag(0)))
        made.estimators[0].metrics["airborne"][LAG].taken_out = ms
        yield f"known delay of {ms:g} ms", q, made
    itself = {"airborne": {LAG: missing("not_applicable", "it is the reference itself", "ms", "airborne")}}
    few = absent(LAG, "airborne", "too_few_events", "2 steps; at least 3 are needed")
    no_lag = [*each(few, few), row("onboard", itself, is_reference=True)]
    yield "too few steps", q, result(no_lag)
    yield "too few steps of two filters", q, result([*no_lag, row("c", lag(0))])


def drifts() -> Iterator[Situation]:
    q = "yaw_drift"
    still = each(drift(4.0), drift(0.05), drift(-0.1, 0.3))
    yield "one drifts", q, result(still)
    air = each(drift(4.0, against="truth"), drift(0.0, against="truth"))
    yield "in the air", q, result(air, reference="truth")
    wide = each(drift(40.0, 9.0), drift(1.0, 20.0), drift(-2.0, 20.0))
    yield "bounds that exclude nothing, beside a drift", q, result(wide)
    yield "bounds that exclude nothing", q, result(wide[1:])
    force = Check("accelerometer_rest", "fault", "It is 14 m/s^2.", 14.0)
    yield "the accelerometer is wrong", q, checked(result(still[:2], {DRIFT_REST: ["b"]}), force)
    yield "the accelerometer is wrong, no filter", q, checked(result([]), force)
    for value, width in ((6.9, 1.0), (2.1, 4.0), (6.9, 11.6)):
        name = f"onboard {value:g} +- {width:g}"
        yield name, q, result([*each(drift(0.1), drift(0.0)), row("onboard", drift(value, width))])
    for there in (("onboard", "truth"), ("onboard", "mag"), ("course", "mag")):
        made = result(each(*(merged(*(drift(v, against=p) for p in there)) for v in (1.0, 2.0))))
        yield f"references {' and '.join(there)}", q, checked(made, Check("field", "fault", "x"))
    rests = result(each(drift(1.0)), place={"earth_turn_deg_per_min": 0.15})
    rests.estimators[0].metrics["rest"][DRIFT_REST].records = [
        SpanAnswer(0.0, 14.2, 0.0, reason="0 s after settling; 8 are needed"),
        SpanAnswer(700.0, 736.0, 31.0, 1.0, (0.9, 1.1)),
    ]
    yield "two rests", q, rests
    nothing = merged(
        absent(DRIFT_REST, "rest", "no_rest", "No rest."),
        absent(f"{DRIFT_AIR}.onboard", "airborne", "record_too_short", "8 s in the air; 20 are needed"),
    )
    yield "no rest, and a short flight", q, result(each(nothing), advice={"rest": "Set LOG_DISARMED to 1"})


def test_answers_and_notes_are_as_reviewed() -> None:
    lines = []
    for name, question, made in (*tilts(), *noises(), *lags(), *drifts()):
        found = verdict(question, made)
        mark = "" if found.answered else " (not answered)"
        lines += [f"{question}, {name}: {found.metric}{mark}", f"  {found.sentence}"]
        lines += [f"  - {note}" for note in found.notes]
    check_golden(GOLDEN, lines)


def test_the_onboard_attitude_is_added_where_it_fits() -> None:
    made = result([*rows(0.4, 1.2), row("onboard", tilt(0.9))], {TILT: ["a"]}, reference="truth")
    found = answer_lines(made)["accuracy"]
    assert found.within(70) == "Tilt: A 0.40°, B 1.2°. Onboard 0.90°."
    assert found.within(30) == "Tilt: A 0.40°, B 1.2°."
    assert AnswerLine("ab", found.column, "cd", "ef.").within(5) == "ab cd"
    assert AnswerLine("ab", found.column, "cd", "ef.").sentence == "ab cd ef."


def test_nothing_at_all_still_gives_four_answers() -> None:
    found = verdicts(Result({}, "", {}, {}))
    assert [v.question for v in found] == ["accuracy", "noise", "lag", "yaw_drift"]
    assert all(v.sentence == "Cannot be determined: no filter was run." for v in found)


def test_answers_stay_short_with_many_filters() -> None:
    every = [
        merged(tilt(i + 1.0, i + 2.0), noise(0.01 * (i + 1)), lag(3.0 * i), step(i + 0.1, -i * 3), drift(i, 0.5))
        for i in range(20)
    ]
    many = [row(f"filter{i}@preset", metrics) for i, metrics in enumerate(every)]
    best = dict.fromkeys((TILT, NOISE, LAG, DRIFT_REST), [r.name for r in many][:4])
    for found in verdicts(result(many, best, reference="truth")):
        assert len(found.sentence.split()) <= 30, found.sentence
