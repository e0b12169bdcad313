"""Which filter is closest?"""

from __future__ import annotations

import pytest

from attlog.health.check import Check as check_Check
from attlog.metrics.metric import SpanAnswer, missing
from attlog.result import Check
from attlog.words.answers import brief_answers, verdicts
from attlog.words.ranking import quoted_heading_reference
from tests.words.contradictions import contradictions
from tests.words.made import (
    DRIFT_AIR,
    DRIFT_REST,
    LAG,
    NOISE,
    STEP,
    TILT,
    absent,
    drift,
    impure,
    lag,
    merged,
    noise,
    row,
    sentence,
    step,
    tilt,
    verdict,
)
from tests.words.made import HEADING as HEAD
from tests.words.made import result as made


def test_against_truth_tilt_and_heading_are_said_with_who_is_farthest_and_what_flew():
    rows = [row("vqf", tilt(1.2, 1.6)), row("ekf12", tilt(3.7, 13.7)), row("mahony", tilt(1.7, 4.0))]
    rows.append(row("onboard", tilt(0.9, 0.92)))
    found = made(rows, {TILT: ["vqf"], HEAD: ["vqf", "mahony"]}, {TILT: "ekf12", HEAD: "ekf12"}, "truth")
    assert sentence("accuracy", found) == (
        "VQF is closest in tilt to the logged truth: 1.2° (1.1 to 1.3). EKF12 is farthest: 3.7° (3.3 to 4.1). "
        "In heading VQF and Mahony are closest: 1.6° and 4.0° (not significant). "
        "EKF12 is farthest: 13.7° (12.3 to 15.1). "
        "Onboard: 0.90°, heading 0.92°."
    )


def test_against_onboard_it_is_agreement_and_the_heading_is_shown_but_not_ranked():
    rows = [row("vqf", tilt(1.2, 9.4)), row("mahony", tilt(3.7, 2.0)), row("onboard", {}, is_reference=True)]
    for one in rows[:2]:
        one.metrics["airborne"][HEAD].ranked = False
    found = verdict("accuracy", made(rows, {TILT: ["vqf"]}, {TILT: "mahony"}))
    assert found.title == "Agreement with onboard"
    assert found.sentence == (
        "VQF agrees best in tilt with onboard (agreement, not truth): 1.2° (1.1 to 1.3). "
        "Mahony agrees least: 3.7° (3.3 to 4.1). Its heading is off by 9.4° (8.5 to 10.3), not ranked."
    )


def test_filters_that_do_not_differ_significantly_are_not_named():
    found = made([row("vqf", tilt(1.2)), row("mahony", tilt(3.7)), row("ekf12", tilt(2.0))])
    assert sentence("accuracy", found) == (
        "No significant difference in tilt against onboard (agreement, not truth): 1.2 to 3.7°."
    )


def test_too_short_a_flight_still_gives_the_errors():
    rows = [row("vqf", tilt(1.2, ranked=False, reason="too short")), row("mahony", tilt(3.7, ranked=False))]
    assert sentence("accuracy", made(rows, reference="truth")) == (
        "Filters cannot be ranked over 60 s: tilt errors are VQF 1.2° (1.1 to 1.3) and Mahony 3.7° (3.3 to 4.1) "
        "against the logged truth."
    )


def test_where_no_flight_was_scored_the_whole_log_counts():
    found = verdict("accuracy", made([row("vqf", tilt(1.2, window="all")), row("mahony", tilt(2.0, window="all"))]))
    assert found.window == "all"
    assert "over the whole log" in found.notes[-1]


def test_filters_that_all_diverge_from_onboard_do_not_acquit_it():
    rows = [row(n, tilt(50.0), status="diverged", reason="tilt error above 30 deg") for n in ("vqf", "mahony")]
    assert sentence("accuracy", made(rows)) == (
        "All 2 filters diverged from onboard (agreement, not truth): either they or the onboard attitude is wrong."
    )


def test_filters_that_did_not_settle_or_are_not_judged_are_not_said_to_have_diverged():
    rows = [row(n, tilt(9.0), status="not_converged", reason="had not settled") for n in ("vqf", "mahony")]
    assert sentence("accuracy", made(rows, reference="truth")).startswith(
        "All 2 filters did not settle near the logged"
    )
    rows[0].status = "diverged"
    assert "diverged from or did not settle near" in sentence("accuracy", made(rows, reference="truth"))
    rows = [row(n, tilt(9.0), status="not_judged", reason="the gyro is broken") for n in ("vqf", "mahony")]
    assert sentence("accuracy", made(rows, reference="truth")) == "No filter can be judged: the gyro is broken."


@pytest.mark.parametrize("reference", ["onboard", "truth"])
def test_the_gyro_alone_is_never_closest_and_its_bar_is_pale(reference):
    rows = [row("gyro", tilt(0.1)), row("vqf", tilt(1.2)), row("mahony", tilt(3.7))]
    found = verdict("accuracy", made(rows, {TILT: ["gyro", "vqf"]}, {TILT: "mahony"}, reference))
    assert found.sentence.startswith("VQF ")
    assert "gyro" in dict(found.not_judged)


def test_who_lost_its_way_is_named():
    rows = [
        row("vqf", tilt(1.2)),
        row("mahony", tilt(2.0)),
        row("nan", {}, status="failed", reason="returned NaN from 0.0 s on"),
    ]
    assert sentence("accuracy", made(rows)).endswith("Nan returned NaN from 0.0 s on.")


def test_nothing_to_compare_with_says_so():
    assert sentence("accuracy", made([], reference="none")) == (
        "Cannot be judged: the log holds no attitude to compare with."
    )


def against_smoother(rows, heading_by="own", **more):
    found = made(rows, {TILT: ["vqf"]}, {TILT: "mahony"}, "smoother")
    found.reference.sigma_tilt_deg, found.reference.heading_by = 0.12, heading_by
    found.audit = [Check("onboard against smoother", more.get("onboard", "ok"), "")]
    return found


def test_against_the_smoother_its_sigma_is_named_and_what_flew_is_judged():
    rows = [row("vqf", tilt(1.2)), row("mahony", tilt(3.7)), row("onboard", tilt(18.2))]
    assert sentence("accuracy", against_smoother(rows, onboard="fault")) == (
        "VQF is closest in tilt to the smoother (sigma 0.12°): 1.2° (1.1 to 1.3). "
        "Mahony is farthest: 3.7° (3.3 to 4.1). Onboard: 18.2°; it is in error here."
    )
    for verdict_on_onboard in ("ok", "warning"):  # a warning asks for a look, it calls nothing wrong
        assert sentence("accuracy", against_smoother(rows, onboard=verdict_on_onboard)).endswith("Onboard: 18.2°.")
    assert verdict("accuracy", against_smoother(rows)).title == "Accuracy"


def test_a_heading_that_is_compared_with_onboard_is_said_to_be():
    rows = [row("vqf", tilt(1.2, 9.4)), row("mahony", tilt(3.7, 2.0)), row("onboard", tilt(0.5))]
    for one in rows[:2]:
        one.metrics["airborne"][HEAD].ranked = False
    whom = "against onboard (agreement, not truth)"
    assert f"Its heading is off by 9.4° (8.5 to 10.3) {whom}, not ranked." in sentence(
        "accuracy", against_smoother(rows, "onboard")
    )
    for one in rows[:2]:
        one.metrics["airborne"][TILT].ranked = False
    assert f"Heading errors are 9.4° and 2.0° {whom}." in sentence("accuracy", against_smoother(rows, "onboard"))


def test_nothing_that_is_said_of_the_smoother_contradicts_its_numbers():
    rows = [row("vqf", tilt(1.2, 1.6)), row("mahony", tilt(3.7, 4.0)), row("onboard", tilt(18.2, 2.0))]
    found = against_smoother(rows)
    found.reference.text = "Differences below its own sigma mean nothing: 0.12 deg in tilt, 0.3 deg in heading."
    found.verdicts = verdicts(found)
    assert contradictions(found) == []
    found.verdicts[0].sentence = found.verdicts[0].sentence.replace("0.12", "0.13")
    assert any("0.13 is no number" in said for said in contradictions(found))


def test_filters_that_all_diverge_from_the_smoother_do_not_acquit_it():
    rows = [row(n, tilt(50.0), status="diverged", reason="tilt error above 30 deg") for n in ("vqf", "mahony")]
    assert "All 2 filters diverged from the smoother (sigma 0.12°): either they or the smoother is wrong." in sentence(
        "accuracy", against_smoother(rows)
    )


def test_where_only_the_gyro_was_run_the_log_is_not_blamed():
    alone = made([row("gyro", tilt(1.0)), row("onboard", tilt(0.9))])
    said = "Cannot be judged: of the filters only Gyro was run, which is shown and never ranked."
    assert {v.sentence for v in verdicts(alone)} == {said}


def test_errors_that_are_shown_alike_are_all_the_same_and_what_has_no_compass_has_no_north():
    rows = [row(n, tilt(2.1, 0.4, ranked=False), uses_mag=False) for n in "abcd"]
    said = sentence("accuracy", made(rows))
    assert "tilt errors are all 2.1° against" in said
    assert "Heading errors are all 0.40°" in said
    assert said.endswith(" Without a compass they know no north: each heading counts from the start.")
    rows[0].north_by_gnss = True
    assert "no north" not in sentence("accuracy", made(rows))


def test_what_the_ranking_rests_on_is_said_once():
    rows = [row("vqf", tilt(1.2, 1.6)), row("mahony", tilt(3.7, 4.0))]
    found = against_smoother(rows)
    found.reference.caveat = "the heading rests on the compass alone"
    assert sentence("accuracy", found).endswith(" The heading rests on the compass alone.")
    found.reference.caveat = "the smoother is in doubt: own tilt sigma 1.8 deg; no heading is compared"
    assert sentence("accuracy", found).endswith(
        " The smoother is in doubt: own tilt sigma 1.8°. No heading is compared."
    )
    found = made(rows)
    found.reference.caveat = "the smoother was refused: own tilt sigma 2.3 deg"
    assert sentence("accuracy", found).endswith(" The smoother was refused: own tilt sigma 2.3°.")
    assert "refused" not in sentence("lag", found) + sentence("yaw_drift", found)


def test_an_onboard_attitude_that_was_refused_is_in_error_its_heading_where_gnss_contradicts_that():
    found = against_smoother([row("vqf", tilt(1.2)), row("mahony", tilt(3.7)), row("onboard", tilt(0.9))])
    found.reference.refused = {"onboard": "gravity contradicts it"}
    assert sentence("accuracy", found).endswith("Onboard: 0.90°; it is in error here.")
    found.audit = [Check("heading by GNSS", "fault", "")]
    assert sentence("accuracy", found).endswith("Onboard: 0.90°; its heading is in error.")


def test_headings_against_an_onboard_heading_that_jumps_are_in_doubt():
    rows = [row("vqf", tilt(1.2, 9.4)), row("mahony", tilt(3.7, 2.0)), row("onboard", tilt(0.5))]
    for one in rows[:2]:
        one.metrics["airborne"][HEAD].ranked = False
    found = against_smoother(rows, "onboard")
    found.audit = [Check("attitude jumps", "fault", "")]
    assert "against onboard (in doubt: it jumps), not ranked." in sentence("accuracy", found)


# How much does a filter wander?


def test_one_leader_is_named_beside_its_tilt_error_and_the_worst_after_it():
    rows = [row("ekf12", merged(noise(0.047), tilt(3.1))), row("vqf", noise(0.2)), row("mahony", noise(0.5))]
    assert sentence("noise", made(rows, {NOISE: ["ekf12"]}, {NOISE: "mahony"})) == (
        "EKF12 has the least noise: 0.047° (1 sigma within 5 s; 0.042 to 0.052) at rest. Its tilt error is 3.1°. "
        "Mahony has the most noise: 0.50° (0.45 to 0.55)."
    )


def test_several_leaders_do_not_differ_significantly_and_nobody_is_worst_unless_the_ranking_says_so():
    rows = [row("ekf12", noise(0.047)), row("vqf", noise(0.06)), row("mahony", noise(0.5)), row("madgwick", noise(0.4))]
    assert sentence("noise", made(rows, {NOISE: ["ekf12", "vqf"]})) == (
        "EKF12 and VQF have the least noise: 0.047° and 0.060° (1 sigma within 5 s) at rest (not significant)."
    )


def test_where_everybody_is_best_nobody_is_named():
    rows = [row(n, noise(v)) for n, v in (("ekf12", 0.047), ("vqf", 0.06), ("mahony", 0.08), ("madgwick", 0.09))]
    assert sentence("noise", made(rows)) == ("No significant difference: 0.047 to 0.090° (1 sigma within 5 s) at rest.")


@pytest.mark.parametrize(
    ("phases", "lead", "rest"),
    [
        (("hover", "rest"), "at rest", "In hover"),
        (("cruise", "hover"), "in hover", "In moving flight"),
        (("idle", "cruise"), "in moving flight", "With motors idling"),
    ],
)
def test_the_first_phase_with_an_answer_leads_and_others_follow_unpooled(phases, lead, rest):
    rows = [row(n, merged(*(noise(v, p) for p in phases))) for n, v in (("vqf", 0.01), ("mahony", 0.09))]
    found = verdict("noise", made(rows, {NOISE: ["vqf"]}))
    assert f"(1 sigma within 5 s; 0.009 to 0.011) {lead}." in found.sentence
    assert found.sentence.endswith(f" {rest} VQF adds least, 0.010°.")
    assert found.window == phases[1]


def test_a_phase_in_which_nothing_is_ranked_does_not_lead():
    hidden = noise(0.0001, ranked=False, reason="below the noise that the steps of the logged gyro can hide")
    rows = [row(n, merged(hidden, noise(v, "hover"))) for n, v in (("vqf", 0.01), ("mahony", 0.09))]
    assert verdict("noise", made(rows, {NOISE: ["vqf"]})).window == "hover"


def test_the_gyro_alone_is_never_quietest():
    rows = [row("gyro", noise(0.001)), row("vqf", noise(0.01)), row("mahony", noise(0.09))]
    found = verdict("noise", made(rows, {NOISE: ["gyro", "vqf"]}))
    assert found.sentence.startswith("VQF has the least noise: 0.010°")
    assert [name for name, _, _ in found.bars] == ["gyro", "vqf", "mahony"]


def test_a_row_that_was_not_compared_is_not_named_and_says_why():
    rows = [
        row("frozen", noise(0.0001, ranked=False, reason="does not follow motion: gain 0.1")),
        row("vqf", noise(0.01)),
    ]
    found = verdict("noise", made([*rows, row("mahony", noise(0.09))], {NOISE: ["vqf"]}))
    assert found.sentence.startswith("VQF has the least noise")
    assert ("frozen", "does not follow motion: gain 0.1") in found.not_judged


def test_where_nobody_can_be_ranked_the_sentence_says_why():
    rows = [
        row("vqf", noise(0.001), status="diverged", reason="tilt above 30 deg"),
        row("a", noise(0.004, ranked=False, reason="does not follow motion: gain 0.5")),
        row("b", noise(0.004, ranked=False, reason="does not follow motion: gain 0.6")),
        row("onboard", noise(0.012)),
    ]
    assert sentence("noise", made(rows)) == (
        "No filter can be ranked: VQF (diverged), A and B (do not follow motion). Onboard: 0.012°."
    )


def test_a_lone_filter_is_not_called_best():
    assert sentence("noise", made([row("mahony", noise(0.004))])) == (
        "Mahony is the only filter to be ranked: 0.004° (1 sigma within 5 s; 0.004 to 0.004) at rest."
    )


@pytest.mark.parametrize("advice", ["Set LOG_DISARMED to 1 and let the vehicle stand still.", ""])
def test_a_log_without_rest_says_how_the_vehicle_would_log_one(advice):
    found = made([row("vqf", absent(NOISE, "rest", "no_rest", "The log holds no rest."))], advice={"rest": advice})
    assert sentence("noise", found) == f"Cannot be judged: the log holds no rest. {advice}".rstrip()


def test_in_motion_filters_add_noise_and_the_gyros_own_is_told_where_it_is_larger():
    rows = [row(n, noise(v, "hover", gyro_share=0.0184)) for n, v in (("vqf", 0.01), ("mahony", 0.09))]
    assert sentence("noise", made(rows, {NOISE: ["vqf"]}, {NOISE: "mahony"})) == (
        "VQF adds the least noise: 0.010° (1 sigma within 5 s; 0.009 to 0.011) in hover. "
        "Mahony adds the most noise: 0.090° (0.081 to 0.099). The gyro's own noise is about 0.020°."
    )
    rows = [row(n, noise(v, "hover", gyro_share=0.0184)) for n, v in (("vqf", 0.05), ("mahony", 0.09))]
    assert "gyro itself" not in sentence("noise", made(rows, {NOISE: ["vqf"]}))


def test_why_filters_far_from_each_other_share_a_rank_is_said_of_every_phase():
    rows = [
        row(n, merged(noise(0.01 * k), noise(0.01 * k, "hover", gyro_share=0.8)))
        for k, n in enumerate(("vqf", "mahony", "madgwick"), 1)
    ]
    found = sentence("noise", made(rows, {NOISE: ["vqf", "mahony"]}))
    assert found.endswith("In hover VQF and Mahony add least, 0.010° and 0.020° (the gyro's own noise is about 0.80°).")


# How late, and how wrong, in a step?


def test_who_lags_is_known_by_its_interval_and_the_others_are_bounded_by_the_largest_end_of_theirs():
    rows = [row("ekf12", lag(12)), row("vqf", lag(-1, 3.2)), row("mahony", lag(1, 0.5))]
    assert sentence("lag", made(rows, {LAG: ["vqf", "mahony"]}, {LAG: "ekf12"}, "truth")) == (
        "EKF12 lags by +12 ms (+11 to +13) against the logged truth in 28 steps. "
        "No significant lag of VQF and Mahony: less than 5 ms."
    )


def test_a_wide_interval_bounds_nothing_below_itself():
    rows = [row("a", lag(1, 3)), row("b", lag(0, 12)), row("c", lag(0.4, 17.7))]
    assert sentence("lag", made(rows)) == (
        "No significant lag of 3 filters: less than 19 ms against onboard (agreement, not truth) in 28 steps."
    )


def test_less_than_half_a_sample_is_no_lag():
    assert sentence("lag", made([row("a", lag(4, 0.5, floor=5.0))])).startswith(
        "No significant lag of A: less than 5 ms"
    )


def test_most_is_said_only_of_the_row_that_the_ranking_finds_worst():
    rows = [row("a", lag(12)), row("b", lag(14)), row("c", lag(0))]
    assert "lag by +12 ms and +14 ms" in sentence("lag", made(rows, {LAG: ["c"]}))
    assert "B lags most: +14 ms (+13 to +15); A by +12 ms against" in sentence(
        "lag", made(rows, {LAG: ["c"]}, {LAG: "b"})
    )


@pytest.mark.parametrize(
    ("verdict_", "ms", "said"), [("warning", 15.2, True), ("ok", 3.0, False), ("fault", -25.0, False)]
)
def test_an_imu_that_is_late_by_itself_is_said_to_make_every_filter_late(verdict_, ms, said):
    found = made([row("a", lag(15)), row("b", lag(16))])
    found.audit = [check_Check("imu delay", verdict_, "IMU:0 comes later.", ms, "ms")]
    expected = "The IMU itself is 15 ms late, and every filter with it."
    assert (expected in sentence("lag", found)) == said
    assert (expected in brief_answers(found)["lag"].text) == said


def test_one_step_is_in_the_singular():
    rows = [row("a", lag(12))]
    rows[0].metrics["airborne"][LAG].n = 1
    assert "in 1 step." in sentence("lag", made(rows))


def test_a_lag_of_one_sample_of_a_slow_log_is_said_to_be_that():
    rows = [row("ekf12", lag(40, floor=20.0)), row("vqf", lag(0, floor=20.0))]
    found = made(rows, {LAG: ["vqf"]}, imu={"rate_hz": 25.0})
    assert "+40 ms (+39 to +41), one sample of this log's 25 Hz IMU, against" in sentence("lag", found)
    assert "one sample" not in sentence("lag", made(rows, {LAG: ["vqf"]}, imu={"rate_hz": 400.0}))


def test_filters_that_all_come_before_onboard_tell_that_onboard_is_late():
    rows = [row("a", lag(-8)), row("b", lag(-12))]
    assert sentence("lag", made(rows)) == (
        "A and B are ahead: −8 ms and −12 ms against onboard (agreement, not truth) in 28 steps. "
        "The onboard attitude itself lags."
    )
    assert "itself lags" not in sentence("lag", made([*rows, row("c", lag(0))]))


def test_a_row_that_is_no_pure_delay_is_not_judged_and_never_early():
    found = verdict("lag", made([row("a", lag(1)), row("fan", merged(impure(), step(5.0, -52.0)))]))
    assert "Lag cannot be determined for Fan: not a pure delay." in found.sentence
    assert ("fan", "follows 51 % of the step") in found.not_judged
    assert "fan" not in [name for name, _, _ in found.bars]


def test_the_angle_after_a_step_is_named_for_who_is_short_of_it():
    rows = [
        row("mahony@xu-0.6", merged(lag(0), step(8.0, -25.2))),
        row("complementary@fan", merged(lag(0), step(12.7, -51.8))),
        row("madgwick", merged(lag(0), step(1.5, -4.8))),
        row("ekf12", merged(lag(0), step(4.4, 7.0))),
    ]
    assert sentence("lag", made(rows)).endswith(
        " 0.5 s after a step (28 steps) Complementary Fan is still 52 % short (12.7°) and Mahony Xu 0.6 25 % (8.0°); "
        "Madgwick and EKF12 are off by 1.5° and 4.4°."
    )
    assert "Madgwick is least off, 1.5°; EKF12 is off by 4.4°." in sentence("lag", made(rows, {STEP: ["madgwick"]}))


def test_too_much_of_a_step_is_not_called_short():
    found = made([row("a", merged(lag(0), step(8.0, 25.0))), row("b", merged(lag(0), step(1.0, 2.0)))])
    assert "A is still 25 % too far (8.0°); B is off by 1.0°." in sentence("lag", found)


def test_the_delay_of_the_logged_imu_is_printed():
    rows = [row("a", lag(0))]
    rows[0].metrics["airborne"][LAG].taken_out = 11.2
    assert verdict("lag", made(rows)).notes == ["The logged IMU itself comes 11 ms late; that is not counted as lag."]
    rows[0].metrics["airborne"][LAG].taken_out = 0.0
    assert verdict("lag", made(rows)).notes == ["No delay of the logged IMU is known; lags are taken as they are."]


def test_all_impure():
    rows = [row("a", impure()), row("b", impure())]
    assert sentence("lag", made(rows)) == ("No filter's lag can be judged: A and B (wrong angle in the step).")


@pytest.mark.parametrize(("airborne", "advice"), [(60.0, True), (0.0, False), (None, False)])
def test_too_few_steps_are_said_with_the_count_and_only_who_flew_is_told_to_fly_more(airborne, advice):
    few = absent(LAG, "airborne", "too_few_events", "2 steps; at least 3 are needed")
    found = made([row("a", few), row("b", few)], seconds={"airborne": airborne})
    assert sentence("lag", found) == (
        "Cannot be judged: 2 steps; at least 3 are needed."
        + (" Fly some more brisk steps in roll, pitch and yaw." if advice else "")
    )


def test_what_flew_is_not_late_against_itself():
    itself = {"airborne": {LAG: missing("not_applicable", "this row is the reference itself", "ms", "airborne")}}
    rows = [row("a", lag(0)), row("onboard", itself, is_reference=True)]
    assert "Onboard:" not in sentence("lag", made(rows))


def test_a_row_behind_a_worse_one_is_not_called_least_off():
    """Few steps show no significant difference of a row that is wrong in some of them: 1.0 deg beside 0.02 and 0.14."""
    rows = [row(n, merged(lag(0.0), step(deg, -1.0))) for n, deg in (("a", 0.02), ("b", 0.14), ("c", 1.0))]
    assert "A is least off, 0.020°; B and C are off by 0.14° and 1.0°." in sentence(
        "lag", made(rows, {STEP: ["a", "c"]})
    )


# How fast does the heading drift?


def test_a_drift_is_significant_where_its_interval_excludes_zero_however_wide_it_is():
    rows = [row("a", drift(254.5, 40.0)), row("b", drift(0.02))]
    assert sentence("yaw_drift", made(rows)) == (
        "At rest, A drifts +254°/min (+214 to +294). No significant drift of B: less than 0.12°/min."
    )


def test_others_are_bounded_by_the_larger_end_of_their_intervals_never_less():
    rows = [row("a", drift(0.02, 0.1)), row("b", drift(-0.05, 0.1234))]
    assert sentence("yaw_drift", made(rows)) == "At rest, no significant drift of A and B: less than 0.18°/min."
    assert sentence("yaw_drift", made([row("a", drift(0.1, 0.2)), row("b", drift(3.0, 9.0))])) == (
        "At rest, no significant drift of A and B: less than 0.30°/min to 12.0°/min."
    )


def test_a_drift_to_the_left_is_bounded_by_the_end_further_left():
    """From -12 to +6 and from -0.3 to +0.1 deg/min."""
    assert sentence("yaw_drift", made([row("a", drift(-0.1, 0.2)), row("b", drift(-3.0, 9.0))])) == (
        "At rest, no significant drift of A and B: less than 0.30°/min to 12.0°/min."
    )


def test_most_and_least_come_from_the_ranking():
    rows = [row("a", drift(-4.8)), row("b", drift(2.0)), row("c", drift(0.0))]
    found = made(rows, {DRIFT_REST: ["c"]}, {DRIFT_REST: "a"})
    assert sentence("yaw_drift", found) == (
        "At rest, A drifts most: −4.8°/min (−4.9 to −4.7); B +2.0°/min. No significant drift of C: less than 0.10°/min."
    )
    assert "A and B drift: −4.8°/min and +2.0°/min" in sentence("yaw_drift", made(rows))


@pytest.mark.parametrize(
    ("present", "quoted", "said"),
    [
        (("onboard", "truth"), "truth", "the logged truth"),
        (("onboard", "gnss_yaw", "mag"), "gnss_yaw", "the GNSS heading"),
        (("mag", "onboard"), "onboard", "onboard (agreement, not truth)"),
        (("course", "mag"), "mag", "the magnetometer (agreement, not truth)"),
    ],
)
def test_one_heading_reference_is_quoted_whatever_it_ranks(present, quoted, said):
    answers = [drift(2.0, against=p, ranked=p != quoted, reason=None if p != quoted else "not ranked") for p in present]
    found = verdict("yaw_drift", made([row("a", merged(*answers))]))
    assert found.metric == f"{DRIFT_AIR}.{quoted}"
    assert f"In the air against {said}, " in found.sentence
    assert found.sentence.count("against") == 1


def test_a_heading_reference_that_only_onboard_rows_have_is_not_quoted():
    rows = [row("a", drift(4.0, against="mag")), row("onboard:AHR2", drift(0.4, against="onboard"))]
    assert "against the magnetometer" in sentence("yaw_drift", made(rows))


def test_rests_that_disagree_are_said_as_a_range():
    apart = drift(0.5, 4.0, ranked=False, reason="the rests of this log disagree", disagree=(-2.0, 4.7))
    assert sentence("yaw_drift", made([row("a", apart)])) == (
        "At rest, the rests disagree for A: −2.0°/min to +4.7°/min."
    )


def test_a_rate_that_changes_is_said():
    changing = drift(2.0, changes=(0.5, 3.5))
    assert "(the rate itself changes from +0.50°/min to +3.5°/min)" in sentence("yaw_drift", made([row("a", changing)]))


def test_rows_that_diverged_are_named_last_with_their_drift_and_never_least():
    rows = [row("a", drift(1.0)), row("lost", drift(0.01, 0.001), status="diverged"), row("b", drift(2.0))]
    found = verdict("yaw_drift", made(rows))
    assert found.sentence.endswith(". Lost, which diverged, +0.01°/min (+0.01 to +0.01).")
    assert [name for name, _, _ in found.bars] == ["a", "b", "lost"]


def test_every_rest_is_listed_with_what_could_be_used_of_it():
    rows = [row("a", drift(1.0))]
    rows[0].metrics["rest"][DRIFT_REST].records = [
        SpanAnswer(0.0, 14.2, 0.0, reason="0 s after settling; 8 are needed"),
        SpanAnswer(700.0, 736.0, 31.0, 1.0, (0.9, 1.1)),
    ]
    assert verdict("yaw_drift", made(rows)).notes == [
        "Rest from 0.0 s to 14.2 s: 0 s after settling; 8 are needed.",
        "Rest from 0:11:40 to 0:12:16: 31 s usable.",
    ]


def test_without_any_drift_both_reasons_are_given():
    metrics = merged(
        absent(DRIFT_REST, "rest", "no_rest", "No rest."),
        absent(f"{DRIFT_AIR}.onboard", "airborne", "record_too_short", "8 s in the air; 20 are needed"),
    )
    assert sentence("yaw_drift", made([row("a", metrics)])) == (
        "Cannot be judged. At rest: no rest. In the air: 8 s in the air; 20 are needed."
    )


def test_the_part_that_is_not_answered_is_explained():
    air = merged(drift(6.0, against="onboard"), absent(DRIFT_REST, "rest", "no_rest", "no rest"))
    assert verdict("yaw_drift", made([row("a", air)])).not_judged == [("a", "at rest, no rest")]


def test_filters_whose_drift_is_not_determined_are_named_apart_with_the_reason():
    unsure = absent(f"{DRIFT_AIR}.onboard", "airborne", "too_uncertain", "34 s, too noisy to see even 60 deg/min")
    rows = [row("a", drift(1.0, 2.0, against="onboard")), row("b", unsure)]
    assert sentence("yaw_drift", made(rows)) == (
        "In the air against onboard (agreement, not truth), no significant drift of A: less than 3.0°/min. "
        "Cannot be determined for B: 34 s, too noisy to see even 60°/min."
    )
    assert sentence("yaw_drift", made([row("b", unsure)])) == ("Cannot be judged: 34 s, too noisy to see even 60°/min.")


def test_truth_is_quoted_also_where_nothing_can_be_determined_by_it():
    rows = [
        row(
            "a",
            merged(absent(f"{DRIFT_AIR}.truth", "airborne", "too_uncertain", "too noisy"), drift(1.0, against="mag")),
        )
    ]
    assert quoted_heading_reference(made(rows)) == "truth"


def test_what_flew_drifts_at_rest_also_where_it_is_the_reference():
    rows = [row("a", drift(1.0)), row("b", drift(2.0)), row("onboard", drift(-4.0), is_reference=True)]
    assert sentence("yaw_drift", made(rows, reference="onboard")).endswith("Onboard: −4.0°/min (−4.1 to −3.9).")


def test_least_is_left_out_where_it_repeats_who_is_bounded_or_only_counts():
    rows = [row("a", drift(-4.8)), row("b", drift(0.0)), row("c", drift(0.01))]
    assert "Least" not in sentence("yaw_drift", made(rows, {DRIFT_REST: ["b", "c"]}))
    rows += [row("d", drift(0.5)), row("e", drift(0.02))]
    assert sentence("yaw_drift", made(rows, {DRIFT_REST: ["b", "c", "d"]})).endswith(". Least: B, C and D.")
    assert "Least" not in sentence("yaw_drift", made(rows, {DRIFT_REST: ["b", "c", "d", "e"]}))


def test_drift_against_a_compass_whose_field_is_wrong_is_in_doubt():
    found = made([row(n, drift(v, against="mag")) for n, v in (("vqf", 1.0), ("mahony", 2.0))], reference="none")
    assert "against the magnetometer (agreement, not truth)" in sentence("yaw_drift", found)
    assert "against" not in brief_answers(found)["yaw_drift"].text
    found.audit = [Check("field", "warning", "")]
    assert "against the magnetometer (in doubt: its field is wrong)" in sentence("yaw_drift", found)
    assert "in doubt: its field is wrong" in brief_answers(found)["yaw_drift"].text
