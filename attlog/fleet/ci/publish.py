"""What CI systems read of gates: a Markdown summary, annotations and a JUnit file; the worst first."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TextIO

from attlog import __version__
from attlog.base.errors import OutputError
from attlog.base.files.output import write_atomic
from attlog.fleet.ci import github, junit
from attlog.fleet.ci.gating import GatedLog, failing
from attlog.present.numbers import counted
from attlog.present.table.markdown import escaped

MOST_BYTES = 900_000
"""GitHub refuses the whole summary of a step above 1 MiB."""


def summary(logs: Sequence[GatedLog], most: int = MOST_BYTES) -> str:
    """The summary of all logs; what does not fit is counted."""
    found = failing(logs)
    lines = [_headline(logs, found), "", _counts(logs), ""]
    used = sum(len(line.encode()) + 1 for line in lines) + 200
    left = sum(max(j.failed, 1) for j in found)
    if found:
        lines += ["| log | row | check | what was found |", "| --- | --- | --- | --- |"]
    for line in _table(found):
        used += len(line.encode()) + 1
        if used > most:
            break
        lines.append(line)
        left -= 1
    if left > 0:
        lines += ["", f"... and {counted(left, 'more failure')}: the reports of these logs show them."]
    return "\n".join(lines) + "\n"


def write(logs: Sequence[GatedLog], path: Path | None, environment: Mapping[str, str] = os.environ) -> str:
    """Write the summary to a file, and add it to the job's where ``$GITHUB_STEP_SUMMARY`` names one.

    Returns the text that is left to be printed: all of it where it was written nowhere. OutputError if a file cannot
    be written.
    """
    return write_text(summary(logs), path, environment)


def not_run(why: str) -> str:
    """The summary of a run that was refused before it looked at a log."""
    return "\n".join(
        ["## ❌ attlog: nothing was analysed", "", *(f"- {escaped(line)}" for line in why.splitlines()), ""]
    )


def write_text(text: str, path: Path | None, environment: Mapping[str, str] = os.environ) -> str:
    """Bring a summary to its places, as :func:`write`."""
    step = environment.get("GITHUB_STEP_SUMMARY")
    if path is not None:
        write_atomic(path, text)
    if step and (path is None or path.resolve() != Path(step).resolve()):
        try:
            with open(step, "a", encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise OutputError(f"{step}: cannot be written ({error.strerror or error})") from error
    return "" if step or path is not None else text


def _headline(logs: Sequence[GatedLog], found: Sequence[GatedLog]) -> str:
    if not logs:
        return "## attlog: no log"
    if not found:
        return f"## ✅ attlog: {counted(len(logs), 'log')}, no gate failed"
    return f"## ❌ attlog: {len(found)} of {counted(len(logs), 'log')} failed"


def _counts(logs: Sequence[GatedLog]) -> str:
    passed, failed, skipped, excused = (
        sum(getattr(j, kind) for j in logs) for kind in ("passed", "failed", "skipped", "excused")
    )
    parts = [f"{counted(passed, 'check')} passed", f"{failed} failed", f"{skipped} skipped"]
    broken = sum(j.broken for j in logs)
    parts += [f"{counted(broken, 'log')} could not be analysed"] if broken else []
    known = sum(j.known for j in logs)
    parts += [f"{counted(known, 'log')} failed as in an earlier run"] if known else []
    parts += [f"{excused} beyond a limit to the baseline, without significant difference"] if excused else []
    return f"{', '.join(parts)} (attlog {__version__})."


def _table(found: Sequence[GatedLog]) -> Iterator[str]:
    for j in found:
        if j.broken:
            yield _line(j.log, "", "analysis", j.message.removeprefix(f"{j.log}: "))
        for o in j.worst:
            yield _line(j.log, o.row, o.check, o.sentence)


def _line(*cells: str) -> str:
    return "| " + " | ".join(map(escaped, cells)) + " |"


def publish(
    logs: list[GatedLog],
    junit_file: Path | None = None,
    summary_to: Path | bool = False,
    *,
    environment: Mapping[str, str] = os.environ,
    out: TextIO | None = None,
    err: TextIO | None = None,
) -> None:
    """What CI systems read: a JUnit file, a Markdown summary, and on GitHub annotations (on standard error).

    ``summary_to``: a file, or True for ``$GITHUB_STEP_SUMMARY`` where it is set, else standard output. OutputError for
    a file that cannot be written; the others are written all the same.
    """
    wrong: list[str] = []
    if github.on_github(environment):
        root = environment.get("GITHUB_WORKSPACE")
        for line in github.commands(logs, Path(root) if root else None):
            print(line, file=err or sys.stderr)
    if junit_file is not None:
        try:
            junit.write(junit_file, (j.suite for j in logs))
        except OutputError as error:
            wrong.append(str(error))
    if summary_to is not False:
        try:
            text = write(logs, summary_to if isinstance(summary_to, Path) else None, environment)
            print(text, end="", file=out or sys.stdout)
        except OutputError as error:
            wrong.append(str(error))
    if wrong:
        raise OutputError("\n".join(wrong))


def publish_refusal(
    why: str,
    summary_to: Path | bool = False,
    *,
    environment: Mapping[str, str] = os.environ,
    out: TextIO | None = None,
    err: TextIO | None = None,
) -> None:
    """What CI systems read of a run that was refused for its gates or options: else its step is red without a word."""
    if github.on_github(environment):
        for line in github.refused(why):
            print(line, file=err or sys.stderr)
    if summary_to is not False:
        path = summary_to if isinstance(summary_to, Path) else None
        print(write_text(not_run(why), path, environment), end="", file=out or sys.stdout)
