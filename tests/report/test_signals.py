"""The picker of signals: its packed samples, and what a reader does with it."""

from __future__ import annotations

import base64
import csv
import gzip
import json

import numpy as np
import pytest

from attlog.metrics.trace import Trace
from attlog.report import write_report
from attlog.report.bundle import bundle
from attlog.report.figures.signals import packed_signals, picker
from attlog.report.page import render
from tests.report.conftest import make_result

T = np.arange(0.0, 200.0, 0.1)


def traces() -> list[Trace]:
    """A battery, an attitude and a position, each at its own times; one message by name alone."""
    battery = {"Volt": 16.0 - 0.01 * T, "Curr": 10.0 + np.sin(T)}
    place = {"Lat": 47.3977 + 1e-6 * T, "Alt": 500.0 + np.sin(0.1 * T)}
    return [
        Trace("signal", "", T, battery, "BAT[0]", 40.0, {"records": 80_000.0}, {"Volt": "V", "Curr": "A"}),
        Trace(
            "signal",
            "",
            T,
            {"Roll": 20.0 * np.sin(T), "DesRoll": 20.0 * np.cos(T)},
            "ATT",
            1.0,
            {"records": 2000.0},
            {"Roll": "deg", "DesRoll": "deg"},
        ),
        Trace("signal", "", T[::10], {name: y[::10] for name, y in place.items()}, "POS", 1.0, {"records": 200.0}),
        Trace(
            "signal",
            "",
            T,
            {f"C{k}": np.full(len(T), float(k)) for k in range(1, 10)},
            "RCIN",
            1.0,
            {"records": 2000.0},
        ),
        Trace("signal", "", np.zeros(0), {"X": np.zeros(0)}, "XKF2"),
    ]


def unpacked(block: str) -> tuple[dict, bytes]:  # type: ignore[type-arg]
    raw = gzip.decompress(base64.b64decode(block))
    size = int.from_bytes(raw[:4], "little")
    return json.loads(raw[4 : 4 + size]), raw[4 + size :]


def decoded(place: dict, data: bytes) -> np.ndarray:  # type: ignore[type-arg]
    """The array of a place, as the format's description says."""
    n, w, o = place["n"], place["w"], place["o"]
    zigzag = np.frombuffer(data[o : o + n * w], np.uint8).reshape(w, n).T.copy().view(f"<u{w}")[:, 0]
    whole = np.cumsum((zigzag >> 1).astype(f"<i{w}") ^ -(zigzag & 1).astype(f"<i{w}"), dtype=f"<i{w}")
    return np.where(whole == -32768, np.nan, whole * place["s"] + place.get("b", 0.0))


def test_positions_keep_centimetres_and_times_a_tenth_of_a_millisecond():
    header, data = unpacked(packed_signals(traces()[:4]))
    position = header["messages"][2]
    (_, _, lat), _ = position["fields"]
    assert decoded(lat, data) == pytest.approx(47.3977 + 1e-6 * T[::10], abs=1e-8)
    assert decoded(position["t"], data) == pytest.approx(T[::10], abs=1e-4)
    assert [field[:2] for field in header["messages"][0]["fields"]] == [["Volt", "V"], ["Curr", "A"]]


def test_noise_beyond_the_budget_is_reduced_and_keeps_its_peaks():
    noise = np.random.default_rng(1).normal(size=(40, 20_000))
    noise[7, 9999] = 90.0
    t = np.arange(20_000) * 0.01
    many = [Trace("signal", "", t, {f"f{k}": y for k, y in enumerate(noise)}, "M", 1.0, {"records": 20_000.0})]
    block = packed_signals(many, limit=200_000)
    assert 100_000 < len(block) <= 200_000
    header, data = unpacked(block)
    spiked = decoded(header["messages"][0]["fields"][7][2], data)
    assert spiked.max() == pytest.approx(90.0, rel=1e-3)


def test_samples_take_what_the_rest_of_a_page_leaves_of_its_bytes(monkeypatch):
    result = make_result()
    noise = np.random.default_rng(2).normal(size=(40, 5_000))
    fields = {f"f{k}": y for k, y in enumerate(noise)}
    result.traces.append(Trace("signal", "", np.arange(5_000) * 0.01, fields, "M", 1.0, {"records": 5_000.0}))
    whole = len(render(result))
    monkeypatch.setattr("attlog.report.page.MAX_OWN_BYTES", whole - len(bundle().packed) * 4 // 3 - 100_000)
    assert whole - 300_000 < len(render(result)) <= whole - 99_000


def test_without_samples_there_is_no_picker():
    result = make_result()
    assert picker(result) is None
    result.traces += traces()[4:]
    assert picker(result) is None


@pytest.fixture
def page(visit, tmp_path):
    result = make_result()
    result.traces += traces()
    write_report(result, tmp_path / "report.html")
    found = visit(tmp_path / "report.html")
    found.page.locator("#picker > summary").click()
    found.page.wait_for_selector("#signal-list li")
    return found


def choose(page, search: str, name: str) -> None:
    page.fill("#signal-search", search)
    page.get_by_role("checkbox", name=name).check()


AXES = "() => document.getElementById('signals').data.filter((t) => t.name).map((t) => [t.name, t.yaxis])"


def test_signals_share_an_axis_by_their_unit_and_can_be_moved(page):
    choose(page.page, "volt", "BAT[0].Volt")
    choose(page.page, "att roll", "ATT.Roll")
    choose(page.page, "att des", "ATT.DesRoll")
    assert page.page.evaluate(AXES) == [["BAT[0].Volt", "y"], ["ATT.Roll", "y2"], ["ATT.DesRoll", "y2"]]
    titles = "() => ['yaxis', 'yaxis2'].map((k) => document.getElementById('signals').layout[k].title.text)"
    assert page.page.evaluate(titles) == ["V", "°"]
    page.page.get_by_role("button", name="ATT.Roll on the right axis").click()
    assert page.page.evaluate(AXES)[1] == ["ATT.Roll", "y"]
    page.page.get_by_role("button", name="Remove BAT[0].Volt").click()
    assert [name for name, _ in page.page.evaluate(AXES)] == ["ATT.Roll", "ATT.DesRoll"]
    notes = page.page.inner_text("#signal-notes")
    assert "ATT: all 2,000 records" in notes
    assert page.complaints == []


def test_a_constant_has_a_range_of_its_own_size_and_a_small_signal_fills_its_axis(page):
    span = "() => ((r) => r[1] - r[0])(document.getElementById('signals').layout.yaxis.range)"
    choose(page.page, "RCIN", "RCIN.C9")
    assert page.page.evaluate(span) == pytest.approx(1.8)
    page.page.get_by_role("button", name="Remove RCIN.C9").click()
    choose(page.page, "POS", "POS.Lat")
    moved = 1e-6 * float(np.ptp(T[::10]))
    assert page.page.evaluate(span) == pytest.approx(1.12 * moved, rel=0.01)


def test_what_is_thinned_names_the_command_that_has_all(page):
    choose(page.page, "curr", "BAT[0].Curr")
    note = page.page.inner_text("#signal-notes")
    assert "1 in 40 samples" in note
    assert note.endswith("attlog extract 'flight.bin' 'BAT[0]'")


def test_the_ninth_is_refused_with_a_reason_and_what_is_not_packed_is_named(page):
    page.page.fill("#signal-search", "RCIN")
    for k in range(1, 9):
        page.page.get_by_role("checkbox", name=f"RCIN.C{k}").check()
    page.page.get_by_role("checkbox", name="RCIN.C9").click()
    assert not page.page.get_by_role("checkbox", name="RCIN.C9").is_checked()
    assert "At most 8" in page.page.inner_text("#signal-count")
    page.page.fill("#signal-search", "xkf2")
    assert page.page.inner_text("#signal-count") == "0 signals; 1 with --signals all"


def test_it_zooms_with_the_page_and_saves_what_is_in_sight(page):
    choose(page.page, "volt", "BAT[0].Volt")
    page.page.evaluate("Plotly.relayout('attitude', {'xaxis.range[0]': 50, 'xaxis.range[1]': 60})")
    page.page.wait_for_function("document.getElementById('signals').layout.xaxis.range[0] === 50")
    page.page.evaluate(
        """() => {
            URL.createObjectURL = (blob) => { window.kept = blob; return ''; };
            HTMLAnchorElement.prototype.click = () => {};
        }"""
    )
    page.page.evaluate("() => document.querySelector('.out[data-figure=signals] [data-out=csv]').click()")
    lines = list(csv.DictReader(page.page.evaluate("() => window.kept.text()").splitlines()))
    assert {(line["quantity"], line["unit"]) for line in lines} == {("BAT[0].Volt", "V")}
    t = np.array([float(line["time_s"]) for line in lines])
    assert (t.min(), t.max()) == (pytest.approx(50.0, abs=0.11), pytest.approx(60.0, abs=0.11))
    assert np.array([float(line["value"]) for line in lines]) == pytest.approx(16.0 - 0.01 * t, abs=1e-3)


def test_keys_alone_choose_a_signal(page):
    page.page.focus("#signal-search")
    page.page.keyboard.type("curr")
    page.page.keyboard.press("Tab")
    page.page.keyboard.press("Space")
    assert [name for name, _ in page.page.evaluate(AXES)] == ["BAT[0].Curr"]


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_violation_with_signals_drawn(visit, tmp_path, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    result = make_result()
    result.traces += traces()
    write_report(result, tmp_path / "report.html")
    page = visit(tmp_path / "report.html", color_scheme=scheme).page
    page.locator("#picker > summary").click()
    page.wait_for_selector("#signal-list li")
    choose(page, "volt", "BAT[0].Volt")
    choose(page, "att roll", "ATT.Roll")
    page.evaluate("document.getElementById('parameters').open = true")
    found = axe.Axe().run(page)
    assert [(v["id"], v["nodes"][0]["html"][:120]) for v in found.response["violations"]] == []
