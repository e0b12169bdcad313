"""The page of a sweep: one file that loads nothing, figures that say what they show."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.compare.grid import GridAxis, parse_grid
from attlog.compare.search import Sweep, sweep
from attlog.compare.sweep_report import axis_places, sweep_figures, sweep_page
from attlog.compare.tables import table_csv, table_latex, table_markdown
from attlog.estimators import get
from tests.compare.test_search import Made
from tests.conftest import few
from tests.report.browser import Visit

LOG = {"name": "<a>.bin", "vehicle": "quad", "firmware": "1", "reference": "truth"}
ABOUT = {"attlog": {"version": "1"}, "command": "attlog sweep <a>.bin mahony", "logs": [LOG]}


def swept(*axes: str, name: str = "<a>.bin") -> Sweep:
    return sweep("mahony", parse_grid(axes, get("mahony")), [Made(name, 0.4), Made("bb", 0.2)])  # type: ignore[list-item]


def test_the_page_loads_nothing_and_shows_names_as_text() -> None:
    page = sweep_page(swept("kp=0.1,0.2,0.4", "ki=0,0.01"), ABOUT)
    assert "default-src &#39;none&#39;" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "<a>" not in page
    assert "&lt;a&gt;.bin" in page
    assert "--estimators mahony:kp=" in page
    assert not re.findall(r"=&#34;", page), "an attribute of the template was taken for text"


@pytest.mark.parametrize(
    ("axes", "kinds"),
    few(
        [
            (["kp=0.1,0.2,0.4"], ["along"]),
            (["kp=0.1..2/4log", "ki=0,0.01"], ["along", "along", "cells"]),
            (["kp=0.1,0.2", "mag_form=heading,vector", "ki=0,1"], ["along", "along", "along", "cells"]),
        ],
        1,
    ),
)
def test_every_figure_is_drawn_wide_and_narrow(axes: list[str], kinds: list[str], tmp_path: Path, browser: Any) -> None:
    found = swept(*axes)
    drawn = sweep_figures(found)
    assert [f.kind for f in drawn] == kinds
    path = tmp_path / "sweep.html"
    path.write_text(sweep_page(found, ABOUT), encoding="utf-8")
    for options in ({}, {"viewport": {"width": 360, "height": 700}, "color_scheme": "dark"}):
        visit = Visit(browser, path, **options)
        assert visit.figures() == {f.id: True for f in drawn}
        assert visit.complaints == []
        assert visit.requests == [path.as_uri()]
        assert visit.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        visit.close()


@pytest.mark.slow
def test_figures_and_tables_are_saved_as_numbers(tmp_path: Path, browser: Any) -> None:
    found = swept("kp=0.1,0.2,0.4", "ki=0,0.01")
    path = tmp_path / "sweep.html"
    path.write_text(sweep_page(found, ABOUT), encoding="utf-8")
    visit = Visit(browser, path)
    with visit.page.expect_download() as download:
        visit.page.click("#fig-cells0 button[data-out=csv]")
    lines = list(csv.reader(io.StringIO(Path(download.value.path()).read_text())))
    column = found.columns[0]
    assert [[float(line[0]), float(line[1])] for line in lines[1:]] == [
        [kp, ki] for kp in (0.1, 0.2, 0.4) for ki in (0.0, 0.01)
    ]
    assert [float(line[2]) for line in lines[1:]] == pytest.approx(column.score[:6].tolist(), rel=1e-4)
    assert [line[3] for line in lines[1:]] == ["no" if k in column.near else "yes" for k in range(6)]
    visit.page.click("summary:has-text('Every setting')")
    with visit.page.expect_download() as download:
        visit.page.click("button.csv >> nth=0")
    assert download.value.suggested_filename == "sweep-table-3.csv"
    assert len(Path(download.value.path()).read_text().splitlines()) == 1 + 7
    visit.close()


@pytest.mark.slow
def test_the_band_spans_the_settings_that_are_not_significantly_worse(tmp_path: Path, browser: Any) -> None:
    found = sweep("mahony", parse_grid(["kp=0.1,0.2,0.21,0.8,6.4"], get("mahony")), [Made("x", 0.2)])  # type: ignore[list-item]
    figure = sweep_figures(found)[0]
    path = tmp_path / "sweep.html"
    path.write_text(sweep_page(found, ABOUT), encoding="utf-8")
    visit = Visit(browser, path)
    bands = visit.page.evaluate("document.getElementById('along0_0').layout.shapes.map((s) => [s.x0, s.x1])")
    visit.close()
    inside = [any(a <= x <= b for a, b in bands) for x in figure.data["x"]]
    assert inside == figure.data["near"]
    assert 0 < sum(inside) < len(inside)


@pytest.mark.parametrize(
    ("values", "spacing", "scale"),
    [
        ((0.1, 0.2, 0.4), "linear", "linear"),
        ((0.1, 1.0), "linear", "log"),
        ((0.5, 0.6), "log", "log"),
        ((0.0, 1e-4, 1.0), "linear", "side by side"),
        ((0.0, 0.5, 1.0), "linear", "linear"),
        (("heading", "vector"), "words", "side by side"),
    ],
)
def test_values_stand_where_they_can_be_told_apart(values: tuple[Any, ...], spacing: Any, scale: str) -> None:
    places, found = axis_places(GridAxis("kp", "", values, spacing))
    assert found == scale
    assert places == ([float(i) for i in range(len(values))] if scale == "side by side" else list(values))


def test_tables_for_papers_keep_their_signs() -> None:
    head, rows = ["a_b", "x"], [["5 %", "1|2"], ["±3°", "{}"]]
    assert r"5 \% & 1|2 \\" in table_latex(head, rows)
    assert r"$\pm$3$^\circ$ & \{\} \\" in table_latex(head, rows)
    assert r"| 5 % | 1\|2 |" in table_markdown(head, rows)
    assert table_csv(head, rows).splitlines()[1] == "5 %,1|2"


def test_a_curve_has_the_mean_over_logs_at_each_value_and_each_log_beside() -> None:
    s = swept("kp=0.1,0.2,0.4", "ki=0,0.01")
    judged = next(c for c in s.columns if c.single is not None)
    curve = next(f for f in sweep_figures(s) if f.kind == "along")
    best = [
        min((k for k in range(s.base) if s.settings[k]["kp"] == v), key=lambda k: float(judged.score[k]))
        for v in (0.1, 0.2, 0.4)
    ]
    assert curve.data["y"] == pytest.approx([float(judged.score[k]) for k in best])
    assert [y["name"] for y in curve.data["logs"]] == ["<a>.bin", "bb"]
    for j, y in enumerate(curve.data["logs"]):
        assert y["y"] == pytest.approx([abs(float(judged.values[k, j])) for k in best])
    assert curve.data["best"] == best.index(judged.single)
    judged.score[[k for k in range(s.base) if s.settings[k]["kp"] == 0.2]] = np.nan
    again = next(f for f in sweep_figures(s) if f.kind == "along")
    assert again.data["y"][1] is None
    assert again.data["say"][1] == ""


def test_the_answer_comes_before_the_first_figure() -> None:
    page = sweep_page(swept("kp=0.1,0.2,0.4"), ABOUT)
    main = page[page.index("<main") :]
    assert main.index("best single setting") < main.index("<figure")


def test_values_without_result_are_named_with_the_log_below_the_figure() -> None:
    axes = parse_grid(["kp=0.1,0.2,0.4"], get("mahony"))
    logs = [Made("a.bin", 0.2), Made("bb.bin", 0.2, unsound=0.4), Made("ccc.bin", 0.2, unsound=0.2)]
    found = sweep("mahony", axes, logs)  # type: ignore[arg-type]
    for k in range(3):
        found.cells[k][2].status = "diverged" if k else "ok"
    (curve,) = (f for f in sweep_figures(found) if f.kind == "along")
    assert "kp above 0.2: tilt error above 30° on bb.bin." in curve.caption
    assert "kp above 0.1 diverged on ccc.bin." in curve.caption
    assert "a.bin" not in curve.caption
