"""Scales of the dots: what is far off does not press the others together, and zero is on a scale with signs."""

from __future__ import annotations

import pytest

from attlog.report.first_screen.scale import log_scale, zero_scale


def test_decades_are_equally_wide_on_a_scale_of_sizes() -> None:
    scale = log_scale([0.01, 0.1, 1.0], [])
    assert scale.place(0.1) - scale.place(0.01) == pytest.approx(scale.place(1.0) - scale.place(0.1))
    assert scale.place(0.1) == pytest.approx(50.0)
    assert scale.ticks == pytest.approx([0.01, 0.1, 1.0])


def test_an_interval_down_to_zero_does_not_stretch_a_scale_of_sizes() -> None:
    scale = log_scale([0.5, 1.0], [(0.0, 0.9), (1e-9, 1.2)])
    assert scale.low == pytest.approx(0.1)
    assert scale.place(0.0) == pytest.approx(3.0)
    assert scale.place(1e-9) == 0.5


def test_a_value_far_off_stands_at_the_edge() -> None:
    scale = zero_scale([1.0, 2.0, -1.5, 900.0], [], "deg/min")
    assert not scale.holds(900.0)
    assert scale.place(900.0) == 99.5
    assert scale.high == 2.0


def test_half_a_millisecond_does_not_fill_a_column() -> None:
    scale = zero_scale([0.2, -0.3], [(-0.5, 0.5)], "ms")
    assert scale.high - scale.low == pytest.approx(10.0)
    assert scale.holds(0.0)


def test_a_single_value_has_a_scale() -> None:
    assert log_scale([0.46], []).holds(0.46)
    assert len(log_scale([0.46], []).ticks) >= 1
    assert zero_scale([3.0], [], "deg/min").holds(0.0)


def test_a_wide_interval_of_a_value_nearby_is_shown_whole() -> None:
    scale = zero_scale([1.0, 7.4, -1.0], [(-4.0, 5.0), (-12.7, 27.4), (-5.0, 3.0)], "deg/min")
    assert scale.holds(27.4)
    assert scale.holds(-12.7)
