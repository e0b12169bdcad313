"""How fast does the heading drift?"""

from __future__ import annotations

import pytest

from attlog.metrics.answer import SpanAnswer
from attlog.present.heading import quoted_heading_reference
from attlog.present.sentences.brief import brief_answers
from attlog.result import Check
from tests.present.made import DRIFT_AIR, DRIFT_REST, absent, drift, merged, row, sentence, verdict
from tests.present.made import result as made


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
