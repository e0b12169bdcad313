"""The Markdown summary: worst first, escaped, within GitHub's limit."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.base.errors import OutputError
from attlog.fleet.ci.gating import gated
from attlog.fleet.ci.publish import MOST_BYTES, summary, write
from attlog.present.table.markdown import escaped
from tests.fleet.gated import NASTY, outcome, some


def test_red_or_green_in_the_first_line() -> None:
    assert summary(some()).startswith("## ❌ attlog: 3 of 4 logs failed\n")
    assert summary(some()[:1]).startswith(
        "## ✅ attlog: 1 log, no gate failed\n\n1 check passed, 0 failed, 1 skipped ("
    )
    assert summary([]).startswith("## attlog: no log")


def test_failures_stand_in_a_table_broken_logs_and_the_worst_first() -> None:
    rows = [line for line in summary(some()).splitlines() if line.startswith("| ")][2:]
    assert rows[0] == "| gone.ulg |  | analysis | cannot be read (no such file) |"
    assert rows[1].startswith("| bad.ulg | c | lag\\_ms@airborne max=5 | c: lag\\_ms 45 ms")
    assert rows[2].startswith("| bad.ulg | a |")
    assert len(rows) == 4


def test_a_name_is_neither_markup_nor_html_nor_a_cell() -> None:
    text = escaped(NASTY)
    assert "<" not in text
    assert text.startswith("a\\|b&lt;i&gt;&amp;\"'\\`\\*\\_\\[x\\](y) ")
    assert all(
        line.count(" | ") == 3 for line in summary(some()).splitlines() if line.startswith("| ") and "---" not in line
    )


def test_a_long_summary_stays_within_the_limit_and_counts_what_is_left() -> None:
    logs = [gated(f"{k}.ulg", "n", [outcome(f"f{n}", sentence="x" * 200) for n in range(60)]) for k in range(200)]
    text = summary(logs)
    assert 0.9 * MOST_BYTES < len(text.encode()) < MOST_BYTES
    shown = text.count("xxx |")
    assert f"... and {12_000 - shown:,} more failures: the reports of these logs show them." in text
    few = summary(logs[:1])
    assert "... and 10 more failures" in few  # of one log so many are kept


def test_where_it_goes(tmp_path: Path) -> None:
    step, file = tmp_path / "step.md", tmp_path / "own.md"
    step.write_text("before\n")
    whole = summary(some())
    assert write(some(), None, {}) == whole
    assert write(some(), None, {"GITHUB_STEP_SUMMARY": str(step)}) == ""
    assert step.read_text(encoding="utf-8") == "before\n" + whole
    assert write(some(), file, {"GITHUB_STEP_SUMMARY": str(step)}) == ""
    assert file.read_text(encoding="utf-8") == whole
    assert step.read_text(encoding="utf-8") == "before\n" + whole * 2
    with pytest.raises(OutputError, match="cannot be written"):
        write(some(), None, {"GITHUB_STEP_SUMMARY": str(tmp_path / "no" / "step.md")})
