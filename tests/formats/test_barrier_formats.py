"""In every format a fault that nobody thought of costs one message; the others read as they would without it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from attlog import formats
from attlog.base.barrier import RAISE
from attlog.formats.barrier import CODE
from attlog.formats.dataflash import tables, text
from attlog.formats.mavlink import reader as mavlink
from tests.conftest import SAMPLES, corpus_logs

TEXT = [p for p in corpus_logs(".log") if "3.1.1" in p.name]
SDLOG2 = [p for p in corpus_logs(".px4log") if "2013" in p.name]
CASES = [
    (SAMPLES / "copter_steps_stabilize.bin", tables, "gather", "ATT", lambda args: len(args[2].names or ())),
    (SAMPLES / "copter_steps_stabilize.tlog", mavlink, "payloads", "ATTITUDE", lambda args: len(args[2].names)),
    *((p, tables, "gather", "ATT", lambda args: len(args[2].names or ())) for p in SDLOG2),
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
    monkeypatch.delenv(RAISE, raising=False)
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
    assert {r.code for r in log.remarks} == {CODE}
    assert any(r.text.startswith(f"{victim} ") and "ZeroDivisionError" in r.text for r in log.remarks)


@pytest.mark.parametrize("path", TEXT, ids=lambda p: p.name)
def test_a_fault_in_one_kind_of_text_line_leaves_the_others(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(RAISE, raising=False)
    whole = formats.open(path)
    healthy = text._fields

    def fails(fmt: Any) -> Any:
        if fmt.name == "ATT":
            raise ZeroDivisionError("planted")
        return healthy(fmt)

    monkeypatch.setattr(text, "_fields", fails)
    log = formats.open(path)
    assert set(whole) - set(log) == {("ATT", 0)}
    assert [(r.code, r.text[:4]) for r in log.remarks] == [(CODE, "ATT ")]
