"""Gates over a run of many logs: judged as results come, told together at the end."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TextIO

from attlog.base.errors import LogUnreadable, OutputError, UsageError
from attlog.compare.gates import baseline
from attlog.compare.gates import file as gate_file
from attlog.compare.gates.baseline import Baseline
from attlog.compare.gates.gates import Gates, judge
from attlog.fleet.ci import gate_summary, github, junit
from attlog.fleet.ci.judged import Judged, judged
from attlog.fleet.records.record import Record, write_record, written
from attlog.report import gates
from attlog.result import Result


@dataclass(slots=True)
class Gating:
    """Gates with what they look into, and what they said of each log so far, by the name of its report."""

    gates: Gates
    baselines: Mapping[Path, Baseline] = field(default_factory=dict)
    logs: dict[str, Judged] = field(default_factory=dict)

    def result(self, log: str, name: str, found: Result, seconds: float = 0.0, report: Path | None = None) -> Judged:
        """Judge the result of a log; ``name``: of its report. Shown in the file ``report``.

        OutputError if that cannot be written.
        """
        outcomes = judge(self.gates, found, self.baselines)
        self.logs[name] = judged(log, name, outcomes, seconds=seconds)
        if report is not None and outcomes:
            gates.show(report, [(o.status, f"{o.row}: {o.check}", o.sentence) for o in outcomes])
        return self.logs[name]

    def file(self, log: str, name: str, path: Path, seconds: float = 0.0, report: Path | None = None) -> Judged:
        """Judge the JSON file of a log's result. A file that cannot be read is an error of the log, never passed."""
        try:
            found = Result.load(path)
        except (LogUnreadable, UsageError) as error:
            return self.broken(log, name, LogUnreadable.exit_code, str(error))
        return self.result(log, name, found, seconds, report)

    def record(self, record: Record, folder: Path, timed: bool = True) -> Judged:
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

    def broken(self, log: str, name: str, code: int, message: str, seconds: float = 0.0, known: bool = False) -> Judged:
        """A log without a result; ``code``: what its analysis ended with; ``known``: as in an earlier run."""
        self.logs[name] = judged(log, name, code=code, message=message, known=known, seconds=seconds)
        return self.logs[name]

    def in_order(self, names: Iterable[str] | None = None) -> list[Judged]:
        """What was said, in the order of these reports, else as it came."""
        return list(self.logs.values()) if names is None else [self.logs[n] for n in names if n in self.logs]


def gating(path: Path | None, strict: bool | None = None, output: Path | None = None) -> Gating | None:
    """The gates of a file, read with their baselines; ``strict`` has the last word. None where nothing is asked.

    UsageError tells everything that is wrong in the file, and every baseline that cannot be used: one that the run
    writes to (``output``, a folder) would be compared with itself.
    """
    if path is None:
        return Gating(Gates((), True)) if strict else None
    found = gate_file.read(path)
    if strict is not None:
        found = Gates(found.gates, strict)
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
    return Gating(found, baseline.read_all(places))


def tell_refused(
    why: str,
    summary: Path | bool = False,
    *,
    environment: Mapping[str, str] = os.environ,
    out: TextIO | None = None,
    err: TextIO | None = None,
) -> None:
    """What CI systems read of a run that was refused for its gates or options: else its step is red without a word."""
    if github.on_github(environment):
        for line in github.refused(why):
            print(line, file=err or sys.stderr)
    if summary is not False:
        path = summary if isinstance(summary, Path) else None
        print(gate_summary.publish(gate_summary.not_run(why), path, environment), end="", file=out or sys.stdout)


def _overlap(one: Path, other: Path) -> bool:
    return one.is_relative_to(other) or other.is_relative_to(one)


def tell(
    logs: list[Judged],
    junit_file: Path | None = None,
    summary: Path | bool = False,
    *,
    environment: Mapping[str, str] = os.environ,
    out: TextIO | None = None,
    err: TextIO | None = None,
) -> None:
    """What CI systems read: a JUnit file, a Markdown summary, and on GitHub annotations (on standard error).

    ``summary``: a file, or True for ``$GITHUB_STEP_SUMMARY`` where it is set, else standard output. OutputError for a
    file that cannot be written; the others are written all the same.
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
    if summary is not False:
        try:
            text = gate_summary.write(logs, summary if isinstance(summary, Path) else None, environment)
            print(text, end="", file=out or sys.stdout)
        except OutputError as error:
            wrong.append(str(error))
    if wrong:
        raise OutputError("\n".join(wrong))
