"""Figures: one colour per row, words for those who do not see them, close-ups that show what they are for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.metrics.figures.trace import Trace
from attlog.present.names import row_name
from attlog.report import write_report
from attlog.report.figures.catalogue import sections
from attlog.report.figures.figure import Rows, dots_text, reach
from attlog.report.figures.marks import time_marks
from attlog.report.look import looks
from attlog.report.pack import Store
from attlog.story.event import Event
from tests.report.browser import own_bytes
from tests.report.conftest import make_result


def figures(result):
    """All figures of a result by id."""
    return {f.id: f for part in sections(result, looks(result), Store()).values() for f in part}


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
    assert reach([trace], Rows({"vqf": "VQF"})) == "VQF: roll −2.0° to 31.0°"


def test_dots_in_words_are_value_and_interval():
    dots = [{"r": 0, "v": 9.3, "ci": [7.0, 11.0], "ok": True}, {"r": 1, "v": None, "ci": None, "ok": False}]
    assert dots_text(dots, ["ekf", "fan"], "ms") == "ekf: +9 ms (+7 to +11); fan: not judged"


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
    assert [name for _, name in figure.bands] == [v.name for v in looks(make_result()).values() if not v.onboard]


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
