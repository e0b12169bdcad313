"""The four answers in a line each."""

from __future__ import annotations

from attlog.metrics.gyro_bias import CommonBias
from attlog.result import Check, Result, Verdict
from attlog.words.answers import BriefAnswer, brief_answers, grouped_reasons, verdicts
from tests.words.made import (
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
)


def brief(question: str, made: Result) -> str:
    """The answer without the onboard attitude."""
    return brief_answers(made)[question].text


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
    found = brief_answers(made)["accuracy"]
    assert found.within(70) == "Tilt: A 0.40°, B 1.2°. Onboard 0.90°."
    assert found.within(30) == "Tilt: A 0.40°, B 1.2°."
    assert BriefAnswer("ab", found.column, "cd").within(5) == "ab cd"


def test_what_has_no_answer_says_why_and_what_is_not_ranked_shows_its_range() -> None:
    made = result([row("a", absent(LAG, "airborne", "no_events", "no step in flight; fly some"))])
    assert brief("lag", made) == "Cannot be determined: no step in flight."
    assert brief("noise", result([])) == "Cannot be determined: no filter was run."
    unranked = result([row("a", tilt(0.4, ranked=False)), row("b", tilt(0.7, ranked=False))])
    assert brief("accuracy", unranked) == "Not ranked (too little data in common): tilt 0.40 to 0.70°."


def test_a_sensor_that_spoils_all_filters_is_named_in_each_answer_that_has_a_value() -> None:
    made = result([row("a", drift(4.0)), row("b", drift(0.05))], {DRIFT_REST: ["b"]})
    made.audit = [Check("gravity", "fault", "It is 12 m/s^2.")]
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
        return brief_answers(made)["yaw_drift"].onboard

    assert onboard(6.9, 1.0) == "Onboard +6.9°/min."
    assert onboard(2.1, 4.0) == "Onboard below 6.1°/min."
    assert onboard(6.9, 11.6) == ""


# What holds for all sentences: there are always four, short, and a wrong sensor is said by each.


def test_nothing_at_all_still_gives_four_sentences():
    found = verdicts(Result({}, "", {}, {}))
    assert [v.question for v in found] == ["accuracy", "noise", "lag", "yaw_drift"]
    assert all(v.sentence.startswith("Cannot be judged: ") and v.sentence.endswith(".") for v in found)


def test_sentences_stay_short_with_many_filters():
    every = [
        merged(tilt(i + 1.0, i + 2.0), noise(0.01 * (i + 1)), lag(3.0 * i), step(i + 0.1, -i * 3), drift(i, 0.5))
        for i in range(20)
    ]
    rows = [row(f"filter{i}@preset", metrics) for i, metrics in enumerate(every)]
    names = [r.name for r in rows]
    best = {m: names[:4] for m in ("tilt_rmse_deg", "noise_tilt_deg", "lag_ms", "drift_rest_deg_per_min")}
    for found in verdicts(result(rows, best, dict.fromkeys(best, names[-1]), "truth")):
        assert len(found.sentence.split()) <= 70, found.sentence


def test_a_gyro_that_reads_wrong_standing_still_is_said_by_every_card():
    made = result([row("a", noise(0.01))])
    made.audit = [Check("gyro bias", "fault", "At rest -24.34, -23.28, 2.62 deg/s about x, y, z.")]
    for found in verdicts(made):
        assert found.sentence.startswith(
            "Unreliable, the gyro is wrong: at rest −24.34, −23.28, 2.62°/s about x, y, z. "
        )
    made.gyro_bias = [CommonBias("rest", "rest", dps=[-24.2, -24.1, 2.5])]
    assert not any(found.sentence.startswith("Unreliable") for found in verdicts(made)), "it was subtracted"
    made.estimators[0].status = "not_judged"
    assert sentence("noise", made).startswith("Unreliable")
    made.audit[0].verdict = "warning"
    assert not sentence("noise", made).startswith("Unreliable")


def test_what_a_filter_of_nan_is_missing_is_not_blamed_on_the_log():
    nan = row(
        "nan",
        absent("noise_tilt_deg", "rest", "rest_too_short", "rest too short"),
        status="failed",
        reason="returned NaN from 0.0 s on",
    )
    found = {v.question: v for v in verdicts(result([nan, row("a", noise(0.01))]))}
    assert ("nan", "returned NaN from 0.0 s on") in found["noise"].not_judged
    assert sentence("noise", result([nan])) == "Cannot be judged: returned NaN from 0.0 s on."


# Who is not judged in an answer, and why.


def test_rows_with_the_same_reason_stand_together_by_name_and_the_reference_itself_is_left_out():
    given = [("a@x-1", "short"), ("b", "short"), ("onboard", "it is the reference itself")]
    verdict = Verdict("lag", "", "", "lag_ms", "all", [], given)
    names = {"a@x-1": "A, X 1", "b": "B"}
    assert grouped_reasons(verdict, names, {"a@x-1", "b", "c"}) == [("A, X 1 and B", "short")]
    assert grouped_reasons(verdict, names, {"a@x-1", "b"}) == [("All filters", "short")]
