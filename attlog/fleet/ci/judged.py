"""What the gates said of one log, small enough to be kept for ten thousand of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from attlog.compare.gates.gates import GateOutcome, worst_first
from attlog.fleet.ci import junit

MOST_KEPT = 50
"""Failures kept of one log, the worst first; all of them are counted and stand in the JUnit file."""


@dataclass(frozen=True, slots=True)
class Judged:
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


def judged(
    log: str,
    name: str,
    outcomes: Sequence[GateOutcome] = (),
    *,
    code: int = 0,
    message: str = "",
    known: bool = False,
    seconds: float = 0.0,
) -> Judged:
    """A log with what gates said of it; ``name`` is that of its report, ``seconds`` what its analysis took."""
    count = {status: sum(o.status == status for o in outcomes) for status in ("passed", "failed", "skipped")}
    failures = [o for o in worst_first(outcomes) if o.status == "failed"]
    return Judged(
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


def failing(logs: Iterable[Judged]) -> list[Judged]:
    """Logs that make a build fail: broken ones first, then by their worst failure."""
    return sorted((j for j in logs if j.broken or j.failed), key=lambda j: (not j.broken, -_excess(j)))


def _excess(log: Judged) -> float:
    return max((o.excess for o in log.worst), default=0.0)
