"""Lists, ranges and switches of parameters, and everything that can be wrong with them."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.base.errors import UsageError
from attlog.base.limits import MAX_SETS
from attlog.compare.sweep.grid import GridAxis, grid, search_request, spaced, text_of
from attlog.estimators import get

MAHONY = get("mahony")


def test_lists_ranges_and_switches_become_all_combinations() -> None:
    made = grid(["kp=0.6,1.1,2", "ki=0..0.05/6", "mag_form=heading,vector"], MAHONY)
    assert (made.shape, len(made)) == ((3, 6, 2), 36)
    assert made.axes[1] == GridAxis("ki", "1/s^2", (0.0, 0.01, 0.02, 0.03, 0.04, 0.05), "linear")
    settings = list(made)
    assert settings[0] == {"kp": 0.6, "ki": 0.0, "mag_form": "heading"}
    assert settings[-1] == {"kp": 2.0, "ki": 0.05, "mag_form": "vector"}
    assert len({text_of(s) for s in settings}) == 36


def test_a_log_range_has_equal_factors_and_both_ends() -> None:
    found = grid(["ki=1e-4..0.1/4log"], MAHONY).axes[0]
    assert found.values == (1e-4, 1e-3, 1e-2, 0.1)
    assert found.spacing == "log"
    assert spaced(0.5, 2.0, 3, True) == [0.5, 1.0, 2.0]
    assert spaced(0.0, 1.0, 2, False) == [0.0, 1.0]
    assert spaced(1.0, 10.0, 4, True) == [1.0, 2.154, 4.642, 10.0]  # the cube root of 10, to four digits


def test_a_value_may_carry_its_unit_and_comes_once() -> None:
    assert grid(["declination=3deg,3,-2 deg"], MAHONY).axes[0].values == (3.0, -2.0)


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
        grid([text], MAHONY)


def test_everything_wrong_is_told_at_once() -> None:
    with pytest.raises(UsageError) as refused:
        grid(["kp=x", "kj=1", "ki=1", "ki=2"], MAHONY)
    assert len(str(refused.value).split("\n")) == 3


def test_a_grid_that_nobody_can_look_at_is_refused_in_a_sentence() -> None:
    with pytest.raises(UsageError, match=rf"10,000 settings; up to {MAX_SETS:,} .* attlog tune"):
        grid(["kp=0..2/100", "ki=0..1/100"], MAHONY)
    with pytest.raises(UsageError, match="nothing to sweep; give values such as kp="):
        grid([], MAHONY)


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
