"""A pipe gets what a terminal would show, without its colours."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from attlog.cli.common import Piped, console, say, terminal
from attlog.cli.layout import Line

TEXTS = ["", "plain", "bold [red]no markup[/red]  ", "a\tb", "rings\a and\b moves\v\f\r on", "µ° ≥ → ✓", "x" * 300]


def test_a_pipe_and_a_terminal_without_colours_get_the_same_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    shown, piped = io.StringIO(), io.StringIO()
    lines = [Line(text, "bold") for text in TEXTS]
    say(lines, Console(file=shown, width=160, color_system=None, highlight=False))
    say(lines, Piped(piped))
    assert piped.getvalue() == shown.getvalue()


def test_what_is_no_terminal_is_written_without_rich(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    assert isinstance(console(), Piped)
    assert console().width == terminal().width == 160


def test_colours_can_be_forced_into_a_pipe(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("FORCE_COLOR", "1")
    say([Line("text", "red")], console())
    assert "\x1b[31mtext" in capsys.readouterr().out
