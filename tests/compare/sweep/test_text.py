"""What is said of a setting beside the best."""

from __future__ import annotations

import pytest

from attlog.compare.sweep.sweep import SettingDifference
from attlog.compare.sweep.text import difference_text


@pytest.mark.parametrize(
    ("scale", "value", "ci95", "worse", "ends"),
    [
        ("ratio", 1.27, (1.15, 1.41), True, "worse"),
        ("ratio", 1.27, (1.02, 1.6), False, "not significant among so many"),
        ("ratio", 1.27, (0.95, 1.7), False, "not significant"),
        ("ratio", 1.27, None, False, "not significant"),
        ("difference", 0.4, (0.1, 0.7), False, "not significant among so many"),
        ("difference", 0.4, (-0.1, 0.9), False, "not significant"),
    ],
)
def test_an_interval_alone_is_told_apart_from_one_that_holds_among_all_settings(
    scale: str, value: float, ci95: tuple[float, float] | None, worse: bool, ends: str
) -> None:
    """A ratio is significant beyond 1, a difference beyond 0."""
    assert difference_text(SettingDifference(scale, value, ci95, worse), "ms").endswith(f", {ends}")


def test_a_setting_without_value_says_why_and_equal_ones_that_they_are_equal() -> None:
    assert difference_text(SettingDifference("ratio", None, None, False, "too few steps"), "ms") == "too few steps"
    assert difference_text(SettingDifference("ratio", None, None, False), "ms") == "no value"
    assert difference_text(SettingDifference("ratio", 1.0, (1.0, 1.0), False), "ms") == "equal to it"
