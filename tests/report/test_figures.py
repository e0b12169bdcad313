"""Figures: one colour per row, words for those who do not see them, close-ups that show what they are for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.metrics.trace import Trace
from attlog.report import write_report
from attlog.report.bundle import ArrayPacker
from attlog.report.figures.canvas import Rows, dots_words, range_words
from attlog.report.figures.catalogue import sections
from attlog.report.figures.panels import MAX_MESSAGES, marked_messages, time_marks
from attlog.report.figures.style import row_styles
from attlog.story.flight_events import Event
from attlog.words.names import row_name
from tests.report.browser import own_bytes
from tests.report.conftest import make_result


def figures(result):
    """All figures of a result by id."""
    return {f.id: f for part in sections(result, row_styles(result), ArrayPacker()).values() for f in part}


@pytest.mark.slow
def test_a_row_has_one_colour_and_dash_in_every_figure(visit, report):
    page = visit(report).page
    found = page.evaluate(
        """() => [...document.querySelectorAll('.plot')].flatMap((p) => p.data
            .filter((t) => t.meta !== undefined && t.meta !== null && (t.mode === 'lines') && t.line)
            .map((t) => [p.id, t.meta, t.line.color]))"""
    )
    colours = {row: {c for _, r, c in found if r == row} for _, row, _ in found}
    assert len(colours) >= 6
    assert all(len(c) == 1 for c in colours.values()), colours
    assert len({c for cs in colours.values() for c in cs}) == len(colours)


def test_figures_with_numbers_say_them_in_words():
    names = [row_name(row) for row in make_result().estimators if row.kind == "replay"]
    for figure in ("attitude", "difference", "rest", "lag", "drifts", "bias"):
        assert any(name in figures(make_result())[figure].words for name in names), figure


@pytest.mark.slow
def test_what_is_said_in_words_is_there_for_those_who_do_not_see(visit, report):
    page = visit(report).page
    for plot in page.query_selector_all(".plot[aria-describedby]"):
        assert len(page.locator(f"#{plot.get_attribute('aria-describedby')}").inner_text()) > 10


def test_the_figure_of_drifts_holds_every_drift_at_rest_and_in_the_air_once():
    result = make_result()
    rows = [row for row in result.estimators if row.kind == "replay"]
    answers = [(m, a) for row in rows for found in row.metrics.values() for m, a in found.items() if "drift_" in m]
    wanted = sorted({(m.partition(".")[2] or "rest", a.value) for m, a in answers if a.value is not None})
    dots = figures(result)["drifts"].data["rows"]
    found = [(d["where"].removeprefix("against ").removeprefix("at "), d["v"]) for d in dots]
    assert {where for where, _ in wanted} == {"rest", "onboard"}
    assert [one for one in wanted if one not in found] == []


def test_lines_in_words_are_their_smallest_and_largest_value():
    trace = Trace("attitude", "vqf", np.arange(3.0), {"roll": np.array([-2.0, np.nan, 31.04])})
    assert range_words([trace], Rows({"vqf": "VQF"})) == "VQF: roll −2.0° to 31.0°"


def test_dots_in_words_are_value_and_interval():
    dots = [{"r": 0, "v": 9.3, "ci": [7.0, 11.0], "ok": True}, {"r": 1, "v": None, "ci": None, "ok": False}]
    assert dots_words(dots, ["ekf", "fan"], "ms") == "ekf: +9 ms (+7 to +11); fan: not judged"


def test_the_lag_figure_shows_single_movements_of_ranked_rows_only():
    result = make_result()
    for row in result.estimators[1:]:
        row.metrics["airborne"]["lag_ms"].each = [250.0, 3.0]
    result.estimators[1].metrics["airborne"]["lag_ms"].ranked = False
    drawn = {d["r"]: d for d in figures(result)["lag"].data["rows"]}
    assert drawn[5]["single"] == []
    assert drawn[5]["ok"] is False
    assert 1 not in drawn
    assert drawn[3]["single"] == [250.0, 3.0]


def test_modes_armed_airborne_messages_and_failsafes_stand_on_the_time_axis():
    result = make_result()
    result.log["timeline"] = {
        "modes": [[0.0, 60.0, "LOITER"]],
        "armed": [[10.0, 60.0]],
        "airborne": [[12.0, 55.0]],
        "texts": [[20.0, 6, "GPS glitch cleared"], [30.0, 2, "Radio failsafe"]],
    }
    marks = time_marks(result)
    assert marks["modes"] == [[0.0, 60.0, "LOITER"]]
    assert marks["armed"] == [[10.0, 60.0]]
    assert marks["airborne"] == [[12.0, 55.0]]
    assert [level for _, level, _ in marks["texts"]] == [0, 2]


def test_jumps_are_those_of_the_list_of_events():
    result = make_result()
    assert [t for t, _ in time_marks(result)["resets"]] == [103.4]
    assert "jump" in figures(result)["attitude"].caption
    result.events = []
    assert time_marks(result)["resets"] == []
    assert "jump" not in figures(result)["attitude"].caption


def test_figures_end_a_little_after_the_crash_that_ended_the_last_flight():
    result = make_result()
    assert time_marks(result)["crash"] is None
    assert time_marks(result)["first"] == time_marks(result)["range"]
    result.events = [Event("impact", 150.0, "serious", "It crashed.")]
    assert time_marks(result)["first"] == [0.0, 155.0]
    assert time_marks(result)["range"] == [0.0, 200.0]
    result.log["timeline"]["airborne"].append([170.0, 190.0])
    assert time_marks(result)["crash"] is None


def test_the_attitude_starts_with_onboard_and_set_point_and_offers_the_filters():
    figure = figures(make_result())["attitude"]
    assert figure.views == ["Onboard, set-point", "With the filters"]
    assert figure.data["views"] == [{"focus": [0]}, {}]
    assert {"roll", "pitch", "heading"} == set(figure.data["demand"]["y"])
    result = make_result()
    result.traces = [t for t in result.traces if t.row in ("", "onboard")]
    assert figures(result)["attitude"].views == []


def test_the_band_is_of_one_of_the_best_in_lag():
    figure = figures(make_result())["steps"]
    assert dict(figure.bands)[figure.data["band"]] == "VQF"
    assert [name for _, name in figure.bands] == [v.name for v in row_styles(make_result()).values() if not v.onboard]


def test_the_ground_track_says_how_far_heading_and_course_differ():
    figure = figures(make_result())["track"]
    assert "median +20.0°, middle half +18.0° to +22.0°" in figure.caption
    assert "sideways" in figure.caption
    result = make_result()
    trace = next(t for t in result.traces if t.figure == "track")
    trace.values = {"least": 5.0, "forward": 1.0}
    assert figures(result)["track"].caption.endswith("Too little time above 5 m/s to compare heading and course.")


def test_an_alarm_is_explained_only_where_it_is_drawn():
    result = make_result()
    assert "failsafe" in figures(result)["attitude"].caption
    result.log["timeline"]["texts"] = [[-30.0, 2, "Radio Failsafe"]]
    assert "failsafe" not in figures(result)["attitude"].caption


def test_a_drift_that_several_windows_tell_is_one_dot():
    result = make_result()
    before = len(figures(result)["drifts"].data["rows"])
    for row in result.estimators:
        found = row.metrics["rest"]["drift_rest_deg_per_min"]
        row.metrics.setdefault("all", {})["drift_rest_deg_per_min"] = replace(found, n=found.n + 1)
    assert len(figures(result)["drifts"].data["rows"]) == before


def test_dots_hold_how_many_they_stand_on():
    assert {d["n"] for d in figures(make_result())["lag"].data["rows"]} == {28}


@pytest.mark.slow
@pytest.mark.parametrize("log", ["px4_hover.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog"])
def test_reports_of_real_logs_open_without_complaint_and_draw_everything(visit, samples, tmp_path, log):
    import attlog

    path = tmp_path / "report.html"
    write_report(attlog.analyze(samples / log), path)
    assert own_bytes(path) < 2_400_000
    page = visit(path)
    assert page.complaints == []
    assert page.requests == [path.as_uri()]
    assert [name for name, drawn in page.figures().items() if not drawn] == []


def test_a_reference_without_a_heading_shows_none_and_no_difference_from_it():
    result = make_result()
    result.reference = replace(result.reference, choice="onboard", heading_by="nobody")
    found = figures(result)
    assert all("heading" not in line["y"] for line in found["difference"].data["series"])
    by_row = {line["r"]: line["y"] for line in found["attitude"].data["series"]}
    assert [r for r, y in by_row.items() if "heading" not in y] == [0]
    result.reference = replace(result.reference, heading_by="own")
    assert all("heading" in line["y"] for line in figures(result)["difference"].data["series"])


# What is drawn of an autopilot's messages where there are more than a page holds.


def test_of_too_many_messages_the_worst_are_drawn_in_the_order_of_time() -> None:
    """syslog levels: 6 information, 4 warning, 1 alert."""
    calm = [(float(t), 6, "Reached waypoint") for t in range(MAX_MESSAGES)]
    found = marked_messages([*calm, (3000.0, 4, "EKF variance"), (3001.0, 1, "Crash")])
    assert len(found) == MAX_MESSAGES
    assert [row[0] for row in found[-2:]] == [3000.0, 3001.0]
    assert [row[1] for row in found[-3:]] == [0, 1, 2]
    assert [row[0] for row in found] == sorted(row[0] for row in found)


# Figures of the sensors: nothing twice, captions with the numbers, bands where they belong.


def sensor_figures_of(result=None):
    """Figures of the section by id."""
    result = result or make_result()
    return {f.id: f for f in sections(result, row_styles(result), ArrayPacker())["sensors"]}


def without(*figures: str):
    """The result without some traces."""
    result = make_result()
    result.traces = [t for t in result.traces if t.figure not in figures]
    return result


def test_the_fields_size_alone_is_drawn_only_where_its_axes_are_not():
    assert list(sensor_figures_of()) == [
        "compass",
        "interference",
        "vibration",
        "spectrum",
        "gravity",
        "ratios",
        "bias",
    ]
    assert "field" in sensor_figures_of(without("compass"))


def test_the_caption_of_the_field_says_by_which_attitude_and_whether_it_is_corrected():
    caption = sensor_figures_of()["compass"].caption
    assert "by motion alone, without any compass" in caption
    assert "offset that can be set" in caption
    result = make_result()
    trace = next(t for t in result.traces if t.figure == "compass")
    trace.values["by_motion"] = 0.0
    trace.columns = {name: y for name, y in trace.columns.items() if not name.startswith("corrected")}
    caption = sensor_figures_of(result)["compass"].caption
    assert "by the onboard attitude" in caption
    assert "can be set" not in caption
    assert "x off by +12.0 µT" in sensor_figures_of()["compass"].words


def test_the_autopilots_own_level_comes_first_with_percentiles_and_limits():
    figure = sensor_figures_of()["vibration"]
    assert figure.caption == (
        "The autopilot's own level in flight: p50 20.0, p80 26.0, worst second 48.0 m/s²; limits 30 and 60. "
        "▼ 7 samples clipped (VIBE.Clip0)."
    )
    first, second = figure.data["views"]
    assert first["limits"] == [30.0, 60.0]
    assert first["clipped"] == second["clipped"] == [[100.5, 7]]
    assert set(second["axes"]) == {"x", "y", "z"}


def test_without_counters_the_logged_samples_tell_what_was_clipped():
    figure = sensor_figures_of(without("levels", "clipping"))["vibration"]
    assert figure.data["views"][0]["clipped"] == [[100.5, 1]]
    assert "1 sample at the end of its range" in figure.caption


@pytest.mark.parametrize(("rate", "folded"), [(100.0, 0.0), (400.0, 100.0), (500.0, 200.0)])
def test_folded_frequencies_reach_from_the_rate_less_the_fastest_rotor_to_half_the_rate(rate, folded):
    result = make_result()
    for trace in result.traces:
        if trace.figure == "spectrum":
            trace.values["nyquist_hz"] = rate / 2
    figure = sensor_figures_of(result)["spectrum"]
    assert figure.data["views"][0]["folded"] == folded
    assert f"between {rate / 2:.0f} and 300 Hz" in figure.caption


def test_a_rate_beyond_twice_the_fastest_rotor_folds_nothing():
    result = make_result()
    for trace in result.traces:
        if trace.figure == "spectrum":
            trace.values["nyquist_hz"] = 500.0
    assert "Hatched" not in sensor_figures_of(result)["spectrum"].caption


def test_rotors_and_notches_are_bands_of_the_spectrum():
    data = sensor_figures_of()["spectrum"].data
    assert "Grey: rotors, 8.0 Hz and harmonics." in sensor_figures_of()["spectrum"].caption
    assert [b["f"] for b in data["rotor"]] == [8.0, 16.0, 24.0]
    assert [(b["key"], b["f"]) for b in data["notches"]] == [("set", 8.0), ("proposed", 16.0)]


def test_rotors_faster_than_half_the_rate_are_said_to_be_beyond_it():
    result = make_result()
    rotor = next(t for t in result.traces if t.figure == "rotor")
    rotor.t = 10.0 * rotor.t
    assert "Rotors turn at 80 Hz, beyond half the rate." in sensor_figures_of(result)["spectrum"].caption


def test_every_aid_has_a_colour_of_its_own_whoever_else_is_drawn():
    lines = sensor_figures_of()["ratios"].data["lines"]
    assert [(line["aid"], line["slot"]) for line in lines] == [("compass", 1), ("velocity", 2)]
    result = without("bias")
    result.traces = [t for t in result.traces if not (t.figure == "ratios" and t.key == "compass")]
    assert [(line["aid"], line["slot"]) for line in sensor_figures_of(result)["ratios"].data["lines"]] == [
        ("velocity", 2)
    ]


def test_lines_of_nothing_but_gaps_are_drawn_without_error():
    result = make_result()
    for trace in result.traces:
        if trace.figure in ("compass", "levels"):
            trace.columns = {name: np.full(len(trace.t), np.nan) for name in trace.columns}
    assert {"compass", "vibration"} <= set(sensor_figures_of(result))
