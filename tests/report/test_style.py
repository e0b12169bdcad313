"""One colour per filter everywhere and always."""

from __future__ import annotations

import re

import pytest

from attlog.estimators.registry import BUILT_IN
from attlog.report.figures.style import COLOURS, FIXED_LINES, GREY, assign_colours, assign_lines, row_styles
from attlog.report.shell import WEB
from tests.report.conftest import make_result


def test_every_built_in_filter_has_a_line_of_its_own():
    assert set(BUILT_IN) <= set(FIXED_LINES)
    assert len(set(FIXED_LINES.values())) == len(FIXED_LINES)
    assert assign_lines(FIXED_LINES) == list(FIXED_LINES.values())


def test_the_palette_holds_every_slot():
    style = (WEB / "style.css").read_text(encoding="utf-8")
    known = {int(k) for k in re.findall(r"--e(\d):", style)}
    assert {slot for slot, _ in FIXED_LINES.values()} <= known
    assert known == {*range(COLOURS + 1), GREY}


@pytest.mark.parametrize("beside", [[], ["eskf"], ["gyro", "mahony", "smoother", "onboard"]])
def test_a_filter_looks_the_same_beside_any_other(beside):
    assert assign_lines([*beside, "vqf"])[-1] == FIXED_LINES["vqf"]
    assert assign_lines(["vqf", *beside])[0] == FIXED_LINES["vqf"]


def test_presets_share_the_colour_with_another_dash_than_any_other_filter():
    lines = assign_lines(["mahony", "mahony", "mahony", "mahony_passive"])
    assert {slot for slot, _ in lines} == {FIXED_LINES["mahony"][0]}
    assert len(set(lines)) == 4
    assert lines[0] == FIXED_LINES["mahony"]
    assert lines[3] == FIXED_LINES["mahony_passive"]


def test_filters_of_others_take_colours_that_are_free():
    lines = assign_lines(["vqf", "mine", "mekf", "yours"])
    assert len({slot for slot, _ in lines}) == 4
    assert len(set(assign_lines([*FIXED_LINES, "a", "b", "c"]))) == len(FIXED_LINES) + 3


def test_onboard_is_black_and_solid_with_and_without_a_truth():
    assert assign_lines(["truth", "onboard"])[1] == assign_lines(["onboard"])[0] == (0, "solid")
    assert assign_lines(["onboard", "onboard"])[1][0] == 0


def test_a_filter_that_bounces_sets_no_range():
    found = row_styles(make_result(("accel_mag", "vqf")))
    assert found["accel_mag"].lost
    assert not found["vqf"].lost


def test_configurations_of_filters_have_the_colours_of_the_filters():
    assert assign_colours(["mahony", "vqf@fast", "eskf:sigma=2"]) == [
        FIXED_LINES[f][0] for f in ("mahony", "vqf", "eskf")
    ]
    assert assign_colours(["mahony:kp=0.5", "mahony:kp=1", "vqf"]) == [0, 1, 2]
