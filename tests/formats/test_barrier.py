"""A fault that nobody thought of costs one message type; the tests themselves see it raised."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from attlog import flight, formats
from attlog.base.barrier import RAISE
from attlog.base.errors import AttlogError
from attlog.formats.barrier import CODE
from attlog.formats.ulog import content, topic
from tests.conftest import SAMPLES, corpus_logs

LOG = SAMPLES / "px4_hover.ulg"


class Planted(Exception):
    """No exception that any code expects."""


def plant(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    """Decoding of the topic whose records have so many columns fails."""
    healthy = topic.gather

    def gather(data: np.ndarray, at: np.ndarray, dtype: np.dtype) -> np.ndarray:
        if len(dtype.names or ()) == columns:
            raise Planted("boom")
        return healthy(data, at, dtype)

    monkeypatch.setattr(topic, "gather", gather)


def test_a_fault_in_one_topic_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv(RAISE, raising=False)
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
    assert {r.code for r in log.remarks} == {CODE}
    assert len(log.remarks) == len({name for name, _ in same}), "one remark for each message type"
    remark = next(r for r in log.remarks if r.text.startswith("vehicle_attitude "))
    assert "Planted in attlog.formats.ulog.topic, line " in remark.text
    assert remark.offset == int(whole["vehicle_attitude", 0].offsets[0])
    assert "Planted: boom" in caplog.text, "the traceback is kept for those who look"


def test_the_flight_goes_on_without_the_topic(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RAISE, raising=False)
    plant(monkeypatch, len(formats.open(LOG)["vehicle_attitude", 0].fields))
    log = flight.read(LOG)
    assert "vehicle_attitude" not in log.attitudes
    assert log.imus
    assert [p for p in log.problems if p.code == CODE and p.text.startswith("vehicle_attitude ")]


def test_a_fault_in_one_type_of_record_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RAISE, raising=False)

    def broken(*_: object) -> float:
        raise Planted("boom")

    monkeypatch.setattr(content, "parameter_value", broken)
    monkeypatch.setattr(content, "ParamChange", broken)
    log = formats.open(LOG)
    assert {r.text[:10] for r in log.remarks} == {"Parameters", "Records of"}
    monkeypatch.undo()
    whole = formats.open(LOG)
    assert (log.params, log.texts, list(log)) == ([], whole.texts, list(whole))


def test_under_test_the_fault_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, len(formats.open(LOG)["vehicle_attitude", 0].fields))
    with pytest.raises(Planted):
        formats.open(LOG)["vehicle_attitude", 0]["q"]


@pytest.mark.parametrize("path", corpus_logs(), ids=lambda p: p.name)
def test_no_log_in_hand_needs_the_barrier(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RAISE, raising=False)
    try:
        log = formats.open(path)
    except AttlogError:  # refused with a reason
        return
    for table in log.values():
        for column in list(table.fields)[:3]:
            table[column]
    assert [r.text for r in log.remarks] == []
