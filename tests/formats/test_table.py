"""Lists of a log that are made when somebody asks: once, and as if they had been there from the start."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary

from attlog import formats
from attlog.core.errors import RAISE_VARIABLE, AttlogError
from attlog.core.limits import MAX_DAMAGE
from attlog.formats.dataflash import reader, tables
from attlog.formats.mavlink import reader as mavlink
from attlog.formats.table import PART_FAILED, DamageLog, Messages, ParamChange
from attlog.formats.ulog import content
from tests.conftest import SAMPLES, corpus_logs


def log(**given: object) -> Messages:
    return Messages(Path("made.bin"), "dataflash", 1, {}, **given)  # type: ignore[arg-type]


def test_a_function_is_asked_once_and_only_when_its_list_is_wanted() -> None:
    asked = []

    def make(of: Messages) -> list[ParamChange]:
        asked.append(of)
        return [ParamChange("A", 1.0)]

    made = log(params=make)
    assert not asked
    made.params.append(ParamChange("B", 2.0))
    assert ([p.name for p in made.params], [of is made for of in asked]) == (["A", "B"], [True])


def test_a_log_without_parameters_and_texts_has_none_of_either() -> None:
    """The default list was made of the log itself, which gives the names of its messages."""
    held = Messages(Path("made.tlog"), "tlog", 1, {("HEARTBEAT", 1): None})  # type: ignore[dict-item]
    assert held.params == [] == held.texts


def test_opening_a_log_reads_no_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    path = SAMPLES / "copter_yaw_turns.bin"
    monkeypatch.setattr(reader, "read_params", lambda *_: pytest.fail("parameters were read"))
    opened = formats.open(path)
    monkeypatch.setattr(reader, "read_params", tables.read_params)
    official = DFReader_binary(str(path))
    told = {p.name: p.value for p in reversed(formats.open(path).params) if not p.is_default}  # the first of each
    assert told == {name: np.float32(value) for name, value in official.params.items()}
    assert len(opened)


# What of a file cannot be used, counted.


def test_bytes_are_counted_once_and_a_kind_is_always_listed() -> None:
    losses = DamageLog()
    for k in range(MAX_DAMAGE + 5):
        losses.add(1000 + 10 * k, 3, "bytes", "next")
    losses.add_kind(500, 30, "definitions", "next")
    losses.add_kind(700, 40, "of the places above", "next", counted=True)
    assert (losses.places, losses.bytes) == (MAX_DAMAGE + 7, 3 * (MAX_DAMAGE + 5) + 30)
    assert len(losses.listed) == MAX_DAMAGE
    assert [d.offset for d in losses.listed[:3]] == [500, 700, 1000]


# A fault that nobody thought of costs one message type; the tests themselves see it raised.

LOG = SAMPLES / "px4_hover.ulg"


class Planted(Exception):
    """No exception that any code expects."""


def plant(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    """Decoding of the topic whose records have so many columns fails."""
    healthy = content.gather

    def gather(data: np.ndarray, at: np.ndarray, dtype: np.dtype) -> np.ndarray:
        if len(dtype.names or ()) == columns:
            raise Planted("boom")
        return healthy(data, at, dtype)

    monkeypatch.setattr(content, "gather", gather)


def test_a_fault_in_one_topic_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv(RAISE_VARIABLE, raising=False)
    caplog.set_level(logging.DEBUG, "attlog.formats")
    whole = formats.open(LOG)
    victim = whole["vehicle_attitude", 0]
    same = {key for key in whole if len(whole[key].fields) == len(victim.fields)}
    plant(monkeypatch, len(victim.fields))
    log = formats.open(LOG)
    for key, table in log.items():
        for column in list(table.fields):
            if key not in same:
                assert np.array_equal(np.array(table[column]).tobytes(), np.array(whole[key][column]).tobytes())
                continue
            with pytest.raises(KeyError, match="cannot be decoded"):
                table[column]
            assert column not in table
    assert {r.code for r in log.remarks} == {PART_FAILED}
    assert len(log.remarks) == len({name for name, _ in same}), "one remark for each message type"
    remark = next(r for r in log.remarks if r.text.startswith("vehicle_attitude "))
    assert "Planted in attlog.formats.ulog.content, line " in remark.text
    assert remark.offset == int(whole["vehicle_attitude", 0].offsets[0])
    assert "Planted: boom" in caplog.text, "the traceback is kept for those who look"


def test_a_fault_in_one_type_of_record_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RAISE_VARIABLE, raising=False)

    def broken(*_: object) -> float:
        raise Planted("boom")

    monkeypatch.setattr(content, "parameter_value", broken)
    log = formats.open(LOG)
    assert {r.text[:10] for r in log.remarks} == {"Records of"}
    monkeypatch.undo()
    whole = formats.open(LOG)
    assert (log.params, log.texts, list(log)) == ([], whole.texts, list(whole))


def test_under_test_the_fault_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, len(formats.open(LOG)["vehicle_attitude", 0].fields))
    with pytest.raises(Planted):
        formats.open(LOG)["vehicle_attitude", 0]["q"]


@pytest.mark.parametrize("path", corpus_logs(), ids=lambda p: p.name)
def test_no_log_in_hand_needs_the_barrier(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RAISE_VARIABLE, raising=False)
    try:
        log = formats.open(path)
    except AttlogError:  # refused with a reason
        return
    for table in log.values():
        for column in list(table.fields)[:3]:
            table[column]
    assert [r.text for r in log.remarks] == []


# In every format a fault that nobody thought of costs one message; the others read as they would without it.

CASES = [
    (SAMPLES / "copter_steps_stabilize.bin", tables, "gather", "ATT", lambda args: len(args[2].names or ())),
    (SAMPLES / "copter_steps_stabilize.tlog", mavlink, "read_payloads", "ATTITUDE", lambda args: len(args[2].names)),
]


@pytest.mark.parametrize(("path", "module", "function", "victim", "columns"), CASES, ids=[c[0].name for c in CASES])
def test_a_fault_in_one_message_leaves_the_others(
    path: Path,
    module: ModuleType,
    function: str,
    victim: str,
    columns: Callable[[Any], int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(RAISE_VARIABLE, raising=False)
    whole = formats.open(path)
    added = {"_t_us"}  # a reader's own column, decoded apart
    count = len(set(whole.first(victim).fields) - added)
    same = {key for key, table in whole.items() if len(set(table.fields) - added) == count}
    healthy = getattr(module, function)

    def fails(*args: Any) -> Any:
        if columns(args) == count:
            raise ZeroDivisionError("planted")
        return healthy(*args)

    monkeypatch.setattr(module, function, fails)
    log = formats.open(path)
    assert set(log) == set(whole)
    for key, table in log.items():
        for column in [c for c in list(table.fields) if c not in added]:
            if key in same:
                with pytest.raises(KeyError, match="cannot be decoded"):
                    table[column]
            else:
                assert np.array(table[column]).tobytes() == np.array(whole[key][column]).tobytes()
    assert {r.code for r in log.remarks} == {PART_FAILED}
    assert any(r.text.startswith(f"{victim} ") and "ZeroDivisionError" in r.text for r in log.remarks)
