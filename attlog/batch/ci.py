"""Gates as JUnit XML: a suite per log, a test case per gate and row; valid for Jenkins' junit-10.xsd.

``failure`` is a gate that failed, ``error`` a log that has no result, ``skipped`` an optional gate without an answer.
"""

from __future__ import annotations

import os
import re
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TextIO
from xml.sax.saxutils import escape, quoteattr

from attlog import __version__
from attlog.batch.job import Record, write_record, written
from attlog.compare import gate_file
from attlog.compare.baseline import Baseline, read_baselines
from attlog.compare.gates import GateOutcome, Gates, judge_gates, worst_first
from attlog.core.errors import LogUnreadable, OutputError, UsageError
from attlog.core.files import open_atomic, write_atomic
from attlog.report import gates as report_gates
from attlog.result import Result
from attlog.words.numbers import counted
from attlog.words.text import CONTROL, escape_markdown

NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold in any form, bytes of a file name that are not UTF-8 among them."""
ANALYSIS = "analysis"
"""The test case that every log has: whether it could be analysed."""


@dataclass(frozen=True, slots=True)
class Suite:
    """The text of a log's suite, packed: ten thousand of them are kept until the end."""

    packed: bytes

    def text(self) -> str:
        """The XML of the suite."""
        return zlib.decompress(self.packed).decode()


def suite(
    log: str, name: str, outcomes: Sequence[GateOutcome], code: int, message: str, seconds: float, known: bool = False
) -> Suite:
    """What the file says of one log; the arguments are those of :func:`attlog.batch.ci.gated`."""
    time = f' time="{seconds:.3f}"' if seconds > 0.0 else ""
    failures, skipped = (sum(o.status == status for o in outcomes) for status in ("failed", "skipped"))
    skipped += known
    lines = [
        f"<testsuite name={_quoted(log)} tests={_quoted(len(outcomes) + 1)} failures={_quoted(failures)}"
        f" errors={_quoted(int(code != 0 and not known))} skipped={_quoted(skipped)}{time}>",
        f'<properties><property name="report" value={_quoted(name + ".html")}/>'
        f'<property name="attlog" value={_quoted(__version__)}/></properties>',
    ]
    error = "" if code == 0 else _part("error", message, f"exit code {code}", message)
    if known:
        error = f"<skipped message={_quoted(f'as in an earlier run: {message}')}/>"
    lines.append(_case(log, ANALYSIS, error, time))
    in_order = sorted(outcomes, key=lambda o: (o.check, o.row))  # the same place from run to run
    lines += [_case(log, f"{o.row}: {o.check}", _of(o)) for o in in_order]
    return Suite(zlib.compress("\n".join([*lines, "</testsuite>\n"]).encode()))


def write_junit(path: Path, suites: Iterable[Suite | None]) -> None:
    """Write the file of all logs. OutputError if it cannot be written."""
    with open_atomic(path) as file:
        for text in _document(suites):
            file.write(text.encode("utf-8"))


def _document(suites: Iterable[Suite | None]) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="attlog">\n'
    yield from (one.text() for one in suites if one is not None)
    yield "</testsuites>\n"


def _of(outcome: GateOutcome) -> str:
    if outcome.status == "passed":
        return ""
    if outcome.status == "skipped":
        return f"<skipped message={_quoted(outcome.sentence)}/>"
    return _part("failure", outcome.sentence, outcome.cause or "", outcome.sentence)


def _case(log: str, name: str, inside: str, time: str = "") -> str:
    head = f"<testcase classname={_quoted(log)} name={_quoted(name)}{time}"
    return f"{head}>{inside}</testcase>" if inside else f"{head}/>"


def _part(kind: str, message: str, type_: str, text: str) -> str:
    first = message.partition("\n")[0]
    return f"<{kind} message={_quoted(first)} type={_quoted(type_)}>{escape(clean(text))}</{kind}>"


def _quoted(value: object) -> str:
    return quoteattr(clean(str(value)))


def clean(text: str) -> str:
    """The text without what XML cannot hold."""
    return NO_XML.sub("", text)


# Gates over a run of many logs, judged as results come; what they say of a log is small enough for ten thousand.

MOST_KEPT = 50
"""Failures kept of one log, the worst first; all of them are counted and stand in the JUnit file."""


@dataclass(frozen=True, slots=True)
class GatedLog:
    """One log: ``code`` and ``message`` where it has no result, else how many gates passed, failed, were skipped.

    ``known``: it had no result in an earlier run either. ``worst``: failures, the worst first. ``excused``: how many
    are beyond a limit to the baseline that the evidence does not tell. ``suite``: what the JUnit file says of the log.
    """

    log: str
    name: str
    code: int = 0
    message: str = ""
    known: bool = False
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    excused: int = 0
    worst: tuple[GateOutcome, ...] = ()
    suite: Suite | None = None

    @property
    def broken(self) -> bool:
        """Whether the log has no result to be judged, which is news."""
        return self.code != 0 and not self.known

    @property
    def sentences(self) -> tuple[str, ...]:
        """What failed, a sentence each."""
        return tuple(o.sentence for o in self.worst)


def gated(
    log: str,
    name: str,
    outcomes: Sequence[GateOutcome] = (),
    *,
    code: int = 0,
    message: str = "",
    known: bool = False,
    seconds: float = 0.0,
) -> GatedLog:
    """A log with what gates said of it; ``name`` is that of its report, ``seconds`` what its analysis took."""
    count = {status: sum(o.status == status for o in outcomes) for status in ("passed", "failed", "skipped")}
    failures = [o for o in worst_first(outcomes) if o.status == "failed"]
    return GatedLog(
        log,
        name,
        code,
        message,
        known,
        **count,
        excused=sum(o.excused for o in outcomes),
        worst=tuple(failures[:MOST_KEPT]),
        suite=suite(log, name, outcomes, code, message, seconds, known),
    )


def failing(logs: Iterable[GatedLog]) -> list[GatedLog]:
    """Logs that make a build fail: broken ones first, then by their worst failure."""
    return sorted((j for j in logs if j.broken or j.failed), key=lambda j: (not j.broken, -_excess(j)))


def _excess(log: GatedLog) -> float:
    return max((o.excess for o in log.worst), default=0.0)


@dataclass(slots=True)
class Gating:
    """Gates with what they look into, and what they said of each log so far, by the name of its report."""

    gates: Gates
    baselines: Mapping[Path, Baseline] = field(default_factory=dict)
    logs: dict[str, GatedLog] = field(default_factory=dict)

    def result(self, log: str, name: str, found: Result, seconds: float = 0.0, report: Path | None = None) -> GatedLog:
        """Judge the result of a log; ``name``: of its report. Shown in the file ``report``.

        OutputError if that cannot be written.
        """
        outcomes = judge_gates(self.gates, found, self.baselines)
        self.logs[name] = gated(log, name, outcomes, seconds=seconds)
        if report is not None and outcomes:
            report_gates.show(report, [(o.status, f"{o.row}: {o.check}", o.sentence) for o in outcomes])
        return self.logs[name]

    def file(self, log: str, name: str, path: Path, seconds: float = 0.0, report: Path | None = None) -> GatedLog:
        """Judge the JSON file of a log's result. A file that cannot be read is an error of the log, never passed."""
        try:
            found = Result.load(path)
        except (LogUnreadable, UsageError) as error:
            return self.broken(log, name, LogUnreadable.exit_code, str(error))
        return self.result(log, name, found, seconds, report)

    def record(self, record: Record, folder: Path, timed: bool = True) -> GatedLog:
        """Judge the result that a record of a batch in a folder is of, and show it in its report.

        ``timed``: what was measured may be told.
        """
        report, seconds = folder / f"{record.name}.html", record.wall_s if timed else 0.0
        found = self.file(record.log, record.name, folder / f"{record.name}.json", seconds, report)
        kept = record.files.get(report.name)
        now = written(report)
        if kept is not None and now is not None and now != kept:
            write_record(folder, replace(record, files=record.files | {report.name: now}))
        return found

    def broken(
        self, log: str, name: str, code: int, message: str, seconds: float = 0.0, known: bool = False
    ) -> GatedLog:
        """A log without a result; ``code``: what its analysis ended with; ``known``: as in an earlier run."""
        self.logs[name] = gated(log, name, code=code, message=message, known=known, seconds=seconds)
        return self.logs[name]

    def in_order(self, names: Iterable[str] | None = None) -> list[GatedLog]:
        """What was said, in the order of these reports, else as it came."""
        return list(self.logs.values()) if names is None else [self.logs[n] for n in names if n in self.logs]


def gating(path: Path | None, strict: bool | None = None, output: Path | None = None) -> Gating | None:
    """The gates of a file, read with their baselines; ``strict`` has the last word. None where nothing is asked.

    UsageError tells everything that is wrong in the file, and every baseline that cannot be used: one that the run
    writes to (``output``, a folder) would be compared with itself.
    """
    if path is None:
        return Gating(Gates((), True)) if strict else None
    found = gate_file.read_gates(path)
    if strict is not None:
        found = replace(found, strict=strict)
    places = dict.fromkeys(gate.baseline for gate in found.gates if gate.baseline is not None)
    own = [p for p in places if output is not None and _overlap(p.resolve(), output.resolve())]
    if own:
        raise UsageError(
            "\n".join(
                f"baseline {p}: lies where this run writes its results ({output}), so that they would be compared with "
                "themselves; keep it elsewhere, or choose another folder with -o"
                for p in own
            )
        )
    return Gating(found, read_baselines(places))


def _overlap(one: Path, other: Path) -> bool:
    return one.is_relative_to(other) or other.is_relative_to(one)


# Failures as GitHub's workflow commands: marks beside the files of a pull request.
#
# GitHub shows ten of each kind and step and drops the rest without a word: the worst are told, a notice counts the
# rest.

SHOWN = 10


def on_github(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether this runs in a step of a GitHub workflow."""
    return environment.get("GITHUB_ACTIONS") == "true"


def commands(logs: Sequence[GatedLog], root: Path | None = None) -> Iterator[str]:
    """One line for each failure, the worst of every log before the second worst of any; ``root``: of the repository."""
    found = failing(logs)
    errors = [_command("error", j.log, "not analysed", j.message, root) for j in found if j.broken]
    rank = sorted((k, -o.excess, n) for n, j in enumerate(found) for k, o in enumerate(j.worst))
    errors += [
        _command(
            "error",
            found[n].log,
            f"{found[n].worst[k].row}: {found[n].worst[k].check}",
            found[n].worst[k].sentence,
            root,
        )
        for k, _, n in rank
    ]
    yield from errors[:SHOWN]
    total = sum(j.failed + j.broken for j in found)
    if total > SHOWN:
        rest = f"{counted(total, 'failure')} in {counted(len(found), 'log')}"
        yield f"::notice title=attlog::{rest}, of which the worst {SHOWN} are marked; the reports show all of them"


def refused(why: str) -> Iterator[str]:
    """A line for each thing that is wrong with what was asked, so that nothing was run."""
    for line in why.splitlines()[:SHOWN]:
        yield f"::error title={_property('attlog, nothing was analysed')}::{_message(line)}"


def _command(kind: str, log: str, title: str, message: str, root: Path | None) -> str:
    place = _inside(log, root)
    file = f"file={_property(place)}," if place else ""
    said = f"{log}: {message.removeprefix(f'{log}: ')}"  # a log that cannot be read names itself
    return f"::{kind} {file}title={_property(f'attlog, {title}')}::{_message(said)}"


def _inside(log: str, root: Path | None) -> str:
    """The log's path in the repository; empty for what is not in it."""
    try:
        return Path(log).resolve().relative_to((root or Path.cwd()).resolve()).as_posix() if Path(log).exists() else ""
    except (OSError, ValueError):
        return ""


def _message(text: str) -> str:
    escaped = "\r".join(CONTROL.sub("", part) for part in text.split("\r")).replace("%", "%25")
    return escaped.replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _message(text).replace(":", "%3A").replace(",", "%2C")


# What CI systems read of gates: a Markdown summary, annotations and a JUnit file; the worst first.

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


def write_summary(logs: Sequence[GatedLog], path: Path | None, environment: Mapping[str, str] = os.environ) -> str:
    """Write the summary to a file, and add it to the job's where ``$GITHUB_STEP_SUMMARY`` names one.

    Returns the text that is left to be printed: all of it where it was written nowhere. OutputError if a file cannot
    be written.
    """
    return write_text(summary(logs), path, environment)


def not_run(why: str) -> str:
    """The summary of a run that was refused before it looked at a log."""
    return "\n".join(
        ["## ❌ attlog: nothing was analysed", "", *(f"- {escape_markdown(line)}" for line in why.splitlines()), ""]
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
    return "| " + " | ".join(map(escape_markdown, cells)) + " |"


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
    if on_github(environment):
        root = environment.get("GITHUB_WORKSPACE")
        for line in commands(logs, Path(root) if root else None):
            print(line, file=err or sys.stderr)
    if junit_file is not None:
        try:
            write_junit(junit_file, (j.suite for j in logs))
        except OutputError as error:
            wrong.append(str(error))
    if summary_to is not False:
        try:
            text = write_summary(logs, summary_to if isinstance(summary_to, Path) else None, environment)
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
    if on_github(environment):
        for line in refused(why):
            print(line, file=err or sys.stderr)
    if summary_to is not False:
        path = summary_to if isinstance(summary_to, Path) else None
        print(write_text(not_run(why), path, environment), end="", file=out or sys.stdout)
