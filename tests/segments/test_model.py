"""Windows are names or times, and a wrong one says what is allowed."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.segments.model import Segment, Segments

FOUND = Segments(
    [
        Segment("continuous", 0.0, 100.0),
        Segment("rest.short", 50.0, 55.0),
        Segment("rest.long", 0.0, 20.0),
        Segment("idle", 20.0, 25.0),
        Segment("airborne", 25.0, 50.0),
    ]
)


@pytest.mark.parametrize(
    ("window", "expected"),
    [
        ("all", [(0.0, 100.0)]),
        ("rest", [(0.0, 20.0), (50.0, 55.0)]),
        ("rest.long", [(0.0, 20.0)]),
        ("idle", [(20.0, 25.0)]),
        ("hover", []),
        ("30:40.5", [(30.0, 40.5)]),
        ("-5:3", [(-5.0, 3.0)]),
    ],
)
def test_a_window_is_a_name_or_a_pair_of_times(window, expected):
    assert FOUND.spans(window) == expected


@pytest.mark.parametrize("window", ["resting", "5", "9:3", "a:b", "", ":", "3:3", "nan:4"])
def test_a_wrong_window_is_refused_with_what_is_allowed(window):
    with pytest.raises(ValueError, match="use all, rest, "):
        FOUND.spans(window)


def test_the_mask_of_a_window_holds_its_ends():
    t = np.array([-1.0, 0.0, 20.0, 20.1, 49.9, 50.0, 55.0, np.nan])
    np.testing.assert_array_equal(FOUND.mask(t, "rest"), [False, True, True, False, False, True, True, False])
    assert not FOUND.mask(t, "hover").any()
