"""Pictures by an installed browser: as paper has them, or an error that says what to do."""

from __future__ import annotations

import struct
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from attlog.core.errors import OutputError
from attlog.report.figures import files
from attlog.report.figures.catalogue import Album
from attlog.report.figures.files import write_figures
from tests.report.browser import executable
from tests.report.conftest import NAMES, make_result, traces

SVG = "{http://www.w3.org/2000/svg}"
POINTS = {"data": [{"type": "scatter", "x": [0, 1], "y": [0, 1]}], "layout": {"width": 332, "height": 200}}


def script(folder: Path, text: str) -> str:
    """A program that stands for a browser."""
    path = folder / "browser"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def test_without_a_browser_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setattr(files, "BROWSER_PATHS", ())
    monkeypatch.delenv("BROWSER_PATH", raising=False)
    with pytest.raises(OutputError, match="none was found: install one, or set BROWSER_PATH"):
        files.find_browser()
    monkeypatch.setenv("BROWSER_PATH", "/nowhere/chrome")
    with pytest.raises(OutputError, match="BROWSER_PATH /nowhere/chrome is none"):
        files.find_browser()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("echo no display >&2", r"drew no figure \(no display\)"),
        ("echo '<pre id=\"pictures\">W10=</pre>'", "0 of 1 figures were drawn"),
        ("echo '<pre id=\"pictures\">ImJyb2tlbiI=</pre>'", "could not be drawn: broken"),
        ("sleep 30", "took longer than 0.1 s"),
    ],
)
def test_a_browser_that_fails_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, said: str
) -> None:
    monkeypatch.setenv("BROWSER_PATH", script(tmp_path, text))
    monkeypatch.setattr(files, "DRAWING_TIMEOUT_S", 0.1 if "sleep" in text else 20.0)
    with pytest.raises(OutputError, match=said):
        files.draw_pictures({"one": POINTS}, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["browser"]


def test_a_size_is_told_in_millimetres_and_names_are_not_by_chance() -> None:
    svg = '<svg width="332" height="200"><defs id="defs-ab12cd"/><g clip-path="url(#clipab12cdxy)">ab12cd</g></svg>'
    assert files._named(files._in_millimetres(svg), "lag") == (
        '<svg width="87.84mm" height="52.92mm"><defs id="defs-lag-"/><g clip-path="url(#cliplag-xy)">ab12cd</g></svg>'
    )


def test_figures_that_cannot_be_drawn_leave_old_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BROWSER_PATH", script(tmp_path, "exit 1"))
    old = tmp_path / "out" / "flight_lag.svg"
    old.parent.mkdir()
    old.write_text("old")
    with pytest.raises(OutputError):
        write_figures(make_result(("vqf",), with_traces=False), tmp_path / "out" / "flight")
    assert [(path.name, path.read_text()) for path in old.parent.iterdir()] == [("flight_lag.svg", "old")]


def test_a_foreign_file_is_refused_before_a_browser_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "draw_pictures", lambda *_: pytest.fail("a browser draws"))
    result = make_result(NAMES[:2], with_traces=False)
    result.traces = [t for t in traces(NAMES[:2]) if t.figure == "allan"]
    (tmp_path / f"flight_{next(iter(Album.of(result).found))}.png").write_text("mine")
    with pytest.raises(OutputError, match="is not a figure of attlog"):
        write_figures(result, tmp_path / "flight")


@pytest.mark.slow
def test_figures_are_written_as_svg_and_png_and_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BROWSER_PATH", executable())
    result = make_result(NAMES[:2], with_traces=False)
    result.traces = [t for t in traces(NAMES[:2]) if t.figure in ("allan", "compass", "spectrum")]
    album = Album.of(result)
    found = write_figures(result, tmp_path / "flight")
    assert {path.name for path in found} == {f"flight_{n}.{s}" for n in album.found for s in ("svg", "png")}
    assert sorted(tmp_path.iterdir()) == found
    for path in found:
        height = album.drawn(path.stem.removeprefix("flight_"))["layout"]["height"]
        if path.suffix == ".svg":
            root = ET.parse(path).getroot()
            assert root.attrib["width"] == "87.84mm"
            assert root.attrib["viewBox"] == f"0 0 332 {height}"
            styles = [t.attrib["style"] for t in root.iter(f"{SVG}text") if t.text]
            assert styles
            assert all("Arial" in style and "font-size: 10.6" in style for style in styles)
        else:
            size: tuple[Any, ...] = struct.unpack(">II", path.read_bytes()[16:24])
            assert size == (round(332 * 300 / 96), round(height * 300 / 96))
    before = {path.name: path.read_bytes() for path in found if path.suffix == ".svg"}
    assert {p.name: p.read_bytes() for p in write_figures(result, tmp_path / "flight") if p.suffix == ".svg"} == before
