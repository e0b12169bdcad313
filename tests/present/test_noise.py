"""How much does a filter wander?"""

from __future__ import annotations

import pytest

from tests.present.made import NOISE, absent, merged, noise, row, sentence, tilt, verdict
from tests.present.made import result as made


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
