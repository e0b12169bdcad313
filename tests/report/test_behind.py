"""Links from findings, events and checks to the figures behind them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.health.registry import CHECKS
from attlog.report import write_report
from attlog.report.bundle import bundle
from attlog.report.figures import catalogue, flight_data
from attlog.report.figures.behind import FIGURES_OF, FIGURES_OF_WORD, figure_behind, view_named
from attlog.report.page import render
from attlog.result import Finding, Trace
from attlog.story.flight_events import Event
from attlog.words.events import EVENT_LABELS
from tests.report.conftest import make_result

T = np.linspace(0.0, 200.0, 400)
EVERY = {f.id for f in flight_data.FIGURES} | {
    build.__name__ for section in catalogue.SECTIONS.values() for build in section if hasattr(build, "__name__")
}


def test_every_check_and_kind_of_event_has_a_figure() -> None:
    assert set(CHECKS) - set(FIGURES_OF) == {"log_clock"}  # no figure has another clock
    by_word = {"failsafe", "message", "device_error", "sensor_fault", "arming_refused"}
    assert set(EVENT_LABELS) - set(FIGURES_OF) == by_word


def test_figures_that_are_named_can_be_drawn() -> None:
    named = {name for names in (*FIGURES_OF.values(), *FIGURES_OF_WORD.values()) for name in names}
    assert named - EVERY == {"parameters"}


@pytest.mark.parametrize(
    ("kind", "about", "text", "figure"),
    [
        ("motor", "motor_thrust", "Motor 2 (rear left) gave no thrust.", "motors"),
        ("supply", "battery", "The battery is weak.", "battery"),
        ("compass", "heading_by_gnss", "The onboard heading is 24° off.", "headings"),
        ("compass", "compass_offset", "MAG is off by 12 uT.", "compass"),
        ("gyro_bias", "imu_instances", "IMU2 and IMU differ by 1.8°/s.", "bias"),
        ("accelerometer", "imu_instances", "IMU2 and IMU differ by 0.8 m/s².", "gravity"),
        ("vibration", "clipping", "The accelerometer clipped.", "acceleration"),
        ("control", "oscillation", "Roll oscillated at 8 Hz.", "rates"),
        ("rate", "", "RAW_IMU is logged at 4 Hz.", "rates"),
        ("failsafe", "", "Battery failsafe at 23.7 s.", "battery"),
        ("failsafe", "", "Radio failsafe at 5.0 s.", "sticks"),
        ("cut_at_end", "", "The last record is cut.", ""),
    ],
)
def test_a_finding_is_shown_by_the_figure_of_its_subject(kind: str, about: str, text: str, figure: str) -> None:
    assert figure_behind(kind, about, text, False, EVERY) == figure


def test_a_figure_that_is_not_drawn_is_not_linked() -> None:
    assert figure_behind("motor", "motor_thrust", "No thrust.", False, {"attitude"}) == ""
    assert figure_behind("motor", "motor_thrust", "No thrust.", True, {"attitude"}) == "attitude"


@pytest.mark.parametrize(
    ("sensor", "text", "view"),
    [
        ("MAG2", "MAG reads 62 µT.", 1),
        ("", "MAG2 is off by 12 µT, MAG by 3 µT.", 1),
        ("", "COMPASS_MAG, MAG2.x and MAG:0 name no compass.", None),
        ("GPS", "The heading is 24° off.", None),
    ],
)
def test_a_link_chooses_the_view_of_the_sensor_that_it_is_about(sensor: str, text: str, view: int | None) -> None:
    assert view_named(["MAG", "MAG2"], sensor, text) == view
    assert view_named(["MAG"], sensor, text) is None


def made() -> Any:
    """A result with a weak battery from 60 to 80 s."""
    result = make_result()
    result.traces.append(Trace("data", "", T, {"battery": 12.0 + np.sin(T)}, "volts"))
    weak = Finding("supply", "serious", "The battery sags from 60.0 s.", t=60.0, t_end=80.0, about="battery")
    result.findings.append(weak)
    return result


def test_links_lead_to_places_of_the_page() -> None:
    page = render(made(), bundle())
    assert '<a href="#fig-battery" data-t="60.0" data-end="80.000" title="Battery and supply">60.0 s</a>' in page
    places = set(re.findall(r'id="([\w-]+)"', page))
    assert {name for name in re.findall(r'href="#([\w-]+)"', page)} <= places


def test_what_leads_to_a_figure_by_its_name_alone_is_not_printed() -> None:
    result = made()
    result.findings = [Finding("supply", "serious", "The battery sags.", about="battery")]
    links = re.findall(r"<a [^>]*>Figure</a>", render(result, bundle()))
    assert links
    assert all('class="noprint"' in link for link in links)


def test_a_link_draws_the_figure_at_its_time_with_the_span_shaded(visit: Any, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(made(), path)
    page = visit(path)
    page.page.click('#findings a[href="#fig-battery"]')
    page.page.wait_for_selector("#battery[data-ready]")
    top = page.page.evaluate("() => document.querySelector('#fig-battery h3').getBoundingClientRect().top")
    bar = page.page.evaluate("() => document.querySelector('.legend').getBoundingClientRect().bottom")
    assert top >= bar
    low, high = page.range("battery")
    assert 40.0 < low < 60.0 < 80.0 < high < 100.0
    spans = page.page.evaluate("() => document.getElementById('battery')._fullLayout.shapes.map((s) => [s.x0, s.x1])")
    assert [60, 80] in spans
    assert page.complaints == []


def test_a_mark_of_the_strip_leads_to_the_figure_of_its_event() -> None:
    result = made()
    result.headline = "Flew 55 to 190 s."
    result.events.append(Event("battery", 61.5, "serious", "The battery failed."))
    mark = re.search(r'<a href="#([\w-]+)" data-t="61.500" class="bad"', render(result, bundle()))
    assert mark is not None
    assert mark[1] == "fig-battery"


def test_a_finding_of_the_second_compass_draws_the_second_compass(visit: Any, tmp_path: Path) -> None:
    result = make_result()
    fields = {f"{part}{axis}": 20.0 + np.sin(T) for part in ("", "expected_") for axis in "xyz"}
    result.traces += [Trace("compass", "", T, dict(fields), name) for name in ("MAG", "MAG2")]
    off = Finding("compass", "warning", "MAG2 reads 62 µT from 60.0 s.", t=60.0, t_end=80.0, about="field")
    result.findings.append(off)
    path = tmp_path / "report.html"
    write_report(result, path)
    page = visit(path)
    page.page.click('#findings a[href="#fig-compass"]')
    page.page.wait_for_selector("#compass[data-ready]")
    assert page.page.inner_text("select[data-figure=compass] option:checked") == "MAG2"
    drawn = page.page.evaluate("() => document.getElementById('compass').data.map((t) => t.own.quantity)")
    assert any(str(name).startswith("MAG2 ") for name in drawn)
    assert page.complaints == []


def test_an_overturn_is_shown_by_the_attitude_and_an_impact_by_the_height() -> None:
    result = make_result()
    result.headline = "Flew 55 to 190 s."
    result.traces.append(Trace("data", "", T, {"barometer": np.sin(T)}, "height"))
    for kind, t in (("overturn", 61.5), ("impact", 90.25)):
        result.events.append(Event(kind, t, "serious", f"Lost at {t} s."))
        result.findings.append(Finding("crash", "serious", f"Lost at {t:.1f} s.", t=t))
    page = render(result, bundle())
    links = dict(re.findall(r'<li class="bad">.*?<a href="#([\w-]+)" data-t="([\d.]+)"', page))
    assert links == {"fig-attitude": "61.5", "fig-heights": "90.25"}
