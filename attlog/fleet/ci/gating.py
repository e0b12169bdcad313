"""Gates over a run of many logs, judged as results come; what they say of a log is small enough for ten thousand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from attlog.base.errors import LogUnreadable, UsageError
from attlog.compare.gates import baseline
from attlog.compare.gates import file as gate_file
from attlog.compare.gates.baseline import Baseline
from attlog.compare.gates.gates import Gates, judge
from attlog.compare.gates.outcome import GateOutcome, worst_first
from attlog.fleet.ci import junit
from attlog.fleet.records.record import Record, write_record, written
from attlog.report import gates
from attlog.result import Result

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
    suite: junit.Suite | None = None

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
        suite=junit.suite(log, name, outcomes, code, message, seconds, known),
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
        outcomes = judge(self.gates, found, self.baselines)
        self.logs[name] = gated(log, name, outcomes, seconds=seconds)
        if report is not None and outcomes:
            gates.show(report, [(o.status, f"{o.row}: {o.check}", o.sentence) for o in outcomes])
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
    found = gate_file.read(path)
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
    return Gating(found, baseline.read_all(places))


def _overlap(one: Path, other: Path) -> bool:
    return one.is_relative_to(other) or other.is_relative_to(one)
