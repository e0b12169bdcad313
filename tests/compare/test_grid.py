"""Lists, ranges and switches of parameters, and everything that can be wrong with them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from attlog.compare.grid import (
    GENERATION_SIZE,
    FreeParameter,
    GridAxis,
    Setting,
    minimize,
    parse_free_parameters,
    parse_grid,
    search_request,
    setting_text,
    spaced_values,
)
from attlog.core.errors import UsageError
from attlog.core.limits import MAX_SETS
from attlog.estimators import get

MAHONY = get("mahony")


def test_lists_ranges_and_switches_become_all_combinations() -> None:
    made = parse_grid(["kp=0.6,1.1,2", "ki=0..0.05/6", "mag_form=heading,vector"], MAHONY)
    assert (made.shape, len(made)) == ((3, 6, 2), 36)
    assert made.axes[1] == GridAxis("ki", "1/s^2", (0.0, 0.01, 0.02, 0.03, 0.04, 0.05), "linear")
    settings = list(made)
    assert settings[0] == {"kp": 0.6, "ki": 0.0, "mag_form": "heading"}
    assert settings[-1] == {"kp": 2.0, "ki": 0.05, "mag_form": "vector"}
    assert len({setting_text(s) for s in settings}) == 36


def test_a_log_range_has_equal_factors_and_both_ends() -> None:
    found = parse_grid(["ki=1e-4..0.1/4log"], MAHONY).axes[0]
    assert found.values == (1e-4, 1e-3, 1e-2, 0.1)
    assert found.spacing == "log"
    assert spaced_values(0.5, 2.0, 3, True) == [0.5, 1.0, 2.0]
    assert spaced_values(0.0, 1.0, 2, False) == [0.0, 1.0]
    assert spaced_values(1.0, 10.0, 4, True) == [1.0, 2.154, 4.642, 10.0]  # the cube root of 10, to four digits


def test_a_value_may_carry_its_unit_and_comes_once() -> None:
    assert parse_grid(["declination=3deg,3,-2 deg"], MAHONY).axes[0].values == (3.0, -2.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("kp=0.6deg", "in 1/s, not in deg"),
        ("kpp=1", "mean kp"),
        ("kp=1..0.3/4", "smaller value first"),
        ("ki=0..2/4log", "begins above 0"),
        ("kp=0..2", "LOW..HIGH/COUNT"),
        ("kp=0..2/x", "LOW..HIGH/COUNT"),
        ("kp=0..2/1", "2 to 1000"),
        ("kp=", "no values"),
        ("kp=1,,2", "a value is missing"),
        ("kp=many", "not a number"),
        ("kp=nan", "not a number|out of range"),
        ("ki=99", "from 0 to 10 1/s"),
        ("mag_form=both", "known are heading, vector"),
        ("mag_form=0..1/2", "a switch"),
    ],
)
def test_what_is_wrong_is_said(text: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        parse_grid([text], MAHONY)


def test_everything_wrong_is_told_at_once() -> None:
    with pytest.raises(UsageError) as refused:
        parse_grid(["kp=x", "kj=1", "ki=1", "ki=2"], MAHONY)
    assert len(str(refused.value).split("\n")) == 3


def test_a_grid_that_nobody_can_look_at_is_refused_in_a_sentence() -> None:
    with pytest.raises(UsageError, match=rf"10,000 settings; up to {MAX_SETS:,} .* attlog tune"):
        parse_grid(["kp=0..2/100", "ki=0..1/100"], MAHONY)
    with pytest.raises(UsageError, match="nothing to sweep; give values such as kp="):
        parse_grid([], MAHONY)


def test_the_last_word_that_is_no_axis_is_the_filter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a=1.bin").touch()
    Path("mine.py").touch()
    found = search_request(["a=1.bin", "b.ulg", "mahony@xu-2:ki=0.1", "kp=1,2"], "x")
    assert (found.logs, found.filter, found.axes) == (
        [Path("a=1.bin"), Path("b.ulg")],
        "mahony@xu-2:ki=0.1",
        ["kp=1,2"],
    )
    assert search_request(["a=1.bin", "mine.py", "kp=1"], "x").filter == "mine.py"


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    log = tmp_path / "x.bin"
    log.touch()
    for words, says in (
        ([], "a log and a filter are"),
        (["kp=1"], "are missing"),
        (["mahony", "kp=1"], "is missing"),
        ([str(tmp_path), str(log), "kp=1"], "after the logs"),
    ):
        with pytest.raises(UsageError, match=says):
            search_request(words, "attlog sweep x.bin mahony kp=1")


# The search finds minima that are known, repeats itself, and refuses ranges that are none.

KP, KI = FreeParameter("kp", "1/s", 0.01, 10.0, True), FreeParameter("ki", "1/s^2", 0.0, 1.0, False)
START: Setting = {"kp": 5.0, "ki": 0.9}


def bowl(settings: list[Setting]) -> np.ndarray:
    """Its minimum lies at kp 0.2, ki 0.3, with a second, higher one at kp 5."""
    kp, ki = (np.array([float(s[name]) for s in settings]) for name in ("kp", "ki"))
    away = np.log10(kp / 0.2)
    return np.minimum(away**2, 0.5 + (np.log10(kp / 5.0)) ** 2) + (ki - 0.3) ** 2


def test_the_lowest_of_several_minima_is_found() -> None:
    found = minimize([KP, KI], bowl, START, 12, seed=0)
    assert float(found.setting["kp"]) == pytest.approx(0.2, rel=0.05)
    assert float(found.setting["ki"]) == pytest.approx(0.3, abs=0.03)
    assert found.cost == min(c for _, c in found.tried) < 0.002


def test_the_same_seed_gives_the_same_search_and_the_start_is_tried() -> None:
    one, again, other = (minimize([KP, KI], bowl, START, 3, seed) for seed in (1, 1, 2))
    assert one.tried == again.tried
    assert one.tried != other.tried
    assert one.tried[0][0] == START
    assert len(one.tried) <= 4 * GENERATION_SIZE


def test_generations_are_handed_over_whole() -> None:
    sizes: list[int] = []
    minimize([KP], lambda s: sizes.append(len(s)) or bowl([{**x, "ki": 0.3} for x in s]), START, 3, 0)  # type: ignore[func-returns-value]
    assert set(sizes) == {GENERATION_SIZE}


def test_without_ranges_all_gains_with_a_default_are_looked_for() -> None:
    found = {f.name: f for f in parse_free_parameters([], get("mahony"))}
    assert {"kp", "ki"} <= set(found)
    kp = float(get("mahony").parameter("kp").default)
    assert (found["kp"].low, found["kp"].high, found["kp"].log) == pytest.approx((kp / 20.0, kp * 20.0, True))
    assert "declination" not in found
    with pytest.raises(UsageError, match="no gains to tune"):
        parse_free_parameters([], get("gyro"))
    with pytest.raises(UsageError, match="ekf12 has 6 numbers"):
        parse_free_parameters([], get("ekf12"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("kp=1", "give a range"),
        ("kp=0.1,0.2", "give a range"),
        ("kp=0.1..1/5", "attlog sweep"),
        ("kp=2..1", "smaller value first"),
        ("kp=0..1log", "begins above 0"),
        ("kp=0.1deg..1", "1/s, not in deg"),
        ("kq=0.1..1", "no parameter kq"),
        ("mag_form=heading..vector", "give a range"),
        ("kp=0.1..1000", "from 0 to 100"),
    ],
)
def test_what_is_no_range_is_refused(text: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        parse_free_parameters([text], get("mahony"))


def test_values_have_three_digits_and_stay_in_the_range() -> None:
    assert KP.value(0.5) == pytest.approx(0.316)
    assert (KP.value(0.0), KP.value(1.0)) == (0.01, 10.0)
    assert KP.share(100.0) == 1.0
    assert KI.value(KI.share(0.25)) == 0.25


def test_without_scipy_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    with pytest.raises(UsageError, match="pip install scipy"):
        minimize([KP], bowl, START, 1, 0)
