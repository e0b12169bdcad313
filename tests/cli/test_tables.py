"""The table of sensors and the line of ``analyze``: no wider than the terminal, nothing cut off."""

from __future__ import annotations

from dataclasses import replace

import pytest

from attlog.cli.printing import wrapped
from attlog.cli.tables import comparison, printed, said_once, sensor_lines, set_line, setting_lines
from attlog.health.check import Setting
from attlog.metrics.metric import missing
from attlog.result import Duplicates, Finding
from attlog.words.names import row_names
from attlog.words.table import main_table
from attlog.words.text import encodable
from tests.health.made import MADE, OFFSET, REFUSED, SILENT, SOUND
from tests.report.conftest import make_result
from tests.words.made import answer


@pytest.mark.parametrize("width", [60, 80, 100, 160])
@pytest.mark.parametrize("verbose", [False, True])
def test_the_table_fits_and_loses_no_word(width: int, verbose: bool) -> None:
    lines = [line.text for line in sensor_lines(MADE, str, width, verbose)]
    assert max(map(len, lines)) <= width
    text = " ".join(" ".join(lines).split())
    for word in ("MAG.0", "compass offset", "COMPASS_OFS_X -12 -> 145", "COMPASS_OFS_Y 4.5 -> -20.25", "LOG_DISARMED"):
        assert word in text
    assert not [line for line in lines if line != line.rstrip()]


def test_what_is_off_without_anything_to_set_is_told_in_its_sentence() -> None:
    plain = replace(REFUSED, why_no_setting="")
    assert plain.text.replace("uT", "µT") in "\n".join(line.text for line in sensor_lines([plain], str, 160, False))


def test_what_is_sound_and_may_be_set_stands_in_the_table() -> None:
    suggestion = replace(SOUND, settings=[Setting("NOISE", 0.05, 0.03)])
    lines = [line.text for line in sensor_lines([suggestion], str, 160, False)]
    assert "    NOISE 0.05 -> 0.03" in lines
    assert not [line for line in lines if "ok:" in line]


def test_the_line_of_analyze_takes_two_lines_at_most_and_says_how_many_more() -> None:
    many = [Setting(f"COMPASS_OFS{k}_X", float(k), 145.0 + k) for k in range(12)]
    for count in (1, 2, 12):
        lines = [line.text for line in set_line(many[:count], "a_flight.bin", 80)]
        assert len(lines) <= 2
        assert max(map(len, lines)) <= 80
        assert lines[0].startswith("set       COMPASS_OFS0_X 0 -> 145")
        assert ("more" in " ".join(lines)) == (count == 12)
    assert list(set_line([], "a_flight.bin", 80)) == []
    (line,) = set_line(many, "a" * 200, 80)
    assert line.text == "set       12 parameters; attlog health shows which and why."


def test_settings_stand_a_line_each() -> None:
    assert [line.text for line in setting_lines(OFFSET.settings)] == [
        "set",
        "  COMPASS_OFS_X -12 -> 145",
        "  COMPASS_OFS_Y 4.5 -> -20.25",
    ]
    assert list(setting_lines([])) == []


def test_what_is_folded_counts_its_sensors_and_the_same_words_stand_once() -> None:
    twice = [REFUSED, replace(REFUSED, sensor="MAG.2"), SOUND, replace(SOUND, sensor="IMU.1"), SOUND]
    lines = [line.text for line in sensor_lines(twice, str, 160, False)]
    assert lines[-1] == "  ok: vibration (3)"
    assert "\n".join(lines).count(REFUSED.why_no_setting) == 1
    assert "    The same as for MAG.1." in lines


def test_a_long_name_of_a_sensor_leaves_the_value_a_line_of_its_own() -> None:
    long = replace(OFFSET, sensor="estimator_selector_status", question="accelerometer_temperature")
    lines = [line.text for line in sensor_lines([long], str, 80, False)]
    assert max(map(len, lines)) <= 80
    assert lines[2] == "    24.0 ± 3.0 µT"


def test_what_cannot_be_told_says_why_once_when_asked() -> None:
    same = [SILENT, replace(SILENT, sensor="GPS.1")]
    assert [line.text for line in sensor_lines(same, str, 80, False)] == ["  no answer: GNSS delay (2) (why: -v)"]
    assert [line.text for line in sensor_lines(same, str, 80, True)] == [
        "  no answer: GNSS delay of GPS.0; GNSS delay of GPS.1",
        f"      {SILENT.text}",
    ]


# The comparison on the terminal: width, marks, words for what is missing.


def lines(result, width=100, shown=str, verbose=True):
    """The lines of the table in this many columns."""
    return [line.text for line in comparison(result, "all", width, shown, verbose)]


@pytest.mark.parametrize("width", [60, 80, 100, 160])
def test_every_number_is_whole_and_no_line_is_wider_than_the_terminal(width):
    result = make_result()
    found = lines(result, width)
    assert max(map(len, found)) <= width
    table = main_table(result)
    left_out = found[-1] if found[-1].startswith("No room") else ""
    for row, cells in table.rows:
        line = next(x for x in found if x.startswith(row_names(result)[row.name]))
        for heading, cell in zip(table.columns, cells, strict=True):
            words = line.replace("*", " ").replace("~", " ").split()
            gone = heading.title[0].lower() + heading.title[1:] in " ".join(found[-2:])
            assert cell.missing or gone or cell.text in words, (row.name, heading.title, left_out)


def test_a_narrow_terminal_keeps_the_four_questions_and_names_what_it_leaves_out():
    found = "\n".join(lines(make_result(), 60))
    assert all(word in found for word in ("Tilt", "Noise", "Lag", "Drift"))
    assert "No room for: heading error RMS, air drift by onboard, cost" in found


def test_names_give_way_before_numbers_do():
    found = lines(make_result(), 40)
    vqf = next(line for line in found if line.startswith("VQF"))
    assert vqf.split() == ["VQF", "5.2", "0.004*", "−1*", "−0.05*"]
    assert any(line.startswith("Compl") and ".." in line for line in found)


def test_a_wide_terminal_shows_the_ids():
    found = lines(make_result(), 160)
    assert any(line.split()[:4] == ["Mahony,", "Xu", "0.6", "mahony@xu-0.6"] for line in found)
    assert not any("mahony@xu-0.6" in line for line in lines(make_result(), 80))


def test_no_line_ends_with_a_blank():
    assert [x.text for x in printed(make_result(), "all", 80, "utf-8", True) if x.text != x.text.rstrip()] == []


def test_columns_stay_aligned_where_signs_have_stand_ins():
    found = lines(make_result(), 80, lambda text: encodable(text, "ascii"))
    assert "".join(found).isascii()
    assert max(map(len, found)) <= 80
    starts = {line.index(n) for name, n in (("Gyro", "0.003"), ("Madgwick", "0.044")) for line in found if name in line}
    assert len(starts) == 1


def test_who_looks_ahead_is_named_and_the_reference_is_not():
    result = make_result()
    filters = [row for row in result.estimators if row.kind == "replay"]
    filters[0].causal = filters[1].causal = False
    filters[1].is_reference = True
    said = [line for line in lines(result, 200) if line.startswith("Looks ahead")]
    assert said == [f"Looks ahead in time: {row_names(result)[filters[0].name]}."]
    filters[0].causal = True
    assert not any(line.startswith("Looks ahead") for line in lines(result, 200))


def test_why_a_log_is_not_enough_for_a_filter_stands_below_the_table():
    result = make_result()
    row = next(row for row in result.estimators if row.kind == "replay")
    row.status, row.reason = "failed", "no GNSS motion told the heading"
    result.findings = [Finding("estimator_failed", "note", f"{row.name}: {row.reason}")]
    assert f"{row_names(result)[row.name]} failed: no GNSS motion told the heading." in lines(result, 200)
    result.findings = [Finding("estimator_failed", "serious", f"{row.name}: {row.reason}")]
    assert not any(" failed: " in line for line in lines(result, 200))


def test_a_missing_value_is_a_word_and_a_column_without_values_is_left_out():
    result = make_result()
    assert any("not a pure delay" in line for line in lines(result, 160) if line.startswith("Complementary"))
    for row in result.estimators:
        row.metrics["airborne"]["lag_ms"] = missing("no_events", "no steps", "ms", "airborne")
    assert not any("Lag ms" in line for line in lines(result))


def test_the_best_are_marked_and_what_was_not_compared_is_told_apart():
    result = make_result()
    assert "*" in next(line for line in lines(result) if line.startswith("VQF"))
    assert "~" not in next(line for line in lines(result) if line.startswith("VQF"))
    result.best, result.ranked = {}, {}
    assert "~" in next(line for line in lines(result) if line.startswith("VQF"))


def healthy(width=80, verbose=False):
    """What is printed of a flight in which nothing went wrong."""
    result = make_result()
    result.findings, result.events, result.health = [], [], []
    result.headline = "Quadrotor, PX4 1.15.4: flew 36 to 140 s, up to 6 m and 23° of tilt, landed. Nothing went wrong."
    return [line.text for line in printed(result, "all", width, "utf-8", verbose)]


def test_a_healthy_log_takes_twenty_lines_of_eighty_columns_with_the_path_of_its_report():
    found = healthy()
    assert len(found) + 1 <= 20
    assert max(map(len, found)) <= 80
    labels = [line.split()[0] for line in found if line[:1].isalpha()]
    assert labels[1:5] == ["accuracy", "noise", "lag", "yaw"]
    assert len(healthy(verbose=True)) > 25


def test_the_short_table_has_a_column_for_each_question_and_what_flew_alone_of_the_onboard_rows():
    result = make_result()
    result.estimators += [
        replace(r, name="onboard:AHR2", title="AHR2", is_reference=False)
        for r in result.estimators
        if r.name == "onboard"
    ]
    head, *body = lines(result, 80, verbose=False)
    assert head.split() == ["filter", "Tilt", "°", "Heading", "°", "Noise", "°", "Lag", "ms", "Drift", "°/min"]
    assert not any("AHR2" in line or "mahony@xu-0.6" in line for line in body)
    assert any(line.startswith("Onboard ") for line in body)
    assert any("AHR2" in line for line in lines(result, 80))


def test_the_drift_of_the_short_table_is_that_in_the_air_where_there_was_no_rest():
    result = make_result()
    for row in result.estimators:
        row.metrics["rest"].pop("drift_rest_deg_per_min", None)
        row.metrics["airborne"]["drift_air_deg_per_min.onboard"] = answer(7.7, "deg/min", "airborne")
    head, *body = lines(result, 80, verbose=False)
    assert head.split()[-2:] == ["Drift", "°/min"]
    assert "+7.7" in next(line for line in body if line.startswith("VQF"))


def test_a_log_without_any_value_has_no_table():
    result = make_result()
    for row in result.estimators:
        row.metrics = {}
    assert lines(result, 80, verbose=False) == []


def test_a_line_is_not_broken_between_a_number_and_its_unit():
    text = "flew 36 to 140 s, up to 6 m and 23 m/s² for 12 minutes"
    for width in range(12, 40):
        found = [line.text for line in wrapped("", text, width)]
        assert " ".join(found) == text
        assert not any(line.startswith(("s,", "m ", "m/s²")) for line in found)


def test_filters_with_equal_attitudes_are_always_told_and_a_shared_equation_only_when_asked():
    result = make_result()
    rows = [r.name for r in result.estimators[:2]]
    result.alike = [Duplicates(rows, "attitudes"), Duplicates(rows, "equation", "Paper 1")]
    for verbose in (False, True):
        found = " ".join(line.text for line in printed(result, "all", 80, "utf-8", verbose))
        assert "give the same attitudes in this log" in found
        assert ("share one equation" in found) == verbose


def test_the_last_line_says_what_the_reference_rests_on_unless_a_sentence_above_does():
    result = make_result()
    result.reference.caveat = "the smoother was refused: own tilt sigma 2.3 deg"
    said = " ".join(lines(result, 80, verbose=False))
    assert "Agreement with onboard, not truth; the smoother was refused: own tilt sigma 2.3°." in said
    assert max(map(len, lines(result, 80, verbose=False))) <= 80
    assert "refused" not in " ".join(lines(result, 80))


def test_borrowed_headings_are_told_in_the_last_line():
    result = make_result()
    result.reference.choice, result.reference.heading_by = "smoother", "onboard"
    said = " ".join(lines(result, 80))
    assert "Against the smoother; headings against onboard (agreement, not truth)." in said


def test_a_reason_why_several_questions_have_no_answer_stands_once_behind_them():
    no = "Cannot be determined: no step."
    found = list(
        said_once({"accuracy": "Tilt: A 1.0°.", "noise": no, "lag": "Cannot be determined: x.", "yaw drift": no})
    )
    assert [label for label, _ in found] == ["accuracy", "lag", "no answer"]
    assert found[-1][1] == "Noise and yaw drift: no step."


def test_of_many_findings_five_stand_above_the_answers():
    result = make_result()
    result.findings = [Finding("x", "warning", f"Number {i} is wrong.") for i in range(9)]
    found = [line.text for line in printed(result, "all", 80, "utf-8")]
    assert sum("is wrong." in line for line in found) == 5
    assert "          and 4 more with -v" in found
    verbose = [line.text for line in printed(result, "all", 80, "utf-8", True)]
    assert sum("is wrong." in line for line in verbose) == 9


def test_the_table_stands_only_where_filters_were_compared():
    result = make_result()
    result.ranked = {}
    assert not any(line.text.startswith("filter ") for line in printed(result, "all", 80, "utf-8"))
    assert any(line.text.startswith("filter ") for line in printed(result, "all", 80, "utf-8", True))


def test_the_gyro_alone_stands_in_the_short_table_only_without_other_filters():
    result = make_result()
    assert not any(line.startswith("Gyro") for line in lines(result, 80, verbose=False))
    result.estimators = [r for r in result.estimators if r.estimator == "gyro" or r.kind == "onboard"]
    assert any(line.startswith("Gyro") for line in lines(result, 80, verbose=False))
