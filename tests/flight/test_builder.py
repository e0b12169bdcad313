"""Times of measurement: which of them a log's column is believed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.flight.builder import LogBuilder


@pytest.mark.parametrize(("age_us", "believed"), [(3_000, True), (999_999, True), (1_000_000, False), (-1, False)])
def test_a_sample_lies_at_most_a_second_before_its_stamp(age_us: int, believed: bool) -> None:
    """Single ones that cannot be true get the usual age; a column that is mostly wrong is none."""
    nothing: Any = None
    builder, stamps = LogBuilder(nothing, t0_us=5_000_000), 10_000_000 + 20_000 * np.arange(40)
    found = builder.sample_times(stamps, stamps - age_us)
    assert (found is not None) is believed
    one = stamps - 4_000
    one[7] = stamps[7] - age_us
    if not believed:
        mended = builder.sample_times(stamps, one)
        assert mended is not None
        assert mended[7] == pytest.approx(1e-6 * (stamps[7] - 4_000 - 5_000_000), abs=1e-9)
