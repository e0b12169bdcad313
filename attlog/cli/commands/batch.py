"""``attlog batch``: many logs into one folder with an index; interrupted at any point it goes on where it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog.cli.gates import GateOptions, GateReport
from attlog.cli.logs import end, named_sources
from attlog.cli.options import CommonOptions, JobsOfCores, LogOptions, Places, commands, configured, finite
from attlog.cli.printing import TextLine, console, say, to_stderr
from attlog.cli.process import ended_by_signals
from attlog.cli.progress import Bar, compile_first
from attlog.core.errors import EXIT_INTERRUPTED, UsageError

if TYPE_CHECKING:
    from attlog.batch.index_row import Entry
    from attlog.batch.job import Record, Work
    from attlog.batch.run import Outcome, Runner

TIMEOUT_S = 3600.0
"""A log may take this long: no log in hand takes a hundredth of it, and one that hangs costs one worker an hour."""


@dataclass(frozen=True, slots=True)
class BatchOptions:
    """Where and under which limits the logs are worked on, and what becomes of an earlier batch in the folder."""

    jobs: JobsOfCores = None
    timeout: Annotated[
        float, typer.Option(metavar="S", min=0.0, callback=finite, help="Give up on a log after so long; 0: never.")
    ] = TIMEOUT_S
    memory: Annotated[
        float | None,
        typer.Option(
            metavar="MB", min=1.0, callback=finite, help="Give up on a log that needs more memory. [default: no limit]"
        ),
    ] = None
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the batch in DIR: what is done and unchanged stays.")
    ] = False
    fresh: Annotated[bool, typer.Option("--fresh", help="Remove the reports of the batch in DIR and begin again.")] = (
        False
    )
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT",
            help="Work on the Dask cluster of this scheduler; --jobs: tasks at a time. [default: on this machine]",
        ),
    ] = None

    def __post_init__(self) -> None:
        if self.resume and self.fresh:
            raise UsageError("--resume and --fresh: one or the other")

    def runner(self, progress: BatchProgress, bar: Bar) -> Runner:
        """What does the work."""
        if self.scheduler is None:
            from attlog.batch.run import local_runner

            return local_runner(self.jobs, bar.stage)

        from attlog.batch.cluster import cluster_runner

        return cluster_runner(self.scheduler, self.jobs, progress.say)


def command(
    logs: Places,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", show_default=False, help="Write the batch to this folder.")
    ],
    batch: BatchOptions,
    options: LogOptions,
    gate_options: GateOptions,
    common: CommonOptions,
) -> None:
    """Analyse many logs into one folder with an index.

    The folder gets a report for each log and a table of every number.
    Each log has a process of its own. An interrupted batch goes on with --resume.

    Example: attlog batch flights/ -o out --resume
    """
    gates = GateReport(gate_options, output)
    settings = configured(options)
    from attlog.batch.run import Job, run_batch

    judge = gates.judge(output, options.deterministic)
    codes, names = set[int](), list[str]()
    found, wrong = named_sources(logs, codes)
    if found:
        job = Job(
            found,
            output,
            settings,
            commands(options, [source.name for source in found]),
            deterministic=options.deterministic,
            timeout=batch.timeout or None,
            memory=batch.memory,
            resume=batch.resume,
            fresh=batch.fresh,
        )
        compile_first(settings.estimators, common.quiet)
        with ended_by_signals(), Bar(common.quiet, common.verbose > 0) as bar:
            progress = BatchProgress(bar, common.verbose)
            outcome = run_batch(job, batch.runner(progress, bar), progress, judge)
        codes |= outcome.codes
        _say_outcome(outcome, output, common.quiet)
        names = [entry.name for entry in outcome.entries]
    end(codes | gates.finish(names, wrong, interrupted=EXIT_INTERRUPTED in codes))


class BatchProgress:
    """How a batch goes: a bar, and a line for each log that fails (with -v for each log).

    Where a bar is shown it counts what fails; why, by reason, stands in the summary below it.
    """

    def __init__(self, bar: Bar, verbose: int) -> None:
        self._bar, self._verbose = bar, verbose

    def planned(self, works: Sequence[Work]) -> None:
        """Nothing is done yet."""
        self._bar.planned(works)

    def finished(self, record: Record, entry: Entry) -> None:
        """One more."""
        self._bar.advance(record)
        lines = [f"attlog: {record.log}: gate: {sentence}" for sentence in entry.gates]
        if not record.done:
            if self._verbose or not (record.known or self._bar.is_shown):
                lines.append(record.trace * (self._verbose > 1) + record.message)
        elif self._verbose:
            how = "done before" if record.again else f"{record.wall_s:.1f} s, {record.peak_mb:.0f} MB"
            lines.append(f"{record.log}: {how}")
        if lines:
            self.say("\n".join(lines))

    def say(self, text: str) -> None:
        """A message beside the bar."""
        with self._bar.aside():
            to_stderr(text)


def _say_outcome(outcome: Outcome, folder: Path, quiet: bool) -> None:
    """The summary, and why not all logs were reached."""
    from attlog.batch.order import summary

    if not quiet:
        out = console()
        first, *others = summary(
            outcome.entries, outcome.total, outcome.seconds, folder, outcome.again, width=out.width
        )
        say([TextLine(first, "bold"), *others], out)
        if outcome.entries:
            say([f"index: {folder / 'index.html'}"], out)
    if outcome.lost:
        to_stderr(f"attlog: {outcome.lost}")
    if outcome.stopped:
        left = outcome.total - len(outcome.entries)
        to_stderr(
            f"attlog: stopped: {outcome.stopped}, {left} of {outcome.total} logs were not reached; "
            "--resume goes on when there is room"
        )
    if outcome.interrupted:
        reports = sum(entry.row is not None for entry in outcome.entries)
        to_stderr(f"attlog: interrupted; {reports} of {outcome.total} reports are in {folder}; --resume goes on")
