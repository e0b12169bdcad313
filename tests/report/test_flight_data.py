"""Figures of flight data: panels that have lines, colours of motors, drawn when scrolled to."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.flight.panels import PANELS
from attlog.report import write_report
from attlog.report.figures import flight_data
from attlog.report.figures.catalogue import Album, sections
from attlog.report.figures.figure import FigureSource, PageFigure
from attlog.result import Result, Trace
from tests.report.conftest import make_result

T = np.linspace(0.0, 100.0, 200)


def result_with(**panels: dict[str, Any]) -> Result:
    """A result with flight data: columns by panel."""
    result = make_result()
    result.traces += [Trace("data", "", T, columns, panel) for panel, columns in panels.items()]
    return result


def figures(result: Result) -> dict[str, PageFigure]:
    return {figure.id: figure for figure in sections(FigureSource.of(result))["data"]}


def test_every_panel_is_in_one_figure_and_has_an_axis() -> None:
    used = [panel for figure in flight_data.FIGURES for panel in figure.panels]
    assert sorted({*used, *flight_data.ONBOARD.panels}) == sorted(PANELS)
    assert len(used) == len(set(used))
    assert set(flight_data.AXES) == set(PANELS)


def test_a_log_without_flight_data_has_no_figure_of_it() -> None:
    assert figures(make_result()) == {}


def test_panels_without_a_line_take_no_room() -> None:
    found = figures(result_with(volts={"battery": 12.0 + 0 * T}, rails={"board": 5.0 + 0 * T}))
    assert list(found) == ["battery"]
    view = found["battery"].data["views"][0]
    assert [axis["title"] for key, axis in view["axes"].items() if key != "xaxis"] == ["voltage, V", "rails, V"]
    assert found["battery"].words == "voltage: battery 12.0 V to 12.0 V; rails: board 5.00 V to 5.00 V"


def test_every_line_is_saved_under_its_panel_and_label_with_its_unit() -> None:
    found = figures(result_with(volts={"battery": 12.0 + 0 * T}, accuracy={"horizontal": 1.0 + 0 * T}))
    for figure, quantity, unit in (("battery", "voltage battery", "V"), ("reception", "accuracy horizontal", "m")):
        (line,) = found[figure].data["views"][0]["traces"]
        assert (line["meta"]["quantity"], line["meta"]["unit"]) == (quantity, unit)


def test_a_full_turn_breaks_the_line_of_a_heading() -> None:
    turning = (3.6 * 2.0 * T + 180.0) % 360.0 - 180.0
    (line,) = figures(result_with(heading={"onboard": turning}))["headings"].data["views"][0]["traces"]
    assert line["meta"]["wraps"]
    assert float(np.ptp(line["y"])) < 360.0


def test_a_caption_explains_only_what_is_drawn() -> None:
    onboard, course = {"onboard": 0 * T}, {"course": 0 * T}
    assert figures(result_with(heading=onboard))["headings"].caption == ""
    caption = figures(result_with(heading=onboard | course))["headings"].caption
    assert "Course" in caption
    assert "GNSS motion" not in caption


def test_a_motor_has_the_colour_of_its_rotor_and_speed_controller() -> None:
    found = figures(
        result_with(
            motors={"motor 1 (front right)": 50.0 + 0 * T, "motor 2 (rear left)": 60.0 + 0 * T},
            rpm={"rotor 1": 5000.0 + 0 * T, "rotor 2": 6000.0 + 0 * T},
            esc_current={"ESC": 3.0 + 0 * T, "ESC 2": 4.0 + 0 * T},
        )
    )["motors"]
    colours = {t["name"]: t["line"]["color"] for t in found.data["views"][0]["traces"] if t["name"]}
    assert colours["motor 1 (front right)"] == colours["rotor 1"] == colours["ESC"]
    assert colours["motor 2 (rear left)"] == colours["rotor 2"] == colours["ESC 2"] != colours["rotor 1"]


def test_a_reversing_motor_is_drawn_down_to_its_least_output_and_a_stopped_one_is_not() -> None:
    stopped = np.where(T < 20.0, np.minimum(-120.0 + 9.0 * np.maximum(T - 13.0, 0.0), 50.0), 50.0)  # spins up slowly
    reversing = 60.0 * np.sin(0.3 * T)
    for output, floor, words in ((stopped, -25.0, "stopped motor"), (reversing, None, "in reverse")):
        figure = figures(result_with(motors={"motor 1": output}))["motors"]
        (axis,) = [x for key, x in figure.data["views"][0]["axes"].items() if key != "xaxis"]
        assert axis["fit"].get("floor") == floor
        assert words in figure.caption


def test_a_log_without_filters_shows_its_onboard_attitude_first() -> None:
    result = result_with(roll={"onboard": 10.0 * np.sin(T)}, pitch={"onboard": 0 * T + 2.0}, heading={"onboard": T})
    result.estimators, result.traces = [], [trace for trace in result.traces if trace.figure == "data"]
    names = [figure.id for figure in sections(FigureSource.of(result))["flight"]]
    assert names == ["strip", "attitude"]
    assert [figure.id for figure in sections(FigureSource.of(make_result()))["flight"]].count("attitude") == 1


def test_clipped_samples_are_marked_above_the_acceleration() -> None:
    result = result_with(acceleration={"x": 0 * T, "y": 0 * T, "z": 0 * T - 9.8})
    counted = {"samples": np.array([3.0, 40.0])}
    result.traces = [trace for trace in result.traces if trace.figure != "clipping"]
    result.traces.append(Trace("clipping", "", np.array([20.0, 21.0]), counted, "VIBE", values={"samples": 43.0}))
    figure = figures(result)["acceleration"]
    (marks,) = [t for t in figure.data["views"][0]["traces"] if t["mode"] == "markers"]
    assert (marks["x"], marks["meta"]["value"]) == ([20.0, 21.0], [3, 40])
    assert "43 samples clipped" in figure.caption


def test_flight_data_can_be_printed() -> None:
    album = Album.of(result_with(volts={"battery": 12.0 + np.sin(T)}, amperes={"battery": 20.0 + np.cos(T)}))
    drawn = album.drawn("battery")
    assert drawn["layout"]["yaxis"]["title"]["text"] == "voltage, V"
    assert drawn["layout"]["yaxis2"]["title"]["text"] == "current, A"


def test_flight_data_is_drawn_when_scrolled_to(visit: Any, tmp_path: Any) -> None:
    path = tmp_path / "report.html"
    write_report(result_with(volts={"battery": 12.0 + np.sin(T)}), path)
    page = visit(path)
    before = page.page.evaluate("() => !!document.getElementById('battery').dataset.ready")
    assert not before
    assert page.figures()["battery"]
    assert page.complaints == []


def test_what_is_scrolled_to_is_drawn_even_if_the_observer_missed_it(visit: Any, tmp_path: Any) -> None:
    path = tmp_path / "report.html"
    write_report(result_with(volts={"battery": 12.0 + np.sin(T)}), path)
    silent = "<script>window.IntersectionObserver = class { observe() {} unobserve() {} };</script>"
    path.write_text(path.read_text().replace("<script>", f"{silent}<script>", 1))
    assert visit(path, bypass_csp=True).figures()["battery"]
