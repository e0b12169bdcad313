"""The page of a sweep: one file that loads nothing, drawings that say what they show."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from attlog.compare import svg
from attlog.compare.grid import grid
from attlog.compare.sweep import sweep
from attlog.compare.sweep_page import sweep_page
from attlog.compare.table_file import csv_text, latex, markdown
from attlog.estimators import get
from tests.compare.test_sweep import Made

LOG = {"name": "<a>.bin", "vehicle": "quad", "firmware": "1", "reference": "truth"}
ABOUT = {"attlog": {"version": "1"}, "command": "attlog sweep <a>.bin mahony", "logs": [LOG]}


def html(*axes: str) -> str:
    return sweep_page(sweep("mahony", grid(axes, get("mahony")), [Made("<a>.bin", 0.4), Made("bb", 0.2)]), ABOUT)  # type: ignore[list-item]


def test_the_page_loads_nothing_and_shows_names_as_text() -> None:
    page = html("kp=0.1,0.2,0.4", "ki=0,0.01")
    assert "default-src 'none'" in page
    assert not re.findall(r"(?:src|href)=", page)
    assert "<a>" not in page
    assert "&lt;a&gt;.bin" in page
    assert "--estimators mahony:kp=" in page


@pytest.mark.parametrize(
    ("axes", "count"),
    [
        (["kp=0.1,0.2,0.4"], 1),
        (["kp=0.1..2/4log", "ki=0,0.01"], 3),
        (["kp=0.1,0.2", "mag_form=heading,vector", "ki=0,1"], 4),
    ],
)
def test_every_drawing_is_well_formed_and_stays_inside(axes: list[str], count: int) -> None:
    drawings = re.findall(r"<svg.*?</svg>", html(*axes), re.S)
    assert len(drawings) == count
    for drawing in drawings:
        root = ElementTree.fromstring(drawing)
        width, height = float(root.get("width", 0)), float(root.get("height", 0))
        assert root.get("aria-label")
        for name, limit in (("x", width), ("cx", width), ("y", height), ("cy", height)):
            places = [float(e.get(name, 0)) for e in root.iter() if e.get(name)]
            assert all(-1e-6 <= p <= limit for p in places)


def test_a_scale_and_its_ticks_are_round() -> None:
    assert svg.ticks(0.0, 5.2) == [0.0, 2.0, 4.0]
    assert svg.Scale(0.1, 10.0, 0.0, 100.0, log=True)(1.0) == pytest.approx(50.0)
    assert svg.Scale(3.0, 3.0, 0.0, 100.0)(3.0) == 50.0


def test_tables_for_papers_keep_their_signs() -> None:
    head, rows = ["a_b", "x"], [["5 %", "1|2"], ["±3°", "{}"]]
    assert r"5 \% & 1|2 \\" in latex(head, rows)
    assert r"$\pm$3$^\circ$ & \{\} \\" in latex(head, rows)
    assert r"| 5 % | 1\|2 |" in markdown(head, rows)
    assert csv_text(head, rows).splitlines()[1] == "5 %,1|2"
