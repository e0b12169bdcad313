"""What ``attlog info`` tells costs one reading of the file."""

from __future__ import annotations

import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import formats
from attlog.flight import builder
from attlog.flight.model import TimeLine
from attlog.formats import Messages
from attlog.pipeline import evaluation, inspection, summary
from attlog.reference import alignment
from tests.reference.flights import flight


def test_the_file_is_read_once_and_the_delay_measured_once(samples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened, measured = [], []
    read, by_rates = formats.open, alignment.fit_gyro_delay

    def opening(*given: Any) -> Any:
        opened.append(given)
        return read(*given)

    def measuring(*given: Any) -> Any:
        measured.append(given)
        return by_rates(*given)

    monkeypatch.setattr(formats, "open", opening)
    monkeypatch.setattr(alignment, "fit_gyro_delay", measuring)
    report = inspection.inspect(samples / "px4_hover.ulg")
    assert report["messages"]
    assert any(check["question"] == "filter_delay" for check in report["checks"])
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
    monkeypatch.setattr(builder, "RELEASED_BYTES", 0)
    assert inspection.inspect(samples / name) == whole


def test_a_logs_bytes_are_let_go_of_before_the_flight_is_looked_at(
    samples: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[weakref.ref[Messages]] = []
    alive: list[bool] = []
    open_log, judge = formats.open, evaluation.run_checks

    def opening(*given: Any) -> Messages:
        messages = open_log(*given)
        opened.append(weakref.ref(messages))
        return messages

    def judging(*given: Any) -> Any:
        alive.append(opened[0]() is not None)
        return judge(*given)

    monkeypatch.setattr(formats, "open", opening)
    monkeypatch.setattr(evaluation, "run_checks", judging)
    found = inspection.inspect(samples / "copter_yaw_turns.bin")
    assert found["messages"]
    assert alive == [False]


# A log in a few lines.


def test_a_parameter_that_was_set_in_flight_is_told_with_its_last_value_where_that_is_not_the_default() -> None:
    log = flight()
    values = {"SET": [1.0, 3.0], "BACK": [3.0, 1.0], "SAME": [1.0], "OTHER": [2.0]}
    log.parameters.lines = {name: TimeLine(np.arange(len(v), dtype=float), v, "PARM") for name, v in values.items()}
    log.parameters.defaults = dict.fromkeys(("SET", "BACK", "SAME"), 1.0)
    assert summary._changed(log) == {"SET": [3.0, 1.0]}


def test_parameters_are_listed_that_differ_from_their_default_or_all_where_the_log_tells_none() -> None:
    log = flight()
    values = {"OWN": [2.0], "SAME": [1.0], "UNTOLD": [5.0], "FILE": [6.0]}
    log.parameters.lines = {name: TimeLine(np.arange(len(v), dtype=float), v, "PARM") for name, v in values.items()}
    assert list(summary._params(log)) == ["FILE", "OWN", "SAME", "UNTOLD"]
    log.parameters.defaults = dict.fromkeys(("OWN", "SAME"), 1.0)
    log.parameters.filled = frozenset({"FILE"})  # no default of the log's is that of the file
    assert summary._params(log) == {"FILE": 6.0, "OWN": 2.0}
