"""Samples at the end of a sensor's range: which counts of which firmware mean what they say."""

from __future__ import annotations

import numpy as np
import pytest

import attlog
from attlog.flight.model import FlightLog


def counted(log: FlightLog, sensor: str = "accelerometer") -> dict[int | None, int]:
    """New clipped samples by unit."""
    return {c.unit: int(c.new.sum()) for c in log.clippings if c.sensor == sensor}


def codes(log: FlightLog) -> set[str]:
    """Codes of the log's problems."""
    return {p.code for p in log.problems}


def test_px4_counts_every_unit_and_flags_the_selected_one(corpus):
    """Read by hand: about 400 flagged samples from 37.2 s on; the unit that was not selected counts 1,804."""
    log = attlog.read(corpus / "logs" / "cases" / "px4_1.14_clipping_crash.ulg")
    assert counted(log) == {0: 0, 1: 42 + 158 + 1604, None: 397}
    flags = next(c for c in log.clippings if not c.whole)
    assert flags.t[np.argmax(flags.new > 0)] == pytest.approx(37.2, abs=0.1)


@pytest.mark.parametrize("name", ["px4_1.14_clipping_crash", "px4_1.14_clipping_field", "px4_1.14_hard_landing"])
def test_unset_memory_in_px4_1_14_is_no_gyro_at_the_end_of_its_range(corpus, name):
    """``sensor_combined.gyro_clipping`` holds 90, 115, 243 there, at 34 deg/s."""
    log = attlog.read(corpus / "logs" / "cases" / f"{name}.ulg")
    assert set(counted(log, "gyro").values()) == {0}
    assert "gyro_clipped" not in codes(log)


def test_a_px4_counter_that_does_not_begin_at_zero_counts_its_growth(corpus):
    """It stands at 4 and 44 from the first record to the last."""
    log = attlog.read(corpus / "logs" / "ulg_px4_1.15_fmuv6c_quad_nogps_cut.ulg")
    assert counted(log)[1] == 0


@pytest.mark.parametrize(
    ("name", "clips"),
    [
        ("cases/copter_flip_at_takeoff.bin", {0: 196, 1: 50, 2: 181}),
        ("bin_copter_3.4.4_mechfail_cut.bin", {0: 28, 1: 30}),
    ],
)
def test_ardupilot_counts_by_unit_in_one_record_or_in_one_for_each(corpus, name, clips):
    assert counted(attlog.read(corpus / "logs" / name)) == clips


def test_ardupilot_before_3_4_tells_nothing(corpus):
    assert attlog.read(corpus / "logs" / "cases" / "copter_3.3dev_118.BIN").clippings == []
