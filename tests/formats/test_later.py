"""Lists of a log that are made when somebody asks: once, and as if they had been there from the start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary

from attlog import formats
from attlog.formats.base import Messages, ParamChange
from attlog.formats.dataflash import content, reader
from attlog.formats.mapping import texts_of
from tests.conftest import SAMPLES


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


def test_lists_are_each_logs_own() -> None:
    log().params.append(ParamChange("A", 1.0))
    assert log().params == [] == log().texts


def test_a_log_without_parameters_and_texts_has_none_of_either() -> None:
    """The default list was made of the log itself, which gives the names of its messages."""
    held = Messages(Path("made.tlog"), "tlog", 1, {("HEARTBEAT", 1): None})  # type: ignore[dict-item]
    assert held.params == [] == held.texts


def test_opening_a_log_reads_no_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    path = SAMPLES / "copter_yaw_turns.bin"
    monkeypatch.setattr(reader, "params", lambda *_: pytest.fail("parameters were read"))
    opened = formats.open(path)
    monkeypatch.setattr(reader, "params", content.params)
    official = DFReader_binary(str(path))
    told = {p.name: p.value for p in reversed(formats.open(path).params) if not p.is_default}  # the first of each
    assert told == {name: np.float32(value) for name, value in official.params.items()}
    assert len(opened)


def test_texts_that_are_not_plain_are_spelled_one_by_one() -> None:
    listed = [b"plain", b"two\nlines", "gr\u00fc\u00df".encode(), b"gr\xfc\xdf", b"cut\0rest", b""]
    assert texts_of(np.array(listed)) == ["plain", "two\nlines", "gr\u00fc\u00df", "gr\u00fc\u00df", "cut", ""]
    assert texts_of(np.array([b"a", b"b\n"])) == ["a", "b\n"]
    assert texts_of(np.array([], "S4")) == []
