"""A pipe gets what a terminal would show, without its colours."""

from __future__ import annotations

import io
import logging
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich.console import Console

from attlog import Config
from attlog.batch.job import Job, Record
from attlog.batch.sources import Source
from attlog.cli.printing import GrowingText, Piped, TextLine, console, say, wrapped
from attlog.cli.progress import COMPILING, KNOWN, STAGES, Bar, StageHandler, first_lines_shown, progress
from attlog.result import Result
from tests.conftest import SAMPLES

TEXTS = ["", "plain", "bold [red]no markup[/red]  ", "a\tb", "rings\a and\b moves\v\f\r on", "µ° ≥ → ✓", "x" * 300]


def test_a_pipe_and_a_terminal_without_colours_get_the_same_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    shown, piped = io.StringIO(), io.StringIO()
    lines = [TextLine(text, "bold") for text in TEXTS]
    say(lines, Console(file=shown, width=160, color_system=None, highlight=False))
    say(lines, Piped(piped))
    assert piped.getvalue() == shown.getvalue()


def test_colours_can_be_forced_into_a_pipe(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("FORCE_COLOR", "1")
    say([TextLine("text", "red")], console())
    assert "\x1b[31mtext" in capsys.readouterr().out


def test_a_growing_text_is_printed_once_and_again_where_its_beginning_changed() -> None:
    piped = io.StringIO()
    text = GrowingText(Piped(piped), ["above"])
    for lines in (["title"], ["title", "flew"], ["title", "flew", "table"], ["title", "crashed"]):
        text.show(TextLine(line) for line in lines)
    assert piped.getvalue().split() == ["above", "title", "flew", "table", "title", "crashed"]


def test_a_reader_that_goes_away_after_the_headline_does_not_end_the_analysis() -> None:
    tried = []

    class Gone(io.StringIO):
        def write(self, text: str) -> int:
            tried.append(text)
            raise BrokenPipeError

    with first_lines_shown(GrowingText(Piped(Gone())), lambda: None):
        result = Result({}, "", {}, {"name": "a.ulg"}, "Flew.")
        logging.getLogger(KNOWN).info("headline: %s", result.headline, extra={"result": result})
    assert tried == ["a.ulg;\n"]


def test_a_terminal_made_narrower_meanwhile_is_not_shown_the_first_lines_again() -> None:
    class Resized(Piped):
        width = 80

    piped, words = io.StringIO(), " ".join(["word"] * 12)
    out = Resized(piped)
    text = GrowingText(out)
    for width in (80, 40):
        out.width = width
        text.show(wrapped("", words, text.width))
    assert piped.getvalue() == words + "\n"


# What a run says while it works: stages of one log, a bar over many, on a terminal only.


class Terminal(io.StringIO):
    """A standard error that somebody looks at."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("terminal", "verbose", "stages", "compiling"),
    [(True, False, True, True), (True, True, True, True), (False, True, False, True), (False, False, False, False)],
)
def test_stages_only_on_a_terminal_compiling_also_with_v(
    monkeypatch: pytest.MonkeyPatch, terminal: bool, verbose: bool, stages: bool, compiling: bool
) -> None:
    screen = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", screen)
    with progress(quiet=False, verbose=verbose):
        logging.getLogger(STAGES).info("running %s", "mahony")
        logging.getLogger(COMPILING).info("compiling mahony (once)")
    assert ("running mahony ..." in screen.getvalue()) is stages
    assert ("attlog: compiling mahony (once)\n" in screen.getvalue()) is compiling
    assert "\x1b" not in screen.getvalue()
    assert not logging.getLogger(STAGES).handlers


LONG = """
import logging, time
from attlog.cli import progress
progress.SILENCE_S = 0.05
with progress.progress(quiet={quiet}, verbose=False):
    logging.getLogger(progress.STAGES).info("flying %s", "hover")
    time.sleep(0.5)
with progress.Bar(quiet={quiet}) as bar:
    time.sleep(0.2)
"""


@pytest.mark.parametrize("quiet", [False, True])
def test_a_pipe_hears_of_work_that_takes_long_ever_more_rarely(quiet: bool) -> None:
    done = subprocess.run([sys.executable, "-c", LONG.format(quiet=quiet)], capture_output=True, text=True)
    lines = done.stderr.splitlines()
    of_stage, of_bar = ([x for x in lines if text in x] for text in ("attlog: flying hover, ", "attlog: 0 of 0 logs, "))
    assert lines == [*of_stage, *of_bar]
    assert (len(of_stage) in range(2, 5), bool(of_bar)) == (not quiet, not quiet)


def test_a_terminal_is_shown_the_seconds_beside_the_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    shown = StageHandler(stages=True)
    shown.emit(logging.LogRecord(STAGES, logging.INFO, "", 0, "drawing the figures", None, None))
    for seconds in (5.0, 6.0):
        shown.tell_time(seconds)
    lines = [line.rstrip() for line in sys.stderr.getvalue().split("\r")]
    assert lines == ["", *(f"drawing the figures{more} ..." for more in ("", ", 5 s", ", 6 s"))]


def test_an_analysis_tells_its_stages(caplog: pytest.LogCaptureFixture, tmp_path: Path) -> None:
    from attlog import Config
    from attlog.batch.report_files import analyze_to_files

    with caplog.at_level(logging.INFO, STAGES):
        analyze_to_files(SAMPLES / "copter_yaw_turns.bin", Config(estimators=["gyro"]), tmp_path)
    told = [record.getMessage() for record in caplog.records if record.name == STAGES]
    assert told[0] == "reading the log"
    assert "running gyro" in told
    assert told[-1] == "writing the report"


JOBS = [Job(Source(f"{k}.bin"), f"{k}.bin", Path("out"), Config(), "") for k in range(4)]


def screen(monkeypatch: pytest.MonkeyPatch, terminal: bool, verbose: bool = False, quiet: bool = False) -> str:
    """What a run of four logs leaves on standard error: two were done before, two take 0.1 s each, one fails."""
    err, out = Terminal() if terminal else io.StringIO(), io.StringIO()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setattr(sys, "stdout", out)
    with Bar(quiet, verbose) as bar:
        bar.planned(JOBS)
        for k, job in enumerate(JOBS):
            for _ in range(2):
                bar.stage(job, {"compiling": "compiling mahony (once)"})
            bar.stage(job, {"stage": "reading the log"})
            time.sleep(0.1 * (k > 1))
            bar.advance(Record(job.source.name, job.name, code=66 * (k == 3), again=k < 2))
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
