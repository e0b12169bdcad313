"""``attlog batch``: many logs into one folder with an index; interrupted at any point it goes on where it was."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog import __version__
from attlog.base.errors import INTERRUPTED, UsageError, exit_code, message, worst
from attlog.cli.shared import gates as gated
from attlog.cli.shared import options
from attlog.cli.shared.printing import Boot, NoColor, Places, Quiet, System, Verbose, console, finite, say, to_stderr
from attlog.cli.shared.process import ended_by_signals
from attlog.cli.shared.progress import Bar

if TYPE_CHECKING:
    from attlog.fleet.records.entry import Entry
    from attlog.fleet.records.record import Record
    from attlog.fleet.records.work import Work
    from attlog.fleet.schedulers.batch import Outcome
    from attlog.fleet.schedulers.local import Runner, Tell

TIMEOUT_S = 3600.0
"""A log may take this long: no log in hand takes a hundredth of it, and one that hangs costs one worker an hour."""


def command(
    context: typer.Context,
    logs: Places,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", show_default=False, help="Folder of the batch.")
    ],
    workers: Annotated[
        int | None,
        typer.Option("-j", "--workers", metavar="N", min=1, help="Logs at a time. [default: one for each core]"),
    ] = None,
    timeout: Annotated[
        float,
        typer.Option(
            "--timeout", metavar="S", min=0.0, callback=finite, help="Give up on a log after so long; 0: never."
        ),
    ] = TIMEOUT_S,
    memory: Annotated[
        float | None,
        typer.Option(
            "--memory",
            metavar="MB",
            min=1.0,
            callback=finite,
            help="Give up on a log that needs more memory. [default: no limit]",
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the batch in DIR: what is done and unchanged stays.")
    ] = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Remove the reports of the batch in DIR and begin again.")
    ] = False,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler",
            metavar="tcp://HOST:PORT",
            help="Work on the Dask cluster of this scheduler; --workers: tasks at a time. [default: on this machine]",
        ),
    ] = None,
    estimators: options.Estimators = None,
    imu: options.ImuOption = None,
    mag: options.MagOption = None,
    reference: options.ReferenceOption = None,
    window: options.Window = None,
    score_from: options.ScoreFrom = None,
    clock: options.Clock = None,
    declination: options.Declination = None,
    trim: options.Trim = None,
    input_delay: options.InputDelay = None,
    gyro_bias: options.GyroBias = None,
    params: options.Params = None,
    config: options.ConfigFile = None,
    plotly: options.Plotly = "inline",
    deterministic: options.Deterministic = False,
    boot: Boot = None,
    system: System = None,
    gates: gated.GatesFile = None,
    strict: gated.Strict = None,
    junit: gated.Junit = None,
    summary: gated.Summary = None,
    filter_timeout: options.FilterTimeout = None,
    no_color: NoColor = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Analyse many logs into the folder DIR: a report each, an index, a table of every number."""
    if resume and fresh:
        raise UsageError("--resume and --fresh: one or the other")
    held = gated.Gated(gates, strict, junit, summary, output)
    settings = options.settings(
        config,
        estimators=estimators,
        imu=imu,
        mag=mag,
        reference=reference,
        window=window,
        score_from=score_from,
        clock=clock,
        declination=declination,
        trim=trim,
        input_delay=input_delay,
        gyro_bias=gyro_bias,
        params=params,
        boot=boot,
        system=system,
    )
    from attlog.fleet.records.plan import Job
    from attlog.fleet.schedulers.batch import run_batch
    from attlog.fleet.sources.find import sources

    judge = held.judge(output, deterministic)
    found, wrong = sources(logs)
    for error in wrong:
        to_stderr(message(error, __version__))
    codes, names = {exit_code(error) for error in wrong}, list[str]()
    if found:
        job = Job(
            found,
            output,
            settings,
            options.commands(context, [source.name for source in found]),
            options.bundle(plotly),
            deterministic,
            timeout or None,
            memory,
            resume,
            fresh,
        )
        with ended_by_signals(), Bar(quiet, verbose > 0) as bar:
            told = _Told(bar, quiet, verbose)
            outcome = run_batch(job, runner(scheduler, workers, told.say, bar.heard), told, judge)
        codes |= outcome.codes
        _say(outcome, output, quiet)
        names = [entry.name for entry in outcome.entries]
    codes |= held.finish(names, wrong, interrupted=INTERRUPTED in codes)
    if worst(codes):
        raise typer.Exit(worst(codes))


def runner(scheduler: str | None, workers: int | None, say: Callable[[str], None], heard: Tell | None = None) -> Runner:
    """Where the work is done."""
    if scheduler is None:
        from attlog.fleet.schedulers.local import here

        return here(workers, heard)
    from attlog.fleet.schedulers.cluster import there

    return there(scheduler, workers, say)


class _Told:
    """Says how a batch goes: a bar, and a line for each log that fails (with -v for each log)."""

    def __init__(self, bar: Bar, quiet: bool, verbose: int) -> None:
        self._bar, self._quiet, self._verbose = bar, quiet, verbose

    def planned(self, works: Sequence[Work]) -> None:
        """Nothing is done yet."""
        self._bar.planned(works)

    def finished(self, record: Record, entry: Entry) -> None:
        """One more."""
        self._bar.advance(record)
        lines = [f"attlog: {record.log}: gate: {sentence}" for sentence in entry.gates]
        if not record.done:
            if not record.known or self._verbose:
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


def _say(outcome: Outcome, folder: Path, quiet: bool) -> None:
    """The summary, and why not all logs were reached."""
    from attlog.cli.shared.printing import Line
    from attlog.fleet.pages.summary import summary

    if not quiet:
        out = console()
        first, *others = summary(
            outcome.entries, outcome.total, outcome.seconds, folder, outcome.again, width=out.width
        )
        say([Line(first, "bold"), *map(Line, others)], out)
        if outcome.entries:
            say([Line(f"index: {folder / 'index.html'}")], out)
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
