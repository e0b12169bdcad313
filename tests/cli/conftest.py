"""Runs the command line inside the test process, with the real exit codes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from attlog.cli import main


@dataclass
class Done:
    """What a command left behind."""

    code: int
    out: str
    err: str


@pytest.fixture
def attlog(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    """``attlog("info", path)`` -> exit code, standard output, standard error."""

    def run(*args: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["attlog", *map(str, args)])
        monkeypatch.setenv("NO_COLOR", "1")
        capsys.readouterr()
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = int(stop.code or 0)
        captured = capsys.readouterr()
        return Done(code, captured.out, captured.err)

    return run
