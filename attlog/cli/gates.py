"""Options of gates, and their outcome on the terminal."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog import __version__
from attlog.cli.printing import Piped, say, to_stderr
from attlog.core.errors import OutputError, UsageError, error_message
from attlog.core.own_files import JUNIT, SUMMARY, require_replaceable

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
# Value of ``--summary`` without a file.
ANY_PLACE = "-"


def report_refusal(why: str, words: Sequence[str]) -> None:
    """Report to CI what is wrong with gates or options; ``words``: of the command line.

    No log is read then, and the summary would be empty. A file that is no summary is not overwritten.
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
    """Return True for a missing file or an earlier summary."""
    try:
        require_replaceable(file, SUMMARY)
    except OutputError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class GateOptions:
    """Gates, and where their outcome is written."""

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
        if self.summary not in (None, ANY_PLACE) and not str(self.summary).endswith(".md"):
            raise UsageError(f"--summary {self.summary}: the name of a Markdown file ends with .md")
        for option, place in (("--junit", self.junit), ("--summary", self.summary)):
            if place not in (None, ANY_PLACE) and os.path.isdir(str(place)):
                raise UsageError(f"{option} {place}: is a folder; use the name of a file")
            if place not in (None, ANY_PLACE):
                require_replaceable(Path(str(place)), JUNIT if option == "--junit" else SUMMARY)

    @property
    def any(self) -> bool:
        """True if anything is judged."""
        return self.gates is not None or bool(self.strict) or self.junit is not None or self.summary is not None


class GateReport:
    """Gates of a command: read before any log, judged as logs come, published after the last."""

    def __init__(self, options: GateOptions, output: Path) -> None:
        self._options, self._folder = options, output
        self.gating: Gating | None = None
        if options.any:  # else nothing of it is imported
            from attlog.batch.ci import Gating, read_gating
            from attlog.compare.gates import Gates

            strict = options.strict
            self.gating = read_gating(options.gates, strict, output) or Gating(Gates((), strict=strict is not False))

    def judge(self, record: Record, timed: bool = True) -> tuple[str, ...]:
        """Judge the result of a record, or note that there is none; return a sentence for each gate that failed."""
        return () if self.gating is None else self.gating.judge(record, self._folder, timed).sentences

    def judge_and_print(self, record: Record, quiet: bool, out: Console | Piped) -> None:
        """Judge the result of a record and print the outcome."""
        failures = self.judge(record)
        if quiet:
            for sentence in failures:
                to_stderr(f"attlog: {record.log}: gate: {sentence}")
        elif self.gating is not None:
            say(lines(self.gating.logs[record.name]), out)

    def total(self, names: Iterable[str]) -> list[TextLine]:
        """Return one line about the gates of all logs; none where nothing is judged."""
        from attlog.cli.printing import TextLine
        from attlog.words.numbers import counted

        logs = [] if self.gating is None else self.gating.in_order(names)
        if not logs:
            return []
        passed, failed, skipped = (sum(getattr(log, what) for log in logs) for what in ("passed", "failed", "skipped"))
        parts = [f"{passed} of {passed + failed} passed" if passed + failed else "none could be checked"]
        parts += [f"{failed} failed on {counted(sum(log.failed > 0 for log in logs), 'log')}"] if failed else []
        parts += [f"{skipped} skipped"] if skipped else []
        parts += (
            [f"{counted(broken, 'log')} without a result"] if (broken := sum(log.code != 0 for log in logs)) else []
        )
        style = "bold red" if failed else "green" if passed and not broken else ""
        return [TextLine(f"gates: {', '.join(parts)}", style)]

    def finish(self, names: Iterable[str], wrong: Sequence[AttlogError] = (), *, interrupted: bool = False) -> set[int]:
        """Publish the outcomes of logs in the order of their reports; return exit codes.

        After an interrupt nothing is published: half a run would look green.
        """
        if self.gating is None or interrupted:
            return set()
        from attlog.batch.ci import publish
        from attlog.batch.job import Record

        missing = [f"named {k}" for k, _ in enumerate(wrong, 1)]
        for name, error in zip(missing, wrong, strict=True):
            self.judge(Record("command line", name, code=error.exit_code, message=str(error)))
        logs = self.gating.in_order([*missing, *names])
        named = self._options.summary
        summary = False if named is None else named == ANY_PLACE or Path(named)
        codes = {1} if any(log.failed for log in logs) else set[int]()
        try:
            publish(logs, self._options.junit, summary)
        except OutputError as error:
            to_stderr(error_message(error, __version__))
            codes |= {error.exit_code}
        return codes


def lines(log: GatedLog) -> list[TextLine]:
    """Return the outcome of the gates of one log, the worst first."""
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
