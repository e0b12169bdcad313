"""Which filter is closest?"""

from __future__ import annotations

import pytest

from attlog.present.sentences import verdicts
from attlog.result import Check
from tests.present.contradictions import contradictions
from tests.present.made import HEADING as HEAD
from tests.present.made import TILT, row, sentence, tilt, verdict
from tests.present.made import result as made


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
