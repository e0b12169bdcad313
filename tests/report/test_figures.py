"""Figures: one colour per row, words for those who do not see them, close-ups that show what they are for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog.metrics.trace import Trace
from attlog.report import write_report
from attlog.report.figures.catalogue import sections
from attlog.report.figures.drift import AnswerDot, dots_words
from attlog.report.figures.figure import (
    FIT_KEYS,
    MAX_MESSAGES,
    META_KEYS,
    FigureSource,
    marked_messages,
    range_words,
    time_marks,
)
from attlog.report.shell import WEB
from attlog.result import Result
from attlog.story.flight_events import Event
from tests.golden import check_golden
from tests.report.browser import own_bytes
from tests.report.conftest import make_result


def figures(result):
    """All figures of a result by id."""
    return {f.id: f for part in sections(FigureSource.of(result)).values() for f in part}


def traces(figure, view=0):
    """The traces of a view."""
    return (figure.data | figure.data["views"][view])["traces"]


def dots(figure):
    """Own keys of the dots with an interval or a value."""
    return [t["meta"] for t in traces(figure) if "value" in t["meta"]]


def without(*figures: str):
    """The result without some traces."""
    result = make_result()
    result.traces = [t for t in result.traces if t.figure not in figures]
    return result


def changed() -> Iterator[tuple[str, Result]]:
    """Yield results with something changed that captions and words tell."""
    yield "no events", replace(make_result(), events=[])
    result = make_result()
    result.log["timeline"]["texts"] = [[-30.0, 2, "Radio Failsafe"]]
    yield "an alarm before the log", result
    yield "no compass", without("compass")
    yield "no counters of clipping, no onboard level", without("levels", "clipping")
    result = make_result()
    result.traces = [t for t in result.traces if t.row in ("", "onboard")]
    yield "onboard only", result
    result = make_result()
    by_figure = {t.figure: t for t in result.traces}
    by_figure["track"].values = {"least": 5.0, "forward": 1.0}
    field = next(t for t in result.traces if t.figure == "compass")
    field.values["by_motion"] = 0.0
    field.columns = {name: y for name, y in field.columns.items() if not name.startswith("corrected")}
    by_figure["rotor"].t = 10.0 * by_figure["rotor"].t
    yield "slow, compass by the attitude and not corrected, rotors beyond the rate", result
    for rate in (100.0, 400.0, 500.0, 1000.0):
        result = make_result()
        for trace in result.traces:
            if trace.figure == "spectrum":
                trace.values["nyquist_hz"] = rate / 2
        yield f"sampled at {rate:g} Hz", result


def told(result: Result) -> dict[str, list[str]]:
    """What a figure says, by id."""
    return {
        name: [
            f"{f.title} | views {', '.join(f.views)} | bands {', '.join(band for _, band in f.bands)}",
            f"  {f.caption}",
            f"  in words: {f.words}",
        ]
        for name, f in figures(result).items()
    }


def test_titles_captions_and_words_are_as_reviewed() -> None:
    plain = told(make_result())
    lines = [line for name, said in plain.items() for line in (f"{name}: {said[0]}", *said[1:])]
    for what, result in changed():
        lines.append(f"== {what}")
        said = told(result)
        lines += [f"{name}: not drawn" for name in plain if name not in said]
        lines += [x for name, s in said.items() if s != plain.get(name) for x in (f"{name}: {s[0]}", *s[1:])]
    check_golden(Path(__file__).parent / "golden" / "figures.txt", lines)
    steps = figures(make_result())["steps"]
    assert dict(steps.bands)[steps.data["band"]] == "VQF", "one of the best in lag"


def test_own_keys_are_documented_and_read_by_the_page():
    scripts = "".join((WEB / name).read_text(encoding="utf-8") for name in ("plots.js", "reduce.js", "spreadsheet.js"))
    printed = {"group", "places", "step", "log"}  # of the printed legend, and of packing
    for figure in figures(make_result()).values():
        for view in range(len(figure.data["views"])):
            assert {k for t in traces(figure, view) for k in t["meta"]} <= set(META_KEYS), figure.id
            axes = (figure.data | figure.data["views"][view])["axes"].values()
            assert {k for axis in axes for k in axis.get("fit", {})} <= set(FIT_KEYS), figure.id
    assert [k for k in set(META_KEYS) - printed if f"m.{k}" not in scripts and f"own.{k}" not in scripts] == []
    assert [k for k in FIT_KEYS if f"fit.{k}" not in scripts] == []


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
    found = [(d["quantity"].split(" ")[-1], d["value"]) for d in dots(figures(result)["drifts"])]
    assert {where for where, _ in wanted} == {"rest", "onboard"}
    assert [one for one in wanted if one not in found] == []


def test_lines_in_words_are_their_smallest_and_largest_value():
    trace = Trace("attitude", "vqf", np.arange(3.0), {"roll": np.array([-2.0, np.nan, 31.04])})
    assert range_words([trace], FigureSource.of(make_result())) == "VQF: roll −2.0° to 31.0°"


def test_dots_in_words_are_value_and_interval():
    found = [AnswerDot(0, 9.3, [7.0, 11.0], True, 3), AnswerDot(5, 1.0, None, False, 3, "at rest")]
    assert dots_words(found, FigureSource.of(make_result()), "ms") == "Onboard: +9 ms (+7 to +11); Gyro at rest: +1 ms"


def test_the_lag_figure_holds_every_value_where_no_row_is_ranked():
    result = make_result()
    for k, row in enumerate(result.estimators):
        found, value = row.metrics["airborne"].get("lag_ms"), (0.01, -8.2, -0.02, 4.7, 0.03)[k % 5]
        if found is not None:
            row.metrics["airborne"]["lag_ms"] = replace(found, value=value, ci95=(value - 2, value + 2), ranked=False)
    low, high = figures(result)["lag"].data["views"][0]["axes"]["xaxis"]["range"]
    assert low < -10.2
    assert high > 6.7


def test_the_lag_figure_shows_single_movements_of_ranked_rows_only():
    result = make_result()
    for row in result.estimators[1:]:
        row.metrics["airborne"]["lag_ms"].each = [250.0, 3.0]
    result.estimators[1].metrics["airborne"]["lag_ms"].ranked = False
    found = traces(figures(result)["lag"])
    drawn = {t["meta"]["row"]: t for t in found if "value" in t["meta"]}
    single = {t["meta"]["row"]: t["x"] for t in found if "value" not in t["meta"]}
    assert drawn[5]["marker"]["color"] == "bg"
    assert drawn[3]["marker"]["color"] != "bg"
    assert 1 not in drawn
    assert single[3] == [3.0], "what is beyond the figure is not drawn"
    assert 5 not in single


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
    result.events = []
    assert time_marks(result)["resets"] == []


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
    assert figure.data["views"] == [{"focus": [0]}, {}]
    assert {"roll", "pitch", "heading"} == {t["meta"]["quantity"] for t in traces(figure) if t["name"] == "set-point"}


def test_a_drift_that_several_windows_tell_is_one_dot():
    result = make_result()
    before = len(dots(figures(result)["drifts"]))
    for row in result.estimators:
        found = row.metrics["rest"]["drift_rest_deg_per_min"]
        row.metrics.setdefault("all", {})["drift_rest_deg_per_min"] = replace(found, n=found.n + 1)
    assert len(dots(figures(result)["drifts"])) == before


def test_dots_hold_how_many_they_stand_on():
    assert {d["n"] for d in dots(figures(make_result())["lag"])} == {28}


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
    result.reference = replace(result.reference, choice="onboard", heading_by="none")
    found = figures(result)
    assert not any(t["meta"]["quantity"] == "heading" for t in traces(found["difference"]))
    headings = {t["meta"].get("row") for t in traces(found["attitude"]) if t["meta"]["quantity"] == "heading"}
    assert headings == {None, 1, 2, 3, 4, 5}
    result.reference = replace(result.reference, heading_by="own")
    assert any(t["meta"]["quantity"] == "heading" for t in traces(figures(result)["difference"]))


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
    return {f.id: f for f in sections(FigureSource.of(result or make_result()))["sensors"]}


def test_the_autopilots_own_level_comes_first_with_percentiles_and_limits():
    figure = sensor_figures_of()["vibration"]
    assert [n["text"] for n in figure.data["views"][0]["notes"]] == ["p50 20", "p80 26", "limit 30"]
    for view in (0, 1):
        clipped = traces(figure, view)[-1]
        assert (clipped["x"], clipped["meta"]["value"]) == ([100.5], [7])
    assert [t["name"] for t in traces(figure, 1)] == ["x", "y", "z", "clipped"]


@pytest.mark.parametrize(("rate", "folded"), [(100.0, 0.0), (400.0, 100.0), (500.0, 200.0)])
def test_folded_frequencies_reach_from_the_rate_less_the_fastest_rotor_to_half_the_rate(rate, folded):
    result = make_result()
    for trace in result.traces:
        if trace.figure == "spectrum":
            trace.values["nyquist_hz"] = rate / 2
    figure = sensor_figures_of(result)["spectrum"]
    hatched = next(t for t in traces(figure) if t["name"] == "folded")
    assert hatched["x"][0] == max(folded, 0.1)


def test_rotors_and_notches_are_bands_of_the_spectrum():
    figure = sensor_figures_of()["spectrum"]
    bands = [s for s in figure.data["views"][0]["shapes"] if s["type"] == "rect"]
    assert [(s["fillcolor"], round(s["x0"], 2), round(s["x1"], 2)) for s in bands] == [
        ("e9/0.18", 7.2, 8.8),
        ("e9/0.18", 14.4, 17.6),
        ("e9/0.18", 21.6, 26.4),
        ("e1/0.18", 6.4, 9.6),
        ("e3/0.18", 12.8, 19.2),
    ]


def test_every_aid_has_a_colour_of_its_own_whoever_else_is_drawn():
    def colours(result):
        return [(t["name"], t["line"]["color"]) for t in traces(sensor_figures_of(result)["ratios"])]

    assert colours(make_result()) == [("compass", "e1"), ("velocity", "e2"), ("gate", "bad")]
    result = without("bias")
    result.traces = [t for t in result.traces if not (t.figure == "ratios" and t.key == "compass")]
    assert colours(result) == [("velocity", "e2"), ("gate", "bad")]


def test_lines_of_nothing_but_gaps_are_drawn_without_error():
    result = make_result()
    for trace in result.traces:
        if trace.figure in ("compass", "levels"):
            trace.columns = {name: np.full(len(trace.t), np.nan) for name in trace.columns}
    assert {"compass", "vibration"} <= set(sensor_figures_of(result))
