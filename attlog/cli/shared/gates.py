"""The options of gates, the same for ``analyze`` and ``batch``, and what is printed of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog import __version__
from attlog.base.errors import OutputError, UsageError, message
from attlog.cli.shared.printing import Piped, say, to_stderr

if TYPE_CHECKING:
    from rich.console import Console

    from attlog.base.errors import AttlogError
    from attlog.cli.shared.printing import Line
    from attlog.fleet.ci.gating import Gating
    from attlog.fleet.ci.judged import Judged
    from attlog.fleet.records.record import Record

GatesFile = Annotated[
    Path | None,
    typer.Option(
        "--gates",
        metavar="F.toml",
        help="Limits that every log must keep; exit code 1 where one does not. [default: none]",
    ),
]
Strict = Annotated[
    bool | None,
    typer.Option(
        "--strict/--no-strict",
        show_default=False,
        help="End with 1 where a filter failed or diverged. [default: with --gates (unless its file says otherwise), "
        "--junit and --summary]",
    ),
]
Junit = Annotated[
    Path | None, typer.Option("--junit", metavar="F.xml", help="Write what gates said as JUnit XML. [default: none]")
]
Summary = Annotated[
    str | None,
    typer.Option(
        "--summary",
        metavar="[F.md]",
        help="Write what gates said as Markdown: to $GITHUB_STEP_SUMMARY where that is set, else to the terminal; "
        "with F.md to a file. [default: none]",
    ),
]
ANYWHERE = "-"
"""The value of a bare ``--summary``."""


def tell_refused(why: str, words: Sequence[str]) -> None:
    """Tell CI systems, where one asks, what was wrong with gates or options; ``words``: of the command line.

    They are read before any log, so nothing else would be told: the step was red with an empty summary.
    """
    given = [k for k, word in enumerate(words) if word.partition("=")[0] == "--summary"]
    if not given and not os.environ.get("GITHUB_ACTIONS"):
        return
    from attlog.fleet.ci.gating import tell_refused as tell

    file = ""
    for k in given:
        behind = words[k + 1] if k + 1 < len(words) else ""
        file = words[k].partition("=")[2] or behind
    try:
        tell(why, Path(file) if file.endswith(".md") else bool(given))
    except OutputError as error:
        to_stderr(message(error, __version__))


class Gated:
    """The gates of a command: read before any log, told after the last."""

    def __init__(
        self, file: Path | None, strict: bool | None, junit: Path | None, summary: str | None, output: Path
    ) -> None:
        if summary not in (None, ANYWHERE) and not str(summary).endswith(".md"):
            raise UsageError(f"--summary {summary}: the name of a Markdown file ends with .md")
        for option, file_ in (("--junit", junit), ("--summary", summary)):
            if file_ not in (None, ANYWHERE) and os.path.isdir(str(file_)):
                raise UsageError(f"{option} {file_}: is a folder; give the name of a file")
        self._junit, self._summary = junit, summary
        self.gating: Gating | None = None
        if file is not None or strict or junit is not None or summary is not None:  # else nothing of it is imported
            from attlog.compare.gates.gates import Gates
            from attlog.fleet.ci.gating import Gating, gating

            self.gating = gating(file, strict, output) or Gating(Gates((), strict=strict is not False))

    def judge(self, folder: Path, deterministic: bool) -> Callable[[Record], tuple[str, ...]] | None:
        """What judges the records of a batch in a folder as they come; None without gates."""
        held = self.gating
        if held is None:
            return None

        def failures(record: Record) -> tuple[str, ...]:
            if not record.done:
                seconds = 0.0 if deterministic else record.wall_s
                self.broken(record.log, record.name, record.code, record.message, seconds, record.known)
                return ()
            return held.record(record, folder, timed=not deterministic).sentences

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
        from attlog.fleet.ci.gating import tell

        missing = [f"named {k}" for k, _ in enumerate(wrong, 1)]
        for name, error in zip(missing, wrong, strict=True):
            self.broken("command line", name, error.exit_code, str(error))
        logs = self.gating.in_order([*missing, *names])
        summary = False if self._summary is None else self._summary == ANYWHERE or Path(self._summary)
        codes = {1} if any(judged.failed for judged in logs) else set[int]()
        try:
            tell(logs, self._junit, summary)
        except OutputError as error:
            to_stderr(message(error, __version__))
            codes |= {error.exit_code}
        return codes


def lines(judged: Judged) -> list[Line]:
    """What gates said of one log, the worst first."""
    from attlog.cli.shared.printing import Line
    from attlog.present.numbers import counted

    total = judged.passed + judged.failed + judged.skipped
    if not total:
        return []
    parts = [f"{judged.failed} of {counted(total, 'check')} failed" if judged.failed else f"{judged.passed} passed"]
    parts += [f"{judged.skipped} skipped"] if judged.skipped else []
    parts += [f"{judged.excused} beyond a limit to the baseline, but not told from it"] if judged.excused else []
    style = "bold red" if judged.failed else "green" if judged.passed else ""
    found = [Line(f"gates: {', '.join(parts)}", style)]
    found += [Line(f"  failed   {sentence}", "red") for sentence in judged.sentences]
    if judged.failed > len(judged.worst):
        found.append(Line(f"  ... and {judged.failed - len(judged.worst)} more"))
    return found
