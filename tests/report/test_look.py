"""One colour per filter everywhere and always."""

from __future__ import annotations

import re

import pytest

from attlog.estimators.registry import BUILT_IN
from attlog.report.look import COLOURS, FIXED, GREY, colours_of, lines_of, looks
from attlog.report.page import WEB
from tests.report.conftest import make_result


def test_every_built_in_filter_has_a_line_of_its_own():
    assert set(BUILT_IN) <= set(FIXED)
    assert len(set(FIXED.values())) == len(FIXED)
    assert lines_of(FIXED) == list(FIXED.values())


def test_the_palette_holds_every_slot():
    style = (WEB / "style.css").read_text(encoding="utf-8")
    known = {int(k) for k in re.findall(r"--e(\d):", style)}
    assert {slot for slot, _ in FIXED.values()} <= known
    assert known == {*range(COLOURS + 1), GREY}


@pytest.mark.parametrize("beside", [[], ["eskf"], ["gyro", "mahony", "smoother", "onboard"]])
def test_a_filter_looks_the_same_beside_any_other(beside):
    assert lines_of([*beside, "vqf"])[-1] == FIXED["vqf"]
    assert lines_of(["vqf", *beside])[0] == FIXED["vqf"]


def test_presets_share_the_colour_with_another_dash_than_any_other_filter():
    lines = lines_of(["mahony", "mahony", "mahony", "mahony_passive"])
    assert {slot for slot, _ in lines} == {FIXED["mahony"][0]}
    assert len(set(lines)) == 4
    assert lines[0] == FIXED["mahony"]
    assert lines[3] == FIXED["mahony_passive"]


def test_filters_of_others_take_colours_that_are_free():
    lines = lines_of(["vqf", "mine", "mekf", "yours"])
    assert len({slot for slot, _ in lines}) == 4
    assert len(set(lines_of([*FIXED, "a", "b", "c"]))) == len(FIXED) + 3


def test_onboard_is_black_and_solid_with_and_without_a_truth():
    assert lines_of(["truth", "onboard"])[1] == lines_of(["onboard"])[0] == (0, "solid")
    assert lines_of(["onboard", "onboard"])[1][0] == 0


def test_a_filter_that_bounces_sets_no_range():
    found = looks(make_result(("accel_mag", "vqf")))
    assert found["accel_mag"].lost
    assert not found["vqf"].lost


def test_configurations_of_filters_have_the_colours_of_the_filters():
    assert colours_of(["mahony", "vqf@fast", "eskf:sigma=2"]) == [FIXED[f][0] for f in ("mahony", "vqf", "eskf")]
    assert colours_of(["mahony:kp=0.5", "mahony:kp=1", "vqf"]) == [0, 1, 2]
