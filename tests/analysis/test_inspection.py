"""What ``attlog info`` tells costs one reading of the file."""

from __future__ import annotations

import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import formats
from attlog.analysis import inspection
from attlog.flight import builder
from attlog.formats import Messages
from attlog.reference.physics import delay


def test_the_file_is_read_once_and_the_delay_measured_once(samples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened, measured = [], []
    read, by_rates = formats.open, delay.by_rates

    def opening(*given: Any) -> Any:
        opened.append(given)
        return read(*given)

    def measuring(*given: Any) -> Any:
        measured.append(given)
        return by_rates(*given)

    monkeypatch.setattr(formats, "open", opening)
    monkeypatch.setattr(delay, "by_rates", measuring)
    report = inspection.inspect(samples / "px4_hover.ulg")
    assert report["messages"]
    assert any(check["name"] == "delay" for check in report["audit"])
    assert (len(opened), len(measured)) == (1, 1)


@pytest.mark.parametrize("name", ["px4_hover.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog"])
def test_columns_can_be_had_again_once_they_were_let_go(samples: Path, name: str) -> None:
    log, fresh = formats.open(samples / name), formats.open(samples / name)
    for key, table in log.items():
        first = {column: table[column].copy() for column in table.fields}
        table.forget()
        assert all(np.array_equal(table[column], x, equal_nan=x.dtype.kind == "f") for column, x in first.items())
        assert np.array_equal(table.offsets, fresh[key].offsets)


def test_rates_are_told_without_keeping_a_column(samples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[formats.Messages] = []
    read = formats.open

    def opening(*given: Any) -> formats.Messages:
        kept.append(read(*given))
        return kept[-1]

    monkeypatch.setattr(formats, "open", opening)
    report = inspection.inspect(samples / "px4_hover.ulg")
    assert not any(table._columns for table in kept[0].values())
    table, told = kept[0]["sensor_combined", 0], next(m for m in report["messages"] if m["name"] == "sensor_combined")
    t = table["timestamp"].astype(float)
    assert told["rate_hz"] == pytest.approx((len(t) - 1) / (t[-1] - t[0]) * 1e6, rel=1e-12)


@pytest.mark.parametrize("name", ["px4_hover.ulg", "copter_yaw_turns.bin"])
def test_a_large_log_read_with_copies_let_go_is_the_same_flight(
    samples: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = inspection.inspect(samples / name)
    monkeypatch.setattr(builder, "READ_BYTES", 0)
    assert inspection.inspect(samples / name) == whole


def test_a_logs_bytes_are_let_go_of_before_the_flight_is_looked_at(
    samples: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[weakref.ref[Messages]] = []
    alive: list[bool] = []
    open_log, judge = formats.open, inspection.audit

    def opening(*given: Any) -> Messages:
        messages = open_log(*given)
        opened.append(weakref.ref(messages))
        return messages

    def judging(*given: Any) -> Any:
        alive.append(opened[0]() is not None)
        return judge(*given)

    monkeypatch.setattr(formats, "open", opening)
    monkeypatch.setattr(inspection, "audit", judging)
    found = inspection.inspect(samples / "copter_yaw_turns.bin")
    assert found["messages"]
    assert alive == [False]
