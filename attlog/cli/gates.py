"""The options of gates, and what is printed of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog import __version__
from attlog.cli.printing import Piped, say, to_stderr
from attlog.core.errors import OutputError, UsageError, error_message

if TYPE_CHECKING:
    from rich.console import Console

    from attlog.batch.ci import GatedLog, Gating
    from attlog.batch.job import Record
    from attlog.cli.printing import TextLine
    from attlog.core.errors import AttlogError

GatesFile = Annotated[
    Path | None,
    typer.Option(
        "--gates",
        metavar="F.toml",
        help="Check every log against the limits of this file; exit with 1 where one fails. [default: none]",
    ),
]
HEADING = b"## "
"""How a summary begins."""
ANYWHERE = "-"
"""The value of a bare ``--summary``."""


def report_refusal(why: str, words: Sequence[str]) -> None:
    """Say to CI systems, where one asks, what is wrong with gates or options; ``words``: of the command line.

    They are read before any log, so nothing else would be said: the step was red with an empty summary. A file that
    is no summary stays: that it would be overwritten may be what is wrong.
    """
    asked = [k for k, word in enumerate(words) if word.partition("=")[0] == "--summary"]
    if not asked and not os.environ.get("GITHUB_ACTIONS"):
        return
    from attlog.batch.ci import publish_refusal

    summary: Path | bool = bool(asked)
    for k in asked:
        behind = words[k + 1] if k + 1 < len(words) else ""
        named = words[k].partition("=")[2] or behind
        if named.endswith(".md"):
            summary = Path(named) if _may_be_written(Path(named)) else False
    try:
        publish_refusal(why, summary)
    except OutputError as error:
        to_stderr(error_message(error, __version__))


def _may_be_written(file: Path) -> bool:
    """Whether a file is not there, or an earlier summary."""
    if not os.path.isfile(file):
        return True
    with open(file, "rb") as opened:
        return opened.read(len(HEADING)) == HEADING


@dataclass(frozen=True, slots=True)
class GateOptions:
    """What is judged, and where the verdicts go."""

    gates: GatesFile = None
    strict: Annotated[
        bool | None,
        typer.Option(
            "--strict/--no-strict",
            show_default=False,
            help="End with 1 where a filter failed or diverged. [default: with --gates (unless its file says "
            "otherwise), --junit and --summary]",
        ),
    ] = None
    junit: Annotated[
        Path | None, typer.Option(metavar="F.xml", help="Write the verdicts of gates as JUnit XML. [default: none]")
    ] = None
    summary: Annotated[
        str | None,
        typer.Option(
            metavar="[F.md]",
            help="Write the verdicts of gates as Markdown: to $GITHUB_STEP_SUMMARY where that is set, else to the "
            "terminal; with F.md to a file. [default: none]",
        ),
    ] = None

    def __post_init__(self) -> None:
        if self.summary not in (None, ANYWHERE) and not str(self.summary).endswith(".md"):
            raise UsageError(f"--summary {self.summary}: the name of a Markdown file ends with .md")
        for option, place in (("--junit", self.junit), ("--summary", self.summary)):
            if place not in (None, ANYWHERE) and os.path.isdir(str(place)):
                raise UsageError(f"{option} {place}: is a folder; use the name of a file")

    @property
    def any(self) -> bool:
        """Whether anything is to be judged."""
        return self.gates is not None or bool(self.strict) or self.junit is not None or self.summary is not None


class GateReport:
    """The gates of a command: read before any log, judged as logs come, written after the last."""

    def __init__(self, options: GateOptions, output: Path) -> None:
        self._options = options
        self.gating: Gating | None = None
        if options.any:  # else nothing of it is imported
            from attlog.batch.ci import Gating, gating
            from attlog.compare.gates import Gates

            strict = options.strict
            self.gating = gating(options.gates, strict, output) or Gating(Gates((), strict=strict is not False))

    def judge(self, folder: Path, deterministic: bool) -> Callable[[Record], tuple[str, ...]] | None:
        """What judges the records of a batch in a folder as they come; None without gates."""
        gating = self.gating
        if gating is None:
            return None

        def failures(record: Record) -> tuple[str, ...]:
            if not record.done:
                seconds = 0.0 if deterministic else record.wall_s
                self.broken(record.log, record.name, record.code, record.message, seconds, record.known)
                return ()
            return gating.record(record, folder, timed=not deterministic).sentences

        return failures

    def shown(self, log: str, report: Path, quiet: bool, out: Console | Piped) -> None:
        """Judge the result beside a report, show it there, and say what was found."""
        if self.gating is None:
            return
        name = report.name.removesuffix(".html")
        judged = self.gating.file(log, name, report.with_name(f"{name}.json"), report=report)
        if quiet:
            for sentence in judged.sentences:
                to_stderr(f"attlog: {log}: gate: {sentence}")
        else:
            say(lines(judged), out)

    def broken(self, log: str, name: str, code: int, message: str, seconds: float = 0.0, known: bool = False) -> None:
        """A log that has no result."""
        if self.gating is not None:
            self.gating.broken(log, name, code, message.removeprefix("attlog: "), seconds, known)

    def finish(self, names: Iterable[str], wrong: Sequence[AttlogError] = (), *, interrupted: bool = False) -> set[int]:
        """Write what was asked for, logs in the order of these reports; the exit codes that come of it.

        After an interrupt nothing is written: half a run would look green.
        """
        if self.gating is None or interrupted:
            return set()
        from attlog.batch.ci import publish

        missing = [f"named {k}" for k, _ in enumerate(wrong, 1)]
        for name, error in zip(missing, wrong, strict=True):
            self.broken("command line", name, error.exit_code, str(error))
        logs = self.gating.in_order([*missing, *names])
        named = self._options.summary
        summary = False if named is None else named == ANYWHERE or Path(named)
        codes = {1} if any(log.failed for log in logs) else set[int]()
        try:
            publish(logs, self._options.junit, summary)
        except OutputError as error:
            to_stderr(error_message(error, __version__))
            codes |= {error.exit_code}
        return codes


def lines(log: GatedLog) -> list[TextLine]:
    """The verdicts of gates on one log, the worst first."""
    from attlog.cli.printing import TextLine
    from attlog.words.numbers import counted

    total = log.passed + log.failed + log.skipped
    if not total:
        return []
    parts = [f"{log.failed} of {counted(total, 'check')} failed" if log.failed else f"{log.passed} passed"]
    parts += [f"{log.skipped} skipped"] if log.skipped else []
    if log.excused:
        parts.append(f"{log.excused} beyond a limit to the baseline, but not significantly different")
    style = "bold red" if log.failed else "green" if log.passed else ""
    found = [TextLine(f"gates: {', '.join(parts)}", style)]
    found += [TextLine(f"  failed   {sentence}", "red") for sentence in log.sentences]
    if log.failed > len(log.worst):
        found.append(TextLine(f"  ... and {log.failed - len(log.worst)} more"))
    return found
