"""How far many logs are, on a terminal only."""

from __future__ import annotations

import io
import re
import sys
import time
from pathlib import Path

import pytest

from attlog import Config
from attlog.cli.shared.bar import Bar, speed
from attlog.fleet.records.record import Record
from attlog.fleet.records.work import Work
from attlog.fleet.sources.source import Source
from tests.cli.shared.test_progress import Terminal

WORKS = [Work(Source(f"{k}.bin"), f"{k}.bin", Path("out"), Config(), "") for k in range(4)]


def screen(monkeypatch: pytest.MonkeyPatch, terminal: bool, verbose: bool = False, quiet: bool = False) -> str:
    """What a run of four logs leaves on standard error: two were done before, two take 0.1 s each, one fails."""
    err, out = Terminal() if terminal else io.StringIO(), io.StringIO()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setattr(sys, "stdout", out)
    with Bar(quiet, verbose) as bar:
        bar.planned(WORKS)
        for k, work in enumerate(WORKS):
            for _ in range(2):
                bar.heard(work, {"compiling": "compiling mahony (once)"})
            bar.heard(work, {"stage": "reading the log"})
            time.sleep(0.1 * (k > 1))
            bar.advance(Record(work.source.name, work.name, code=66 * (k == 3), again=k < 2))
            with bar.aside():
                print(f"told {k}")
    assert out.getvalue() == "told 0\ntold 1\ntold 2\ntold 3\n"
    return err.getvalue()


def test_a_terminal_shows_count_failures_speed_and_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = screen(monkeypatch, terminal=True)
    assert "3/4 logs" in shown
    assert "logs/s" in shown
    assert re.search(r"0:00:0\d left", shown)
    assert "4/4 logs, 1 failed" in shown
    assert shown.count("attlog: compiling mahony (once)\n") == 1


def test_nothing_is_shown_where_nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    assert screen(monkeypatch, terminal=False) == ""
    assert screen(monkeypatch, terminal=True, quiet=True) == ""
    assert screen(monkeypatch, terminal=False, verbose=True) == "attlog: compiling mahony (once)\n"


def test_slow_batches_count_logs_per_minute() -> None:
    assert (speed(2.34), speed(1.0), speed(0.05)) == ("2.3 logs/s", "1.0 logs/s", "3.0 logs/min")
