"""What changed between two runs: tolerances of one log, intervals of two, and everything beside the numbers."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from attlog.compare.diff import (
    NEGLIGIBLE,
    NEGLIGIBLE_SHARE,
    RunDifference,
    TextChange,
    Tolerances,
    compare_results,
    difference_interval,
    metric_units,
    pair_results,
    parse_tolerances,
)
from attlog.compare.diff_report import diff_blocks, diff_document, diff_lines, diff_markdown, diff_page, entry_line
from attlog.core.errors import LogUnreadable, LogUnusable, UsageError
from attlog.health.findings import Finding
from attlog.metrics.metric import Answer
from attlog.result import EstimatorRow, ReferenceSummary, Verdict
from tests.compare.made import filtered, result
from tests.words.made import absent, lag, merged, noise, tilt

NONE = Tolerances()


def verdicts(found) -> dict[tuple[str, str], str]:
    return {(m.window, m.metric): m.verdict for m in found.moved}


def test_the_same_result_has_no_difference() -> None:
    one = result(filtered(merged(tilt(2.0), noise(0.05))))
    found = compare_results("x", one, one, NONE)
    assert (found.count, found.moved, found.equal) == (0, [], 2)
    assert "no difference in 2 numbers" in next(diff_lines([found], [], False))


def test_of_one_log_a_value_counts_beyond_its_tolerance_whatever_its_interval() -> None:
    old = result(filtered(merged(tilt(2.0), noise(0.05), lag(1.0))))
    new = result(
        filtered(merged(tilt(2.0 * (1 + NEGLIGIBLE_SHARE) - 1e-6), noise(0.05 + 1.5 * NEGLIGIBLE["deg"]), lag(1.4)))
    )
    found = compare_results("x", old, new, NONE)
    assert found.same_log
    assert verdicts(found) == {
        ("airborne", "tilt_rmse_deg"): "within",
        ("rest", "noise_tilt_deg"): "beyond",
        ("airborne", "lag_ms"): "within",
    }
    assert found.count == 1


def test_of_two_logs_a_value_counts_only_where_its_interval_tells_it() -> None:
    """Intervals of a tenth: 2.0 +-0.2 and 2.3 +-0.23 overlap in their difference 0.3 +-0.305, 2.0 and 2.4 do not."""
    old = result(filtered(tilt(2.0)))
    near, far = (compare_results("x", old, result(filtered(tilt(v)), sha="b"), NONE) for v in (2.3, 2.4))
    assert [near.moved[0].verdict, far.moved[0].verdict] == ["not_significant", "beyond"]
    assert near.count == 0
    assert near.moved[0].interval == pytest.approx((0.3 - math.hypot(0.2, 0.23), 0.3 + math.hypot(0.2, 0.23)))


def test_the_interval_of_a_difference_takes_the_near_ends() -> None:
    """Zou2008: down from the lower end of the newer and the upper end of the older value."""
    low, high = difference_interval(1.0, (0.7, 1.4), 2.0, (1.7, 3.0)) or (0.0, 0.0)
    assert (low, high) == pytest.approx((1.0 - math.hypot(0.3, 0.4), 1.0 + math.hypot(1.0, 0.3)))
    assert difference_interval(1.0, None, 2.0, (1.0, 3.0)) is None


def test_of_two_logs_a_value_without_interval_counts_only_by_a_tolerance_that_was_given() -> None:
    sides = [result(filtered({"all": {"lag_ms": Answer(v, "ms", "all")}}), sha=str(v)) for v in (1.0, 9.0)]
    assert compare_results("x", *sides, NONE).count == 0
    assert compare_results("x", *sides, parse_tolerances(["lag_ms=5"], {"lag_ms": "ms"})).count == 1


def test_a_lag_further_from_zero_is_worse() -> None:
    old = result(filtered(lag(-1.0)))
    assert compare_results("x", old, result(filtered(lag(-3.0))), NONE).moved[0].closer is False
    assert compare_results("x", old, result(filtered(lag(0.2))), NONE).moved[0].closer is True


def test_values_rows_and_states_that_come_and_go_count_for_one_log() -> None:
    gone = absent("lag_ms", "airborne", "too_few_events", "2 steps")
    old = result(filtered(lag(1.0)), filtered(lag(1.0), "vqf"))
    new = result(filtered(gone, status="diverged"), filtered(lag(1.0), "ekf12"))
    found = compare_results("x", old, new, NONE)
    assert (found.rows_vanished, found.rows_appeared) == (["vqf"], ["ekf12"])
    assert found.status == [TextChange("mahony", "ok", "diverged")]
    assert [(m.verdict, m.reason) for m in found.moved] == [("vanished", "2 steps")]
    assert found.count == 4
    assert compare_results("x", new, old, NONE).count == 4
    new.log["sha256"] = "b"
    assert compare_results("x", old, new, NONE).count == 3  # another flight answers other questions


def test_parameters_gains_and_options_are_told_and_count_for_nothing() -> None:
    old = result(filtered(lag(1.0)))
    new = result(filtered(lag(1.0), kp=1.1), sha="b", log={"params": {"P": 1.0, "Q": 3.0, "R": 1.0}, "sha256": "b"})
    new.config = {"window": "rest"}
    found = compare_results("x", old, new, NONE)
    assert found.parameters == [TextChange("Q", 2.0, 3.0), TextChange("R", "(absent)", 1.0)]
    assert found.gains == [TextChange("mahony: kp", 0.6, 1.1)]
    assert found.config == [TextChange("window", "all", "rest")]
    assert found.count == 0
    text = "\n".join(diff_lines([found], [], False))
    assert "Q: 2 → 3" in text
    assert "R: absent → 1" in text


def test_with_another_reference_that_is_said_first_and_nothing_is_better_or_worse() -> None:
    old, new = result(filtered(lag(1.0))), result(filtered(lag(20.0)))
    assert [m.closer for m in compare_results("x", old, new, NONE).moved] == [False]
    truth = ReferenceSummary("truth", "SIM", 400.0, 0.0, "")
    old.reference, new.reference = truth, replace(truth, choice="onboard", source="ATT")
    old.verdicts = [Verdict("accuracy", "A is best.", "tilt_rmse_deg", "all")]
    new.verdicts = [Verdict("accuracy", "B is best.", "tilt_rmse_deg", "all")]
    found = compare_results("x", old, new, NONE)
    assert found.references == [TextChange("reference", "truth (SIM)", "onboard (ATT)")]
    assert [m.closer for m in found.moved] == [None]
    assert found.count == 1
    assert not found.verdicts
    first, *rest = diff_lines([found], [], False)
    assert first.index("truth (SIM) → onboard (ATT)") < first.index("beyond tolerance")
    assert not re.search("better|worse", "\n".join(rest))
    page = diff_page([found], [], "old", "new", "1", "diff")
    assert page.index("onboard (ATT)") < page.index("<table")


def test_of_two_logs_another_source_of_the_same_kind_is_no_other_reference() -> None:
    old, new = result(filtered(lag(1.0))), result(filtered(lag(20.0)), sha="b", log={"sha256": "b"})
    old.reference = ReferenceSummary("onboard", "ATT", 10.0, 0.0, "")
    new.reference = replace(old.reference, source="AHR2")
    assert compare_results("x", old, new, NONE).references == []


def test_a_parameter_that_only_one_log_lists_had_its_default_in_the_other() -> None:
    about = {"sha256": "b", "params": {"P": 2.0, "R": 5.0}, "params_changed": {"P": [2.0, 1.0], "R": [5.0, 4.0]}}
    other = {"sha256": "c", "params": {"Q": 3.0, "R": 5.0}, "params_changed": {"Q": [3.0, 0.5], "R": [5.0, 4.0]}}
    found = compare_results("x", result(log=about), result(log=other), NONE)
    assert found.parameters == [TextChange("P", 2.0, 1.0), TextChange("Q", 0.5, 3.0)]
    every = {"sha256": "d", "params": {"P": 1.0, "Q": 3.0, "R": 5.0, "S": 7.0}}  # tells no defaults
    found = compare_results("x", result(log=about), result(log=every), NONE)
    assert found.parameters == [TextChange("P", 2.0, 1.0)]


def test_parameters_of_a_result_that_did_not_tell_them_are_said_to_be_unknown() -> None:
    old, new = result(), result(sha="b")
    del old.log["params"]
    found = compare_results("x", old, new, NONE)
    assert found.parameters is None
    assert "not compared" in "\n".join(diff_lines([found], [], False))


def test_measured_times_are_never_compared() -> None:
    sides = [result(filtered({"all": {"cost_ns": Answer(v, "ns", "all")}})) for v in (10.0, 900.0)]
    assert compare_results("x", *sides, NONE).moved == []
    assert "cost_ns" not in metric_units(*sides)


UNITS = {"lag_ms": "ms", "noise_tilt_deg": "deg", "noise_roll_deg": "deg", "distortion_pct": "%"}


def test_tolerances_are_sizes_or_shares_and_the_last_rule_counts() -> None:
    found = parse_tolerances(["noise_*=5%", "noise_tilt_deg=0.02 deg", "lag_ms=2ms", "distortion_pct=10pct"], UNITS)
    assert found.of("noise_roll_deg", "deg", -4.0) == pytest.approx(0.2)
    assert found.of("noise_tilt_deg", "deg", 4.0) == 0.02
    assert found.of("lag_ms", "ms", 100.0) == 2.0
    assert found.of("distortion_pct", "%", 50.0) == pytest.approx(5.0)


def test_everything_wrong_in_the_tolerances_is_told_at_once() -> None:
    texts = ["lagms=2", "lag_ms=2deg", "noise_*=-1", "noise_*", "lag_ms=nan", "cost_ns=5%", "=3"]
    with pytest.raises(UsageError) as refused:
        parse_tolerances(texts, UNITS)
    said = str(refused.value).split("\n")
    assert len(said) == len(texts)
    for text, words in zip(
        texts, ("mean lag_ms", "in ms, not in deg", "no size", "give METRIC", "no size", "anew", "give"), strict=True
    ):
        assert any(text in line and words in line for line in said), (text, said)


def test_markdown_keeps_a_bar_in_a_name_from_opening_a_column() -> None:
    old, new = (result(filtered(lag(v), "a|b")) for v in (1.0, 9.0))
    text = "\n".join(diff_markdown([compare_results("x", old, new, NONE)], [], False))
    table = [line for line in text.split("\n") if line.startswith("|")]
    assert len(table) == 3
    assert all(t.replace("\\|", "").count("|") == 9 for t in table)


def test_the_json_holds_what_was_compared_and_what_stands_alone() -> None:
    old, new = (result(filtered(lag(v))) for v in (1.0, 9.0))
    found = diff_document([compare_results("x", old, new, NONE)], [("y.json", "old")])
    assert found["count"] == 2
    assert found["only_in"] == {"old": ["y.json"], "new": []}
    assert found["logs"][0]["moved"][0]["difference"] == 8.0


def test_what_differs_behind_the_digits_shown_is_shown_with_all_of_them_and_nothing_as_none() -> None:
    said = [
        entry_line(TextChange(*change)) for change in (("a", 3.473641512, 3.473641513), ("b", "", "x"), ("c", 1.5, 2.0))
    ]
    assert said == ["a: 3.473641512 → 3.473641513", "b: none → x", "c: 1.5 → 2"]


def test_changes_stand_by_question_the_main_ones_first_worse_before_better() -> None:
    def row_of(tilt_deg: float, noise_deg: float, lag_ms: float, other: float) -> EstimatorRow:
        more = {"all": {"tilt_rmse_deg": Answer(other, "deg", "all")}}
        return filtered(merged(tilt(tilt_deg), noise(noise_deg), lag(lag_ms), more))

    found = compare_results("x", result(row_of(2.0, 0.1, 1.0, 1.0)), result(row_of(1.0, 0.3, 9.0, 9.0)), NONE)
    assert [(m.metric, m.window) for m in found.moved] == [
        ("tilt_rmse_deg", "airborne"),
        ("tilt_rmse_deg", "all"),
        ("noise_tilt_deg", "rest"),
        ("lag_ms", "airborne"),
    ]
    assert [block.title for block in diff_blocks(found).numbers] == ["Accuracy", "Noise", "Step response"]
    text = [line.strip() for line in diff_lines([found], [], False)]
    assert text.index("Accuracy (2)") < text.index("Noise (1)") < text.index("Step response (1)")
    assert [m["metric"] for m in diff_document([found], [])["logs"][0]["moved"]] == [m.metric for m in found.moved]
    old, new = (result(filtered(tilt(a)), filtered(tilt(b), "vqf")) for a, b in ((1.0, 9.0), (2.0, 1.0)))
    two = compare_results("x", old, new, NONE)
    assert [m.closer for m in two.moved] == [False, True]


def test_headline_verdicts_and_findings_come_first_and_count_for_nothing() -> None:
    old, new = result(filtered(lag(1.0))), result(filtered(lag(1.0)))
    old.headline, new.headline = "A flight.", "A crash."
    new.findings = [Finding("crash", "serious", "It fell."), Finding("dust", "note", "Some dust.")]
    found = compare_results("x", old, new, NONE)
    assert found.statements == [
        TextChange("headline", "A flight.", "A crash."),
        TextChange("finding: crash", "(absent)", "It fell."),
    ]
    assert found.count == 0
    assert "    headline: A flight. → A crash." in list(diff_lines([found], [], False))
    old.headline = ""
    assert compare_results("x", old, new, NONE).statements == [TextChange("finding: crash", "(absent)", "It fell.")]


def test_a_terminal_lists_few_of_each_question_and_all_with_everything() -> None:
    sides = [filtered({"all": {f"noise_{k}_deg": Answer(v, "deg", "all") for k in range(30)}}) for v in (1.0, 2.0)]
    found = compare_results("x", result(sides[0]), result(sides[1]), NONE)
    short, whole = (list(diff_lines([found], [], everything)) for everything in (False, True))
    assert len(short) < 12
    assert "    and 25 more; -v lists all" in short
    assert len(whole) == 32


# Which results of two folders belong together.


def folder(path: Path, **logs: str) -> Path:
    path.mkdir()
    for name, sha in logs.items():
        result(sha=sha).to_json(path / f"{name}.json")
    return path


def test_files_of_one_name_belong_together_and_renamed_ones_by_their_log(tmp_path: Path) -> None:
    old = folder(tmp_path / "old", a="1", b="2", gone="3")
    new = folder(tmp_path / "new", a="9", c="2", come="4")
    pairs = pair_results(old, new).pairs
    both = {name: [None if r is None else r.log["sha256"] for r in pair] for name, pair in pairs.items()}
    assert both == {"a.json": ["1", "9"], "b.json": ["2", "2"], "gone.json": ["3", None], "come.json": [None, "4"]}


def test_a_broken_file_of_a_folder_is_told_and_the_others_are_compared(tmp_path: Path) -> None:
    old, new = folder(tmp_path / "old", a="1", b="2"), folder(tmp_path / "new", a="1", b="2")
    text = (new / "b.json").read_text()
    (new / "b.json").write_text(text[: len(text) // 2])
    (new / "notes.json").write_text('{"no": "result"}')
    answer = pair_results(old, new)
    assert [type(e) for e in answer.wrong] == [LogUnusable]
    assert "b.json" in str(answer.wrong[0])
    assert answer.pairs["a.json"][1] is not None
    assert "notes.json" not in answer.pairs


def test_what_cannot_be_compared_is_told_apart(tmp_path: Path) -> None:
    one = folder(tmp_path / "one", a="1")
    (tmp_path / "none").mkdir()
    (tmp_path / "x.json").write_text("[]")
    with pytest.raises(LogUnreadable, match="without a result"):
        pair_results(one, tmp_path / "none")
    with pytest.raises(LogUnreadable, match="no such file"):
        pair_results(one / "a.json", tmp_path / "missing.json")
    with pytest.raises(LogUnusable, match="no schema"):
        pair_results(one / "a.json", tmp_path / "x.json")
    with pytest.raises(UsageError, match="two files or two folders"):
        pair_results(one, tmp_path / "x.json")


# The page of a difference: short, accessible, in the order of the terminal, and hostile names are only text.


def made(name: str = "x.json", text: str = "A crash.") -> RunDifference:
    many = ({"all": {f"noise_{k}_deg": Answer(v, "deg", "all") for k in range(30)}} for v in (1.0, 2.0))
    rows = [
        filtered(merged(tilt(t), noise(0.1), lag(1.0), more), kp=t) for t, more in zip((2.0, 4.0), many, strict=True)
    ]
    old, new = (result(row) for row in rows)
    old.headline, new.headline = "A flight.", text
    return compare_results(name, old, new, Tolerances())


def written(tmp_path: Path, *found: RunDifference) -> Path:
    path = tmp_path / "diff.html"
    path.write_text(diff_page(found, [("y.json", "old")], "a", "b", "1", "attlog diff a b"), encoding="utf-8")
    return path


def test_headline_numbers_by_question_and_causes_stand_in_this_order(tmp_path: Path) -> None:
    body = written(tmp_path, made()).read_text(encoding="utf-8")
    body = body[body.index("<main") :].replace("\u00a0", " ")
    places = [
        body.index(w)
        for w in ("A crash.", "Accuracy (1)", "Other numbers (30)", "28 more", "Filter gains", "No change")
    ]
    assert places == sorted(places)
