"""One colour per filter everywhere and always."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from attlog.estimators.registry import BUILT_IN
from attlog.report.figures.style import COLOURS, DASHED, FIXED_LINES, GREY, assign_colours, assign_lines, row_styles
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


# Linear RGB to cone responses and these to OKLab (Ottosson 2020); full deuteranopia and protanopia (Machado 2009).
TO_CONES = [[0.41222, 0.53633, 0.05145], [0.21190, 0.68070, 0.10740], [0.08830, 0.28172, 0.62998]]
TO_LAB = [[0.21045, 0.79362, -0.00407], [1.97800, -2.42859, 0.45059], [0.02590, 0.78277, -0.80868]]
VISION = {
    "normal": np.eye(3),
    "deuteranopia": [[0.36732, 0.86065, -0.22797], [0.28009, 0.67250, 0.04741], [-0.01182, 0.04294, 0.96888]],
    "protanopia": [[0.15229, 1.05258, -0.20487], [0.11450, 0.78628, 0.09922], [-0.00388, -0.04812, 1.05200]],
}


def seen(colour: str, vision: str) -> np.ndarray:
    """A colour as an eye sees it, in OKLab times 100."""
    c = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return (
        100.0 * np.asarray(TO_LAB) @ np.cbrt(np.asarray(TO_CONES) @ np.clip(np.asarray(VISION[vision]) @ linear, 0, 1))
    )


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("theme", [":root{--bg:#fff;", ":root[data-theme=dark]{--bg"])
def test_lines_of_one_dash_differ_in_colour_for_every_eye(theme: str, vision: str) -> None:
    """15 of 100 in OKLab; Madgwick and VQF were 8 apart for some, and the smoother looked like onboard."""
    style = (WEB / "style.css").read_text(encoding="utf-8")
    line = next(line for line in style.splitlines() if line.startswith(theme))
    colours = {int(k): c if len(c) == 7 else "#ffffff" for k, c in re.findall(r"--e(\d):(#\w+)", line)}
    assert colours.keys() == {*range(COLOURS + 1), GREY}
    solid = [k for k in colours if k not in DASHED]
    for group in (solid, [0, *DASHED]):
        for a, b in itertools.combinations(group, 2):
            assert np.linalg.norm(seen(colours[a], vision) - seen(colours[b], vision)) > 15.0, (a, b)


def test_half_of_the_filters_are_dashed() -> None:
    homes = [
        FIXED_LINES[f] for f in ("complementary", "mahony", "madgwick", "ekf12", "vqf", "mekf", "eskf", "smoother")
    ]
    assert [dash for _, dash in homes].count("dash") == len(DASHED) == COLOURS // 2
    assert all((dash == "dash") == (slot in DASHED) for slot, dash in homes)
