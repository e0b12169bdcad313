"""Masks of a gyro at the end of its range count from 1.15 on, where values are masks and something else agrees."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.flight.builder import LogBuilder
from attlog.flight.model import Problem
from attlog.flight.px4 import clipping
from tests.flight.fake import messages, micros

N = 20
FAST, SLOW = np.radians(1601.0), np.radians(1599.0)


def told(mask: Any, rate: float, release: Any = 0x010F0000, counter: int = 0) -> list[Problem]:
    """Problems by a mask (n,), the fastest rate about z, the version, and how far the unit's counter moved."""
    combined = {"timestamp": micros(N, 10.0), "gyro_clipping": np.asarray(mask, np.uint8)}
    status = {"timestamp": micros(N, 10.0), "gyro_clipping": np.where(np.arange(N) < 9, 4, 4 + counter)}
    info = {} if release is None else {"ver_sw_release": release}
    tables = {("sensor_combined", 0): combined, ("vehicle_imu_status", 0): status}
    builder = LogBuilder(messages("ulog", tables, info=info))
    rates = np.zeros((N, 3))
    rates[5, 2] = -rate
    table = builder.messages.tables["sensor_combined", 0]
    return clipping.gyro_mask_problem(builder, "sensor_combined", table, "gyro_clipping", rates)


SOME = np.where(np.arange(N) % 7 == 3, 4, 0)


@pytest.mark.parametrize(
    ("mask", "rate", "release", "counter", "count"),
    [
        (SOME, FAST, 0x010F0000, 0, 3),
        (SOME, SLOW, 0x010F0000, 0, None),
        (SOME, SLOW, 0x010F0000, 1, 3),
        (SOME, FAST, 0x010EFFFF, 0, None),
        (SOME, FAST, 0x01100000, 0, 3),
        (SOME, FAST, None, 5, None),
        (SOME, FAST, "v1.15", 5, None),
        (np.where(SOME > 0, 7, 0), FAST, 0x010F0000, 0, 3),
        (np.where(SOME > 0, 8, 0), FAST, 0x010F0000, 5, None),
        (0 * SOME, FAST, 0x010F0000, 5, None),
    ],
)
def test_a_mask_counts_where_version_values_and_rate_or_counter_agree(
    mask: Any, rate: float, release: Any, counter: int, count: int | None
) -> None:
    found = told(mask, rate, release, counter)
    assert [p.count for p in found] == ([] if count is None else [count])
    if found:
        assert (found[0].code, f"in {count} samples (gyro_clipping)" in found[0].text) == ("gyro_clipped", True)


def test_counters_count_their_growth_over_all_axes_and_masks_their_samples() -> None:
    axes = np.zeros((N, 3), np.int64)
    axes[:, 0], axes[8:, 1], axes[12:, 2] = 7, 2, 300
    tables = {
        ("vehicle_imu_status", 1): {"timestamp": micros(N, 10.0), "accel_clipping": axes},
        ("sensor_combined", 0): {"timestamp": micros(N, 10.0), "accelerometer_clipping": SOME.astype(np.uint8)},
    }
    builder = LogBuilder(messages("ulog", tables))
    builder.t0_us = 10_000_000
    unit, mask = clipping.clippings(builder)
    assert (unit.sensor, unit.unit, unit.whole, unit.source) == (
        "accelerometer",
        1,
        True,
        "vehicle_imu_status:1.accel_clipping",
    )
    assert {int(k): int(unit.new[k]) for k in np.flatnonzero(unit.new)} == {8: 2, 12: 300}
    assert unit.t[8] == pytest.approx(0.8)
    assert (mask.unit, mask.whole, mask.source) == (None, False, "sensor_combined.accelerometer_clipping")
    assert mask.new.tolist() == (SOME > 0).astype(int).tolist()
