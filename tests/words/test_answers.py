"""The four answers in a line each."""

from __future__ import annotations

from dataclasses import replace

import pytest

from attlog.metrics.gyro_bias import CommonBias
from attlog.metrics.metric import SpanAnswer, missing
from attlog.result import Check, Result
from attlog.words.answers import AnswerLine, answer_lines, verdicts
from tests.words.made import (
    DRIFT_AIR,
    DRIFT_REST,
    LAG,
    NOISE,
    TILT,
    absent,
    drift,
    lag,
    merged,
    noise,
    result,
    row,
    sentence,
    step,
    tilt,
    verdict,
)


def brief(question: str, made: Result) -> str:
    """The answer without the onboard attitude."""
    return answer_lines(made)[question].text


def rows(*values: float) -> list:
    return [row(name, tilt(value)) for name, value in zip(("a", "b", "c", "d"), values, strict=False)]


def test_who_is_best_stands_first_and_all_others_are_a_range() -> None:
    assert brief("accuracy", result(rows(0.4, 1.2, 0.9), {TILT: ["a"]})) == "Tilt: A 0.40°, others 0.90 to 1.2°."
    assert brief("accuracy", result(rows(0.4, 1.2), {TILT: ["a"]})) == "Tilt: A 0.40°, B 1.2°."


def test_filters_that_do_not_differ_significantly_are_said_so() -> None:
    tied = result(rows(0.4, 0.5, 3.2), {TILT: ["a", "b"]})
    assert brief("accuracy", tied) == "Tilt: A and B best (0.40 to 0.50°), C 3.2°."
    assert brief("accuracy", result(rows(0.4, 0.5, 0.6))) == "Tilt: all 3 filters 0.40 to 0.60° (not significant)."


def test_a_filter_alone_has_its_interval() -> None:
    assert brief("accuracy", result(rows(0.5))) == "Tilt: A 0.50° (0.45 to 0.55)."


def test_of_several_the_only_ranked_one_does_not_read_as_the_winner() -> None:
    made = result([*rows(0.5), row("b", absent(TILT, "airborne", "not_converged", "did not settle"))])
    assert brief("accuracy", made).startswith("Tilt: A alone is ranked: 0.50°")


def test_filters_that_diverged_stand_beside_the_range_of_the_others() -> None:
    made = result([*rows(0.3, 1.2), row("c", tilt(31.0), status="diverged")])
    made.ranked = {}
    assert brief("accuracy", made).endswith("tilt 0.30 to 1.2°; C diverged.")


def test_noise_says_in_which_phase_it_was_measured() -> None:
    made = result([row("a", noise(0.01, "hover")), row("b", noise(0.03, "hover"))], {NOISE: ["a"]})
    assert brief("noise", made) == "Added in hover: A 0.010°, B 0.030°."


def test_lags_that_can_be_measured_stand_before_the_bound_of_all_others() -> None:
    made = result([row("a", lag(40)), row("b", lag(0)), row("c", lag(3, floor=5.0))])
    assert brief("lag", made) == "A +40 ms; B and C below 4 ms (28 steps)."
    assert brief("lag", result([row("a", lag(0)), row("b", lag(1))])) == "A and B below 2 ms (28 steps)."
    ahead = result([row("a", lag(-40)), row("b", lag(0))])
    assert brief("lag", ahead) == "A \N{MINUS SIGN}40 ms; B below 1 ms (28 steps)."


def test_a_drift_is_told_where_its_interval_excludes_zero_in_the_air_only_without_a_rest() -> None:
    made = [row("a", drift(4.0)), row("b", drift(0.05)), row("c", drift(-0.1, 0.3))]
    assert brief("yaw_drift", result(made)) == "At rest A +4.0°/min; B and C below 0.40°/min."
    air = [row("a", drift(4.0, against="truth")), row("b", drift(0.0, against="truth"))]
    assert brief("yaw_drift", result(air, reference="truth")) == "In flight A +4.0°/min; B below 0.10°/min."


def test_the_onboard_attitude_is_added_where_it_fits() -> None:
    made = result([*rows(0.4, 1.2), row("onboard", tilt(0.9))], {TILT: ["a"]}, reference="truth")
    found = answer_lines(made)["accuracy"]
    assert found.within(70) == "Tilt: A 0.40°, B 1.2°. Onboard 0.90°."
    assert found.within(30) == "Tilt: A 0.40°, B 1.2°."
    assert AnswerLine("ab", found.column, "cd", "ef.").within(5) == "ab cd"
    assert AnswerLine("ab", found.column, "cd", "ef.").sentence == "ab cd ef."


def test_what_has_no_answer_says_why_and_what_is_not_ranked_shows_its_range() -> None:
    made = result([row("a", absent(LAG, "airborne", "no_events", "no step in flight; fly some"))])
    assert brief("lag", made) == "Cannot be determined: no step in flight."
    assert brief("noise", result([])) == "Cannot be determined: no filter was run."
    alone = result([row("gyro", tilt(1.0))])
    assert brief("accuracy", alone) == "Cannot be determined: only Gyro was run, which is never ranked."
    assert not verdict("accuracy", alone).answered
    unranked = result([row("a", tilt(0.4, ranked=False)), row("b", tilt(0.7, ranked=False))])
    assert brief("accuracy", unranked) == "Not ranked (too little data in common): tilt 0.40 to 0.70°."


def test_a_sensor_that_spoils_all_filters_is_named_in_each_answer_that_has_a_value() -> None:
    made = result([row("a", drift(4.0)), row("b", drift(0.05))], {DRIFT_REST: ["b"]})
    made.checks = [Check("accelerometer_rest", "fault", "It is 14 m/s^2.", 14.0)]
    assert brief("yaw_drift", made) == "Unreliable, the accelerometer is wrong: At rest A +4.0°/min; B below 0.15°/min."
    assert brief("noise", made) == "Cannot be determined: no filter was run."


def test_a_bound_that_excludes_nothing_is_called_uncertain() -> None:
    made = [row("a", drift(40.0, 9.0)), row("b", drift(1.0, 20.0)), row("c", drift(-2.0, 20.0))]
    assert brief("yaw_drift", result(made)) == "At rest A +40.0°/min; others uncertain (up to 22.0°/min)."
    assert brief("yaw_drift", result(made[1:])) == "At rest uncertain, up to 22.0°/min is possible."


def test_all_are_said_only_of_all_rows_of_the_table() -> None:
    made = result([*rows(0.4, 0.5, 0.6), row("e", tilt(5.0), status="diverged")])
    assert brief("accuracy", made) == "Tilt: all 3 ranked filters 0.40 to 0.60° (not significant)."


def test_filters_that_all_come_before_what_flew_are_said_to_be_ahead_of_it() -> None:
    early = result([row("a", lag(-7)), row("b", lag(-6)), row("c", lag(-7))])
    assert brief("lag", early) == "All 3 filters 6 to 7 ms ahead of onboard (28 steps)."


def test_filters_that_are_all_lost_are_said_so_once() -> None:
    made = result([row(name, tilt(50.0), status="diverged") for name in ("a", "b")])
    assert brief("accuracy", made) == "Cannot be determined: all 2 filters diverged."


def test_a_drift_of_the_onboard_attitude_is_a_number_only_where_it_is_significant() -> None:
    def onboard(value: float, width: float) -> str:
        made = result([row("a", drift(0.1)), row("b", drift(0.0)), row("onboard", drift(value, width))])
        return answer_lines(made)["yaw_drift"].onboard

    assert onboard(6.9, 1.0) == "Onboard +6.9°/min."
    assert onboard(2.1, 4.0) == "Onboard below 6.1°/min."
    assert onboard(6.9, 11.6) == ""


# All four answers.


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


def test_a_gyro_that_reads_wrong_is_in_every_answer_and_its_numbers_in_the_notes() -> None:
    made = result([row("a", noise(0.01))])
    made.checks = [Check("gyro_bias", "fault", "At rest -24.34, -23.28, 2.62 deg/s about x, y, z.")]
    found = verdict("noise", made)
    assert found.sentence.startswith("Unreliable, the gyro is wrong: At rest A")
    assert found.notes[0] == "The gyro is wrong: At rest −24.34, −23.28, 2.62°/s about x, y, z."
    made.gyro_bias = [CommonBias("rest", "rest", dps=[-24.2, -24.1, 2.5])]
    assert not sentence("noise", made).startswith("Unreliable"), "it was subtracted"
    made.estimators[0].status = "not_judged"
    assert sentence("noise", made).startswith("Unreliable")
    made.estimators[0].status = "ok"
    made.checks[0].verdict = "warning"
    assert not sentence("noise", made).startswith("Unreliable")


def test_a_filter_that_failed_is_not_blamed_on_the_log() -> None:
    few = absent(NOISE, "rest", "rest_too_short", "rest too short")
    nan = row("nan", few, status="failed", reason="returned NaN from 0.0 s on")
    assert "Nan: returned NaN from 0.0 s on." in verdict("noise", result([nan, row("a", noise(0.01))])).notes
    assert sentence("noise", result([nan])) == "Cannot be determined: returned NaN from 0.0 s on."


def test_a_filter_that_misses_the_step_is_named_beside_its_lag() -> None:
    rows = [row("a", merged(lag(0), step(8.0, -30.0))), row("b", merged(lag(0), step(0.1, 1.0)))]
    assert sentence("lag", result(rows)).endswith("(28 steps). A is 30 % short after 0.5 s.")
    rows[1].metrics["airborne"]["step_error_pct.0.5s"].value = 12.0
    assert sentence("lag", result(rows)).endswith("2 filters are up to 30 % off after 0.5 s.")


@pytest.mark.parametrize(
    ("verdict_", "ms", "late"),
    [("warning", 21.0, True), ("fault", 80.0, True), ("ok", 21.0, False), ("warning", -9.0, False)],
)
def test_an_imu_that_is_late_makes_every_filter_late(verdict_: str, ms: float, late: bool) -> None:
    made = result([row("a", lag(0))])
    made.checks = [Check("imu_delay", verdict_, "x", ms, "ms")]
    assert (f"The IMU itself is {ms:.0f} ms late, and every filter with it." in sentence("lag", made)) == late


@pytest.mark.parametrize(
    ("present", "quoted", "doubtful"),
    [(("onboard", "truth"), "truth", False), (("onboard", "mag"), "onboard", False), (("course", "mag"), "mag", True)],
)
def test_one_heading_reference_is_quoted_whatever_it_ranks(present, quoted: str, doubtful: bool) -> None:
    made = result([row(n, merged(*(drift(v, against=p) for p in present))) for n, v in (("a", 1.0), ("b", 2.0))])
    made.checks = [Check("field", "fault", "x")]
    found = verdict("yaw_drift", made)
    assert found.metric == f"{DRIFT_AIR}.{quoted}"
    assert ("in doubt: its field is wrong" in found.sentence) == doubtful


# Notes: what was measured, and who is not ranked.


def test_rows_with_the_same_reason_stand_together_and_the_reference_itself_is_left_out() -> None:
    itself = {"airborne": {LAG: missing("not_applicable", "it is the reference itself", "ms", "airborne")}}
    few = absent(LAG, "airborne", "too_few_events", "2 steps; at least 3 are needed")
    rows = [row("a", few), row("b", few), row("onboard", itself, is_reference=True)]
    assert verdict("lag", result(rows)).notes == [
        "Fly some more brisk steps in roll, pitch and yaw.",
        "All filters: 2 steps; at least 3 are needed.",
    ]
    assert verdict("lag", result([*rows, row("c", lag(0))])).notes == ["A and B: 2 steps; at least 3 are needed."]


def test_accuracy_notes_hold_the_reference_its_doubts_and_the_time() -> None:
    made = result([row("a", tilt(1.0)), row("b", tilt(2.0))], reference="smoother")
    made.reference.sigma_tilt_deg, made.reference.heading_by = 0.12, "onboard"
    made.reference.text, made.reference.caveat = "Own sigma 0.12 deg.", "in doubt: own tilt sigma 1.8 deg; no heading"
    made.estimators = [replace(r, uses_mag=False) for r in made.estimators]
    assert verdict("accuracy", made).notes == [
        "Own sigma 0.12°.",
        "In doubt: own tilt sigma 1.8°.",
        "No heading.",
        "Headings are compared with onboard (agreement, not truth).",
        "RMS error in the air, 60 s, against the smoother (sigma 0.12°).",
        "Without a compass filters know no north: each heading counts from the start.",
    ]


def test_noise_notes_hold_the_phases_and_the_gyros_own_noise_where_it_is_larger() -> None:
    quiet = [row(n, merged(noise(v, "hover", gyro_share=0.3), noise(v, "cruise"))) for n, v in (("a", 0.1), ("b", 0.2))]
    assert verdict("noise", result(quiet)).notes == [
        "In hover: 28 windows of 5 s.",
        "In moving flight: 28 windows of 5 s.",
        "The gyro's own noise is about 0.30°.",
    ]


@pytest.mark.parametrize(
    ("ms", "note"),
    [
        (11.0, "The logged IMU itself comes 11 ms late; that is not counted as lag."),
        (0.2, "No delay of the logged IMU is known; lags are taken as they are."),
    ],
)
def test_the_delay_of_the_logged_imu_is_a_note(ms: float, note: str) -> None:
    made = result([row("a", lag(0))])
    made.estimators[0].metrics["airborne"][LAG].taken_out = ms
    assert note in verdict("lag", made).notes


def test_every_rest_is_a_note_with_what_could_be_used_of_it() -> None:
    made = result([row("a", drift(1.0))], place={"earth_turn_deg_per_min": 0.15})
    made.estimators[0].metrics["rest"][DRIFT_REST].records = [
        SpanAnswer(0.0, 14.2, 0.0, reason="0 s after settling; 8 are needed"),
        SpanAnswer(700.0, 736.0, 31.0, 1.0, (0.9, 1.1)),
    ]
    assert verdict("yaw_drift", made).notes == [
        "Rest from 0.0 s to 14.2 s: 0 s after settling; 8 are needed.",
        "Rest from 0:11:40 to 0:12:16: 31 s usable.",
        "The earth itself turns by +0.15°/min here.",
    ]


def test_both_reasons_for_no_drift_are_notes_with_advice_on_the_rest() -> None:
    metrics = merged(
        absent(DRIFT_REST, "rest", "no_rest", "No rest."),
        absent(f"{DRIFT_AIR}.onboard", "airborne", "record_too_short", "8 s in the air; 20 are needed"),
    )
    found = verdict("yaw_drift", result([row("a", metrics)], advice={"rest": "Set LOG_DISARMED to 1"}))
    assert found.sentence == "Cannot be determined: no rest."
    assert found.notes[0] == "Set LOG_DISARMED to 1."
    assert found.notes[1:] == ["A: at rest, No rest.", "A: in the air, 8 s in the air; 20 are needed."]
