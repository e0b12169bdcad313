"""Figures of the sensors: nothing twice, captions with the numbers, bands where they belong."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.report.figures.catalogue import sections
from attlog.report.look import looks
from attlog.report.pack import Store
from tests.report.conftest import make_result


def drawn(result=None):
    """Figures of the section by id."""
    result = result or make_result()
    return {f.id: f for f in sections(result, looks(result), Store())["sensors"]}


def without(*figures: str):
    """The result without some traces."""
    result = make_result()
    result.traces = [t for t in result.traces if t.figure not in figures]
    return result


def test_the_fields_size_alone_is_drawn_only_where_its_axes_are_not():
    assert list(drawn()) == ["compass", "interference", "vibration", "spectrum", "gravity", "ratios", "bias"]
    assert "field" in drawn(without("compass"))


def test_the_caption_of_the_field_says_by_which_attitude_and_whether_it_is_corrected():
    caption = drawn()["compass"].caption
    assert "by motion alone, without any compass" in caption
    assert "offset that can be set" in caption
    result = make_result()
    trace = next(t for t in result.traces if t.figure == "compass")
    trace.values["by_motion"] = 0.0
    trace.columns = {name: y for name, y in trace.columns.items() if not name.startswith("corrected")}
    caption = drawn(result)["compass"].caption
    assert "by the onboard attitude" in caption
    assert "can be set" not in caption
    assert "x off by +12.0 µT" in drawn()["compass"].words


def test_the_autopilots_own_level_comes_first_with_percentiles_and_limits():
    figure = drawn()["vibration"]
    assert figure.caption == (
        "The autopilot's own level in flight: p50 20.0, p80 26.0, worst second 48.0 m/s²; limits 30 and 60. "
        "▼ 7 samples clipped (VIBE.Clip0)."
    )
    first, second = figure.data["views"]
    assert first["limits"] == [30.0, 60.0]
    assert first["clipped"] == second["clipped"] == [[100.5, 7]]
    assert set(second["axes"]) == {"x", "y", "z"}


def test_without_counters_the_logged_samples_tell_what_was_clipped():
    figure = drawn(without("levels", "clipping"))["vibration"]
    assert figure.data["views"][0]["clipped"] == [[100.5, 1]]
    assert "1 sample at the end of its range" in figure.caption


@pytest.mark.parametrize(("rate", "folded"), [(100.0, 0.0), (400.0, 100.0), (500.0, 200.0)])
def test_folded_frequencies_reach_from_the_rate_less_the_fastest_rotor_to_half_the_rate(rate, folded):
    result = make_result()
    for trace in result.traces:
        if trace.figure == "spectrum":
            trace.values["nyquist_hz"] = rate / 2
    figure = drawn(result)["spectrum"]
    assert figure.data["views"][0]["folded"] == folded
    assert f"between {rate / 2:.0f} and 300 Hz" in figure.caption


def test_a_rate_beyond_twice_the_fastest_rotor_folds_nothing():
    result = make_result()
    for trace in result.traces:
        if trace.figure == "spectrum":
            trace.values["nyquist_hz"] = 500.0
    assert "Hatched" not in drawn(result)["spectrum"].caption


def test_rotors_and_notches_are_bands_of_the_spectrum():
    data = drawn()["spectrum"].data
    assert "Grey: rotors, 8.0 Hz and harmonics." in drawn()["spectrum"].caption
    assert [b["f"] for b in data["rotor"]] == [8.0, 16.0, 24.0]
    assert [(b["key"], b["f"]) for b in data["notches"]] == [("set", 8.0), ("proposed", 16.0)]


def test_rotors_faster_than_half_the_rate_are_said_to_be_beyond_it():
    result = make_result()
    rotor = next(t for t in result.traces if t.figure == "rotor")
    rotor.t = 10.0 * rotor.t
    assert "Rotors turn at 80 Hz, beyond half the rate." in drawn(result)["spectrum"].caption


def test_every_aid_has_a_colour_of_its_own_whoever_else_is_drawn():
    lines = drawn()["ratios"].data["lines"]
    assert [(line["aid"], line["slot"]) for line in lines] == [("compass", 1), ("velocity", 2)]
    result = without("bias")
    result.traces = [t for t in result.traces if not (t.figure == "ratios" and t.key == "compass")]
    assert [(line["aid"], line["slot"]) for line in drawn(result)["ratios"].data["lines"]] == [("velocity", 2)]


def test_lines_of_nothing_but_gaps_are_drawn_without_error():
    result = make_result()
    for trace in result.traces:
        if trace.figure in ("compass", "levels"):
            trace.columns = {name: np.full(len(trace.t), np.nan) for name in trace.columns}
    assert {"compass", "vibration"} <= set(drawn(result))
