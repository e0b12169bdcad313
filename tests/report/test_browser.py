"""What a person sees: the report in a real browser."""

from __future__ import annotations

import base64
import csv
import gzip
import hashlib
import json
import math
import re

import pytest

from attlog.flight.parameters import ParameterHistory
from attlog.report import shell, write_report
from attlog.report.figures.style import FIXED_LINES
from attlog.result import Finding, Result
from attlog.result.document import read
from attlog.story.flight_events import Event
from tests.conftest import ROOT
from tests.report.browser import Visit
from tests.report.conftest import make_result


def test_it_opens_without_complaint_or_request_and_draws_every_figure(visit, report):
    page = visit(report)
    assert page.complaints == []
    assert page.requests == [report.as_uri()]
    assert page.page.get_attribute("html", "data-drawn") == "all"
    figures = page.figures()
    assert {
        "strip",
        "attitude",
        "difference",
        "track",
        "rest",
        "spread",
        "allan",
        "step",
        "steps",
        "lag",
        "drift",
        "drifts",
        "spectrum",
        "vibration",
        "gravity",
        "compass",
        "interference",
        "ratios",
        "bias",
    } <= set(figures)
    assert [name for name, drawn in figures.items() if not drawn] == []


@pytest.mark.slow
def test_the_verdicts_stand_in_the_first_screen_without_script(visit, report):
    page = visit(report, java_script_enabled=False).page
    for question in page.query_selector_all(".q"):
        box = question.bounding_box()
        assert box["y"] + box["height"] < 800
        assert len(question.query_selector("caption span").inner_text()) > 20
    assert page.query_selector("#findings").bounding_box()["y"] < 250
    assert page.query_selector("#part-flight").bounding_box()["y"] > 800
    assert page.query_selector("noscript") is not None
    assert page.query_selector("#table").inner_text().count("\n") > 5


@pytest.mark.slow
def test_zoom_in_one_figure_moves_all_with_flight_time_and_double_click_returns(visit, report):
    page = visit(report)
    whole = page.range("attitude")
    drag(page, "attitude", 0.3, 0.5)
    timed = ("strip", "attitude", "difference", "vibration", "compass", "ratios", "bias")
    seen = {figure: page.range(figure) for figure in timed}
    assert len({tuple(round(x, 6) for x in r) for r in seen.values()}) == 1
    assert seen["bias"][0] > whole[0] + 20
    assert seen["bias"][1] < whole[1] - 20
    assert page.range("rest") == pytest.approx([5.0, 45.0], abs=0.1)
    page.page.click("#reset")
    assert page.range("difference") == pytest.approx(whole)


@pytest.mark.slow
def test_zoom_shows_more_samples_than_the_overview(visit, report):
    page = visit(report)
    count = """() => {
        const p = document.getElementById('attitude'), r = p._fullLayout.xaxis.range;
        const x = p.data.find((t) => t.meta === 0).x.filter((x) => x >= r[0] && x <= r[1]);
        return x.length / (r[1] - r[0]);
    }"""
    before = page.page.evaluate(count)
    page.page.click("summary:has-text('What the autopilot said')")
    page.page.click("a[data-t='104.000']")
    assert page.page.evaluate(count) > 3 * before
    assert page.range("attitude")[0] < 104 < page.range("attitude")[1]


def drag(page: Visit, figure: str, start: float, end: float) -> None:
    """Drag across a figure from one share of its width to another."""
    area = page.page.locator(f"#{figure} .nsewdrag").first
    area.scroll_into_view_if_needed()
    box = area.bounding_box()
    y = box["y"] + box["height"] / 2
    page.page.mouse.move(box["x"] + box["width"] * start, y)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + box["width"] * (start + end) / 2, y, steps=4)
    page.page.mouse.move(box["x"] + box["width"] * end, y, steps=4)
    page.page.mouse.up()
    page.page.wait_for_timeout(500)


@pytest.mark.slow
def test_the_attitude_shows_onboard_and_set_point_until_a_filter_is_asked_for(visit, report):
    page = visit(report)
    assert page.visible("attitude") == {"0": True}
    names = "() => [...new Set(document.getElementById('attitude').data.map((t) => t.name))]"
    assert page.page.evaluate(names) == ["Onboard", "set-point"]
    assert page.visible("difference")["4"] is True
    page.page.select_option("select[data-figure=attitude]", label="With the filters")
    assert page.visible("attitude") == dict.fromkeys("012345", True)


@pytest.mark.slow
def test_all_steps_show_the_band_of_one_filter(visit, report):
    page = visit(report)
    bands = "() => document.getElementById('steps').data.filter((t) => t.fill === 'tonexty').map((t) => t.name)"
    assert page.page.evaluate(bands) == ["VQF: 80 % of the steps"]
    page.page.select_option("select[data-band=steps]", label="Gyro")
    assert page.page.evaluate(bands) == ["Gyro: 80 % of the steps"]


@pytest.mark.slow
def test_the_ground_track_has_equal_scales_and_follows_the_zoom(visit, report):
    page = visit(report)
    scales = """() => ['xaxis', 'yaxis'].map((k) => {
        const a = document.getElementById('track')._fullLayout[k];
        return a._length / (a.range[1] - a.range[0]);
    })"""
    east, north = page.page.evaluate(scales)
    assert east == pytest.approx(north, rel=0.01)
    points = "() => document.getElementById('track').data.find((t) => t.name === 'path').x.length"
    before = page.page.evaluate(points)
    drag(page, "attitude", 0.5, 0.6)
    assert page.page.evaluate(points) < 0.3 * before


@pytest.mark.slow
def test_after_a_crash_the_figures_end_until_full_time_is_asked_for(visit, tmp_path):
    result = make_result()
    result.events.append(Event("impact", 150.0, "serious", "It crashed at 150.0 s."))
    write_report(result, tmp_path / "crash.html")
    page = visit(tmp_path / "crash.html")
    timed = ("strip", "attitude", "difference", "vibration", "compass", "ratios", "bias")
    assert [page.range(figure) for figure in timed] == [pytest.approx([0, 155])] * len(timed)
    page.page.click("#reset")
    assert page.range("attitude") == pytest.approx([0, 200])


@pytest.mark.slow
def test_the_legend_hides_a_filter_in_every_figure(visit, report):
    page = visit(report)
    page.page.click(".lg:has-text('vqf')")
    for figure in page.figures():
        assert page.visible(figure).get("4", False) is False, figure
    assert page.visible("attitude")["1"] is True
    page.page.click("#all")
    assert page.visible("attitude")["4"] is True
    page.page.dblclick(".lg:has-text('gyro')")
    assert page.visible("difference") == {"1": False, "2": False, "3": False, "4": False, "5": True}


@pytest.mark.slow
def test_the_table_sorts_with_empty_cells_last(visit, report):
    page = visit(report).page
    heading = page.locator("#table thead button", has_text="Lag")
    heading.click()
    names = page.locator("#table tbody th").all_inner_texts()
    assert [n.split("\n")[0].strip() for n in names][:4] == ["VQF", "Gyro", "Madgwick, MARG", "Mahony, Xu 0.6"]
    assert page.get_attribute("#table thead th:has-text('Lag')", "aria-sort") == "ascending"
    heading.click()
    names = [n.split("\n")[0].strip() for n in page.locator("#table tbody th").all_inner_texts()]
    assert names[0] == "Mahony, Xu 0.6"
    assert set(names[-2:]) == {"Onboard", "Complementary, Fan"}


@pytest.mark.slow
def test_the_open_list_of_events_leaves_the_strip_where_it_is_and_has_the_full_width(visit, tmp_path):
    result = make_result()
    result.headline = "Copter: flew 60 to 185 s."
    result.events += [Event("gnss_lost", 10.0 + i, "warning", f"GNSS lost, part {i}.") for i in range(40)]
    write_report(result, tmp_path / "events.html")
    page = visit(tmp_path / "events.html").page
    before = page.locator(".strip").bounding_box()
    page.click("#happened summary")
    assert page.locator(".strip").bounding_box() == before
    listed = page.locator("table.events").first.bounding_box()
    assert listed["width"] > 0.9 * page.locator("#happened").bounding_box()["width"]
    assert page.locator("#happened").bounding_box()["height"] < 700
    assert page.locator("table.events .chk").first.inner_text() == "Warning"


@pytest.mark.slow
def test_a_phone_never_scrolls_sideways(visit, report):
    page = visit(report, viewport={"width": 390, "height": 844}, has_touch=True).page
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    for details in page.query_selector_all("details"):
        details.evaluate("d => { d.open = true; }")
    assert page.evaluate("document.documentElement.scrollWidth") == 390


@pytest.mark.slow
def test_print_of_all_holds_every_figure_and_cuts_none(visit, report, tmp_path):
    page = visit(report)
    page.page.evaluate("() => { document.documentElement.dataset.print = 'all'; }")
    page.page.emulate_media(media="print")
    page.page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
    assert [name for name, drawn in page.figures().items() if not drawn] == []
    wide = page.page.evaluate(
        "() => [...document.querySelectorAll('.plot svg.main-svg')].map((s) => s.getBoundingClientRect().width)"
    )
    assert max(wide) <= 684
    tall = page.page.evaluate(
        "() => [...document.querySelectorAll('figure')].map((f) => f.getBoundingClientRect().height)"
    )
    assert max(tall) < 1000
    broken = page.page.evaluate(
        """() => [...document.querySelectorAll('figure')]
            .filter((f) => getComputedStyle(f).breakInside !== 'avoid').length"""
    )
    assert broken == 0
    pdf = page.page.pdf(path=tmp_path / "report.pdf", format="A4")
    assert pdf[:5] == b"%PDF-"
    assert page.complaints == []


@pytest.mark.slow
def test_print_sums_up_on_one_page(visit, report, tmp_path):
    page = visit(report)
    page.page.pdf(path=tmp_path / "report.pdf", format="A4")
    pages = (tmp_path / "report.pdf").read_bytes().count(b"/Type /Page\n")
    assert pages == 1
    page.page.emulate_media(media="print")
    page.page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
    seen = (
        "() => [...document.querySelectorAll('main > *, figure')].filter((e) => e.checkVisibility()).map((e) => e.id)"
    )
    assert {"findings", "comparison", "fig-attitude", "fig-difference"} <= set(page.page.evaluate(seen))
    assert not {"table", "expert", "fig-rest"} & set(page.page.evaluate(seen))


@pytest.mark.slow
def test_five_long_findings_and_many_filters_are_still_one_printed_page(visit, tmp_path):
    result = make_result(tuple(name for name in FIXED_LINES if name not in ("onboard", "rerun", "truth")))
    result.headline = "Copter: flew 60 to 185 s, " + "and something else went wrong, " * 8
    result.findings = [Finding("x", "serious", f"{i}: " + "It shakes heavily. " * 12) for i in range(5)]
    write_report(result, tmp_path / "long.html")
    page = visit(tmp_path / "long.html").page
    page.pdf(path=tmp_path / "long.pdf", format="A4")
    assert (tmp_path / "long.pdf").read_bytes().count(b"/Type /Page\n") == 1
    assert page.evaluate("() => document.body.style.zoom") == "", "on the screen it is as before"


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_violation(visit, tmp_path, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    result = make_result()
    result.headline = "Copter: flew 60 to 185 s."
    result.events.append(Event("impact", 150.0, "serious", "It crashed at 150.0 s."))
    result.findings.append(Finding("x", "serious", "It crashed at 150.0 s.", t=150.0, evidence=["IMU: 9 g"]))
    write_report(result, tmp_path / "axe.html")
    page = visit(tmp_path / "axe.html", color_scheme=scheme).page
    for details in page.query_selector_all("details"):
        details.evaluate("d => { d.open = true; }")
    found = axe.Axe().run(page)
    assert [(v["id"], v["nodes"][0]["html"][:120]) for v in found.response["violations"]] == []


@pytest.mark.slow
def test_dark_follows_the_button_in_page_and_figures(visit, report):
    page = visit(report, color_scheme="light")
    colour = "() => document.getElementById('attitude')._fullLayout.font.color"
    assert page.page.evaluate(colour) == "#1b1f24"
    page.page.click("#theme")
    assert page.page.evaluate(colour) == "#e8edf2"
    assert page.page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(18, 22, 28)"


@pytest.mark.slow
def test_what_a_figure_shows_can_be_chosen(visit, report):
    page = visit(report)
    title = "() => document.getElementById('spectrum').layout.yaxis.title.text"
    assert page.page.evaluate(title) == "gyro, °/s/√Hz"
    page.page.select_option("select[data-figure=spectrum]", label="accelerometer")
    assert page.page.evaluate(title) == "accelerometer, m/s²/√Hz"
    for figure, views in (("allan", 3), ("drift", 2), ("steps", 3)):
        assert page.page.locator(f"select[data-figure={figure}] option").count() == views
    assert page.complaints == []


@pytest.mark.slow
def test_a_figure_can_be_saved_with_its_legend_as_picture_and_numbers(visit, report, tmp_path):
    page = visit(report)

    def saved(figure: str, kind: str) -> bytes:
        with page.page.expect_download() as download:
            page.page.click(f".out[data-figure={figure}] [data-out={kind}]")
        assert download.value.suggested_filename == f"flight_{figure}.{kind}"
        return download.value.path().read_bytes()

    svg = saved("steps", "svg").decode()
    for text in ("All steps together", "Mahony, Xu 0.6", "VQF"):
        assert text in svg
    assert saved("steps", "png")[:8] == b"\x89PNG\r\n\x1a\n"
    assert page.complaints == []


@pytest.mark.slow
def test_a_saved_table_holds_data_with_units_and_not_what_is_drawn(visit, report):
    page = visit(report)

    # a browser that saves twenty files in a row may wait for ever: what would be saved is kept in the page
    page.page.evaluate(
        """() => {
            URL.createObjectURL = (blob) => { window.kept = blob; return ''; };
            HTMLAnchorElement.prototype.click = function () { window.called = this.download; };
        }"""
    )

    def saved(figure: str) -> list[dict[str, str]]:
        page.page.evaluate("(f) => document.querySelector(`.out[data-figure=${f}] [data-out=csv]`).click()", figure)
        assert page.page.evaluate("() => window.called") == f"flight_{figure}.csv"
        return list(csv.DictReader(page.page.evaluate("() => window.kept.text()").splitlines()))

    tables = {figure: saved(figure) for figure in page.figures()}
    for figure, rows in tables.items():
        assert rows, figure
        assert all(None not in row and None not in row.values() for row in rows), figure
        assert {"quantity", "value"} <= set(rows[0]), figure
        assert figure == "strip" or {row["unit"] for row in rows} - {""}, figure
        assert figure == "strip" or all(math.isfinite(float(row["value"])) for row in rows), figure
    modes = [row for row in tables["strip"] if row["quantity"] == "mode"]
    assert [(m["time_s"], m["end_s"], m["value"]) for m in modes][1] == ("75", "150", "LOITER")
    lag = next(row for row in tables["lag"] if row["filter"] == "VQF")
    assert list(lag) == ["filter", "quantity", "value", "lower", "upper", "n", "unit"]
    assert list(lag.values()) == ["VQF", "lag", "-1", "-2.5", "0.5", "28", "ms"]
    drifts = {(row["filter"], row["quantity"]): row for row in tables["drifts"]}
    assert drifts["VQF", "drift at rest"]["upper"] == "0.05"
    assert {row["filter"] for row in tables["attitude"]} == {"Onboard", "set-point"}
    assert {row["quantity"] for row in tables["steps"]} == {"median error, all axes"}
    assert {row["unit"] for row in tables["compass"]} == {"uT"}
    page.page.select_option("select[data-figure=attitude]", label="With the filters")
    attitude = [row for row in saved("attitude") if row["filter"] == "VQF" and row["quantity"] == "roll"]
    assert len(attitude) == 20_000
    assert page.complaints == []


@pytest.mark.slow
def test_values_under_the_pointer_stand_in_the_margin_and_hide_no_line(visit, report):
    page = visit(report).page
    area = page.locator("#difference .nsewdrag").first
    area.scroll_into_view_if_needed()
    area.hover()
    page.wait_for_timeout(500)
    assert "VQF" in page.locator("#difference-read").inner_text()
    assert page.locator("#difference .hoverlayer .hovertext").count() == 0


@pytest.mark.slow
def test_a_number_that_rounds_to_zero_has_no_sign(visit, report):
    minus = next(x for x in (shell.WEB / "theme.js").read_text().splitlines() if x.startswith("const minus"))
    said = visit(report).page.evaluate(
        f"() => {{ {minus} return [-0.004, -0.01, -12.5].map((x) => minus(x.toFixed(2))) }}"
    )
    assert said == ["0.00", "\u22120.01", "\u221212.50"]


@pytest.mark.slow
def test_a_read_out_names_its_panel_and_the_nearest_line_is_thick(visit, report):
    page = visit(report).page
    area = page.locator("#attitude .nsewdrag").nth(1)
    area.scroll_into_view_if_needed()
    area.hover()
    page.wait_for_timeout(500)
    panel = page.evaluate("() => document.getElementById('attitude')._fullLayout.yaxis2.title.text.split(',')[0]")
    assert page.locator("#attitude-read b").inner_text().startswith(f"{panel} ")
    width = (
        "() => [...document.querySelectorAll('#attitude .near .js-line')].map((e) => getComputedStyle(e).strokeWidth)"
    )
    assert page.evaluate(width) == ["3.5px"]
    page.mouse.move(2, 2)
    page.wait_for_timeout(300)
    assert page.evaluate(width) == []


@pytest.mark.slow
def test_figures_over_time_show_the_flight_modes_below_in_the_colours_of_the_strip(visit, report):
    page = visit(report)
    bands = """(id) => document.getElementById(id)._fullLayout.shapes
        .filter((s) => s.ysizemode === 'pixel' && s.y0 < 0).map((s) => [s.x0, s.x1, s.fillcolor])"""
    below = page.page.evaluate(bands, "attitude")
    assert [[75, 150], [150, 200]] == [span[:2] for span in below][1:]
    bar = "() => document.getElementById('strip').data.find((t) => t.name === 'mode').marker.color"
    assert [colour for *_, colour in below] == page.page.evaluate(bar)
    assert page.page.evaluate(bands, "strip") == []
    area = page.page.locator("#attitude .nsewdrag").nth(1)
    area.scroll_into_view_if_needed()
    area.hover()
    page.page.wait_for_function("() => document.getElementById('attitude-read').textContent.includes('(LOITER): ')")


@pytest.mark.slow
def test_a_figure_is_reached_by_tab_and_read_and_zoomed_by_keys(visit, report):
    page = visit(report)
    keys, whole = page.page.keyboard, page.range("attitude")
    page.page.focus(".out[data-figure=attitude] [data-out=csv]")
    while page.page.evaluate("document.activeElement.id") != "attitude":
        keys.press("Tab")
    assert "Shift" in page.page.locator("#attitude-read").inner_text(), "the keys are shown"
    quarter = 0.25 * (whole[1] - whole[0])
    keys.press("+")
    assert page.range("difference") == pytest.approx([whole[0] + quarter, whole[1] - quarter])
    keys.press("ArrowRight")
    keys.press("ArrowRight")
    keys.press("ArrowRight")
    assert page.range("attitude") == pytest.approx([whole[0] + 2 * quarter, whole[1]]), "it stops at the end, as long"
    keys.press("Home")
    assert page.range("attitude") == pytest.approx(whole)
    keys.press("Shift+ArrowRight")
    said = page.page.locator("#attitude-read").inner_text()
    assert said.startswith("102.0 s (LOITER): roll")
    assert all(panel in said for panel in ("pitch", "heading"))
    page.page.focus("#spectrum")
    before = page.range("spectrum")
    keys.press("+")
    assert page.range("spectrum")[1] - page.range("spectrum")[0] == pytest.approx(0.5 * (before[1] - before[0]))
    assert page.range("attitude") == pytest.approx(whole)
    assert page.complaints == []


@pytest.mark.slow
def test_the_result_can_be_saved_from_the_page(visit, report):
    import json

    page = visit(report).page
    page.locator("summary", has_text="Where this comes from").click()
    with page.expect_download() as download:
        page.click("#save")
    saved = json.loads(download.value.path().read_text(encoding="utf-8"))
    assert saved["schema"] == "attlog-result/7"
    assert saved["estimators"][0]["name"] == "onboard"


@pytest.mark.slow
def test_the_parameters_to_set_can_be_saved_as_a_file(visit, report):
    page = visit(report)
    with page.page.expect_download() as download:
        page.page.click("text=Save as .param")
    assert download.value.suggested_filename == "flight.param"
    saved = download.value.path().read_text(encoding="utf-8").splitlines()
    assert [line for line in saved if not line.startswith("#")] == ["COMPASS_OFS_X,-133.5", "COMPASS_OFS_Y,0"]
    assert page.complaints == []


@pytest.mark.slow
def test_parameters_are_found_by_name_and_by_what_was_set_during_the_log(visit, tmp_path):
    result = make_result()
    result.parameters = [
        ParameterHistory("BAT_LOW", 3.5, 3.5, "default"),
        ParameterHistory("BAT_N", 1015294, 1.0, "set"),
        ParameterHistory("RATE_P", 0.15, 0.15, "default", [(103.4, 0.21)]),
    ]
    write_report(result, tmp_path / "report.html")
    page = visit(tmp_path / "report.html").page
    rows = "() => [...document.querySelectorAll('#parameters tbody tr')].map((r) => r.innerText.split(/\\s*\\t\\s*/))"
    assert len(page.locator("#parameters tbody tr").all()) == 2  # without script those that were set
    page.locator("#parameters > summary").click()
    page.locator("#parameters tbody tr").nth(2).wait_for()  # the event of opening comes after the click
    assert [row[0] for row in page.evaluate(rows)] == ["BAT_LOW", "BAT_N", "RATE_P"]
    page.get_by_label("Search").fill("bat n")
    assert page.evaluate(rows) == [["BAT_N", "1015294", "1", ""]]
    assert page.inner_text("#parameter-count") == "1 of 3"
    page.get_by_label("Search").fill("")
    page.locator("#parameter-kind").select_option("during")
    assert page.evaluate(rows) == [["RATE_P", "0.15", "0.15", "103.4 s: 0.21 in the air"]]
    page.locator("#parameters a").click()
    low, high = page.evaluate("document.getElementById('attitude').layout.xaxis.range")
    assert (low + high) / 2 == pytest.approx(103.4, abs=1e-3)


def test_axes_have_colours_of_their_own_that_no_filter_has(visit, report):
    page = visit(report).page
    lines = page.evaluate(
        """() => [...document.querySelectorAll('.plot')].flatMap((p) => p.data
            .filter((t) => t.mode === 'lines' && t.line && t.line.color)
            .map((t) => [p.id, t.meta, t.name, t.line.color]))"""
    )
    axes = {name[0]: colour for figure, _, name, colour in lines if figure == "compass" and "measured" in name}
    assert len({axes[a] for a in "xyz"}) == 3
    assert all(
        axes[name] == colour
        for figure, _, name, colour in lines
        if figure in ("spectrum", "vibration") and name in axes
    )
    assert not {axes[a] for a in "xyz"} & {colour for _, row, _, colour in lines if row is not None}


@pytest.mark.slow
def test_a_phone_shows_what_to_set_without_scrolling(visit, report):
    page = visit(report, viewport={"width": 390, "height": 844}, has_touch=True).page
    box = page.locator("#part-sensors .set").first.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 390


# The report kept in the repository: small, of the demo's log, without a trace of the machine that made it.

PAGE = (ROOT / "reports" / "example.html").read_text(encoding="utf-8")
RESULT = json.loads(gzip.decompress(base64.b64decode(re.search(r'id="result">([^<]+)<', PAGE).group(1))))


def test_it_is_the_report_of_the_demo():
    log = re.search(r"attlog analyze (\S+)", (ROOT / "Makefile").read_text(encoding="utf-8")).group(1)
    assert RESULT["log"]["sha256"] == hashlib.sha256((ROOT / log).read_bytes()).hexdigest()
    assert log in RESULT["command"]


def test_it_answers_all_four_questions():
    result = read(Result, json.dumps(RESULT).encode(), "example.html")
    assert [v.question for v in result.verdicts] == ["accuracy", "noise", "lag", "yaw_drift"]
    for verdict in RESULT["verdicts"]:
        assert verdict["answered"]
        assert not verdict["sentence"].startswith(("Cannot", "No filter"))
        assert len(verdict["sentence"].split()) <= 40


def test_it_is_small_and_names_no_place_on_a_machine():
    assert len(PAGE) < 2_000_000
    assert not re.search(r"/(work|tmp|root|home|Users)/", PAGE + json.dumps(RESULT))


def test_all_sample_logs_together_stay_small():
    assert sum(p.stat().st_size for p in (ROOT / "sample_logs").iterdir()) < 12_000_000
