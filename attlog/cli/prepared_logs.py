"""The logs of ``sweep`` and ``tune``: prepared one after the other, and what is said of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from attlog import __version__
from attlog.cli.arguments import command_line
from attlog.cli.options import ComparisonOptions, for_comparison
from attlog.cli.printing import to_stderr
from attlog.core.errors import AttlogError, UsageError, error_message, exit_code, worst_exit_code

if TYPE_CHECKING:
    from attlog.metrics.metric import Case
    from attlog.pipeline.config import Config


def one_unit(options: ComparisonOptions) -> Config:
    """The configuration in which logs are prepared. UsageError where it asks for every IMU."""
    found = for_comparison(options)
    if found.imu == "all":
        raise UsageError("imu = all: settings are compared on one unit; name it or leave it to the log")
    return found


def all_problems(*checks: Callable[[], object]) -> None:
    """UsageError with everything that these say is wrong."""
    wrong = []
    for check in checks:
        try:
            check()
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))


TELEMETRY = ".tlog"
"""Logs of a radio come last: of one flight they have the slower IMU, and the first log of a flight counts."""


class PreparedLogs:
    """Logs made ready one after the other; what is wrong with one is said as it comes and kept in ``errors``.

    Of several logs of one flight the first is given, and the others are named on standard error.
    """

    def __init__(self, paths: Sequence[Path], settings: Config) -> None:
        from attlog.batch.sources import find

        self._settings = settings
        self._logs, self.errors = find(paths)
        self._logs.sort(key=lambda path: path.suffix.lower() == TELEMETRY)
        self._summaries: list[dict[str, Any]] = []

    def __iter__(self) -> Iterator[Case]:
        """The cases; the first error is raised after the last log if there was none."""
        from attlog.compare.same_flight import FlightTrack, flight_track, repeat_warning, same_flight
        from attlog.pipeline import prepare

        late = list(self.errors)
        tracks: list[FlightTrack] = []
        for log in self._logs:
            try:
                case = prepare(log, self._settings)
            except AttlogError as error:
                self.errors.append(error)
                late.append(error)
                continue
            for wrong in late:
                to_stderr(error_message(wrong, __version__))
            late.clear()
            about = _about_log(case)
            track = flight_track(case.log, about["name"], about["sha256"])
            if same := next((other for other in tracks if same_flight(track, other)), None):
                to_stderr(f"attlog: {repeat_warning(track.name, same.name)}")
                continue
            tracks.append(track)
            self._summaries.append(about)
            yield case
            del case
        for wrong in late if self._summaries else late[1:]:
            to_stderr(error_message(wrong, __version__))
        if not self._summaries:
            raise self.errors[0]

    def about(self) -> dict[str, Any]:
        """What a JSON says of the version, the command and the logs."""
        from attlog.core.machine import versions

        settings = self._settings.resolved()
        return {"attlog": versions(), "command": command_line(), "config": settings, "logs": self._summaries}


def _about_log(case: Case) -> dict[str, Any]:
    from attlog.pipeline.evaluation import summarize
    from attlog.pipeline.summary import sha256

    log = case.log
    return {
        "name": log.path.name,
        "sha256": sha256(log.path),
        "vehicle": log.vehicle,
        "firmware": log.firmware.version,
        "reference": case.reference.kind,
        "reference_text": summarize(case.reference).text,
    }


def end(errors: Sequence[AttlogError]) -> None:
    """End with the exit code of what went wrong with some logs, if anything did."""
    code = worst_exit_code(exit_code(error) for error in errors)
    if code:
        raise typer.Exit(code)


def stem(command: str, filter_name: str) -> str:
    """The name of the files of a command: its own and the filter's."""
    return f"{command}-{re.sub(r'[^A-Za-z0-9._-]+', '-', Path(filter_name).name)}"
