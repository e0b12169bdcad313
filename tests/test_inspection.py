"""What ``attlog info`` tells costs one reading of the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from attlog import formats, inspection
from attlog.reference import delay


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
