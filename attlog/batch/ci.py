"""Gates over the logs of a run, reported to CI.

The reports are JUnit XML, GitHub annotations and a Markdown summary.
"""

from __future__ import annotations

import os
import re
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TextIO
from xml.sax.saxutils import escape, quoteattr

from attlog import __version__
from attlog.batch.job import Record, size_and_hash, write_record
from attlog.compare import gate_file
from attlog.compare.baseline import Baseline, read_baselines
from attlog.compare.gates import GateOutcome, Gates, judge_gates, worst_first
from attlog.core.errors import LogUnreadable, OutputError, UsageError
from attlog.core.files import open_atomic, write_atomic
from attlog.core.own_files import JUNIT, SUMMARY
from attlog.report import gates as report_gates
from attlog.result import Result
from attlog.words.numbers import counted
from attlog.words.text import CONTROL, escape_markdown

# Failures kept per log, the worst first. All are counted and written to the JUnit file.
MAX_KEPT = 50
# GitHub shows this many annotations of each kind and step, and drops the rest silently.
MAX_ANNOTATIONS = 10
# Below GitHub's limit of 1 MiB for the summary of a step.
MAX_SUMMARY_BYTES = 900_000
# JUnit test case of every log: could it be analysed?
ANALYSIS = "analysis"
# Characters that XML 1.0 cannot hold in any form, such as bytes of a file name that are not UTF-8.
NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, slots=True)
class GatedLog:
    """Gate outcomes of one log; ``code`` and ``message`` if it has no result.

    ``known``: an earlier run had no result either. ``worst``: failures, the worst first. ``excused``: gates beyond a
    limit to the baseline whose difference is not significant. ``suite``: JUnit XML, compressed because thousands are
    kept until the end.
    """

    log: str
    code: int = 0
    message: str = ""
    known: bool = False
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    excused: int = 0
    worst: tuple[GateOutcome, ...] = ()
    suite: bytes = b""

    @property
    def broken(self) -> bool:
        """True for a log without a result, unless an earlier run had none either."""
        return self.code != 0 and not self.known

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences of failures."""
        return tuple(o.sentence for o in self.worst)

    @property
    def excess(self) -> float:
        """Largest excess over a limit."""
        return max((o.excess for o in self.worst), default=0.0)


def gated_log(record: Record, outcomes: Sequence[GateOutcome] = (), *, timed: bool = True) -> GatedLog:
    """Summarise gate outcomes of a log; ``timed``: include the time of the analysis."""
    count = {status: sum(o.status == status for o in outcomes) for status in ("passed", "failed", "skipped")}
    failures = [o for o in worst_first(outcomes) if o.status == "failed"]
    record = replace(record, message=record.message.removeprefix("attlog: "))
    return GatedLog(
        record.log,
        record.code,
        record.message,
        record.known,
        **count,
        excused=sum(o.excused for o in outcomes),
        worst=tuple(failures[:MAX_KEPT]),
        suite=zlib.compress(_suite(record, outcomes, record.wall_s if timed else 0.0).encode()),
    )


def failing(logs: Iterable[GatedLog]) -> list[GatedLog]:
    """Return the logs that fail a build: broken first, then by worst failure."""
    return sorted((j for j in logs if j.broken or j.failed), key=lambda j: (not j.broken, -j.excess))


@dataclass(slots=True)
class Gating:
    """Gates, their baselines, and outcomes so far by report name."""

    gates: Gates
    baselines: Mapping[Path, Baseline] = field(default_factory=dict)
    logs: dict[str, GatedLog] = field(default_factory=dict)

    def judge(self, record: Record, folder: Path, timed: bool = True) -> GatedLog:
        """Judge the result of a log and write the outcome into its report.

        A log without a readable result is broken. OutputError if the report cannot be written.
        """
        outcomes: Sequence[GateOutcome] = ()
        if record.done:
            try:
                outcomes = self.outcomes(Result.load(folder / f"{record.name}.json"))
            except (LogUnreadable, UsageError) as error:
                record = replace(record, code=LogUnreadable.exit_code, message=str(error))
        report = folder / f"{record.name}.html"
        if outcomes and report.exists():
            report_gates.show(report, [(o.status, f"{o.row}: {o.check}", o.sentence) for o in outcomes])
            now = size_and_hash(report)
            if report.name in record.files and now is not None and now != record.files[report.name]:
                write_record(folder, replace(record, files=record.files | {report.name: now}))
        self.logs[record.name] = gated_log(record, outcomes, timed=timed)
        return self.logs[record.name]

    def outcomes(self, result: Result) -> list[GateOutcome]:
        """Apply the gates to a result."""
        return judge_gates(self.gates, result, self.baselines)

    def in_order(self, names: Iterable[str]) -> list[GatedLog]:
        """Return the logs of the named reports in the given order."""
        return [self.logs[n] for n in names if n in self.logs]


def read_gating(path: Path | None, strict: bool | None = None, output: Path | None = None) -> Gating | None:
    """Read gates and their baselines; ``strict`` overrides the file.

    None without a file, unless ``strict`` is true. UsageError lists all errors of the file, and baselines inside
    ``output``, because the run would compare them with themselves.
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


# JUnit XML, valid for Jenkins' junit-10.xsd: a suite a log, a test case a gate and row. ``failure``: a gate that
# failed; ``error``: a log without a result; ``skipped``: an optional gate without an answer.


def write_junit(path: Path, logs: Iterable[GatedLog]) -> None:
    """Write the JUnit file of logs. OutputError if it cannot be written."""
    with open_atomic(path, JUNIT) as file:
        file.write(b'<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="attlog">\n')
        for log in logs:
            file.write(zlib.decompress(log.suite))
        file.write(b"</testsuites>\n")


def _suite(record: Record, outcomes: Sequence[GateOutcome], seconds: float) -> str:
    log, message = record.log, record.message
    time = f' time="{seconds:.3f}"' if seconds > 0.0 else ""
    failures, skipped = (sum(o.status == status for o in outcomes) for status in ("failed", "skipped"))
    errors = record.code != 0 and not record.known
    lines = [
        f"<testsuite name={_quoted(log)} tests={_quoted(len(outcomes) + 1)} failures={_quoted(failures)}"
        f" errors={_quoted(int(errors))} skipped={_quoted(skipped + record.known)}{time}>",
        f'<properties><property name="report" value={_quoted(record.name + ".html")}/>'
        f'<property name="attlog" value={_quoted(__version__)}/></properties>',
    ]
    analysis = _problem("error", message, f"exit code {record.code}") if errors else ""
    if record.known:
        analysis = f"<skipped message={_quoted(f'as in an earlier run: {message}')}/>"
    lines.append(_case(log, ANALYSIS, analysis, time))
    in_order = sorted(outcomes, key=lambda o: (o.check, o.row))  # the same place from run to run
    return "\n".join([*lines, *(_case(log, f"{o.row}: {o.check}", _of(o)) for o in in_order), "</testsuite>\n"])


def _of(outcome: GateOutcome) -> str:
    if outcome.status == "passed":
        return ""
    if outcome.status == "skipped":
        return f"<skipped message={_quoted(outcome.sentence)}/>"
    return _problem("failure", outcome.sentence, outcome.cause or "")


def _case(log: str, name: str, inside: str, time: str = "") -> str:
    head = f"<testcase classname={_quoted(log)} name={_quoted(name)}{time}"
    return f"{head}>{inside}</testcase>" if inside else f"{head}/>"


def _problem(kind: str, message: str, type_: str) -> str:
    first = message.partition("\n")[0]
    return f"<{kind} message={_quoted(first)} type={_quoted(type_)}>{escape(NO_XML.sub('', message))}</{kind}>"


def _quoted(value: object) -> str:
    return quoteattr(NO_XML.sub("", str(value)))


# GitHub's workflow commands: annotations of files of a pull request.


def github_commands(logs: Sequence[GatedLog], root: Path | None = None) -> Iterator[str]:
    """Yield a GitHub annotation for each of the worst failures, then a count.

    The worst failure of each log comes first. ``root``: of the repository.
    """
    found = failing(logs)
    lines = [_annotation(j.log, "not analysed", j.message, root) for j in found if j.broken]
    rank = sorted((k, -o.excess, n) for n, j in enumerate(found) for k, o in enumerate(j.worst))
    for k, _, n in rank:
        outcome = found[n].worst[k]
        lines.append(_annotation(found[n].log, f"{outcome.row}: {outcome.check}", outcome.sentence, root))
    yield from lines[:MAX_ANNOTATIONS]
    total = sum(j.failed + j.broken for j in found)
    if total > MAX_ANNOTATIONS:
        rest = f"{counted(total, 'failure')} in {counted(len(found), 'log')}"
        yield (
            f"::notice title=attlog::{rest}, of which the worst {MAX_ANNOTATIONS} are marked; "
            "the reports show all of them"
        )


def _annotation(log: str, title: str, message: str, root: Path | None) -> str:
    place = _in_repository(log, root)
    file = f"file={_property(place)}," if place else ""
    text = f"{log}: {message.removeprefix(f'{log}: ')}"
    return f"::error {file}title={_property(f'attlog, {title}')}::{_message(text)}"


def _in_repository(log: str, root: Path | None) -> str:
    """Return the log's path in the repository, empty outside it."""
    try:
        return Path(log).resolve().relative_to((root or Path.cwd()).resolve()).as_posix() if Path(log).exists() else ""
    except (OSError, ValueError):
        return ""


def _message(text: str) -> str:
    escaped = "\r".join(CONTROL.sub("", part) for part in text.split("\r")).replace("%", "%25")
    return escaped.replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _message(text).replace(":", "%3A").replace(",", "%2C")


# Markdown summary, the worst first.


def summary(logs: Sequence[GatedLog]) -> str:
    """Return the Markdown summary; failures beyond the size limit are only counted."""
    found = failing(logs)
    lines = [_headline(logs, found), "", _counts(logs), ""]
    used = sum(len(line.encode()) + 1 for line in lines) + 200
    left = sum(max(j.failed, 1) for j in found)
    if found:
        lines += ["| log | row | check | what was found |", "| --- | --- | --- | --- |"]
    for line in _table(found):
        used += len(line.encode()) + 1
        if used > MAX_SUMMARY_BYTES:
            break
        lines.append(line)
        left -= 1
    if left > 0:
        lines += ["", f"... and {counted(left, 'more failure')}: the reports of these logs show them."]
    return "\n".join(lines) + "\n"


def _headline(logs: Sequence[GatedLog], found: Sequence[GatedLog]) -> str:
    if not logs:
        return "## attlog: no log"
    if not found:
        return f"## ✅ attlog: {counted(len(logs), 'log')}, no gate failed"
    return f"## ❌ attlog: {len(found)} of {counted(len(logs), 'log')} failed"


def _counts(logs: Sequence[GatedLog]) -> str:
    passed, failed, skipped, excused, broken, known = (
        sum(getattr(j, kind) for j in logs) for kind in ("passed", "failed", "skipped", "excused", "broken", "known")
    )
    parts = [f"{counted(passed, 'check')} passed", f"{failed} failed", f"{skipped} skipped"]
    parts += [f"{counted(broken, 'log')} could not be analysed"] if broken else []
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


def write_summary(text: str, path: Path | None, environment: Mapping[str, str] = os.environ) -> str:
    """Write a summary to a file and append it to ``$GITHUB_STEP_SUMMARY``.

    Returns the text if it was written nowhere, for printing. OutputError if a file cannot be written.
    """
    step = environment.get("GITHUB_STEP_SUMMARY")
    if path is not None:
        write_atomic(path, text, SUMMARY)
    if step and (path is None or path.resolve() != Path(step).resolve()):
        try:
            with open(step, "a", encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise OutputError(f"{step}: cannot be written ({error.strerror or error})") from error
    return "" if step or path is not None else text


def publish(
    logs: list[GatedLog],
    junit_file: Path | None = None,
    summary_to: Path | bool = False,
    *,
    environment: Mapping[str, str] = os.environ,
    out: TextIO | None = None,
    err: TextIO | None = None,
) -> None:
    """Publish gate results as JUnit file, Markdown summary and GitHub annotations.

    ``summary_to``: a file, or True for ``$GITHUB_STEP_SUMMARY``, else standard output. Annotations go to standard
    error. OutputError for files that cannot be written, raised after all others are written.
    """
    root = environment.get("GITHUB_WORKSPACE")
    _annotate(github_commands(logs, Path(root) if root else None), environment, err)
    wrong: list[str] = []

    def attempt(write: Callable[[], None]) -> None:
        try:
            write()
        except OutputError as error:
            wrong.append(str(error))

    if junit_file is not None:
        attempt(lambda: write_junit(junit_file, logs))
    attempt(lambda: _print_summary(summary(logs), summary_to, environment, out))
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
    """Report to CI why a run was refused before any log was read."""
    lines = why.splitlines()
    title = _property("attlog, nothing was analysed")
    _annotate((f"::error title={title}::{_message(line)}" for line in lines[:MAX_ANNOTATIONS]), environment, err)
    text = ["## ❌ attlog: nothing was analysed", "", *(f"- {escape_markdown(line)}" for line in lines), ""]
    _print_summary("\n".join(text), summary_to, environment, out)


def _annotate(lines: Iterable[str], environment: Mapping[str, str], err: TextIO | None) -> None:
    """Print GitHub workflow commands."""
    if environment.get("GITHUB_ACTIONS") == "true":
        for line in lines:
            print(line, file=err or sys.stderr)


def _print_summary(text: str, summary_to: Path | bool, environment: Mapping[str, str], out: TextIO | None) -> None:
    if summary_to is not False:
        path = summary_to if isinstance(summary_to, Path) else None
        print(write_summary(text, path, environment), end="", file=out or sys.stdout)
