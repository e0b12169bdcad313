"""Figures for papers: those of the page, with its values and colours, in a journal's column."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from attlog import Result
from attlog.core.errors import UsageError
from attlog.report.figures.catalogue import Album
from attlog.report.figures.figure import PageFigure, View
from attlog.report.figures.legend import PT, TEXT, WIDTH, Key, legend, text_width
from attlog.report.figures.paper import AXIS_LINE, BUCKETS, PrintedFigure, thinned
from attlog.report.figures.style import RowStyle, palette
from tests.report.conftest import NAMES, make_result

SAME = {"bias": "bias", "compass": "compass", "gravity": "gravity", "spectrum": "spectrum", "steps": "steps"}
SAME |= {name: name for name in ("attitude", "difference", "rest", "spread", "allan", "step", "drift", "ratios")}
"""Figures and the traces that they draw without a change."""
UNIT = re.compile(
    r", (°|RMS °|°/s|°/min|ms|s|Hz|%|A|m|µT|m/s²|°/s/√Hz|share of the gate|% of the step)$|^share of the command$"
)


def axes(layout: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {name: value for name, value in layout.items() if re.fullmatch(r"[xy]axis\d*", name)}


def test_a_result_lists_the_figures_of_its_page_and_draws_each(album: Album, drawn: dict[str, Any]) -> None:
    listed = album.source.result.figures()
    assert list(listed) == list(album.found) == list(drawn)
    assert len(listed) >= 18
    assert all(listed.values())
    assert all(figure["data"] or figure["layout"]["shapes"] for figure in drawn.values())


@pytest.mark.parametrize("name", ["lag", "allan", "spectrum"])
def test_a_figure_is_one_of_plotly(album: Album, name: str) -> None:
    import plotly.graph_objects as go

    found = album.source.result.figure(name)
    assert isinstance(found, go.Figure)
    assert found.layout.width == WIDTH


@pytest.mark.parametrize("name", SAME)
def test_values_drawn_are_values_of_the_traces(album: Album, drawn: dict[str, Any], name: str) -> None:
    known = [t for t in album.source.result.traces if t.figure == SAME[name]]
    values = np.concatenate([np.asarray(y, float) for t in known for y in t.columns.values()])
    values = np.sort(values[np.isfinite(values)])
    other = ("throttle", "expected", "gate")
    lines = [t for t in drawn[name]["data"] if t["mode"] == "lines" and t.get("name") not in other]
    if name == "compass":
        lines = [t for t in lines if t["yaxis"] != "y4"]  # the size is computed of them
    if name == "spectrum":
        lines = [t for t in lines if t["name"] != "folded"]
    if name == "step":
        lines = [t for t in lines if t.get("yaxis", "y") == "y"]
    assert lines
    for line in lines:
        y = np.asarray(line["y"], float)
        y = y[np.isfinite(y)]
        if name == "attitude" and line["yaxis"] == "y3":
            y = (y + 180.0) % 360.0 - 180.0  # the circle is cut open elsewhere
        at = np.clip(np.searchsorted(values, y), 1, len(values) - 1)
        off = np.minimum(np.abs(values[at] - y), np.abs(values[at - 1] - y))
        assert np.all(off <= 1e-4 * np.abs(y) + 1e-9), line


def test_an_error_of_a_step_is_filter_minus_reference(album: Album, drawn: dict[str, Any]) -> None:
    trace = next(t for t in album.source.result.traces if t.figure == "step")
    wanted = trace.columns["est"] - trace.columns["ref"]
    below = [t for t in drawn["step"]["data"] if t.get("yaxis") == "y2" and t["mode"] == "lines"]
    assert any(np.array_equal(t["y"], wanted) for t in below)


def test_dots_stand_at_the_answers_with_their_intervals(album: Album, drawn: dict[str, Any]) -> None:
    answers = [row.metrics["airborne"]["lag_ms"] for row in album.source.result.estimators]
    wanted = {(a.value, *a.ci95) for a in answers if a.value is not None}
    dots = [t for t in drawn["lag"]["data"] if "error_x" in t]
    found = [(t["x"][0], t["error_x"]["arrayminus"][0], t["error_x"]["array"][0]) for t in dots]
    assert wanted
    assert {tuple(np.round((x, x - low, x + high), 6)) for x, low, high in found} == {
        tuple(np.round(w, 6)) for w in wanted
    }


def test_the_comparison_shows_the_answers_of_the_four_questions(album: Album, drawn: dict[str, Any]) -> None:
    layout, rows = drawn["comparison"]["layout"], {row.name: row for row in album.source.result.estimators}
    titles = [note["text"] for note in layout["annotations"] if note["text"].startswith("<b>")]
    asked = ["Agreement with onboard", "Static noise", "Step response", "Yaw drift"]
    assert titles == [f"<b>{title}</b>" for title in asked]
    for number, window, metric in (("", "airborne", "tilt_rmse_deg"), ("3", "airborne", "lag_ms")):
        dots = {t["meta"]: t for t in drawn["comparison"]["data"] if t["xaxis"] == f"x{number}"}
        answers = {i: rows[name].metrics[window][metric] for i, name in enumerate(album.source.styles)}
        assert set(dots) == {i for i, a in answers.items() if a.value is not None}
        ends = layout[f"xaxis{number}"]["range"] if number else [10.0**v for v in layout["xaxis"]["range"]]
        inside = {i: dot for i, dot in dots.items() if dot["marker"]["symbol"] == "circle"}
        assert inside
        assert all(dot["x"] == [answers[i].value] for i, dot in inside.items())
        assert all(ends[0] < answers[i].value < ends[1] for i in inside)


def test_every_axis_of_numbers_tells_its_unit(drawn: dict[str, Any]) -> None:
    for name, figure in drawn.items():
        for key, ax in axes(figure["layout"]).items():
            if "ticktext" in ax and not ax["title"]["text"]:
                assert not [t for t in ax["ticktext"] if t.replace(".", "").isdigit()], (name, key)
            else:
                assert UNIT.search(ax["title"]["text"]), (name, key, ax["title"]["text"])


def test_a_figure_fits_a_column_and_has_lines_that_printers_keep(drawn: dict[str, Any]) -> None:
    assert WIDTH / 96.0 * 25.4 == pytest.approx(88.0, abs=0.5)
    assert pytest.approx(8.0 * PT) == TEXT
    assert pytest.approx(0.5 * PT) == AXIS_LINE
    for name, figure in drawn.items():
        layout = figure["layout"]
        assert layout["width"] == WIDTH
        assert layout["height"] < 420, name
        assert "title" not in layout
        fonts = [ax[key] for ax in axes(layout).values() for key in ("tickfont",)]
        fonts += [note["font"] for note in layout["annotations"]] + [layout["font"]]
        assert all(font["size"] == TEXT for font in fonts), name
        assert all(ax["linecolor"] == ax["tickfont"]["color"] == "#000000" for ax in axes(layout).values())
        widths = [t["line"]["width"] for t in figure["data"] if t.get("line", {}).get("width")]
        assert all(width >= AXIS_LINE for width in widths), name


def test_filters_have_the_colours_of_the_page_and_dashes_that_differ(album: Album, drawn: dict[str, Any]) -> None:
    looks = list(album.source.styles.values())
    lines = {t["meta"]: t["line"] for t in drawn["rest"]["data"] if t["mode"] == "lines"}
    assert len(lines) == 3
    assert all(line["color"] == palette()[f"e{looks[r].slot}"] for r, line in lines.items())
    assert len({line["dash"] for line in lines.values()}) == len(lines)


def test_the_attitude_shows_the_rows_of_its_view(album: Album, drawn: dict[str, Any]) -> None:
    focused = {t["name"] for t in drawn["attitude"]["data"]}
    everybody = {t["name"] for t in album.drawn("attitude", view=1)["data"]}
    assert focused == {"Onboard", "set-point"}
    assert everybody - focused == {"Gyro", "Complementary, Fan", "Mahony, Xu 0.6"}


def test_a_metre_of_the_track_is_as_long_in_both_directions(drawn: dict[str, Any]) -> None:
    layout = drawn["track"]["layout"]
    inside = layout["width"] - layout["margin"]["l"] - layout["margin"]["r"]
    high = layout["height"] - layout["margin"]["t"] - layout["margin"]["b"]
    per_metre = [p / np.ptp(layout[key]["range"]) for p, key in ((inside, "xaxis"), (high, "yaxis"))]
    assert per_metre[0] == pytest.approx(per_metre[1], rel=0.01)
    heads = [t for t in drawn["track"]["data"] if "angle" in t.get("marker", {})]
    assert len(heads) == 2
    assert all(2 <= len(t["x"]) <= 61 for t in heads)


def test_rows_views_and_a_part_of_the_flight_can_be_chosen(album: Album) -> None:
    one = album.drawn("attitude", rows=[NAMES[2]], span=(70.0, 80.0))
    assert {t["name"] for t in one["data"]} == {"Mahony, Xu 0.6", "set-point"}
    assert one["layout"]["xaxis"]["range"] == [70.0, 80.0]
    inside = [t["x"] for t in one["data"] if t["mode"] == "lines"]
    assert all(69.8 <= x.min() and x.max() <= 80.2 for x in inside)
    assert "accelerometer" in album.drawn("spectrum", view="acc")["layout"]["yaxis"]["title"]["text"]
    assert "gyro" in album.drawn("spectrum", view=0)["layout"]["yaxis"]["title"]["text"]


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("atitude", {}, "no figure 'atitude'; this result has comparison, strip, attitude"),
        ("attitude", {"rows": ["mahonny"]}, "no row 'mahonny'"),
        ("spectrum", {"view": "compass"}, "use 'gyro', 'accelerometer'"),
        ("spectrum", {"view": 2}, "no view 2"),
        ("attitude", {"span": (80.0, 70.0)}, "no stretch of time"),
    ],
)
def test_what_is_asked_for_wrongly_is_refused_with_what_there_is(
    album: Album, name: str, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(UsageError, match=re.escape(said)):
        album.drawn(name, **options)


def test_a_result_from_json_has_the_figures_that_need_no_lines() -> None:
    result = make_result(NAMES[:2])
    loaded = Result.read(result.to_json().encode(), "r.json")
    assert list(loaded.figures()) == ["comparison", "strip", "lag", "drifts"]
    assert loaded.figure("lag").data
    with pytest.raises(UsageError, match=r"It holds no lines, .* attlog.analyze\(log\) gives one"):
        loaded.figure("attitude")


def test_flight_modes_are_below_the_time_axis_as_on_the_page(album: Album) -> None:
    layout = album.drawn("attitude", span=(50.0, 100.0))["layout"]
    spans = [(s["x0"], s["x1"]) for s in layout["shapes"] if s.get("ysizemode") == "pixel" and s["y1"] < s["y0"] < 0.0]
    assert spans == [(50.0, 75.0), (75.0, 100.0)]
    assert {n["text"] for n in layout["annotations"]} >= {"STABILIZE", "LOITER"}
    assert "RTL" not in {n["text"] for n in layout["annotations"]}
    timeless = album.drawn("lag")["layout"]["shapes"]
    assert not any(s.get("ysizemode") == "pixel" and s["y1"] < s["y0"] < 0.0 for s in timeless)


def test_the_text_of_a_log_is_never_markup() -> None:
    result = make_result(NAMES[:1], with_traces=False)
    result.log["timeline"]["modes"] = [[0, 200, "<b>A</b>%{x}$"]]
    bars = [t for t in Album.of(result).drawn("strip")["data"] if t["type"] == "bar"]
    assert "‹b›A‹/b›%(x}＄" in bars[0]["text"]


# Long lines keep their peaks and gaps; ranges leave out what diverged.


def test_peaks_gaps_and_order_of_a_long_line_stay() -> None:
    t = 0.01 * np.arange(100_000)
    y = np.sin(t)
    y[77_777], y[12_345], y[5_000:5_400] = 9.0, -9.0, np.nan
    x, kept = thinned(t, y)
    assert len(x) <= 3 * BUCKETS
    assert (np.nanmax(kept), np.nanmin(kept)) == (9.0, -9.0)
    assert np.isnan(kept[(x >= 50.0) & (x < 54.0)]).any()
    assert (np.diff(x) > 0).all()
    assert np.array_equal(kept, np.interp(x, t, y), equal_nan=True)


def test_a_short_line_stays_whole_and_a_span_cuts_it() -> None:
    t = np.arange(100.0)
    assert np.array_equal(thinned(t, t)[0], t)
    assert thinned(t, t, (10.0, 20.0))[0].tolist() == list(range(9, 22))


def test_a_full_turn_breaks_the_line() -> None:
    _, y = thinned(np.arange(4.0), np.array([170.0, 179.0, -179.0, -170.0]), wraps=True)
    assert np.isnan(y).tolist() == [False, False, True, False, False]


def printed(ends: list[float], *, lost: int = -1, **fit: Any) -> dict[str, Any]:
    """A figure of rows that move between 0 and an end each."""
    rows = [RowStyle(f"row {i}", i + 1, "solid", lost=i == lost) for i in range(len(ends))]
    view, t = View(rows), np.arange(10.0)
    for r, end in enumerate(ends):
        view.row(r, t, end * (t % 2))
    view.axis("x", "time, s", range=[0.0, 9.0])
    view.axis("y", "angle, °", fit=fit)
    figure = PageFigure("made", "plot", "", "", 330, {"views": [view.as_data()]})
    return PrintedFigure(figure, figure.data["views"][0], rows, set(range(len(rows))), {}, (0.0, 9.0)).finished()


def test_a_diverged_row_does_not_set_the_range_and_leaves_with_an_arrow() -> None:
    found = printed([1.0, 100.0], lost=1, least=2.0)
    assert found["layout"]["yaxis"]["range"] == [-0.5, 1.5]
    assert [t["marker"]["symbol"] for t in found["data"] if t["mode"] == "markers"] == ["triangle-up"]
    assert [t.get("opacity", 1.0) for t in found["data"] if t["mode"] == "lines"] == [1.0, 0.35]


def test_a_calm_figure_leaves_out_who_moves_far_more() -> None:
    assert printed([1.0, 1.1, 50.0], calm=True)["layout"]["yaxis"]["range"][1] < 2.0
    assert printed([1.0, 1.1, 50.0])["layout"]["yaxis"]["range"][1] > 40.0


@pytest.mark.parametrize(
    ("fit", "low", "high"),
    [
        ({"pad": 0.5}, -0.5, 1.5),
        ({"floor": 0.0, "pad": 0.5}, 0.0, 1.5),
        ({"floor": 0.0, "pad": 0.5, "most": 1.2}, 0.0, 1.2),
        ({"floor": 0.0, "pad": 0.5, "least": 4.0}, 0.0, 4.0),
        ({"pad": 0.1, "include": [11.0]}, -1.1, 12.1),
        ({"pad": 0.1, "to": 0.5}, -1e-6, 1e-6),
    ],
)
def test_the_range_follows_the_keys_of_its_axis(fit: dict[str, Any], low: float, high: float) -> None:
    assert printed([1.0], **fit)["layout"]["yaxis"]["range"] == pytest.approx([low, high])


# The legend above a figure stays inside the column and no entry covers another.

LEFT = 54.0


@pytest.mark.parametrize("count", [1, 2, 7, 12])
def test_entries_stand_one_after_the_other_and_fit(count: int) -> None:
    keys = [Key(f"Filter number {i}" * (1 + i % 2), "#123456") for i in range(count)]
    shapes, texts, height = legend(keys, LEFT, 10.0)
    assert len(shapes) == len(texts) == count
    places = [
        (s["y0"], s["x0"] + LEFT, t["xshift"] + LEFT + text_width(t["text"]))
        for s, t in zip(shapes, texts, strict=True)
    ]
    assert all(0.0 <= start and end <= WIDTH for _, start, end in places)
    for (y, _, end), (next_y, start, _) in pairwise(places):
        assert next_y < y or start > end
    assert all(10.0 < y < 10.0 + height for y, _, _ in places)


def test_nothing_to_tell_takes_no_room() -> None:
    assert legend([], LEFT, 0.0) == ([], [], 0.0)


@pytest.mark.parametrize("symbol", ["circle", "diamond", "square", "triangle-up", "triangle-down", "pentagon"])
def test_a_symbol_is_drawn_filled_or_hollow(symbol: str) -> None:
    [full], _, _ = legend([Key("at rest", "#123456", symbol=symbol)], LEFT, 0.0)
    [hollow], _, _ = legend([Key("at rest", "#123456", symbol=symbol, full=False)], LEFT, 0.0)
    assert (full["fillcolor"], hollow["fillcolor"]) == ("#123456", "#ffffff")
    assert full["type"] == ("circle" if symbol == "circle" else "path")
