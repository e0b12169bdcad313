"""Annotations: escaped, the worst first, no more than GitHub shows."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.fleet.ci.gating import gated
from attlog.fleet.ci.github import commands, on_github
from tests.fleet.gated import outcome, some


def test_failures_are_errors_and_what_passed_is_silent() -> None:
    lines = list(commands(some()))
    assert len(lines) == 4
    assert all(line.startswith("::error ") for line in lines)
    assert lines[0].endswith("::gone.ulg: cannot be read%0A(no such file)")
    assert "c: lag_ms 45 ms (airborne), at most 5 ms" in lines[1]
    assert not any("good" in line for line in lines)


def test_escapes_are_those_of_workflow_commands() -> None:
    (line,) = list(commands([gated("a,b:c%", "n", [outcome("r,1:2%\r\n\x1b", sentence="50% off,\r\nfar: off")])]))
    assert line == (
        "::error title=attlog%2C r%2C1%3A2%25%0D%0A%3A lag_ms@airborne max=5::a,b:c%25: 50%25 off,%0D%0Afar: off"
    )


def test_of_many_failures_the_worst_ten_are_shown_each_log_first_and_the_rest_is_counted() -> None:
    logs = [gated(f"{k}.ulg", "n", [outcome("a", excess=k + 2.0), outcome("b", excess=50.0 + k)]) for k in range(8)]
    lines = list(commands(logs))
    assert [line.startswith("::error") for line in lines] == [True] * 10 + [False]
    assert [line.rpartition("::")[2].partition(":")[0] for line in lines[:10]] == [
        *(f"{k}.ulg" for k in range(7, -1, -1)),
        "7.ulg",
        "6.ulg",
    ]
    assert lines[-1].startswith("::notice title=attlog::16 failures in 8 logs, of which the worst 10 are marked")


def test_a_log_in_the_repository_is_the_annotated_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "a.ulg").write_bytes(b"x")
    monkeypatch.chdir(tmp_path)
    inside = gated("logs/a.ulg", "n", [outcome("a")])
    (line,) = list(commands([inside]))
    assert line.startswith("::error file=logs/a.ulg,title=")
    (line,) = list(commands([inside], tmp_path / "logs"))
    assert line.startswith("::error file=a.ulg,title=")
    (line,) = list(commands([gated("/elsewhere/a.ulg", "n", [outcome("a")])]))
    assert line.startswith("::error title=")


def test_only_in_a_step_of_a_workflow() -> None:
    assert on_github({"GITHUB_ACTIONS": "true"})
    assert not on_github({})
