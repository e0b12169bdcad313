"""A pipe gets what a terminal would show, without its colours."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest
from rich.console import Console

from attlog.cli.shared.printing import Piped, TextLine, console, say, terminal

TEXTS = ["", "plain", "bold [red]no markup[/red]  ", "a\tb", "rings\a and\b moves\v\f\r on", "µ° ≥ → ✓", "x" * 300]


def test_a_pipe_and_a_terminal_without_colours_get_the_same_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    shown, piped = io.StringIO(), io.StringIO()
    lines = [TextLine(text, "bold") for text in TEXTS]
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
    say([TextLine("text", "red")], console())
    assert "\x1b[31mtext" in capsys.readouterr().out


@pytest.mark.parametrize(("given", "kept"), [(None, "1"), ("3", "3")])
def test_products_of_small_arrays_start_no_threads_unless_asked_to(
    given: str | None, kept: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Threads that wait for the next product cost a short run a tenth of its processor time."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if given is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", given)
    code = (
        "import os, sys\nsys.argv = ['attlog', '--version']\nfrom attlog.cli import main\n"
        "assert 'numpy' not in sys.modules\ntry:\n    main()\nexcept SystemExit:\n    pass\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == kept
