"""The samples of a track around each movement."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.steps.events import Event
from attlog.metrics.steps.turning import Turning, around

T = np.arange(0.0, 20.0, 0.01)


def track(segment: np.ndarray | None = None) -> Turning:
    return Turning(
        T, np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1)), np.zeros(len(T), np.int64) if segment is None else segment
    )


def event(onset: float) -> Event:
    return Event(0, onset, onset + 0.2, onset + 0.3, 20.0, onset - 0.5, onset + 1.5)


@pytest.mark.parametrize("margin", [0.0, 0.25])
def test_the_samples_of_the_window_and_of_the_margin_on_both_sides_are_taken(margin: float) -> None:
    (part,) = around(track(), [event(8.005)], margin)
    assert part is not None
    inside = (T >= 8.005 - 0.5 - margin) & (T < 8.005 + 1.5 + margin)
    np.testing.assert_array_equal(np.flatnonzero(inside), np.arange(part.start, part.stop))


@pytest.mark.parametrize(("cut", "reaches"), [(7.85, True), (7.95, False), (8.55, False), (8.65, True)])
def test_a_movement_needs_a_tenth_of_a_second_before_and_three_after_in_one_segment(cut: float, reaches: bool) -> None:
    found = around(track((cut <= T).astype(np.int64)), [event(8.005)], 0.25)
    assert (found[0] is not None) is reaches
