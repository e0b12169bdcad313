"""Samples of a log's signals for the page: which, how many, and what survives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import attlog
from attlog import formats
from attlog.flight.model import FlightLog
from attlog.formats.recording import MessageLayout, Recording
from attlog.pipeline import signal_traces
from attlog.pipeline.signal_traces import samples_each

N = 5000
T_US = (1_000_000 + 20_000 * np.arange(N)).astype(np.uint64)


def flight(folder: Path) -> FlightLog:
    """A log with a spike of one sample in the battery's voltage, and messages few people look at."""
    rates = {f"Gyr{axis}": np.full(N, 0.01, np.float32) for axis in "XYZ"}
    force = {f"Acc{axis}": np.full(N, -9.8 * (axis == "Z"), np.float32) for axis in "XYZ"}
    volt = np.full(N, 15.0, np.float32) + np.sin(0.01 * np.arange(N)).astype(np.float32)
    volt[1234] = 3.25
    tables = {
        ("IMU", 0): {"TimeUS": T_US} | rates | force,
        ("BAT", 0): {"TimeUS": T_US, "Volt": volt, "Bad": np.full(N, np.nan, np.float32)},
        ("XYZ", 0): {"TimeUS": T_US[:10], "A": np.arange(10.0)},
    }
    layouts = {"BAT": MessageLayout("Qff", "sv-", "F0-")}
    formats.write(folder / "made.bin", Recording(tables, layouts=layouts))
    return attlog.read(folder / "made.bin")


def test_a_spike_of_one_sample_keeps_its_height_and_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signal_traces, "MAX_SAMPLES", 500 * 7)
    log = flight(tmp_path)
    found = {trace.key: trace for trace in signal_traces.signal_traces(log, "standard")}
    battery = found["BAT"]
    assert set(battery.columns) == {"Volt"}, "a field without any number is no signal"
    assert (battery.units, battery.values) == ({"Volt": "V"}, {"records": N})
    assert 200 < len(battery.t) <= 500
    assert battery.ratio == pytest.approx(N / len(battery.t))
    at = int(np.argmin(battery.columns["Volt"]))
    assert battery.columns["Volt"][at] == 3.25
    assert battery.t[at] == pytest.approx((int(T_US[1234]) - log.t0_us) * 1e-6, abs=2 * 0.02 * battery.ratio)


@pytest.mark.parametrize(
    ("selection", "drawn", "named"),
    [("none", set(), set()), ("standard", {"IMU", "BAT"}, {"XYZ"}), ("all", {"IMU", "BAT", "XYZ"}, set())],
)
def test_the_selection_decides_which_messages_have_samples(
    selection: signal_traces.Selection, drawn: set[str], named: set[str], tmp_path: Path
) -> None:
    found = signal_traces.signal_traces(flight(tmp_path), selection)
    assert {trace.key for trace in found if len(trace.t)} == drawn
    assert {trace.key for trace in found if not len(trace.t)} == named


def test_a_result_has_signals_for_its_page_alone(tmp_path: Path) -> None:
    flight(tmp_path)
    options = {"estimators": ["gyro"], "reference": "none"}
    result = attlog.analyze(tmp_path / "made.bin", options)
    assert {trace.key for trace in result.traces if trace.figure == "signal"} == {"IMU", "BAT", "XYZ"}
    assert "signal" not in result.to_json(deterministic=True).replace('"signals":"standard"', "")
    assert not [
        t for t in attlog.analyze(tmp_path / "made.bin", options | {"signals": "none"}).traces if t.figure == "signal"
    ]


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # shared machines are slow now and then
@given(st.lists(st.integers(0, 10_000), min_size=1, max_size=30), st.integers(30, 50_000))
def test_the_largest_share_within_the_budget_is_taken(counts: list[int], total: int) -> None:
    keep = samples_each(counts, total)
    assert sum(min(n, keep) for n in counts) <= total
    more = sum(min(n, keep + 1) for n in counts)
    assert more > total or more == sum(counts)
