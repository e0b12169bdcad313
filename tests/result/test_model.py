"""What a result says of itself: why nothing ran, its windows and rows, and a text of ten lines."""

from __future__ import annotations

import pytest

from attlog.core.errors import UsageError
from attlog.result import Check, Event, Finding, Result, model
from tests.words.made import row, tilt


@pytest.mark.parametrize(
    ("states", "said"),
    [
        ((("replay", "failed"), ("replay", "failed")), "f0: why 0"),
        ((("onboard", "ok"), ("replay", "failed")), "f1: why 1"),
        ((("onboard", "failed"), ("replay", "ok")), ""),
        ((("replay", "failed"), ("replay", "diverged")), ""),
        ((("onboard", "failed"),), ""),
        ((), ""),
    ],
)
def test_nothing_ran_where_every_filter_failed(states: tuple[tuple[str, str], ...], said: str) -> None:
    rows = []
    for k, (kind, status) in enumerate(states):
        one = row(f"f{k}", {})
        one.kind, one.status, one.reason = kind, status, f"why {k}"
        rows.append(one)
    assert model.nothing_ran(rows) == said


def made() -> Result:
    rows = [row("mahony", tilt(1.0) | tilt(2.0, window="all")), row("gyro", tilt(3.0))]
    return Result({"version": "1"}, "", {}, {"name": "a.ulg"}, estimators=rows)


def test_an_unknown_window_or_row_is_an_error_that_lists_the_known_ones() -> None:
    result = made()
    assert result.windows == ["airborne", "all"]
    assert result.table("all")["tilt_rmse_deg"].to_dict()["mahony"] == 2.0
    assert result.row("gyro") is result.estimators[1]
    with pytest.raises(UsageError, match="no window 'airbone'; this result has airborne, all; did you mean airborne"):
        result.table("airbone")
    with pytest.raises(UsageError, match="no row 'madgwick'; this result has mahony, gyro"):
        result.row("madgwick")
    with pytest.raises(UsageError, match="no attitudes"):
        result.attitudes()


def test_a_result_is_printed_in_ten_lines() -> None:
    result = made()
    result.headline = "Flew. " * 500
    result.estimators *= 500
    assert len(repr(result).splitlines()) <= 10
    assert len(result._repr_html_()) < 5000
    assert "a.ulg" in repr(result)


def test_checks_findings_and_events_are_printed_in_ten_lines() -> None:
    long = "The compass is off. " * 100
    for one in (
        Check("compass_offset", "warning", long, evidence=[long] * 50),
        Finding("compass", "warning", long, evidence=[long] * 50),
        Event("crash", 1.0, "serious", long, evidence=[long] * 50),
    ):
        lines = repr(one).splitlines()
        assert len(lines) <= 10
        assert max(map(len, lines)) <= 110
