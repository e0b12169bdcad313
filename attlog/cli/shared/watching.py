"""``attlog batch --watch``: a service that ends when it is asked to, and says what it does a line at a time."""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import typer

from attlog.base.errors import INTERRUPTED
from attlog.cli.shared.common import to_stderr
from attlog.cli.shared.signals import ended_by_signals

if TYPE_CHECKING:
    from attlog.fleet.records.entry import Entry
    from attlog.fleet.records.plan import Job
    from attlog.fleet.records.record import Record
    from attlog.fleet.records.work import Work
    from attlog.fleet.schedulers.batch import Judge, Watcher
    from attlog.fleet.schedulers.local import Runner
    from attlog.fleet.sources.source import Source


def watching(
    places: Sequence[str],
    job: Job,
    run: Runner,
    told: Watcher,
    settle: float,
    commands: Callable[[list[str]], Sequence[str]],
    at_a_time: int,
    quiet: bool = False,
    judge: Judge | None = None,
) -> None:
    """Watch until a signal comes. Exit code 0 after SIGTERM, which is how services end, 130 after Ctrl-C.

    ``at_a_time``: see :func:`attlog.fleet.schedulers.watch.watch`.
    """
    from attlog.fleet.schedulers.arrivals import Arrivals
    from attlog.fleet.schedulers.watch import watch
    from attlog.present.numbers import counted

    arrivals = Arrivals(places, settle, job.folder)
    lines = _Lines(told, quiet)
    lines.say(f"watching {', '.join(places)}; reports and index in {job.folder}")
    with ended_by_signals() as received:
        outcome = watch(
            job, arrivals, run, lines, at_a_time, judge, lambda sources: commands([source.name for source in sources])
        )
    reports = sum(entry.row is not None for entry in outcome.entries)
    held = f"{counted(reports, 'report')} of {counted(outcome.total, 'log')} in {job.folder}"
    lines.say(f"ended; {held}; the next start goes on from here")
    if received != [signal.SIGTERM]:
        raise typer.Exit(INTERRUPTED)


class _Lines:
    """A line on standard error for each log that is done, has failed or was known."""

    def __init__(self, told: Watcher, quiet: bool) -> None:
        self._told, self._quiet = told, quiet

    def planned(self, works: Sequence[Work]) -> None:
        """Logs have arrived."""
        self.say(f"{len(works)} arrived: {', '.join(work.name for work in works[:5])}{' ...' * (len(works) > 5)}")

    def finished(self, record: Record, entry: Entry) -> None:
        """One is done or has failed."""
        self._told.finished(record, entry)

    def same(self, source: Source, as_log: str) -> None:
        """One has the content of another."""
        self.say(f"{source.name}: is {as_log} under another name; not analysed again")

    def say(self, text: str) -> None:
        """A line, unless only errors are wanted."""
        if not self._quiet:
            to_stderr(f"attlog: {text}")
