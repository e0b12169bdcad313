"""Logs of a command: found by their names, worked on one by one, what goes wrong as messages and exit codes."""

from __future__ import annotations

import os
import re
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from attlog import __version__
from attlog.cli.arguments import command_line
from attlog.cli.options import ComparisonOptions, for_comparison
from attlog.cli.printing import to_stderr
from attlog.cli.process import is_of_a_stream
from attlog.core.errors import EXIT_BUG, AttlogError, UsageError, error_message, exit_code, worst_exit_code

if TYPE_CHECKING:
    from attlog.batch.sources import Source
    from attlog.metrics.metric import Case
    from attlog.pipeline.config import Config

TELEMETRY = ".tlog"


def named_sources(places: Sequence[str], codes: set[int]) -> tuple[list[Source], list[AttlogError]]:
    """Find the logs of names, also in archives and behind URLs; what is wrong is printed and gives exit codes."""
    from attlog.batch.sources import sources

    found, wrong = sources(places)
    _refuse_filters([source.place for source in found])
    return found, _report_unreadable(wrong, codes)


def named_files(places: Sequence[Path], codes: set[int]) -> list[Path]:
    """Find the log files of names; what is wrong is printed and gives exit codes."""
    from attlog.batch.sources import find

    found, wrong = find(places)
    _refuse_filters(map(str, found))
    _report_unreadable(wrong, codes)
    return found


def _refuse_filters(places: Iterable[str]) -> None:
    """Raise UsageError for a filter among the logs: ``--estimators mahony mekf``."""
    missing = [place for place in places if re.match(r"[a-z]\w*(@|:|$)", place) and not os.path.lexists(place)]
    if not missing:
        return
    from attlog.estimators import names

    for word in missing:
        if re.split("[@:]", word, maxsplit=1)[0] in (*names(), "default", "all"):
            raise UsageError(f"{word}: is a filter, not a log; list filters with commas: --estimators NAME,{word}")


def _report_unreadable(wrong: list[AttlogError], codes: set[int]) -> list[AttlogError]:
    for error in wrong:
        to_stderr(error_message(error, __version__))
    codes |= {exit_code(error) for error in wrong}
    return wrong


def one_log(path: Path) -> Path:
    """Return the one log that a name means, which may be a folder or a pattern."""
    from attlog.batch.sources import find

    logs, wrong = find([path])
    if wrong:
        raise wrong[0]
    if len(logs) > 1:
        names = ", ".join(p.name for p in logs[:3])
        raise UsageError(f"{path}: {len(logs)} logs; this command takes one ({names} ...)")
    return logs[0]


@contextmanager
def run_and_report(log: str, codes: set[int], verbose: int) -> Iterator[None]:
    """Work on one log: an error is printed and gives an exit code, and other logs go on."""
    try:
        yield
    except Exception as error:
        codes.add(report_error(error, log, verbose))


def report_error(error: Exception, log: str, verbose: int) -> int:
    """Print what went wrong with a log, with -vv the traceback of a bug; return its exit code."""
    if is_of_a_stream(error):
        raise error
    if verbose > 1 and exit_code(error) == EXIT_BUG:
        to_stderr("".join(traceback.format_exception(error)))
    to_stderr(error_message(error, __version__, log))
    return exit_code(error)


def end_command(codes: Iterable[int | AttlogError]) -> None:
    """End the command with the worst exit code of codes or errors, if any."""
    if code := worst_exit_code(code if isinstance(code, int) else exit_code(code) for code in codes):
        raise typer.Exit(code)


def parse_all(*parsers: Callable[[], Any]) -> list[Any]:
    """Return the results of parsers; raise one UsageError with everything that is wrong."""
    found, wrong = [], []
    for parse in parsers:
        try:
            found.append(parse())
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    return found


def file_stem(command: str, filter_name: str) -> str:
    """Return the name of a command's files: its own and the filter's."""
    return f"{command}-{re.sub(r'[^A-Za-z0-9._-]+', '-', Path(filter_name).name)}"


class PreparedLogs:
    """Logs of ``sweep`` and ``tune``, prepared one after the other; errors are printed as they come.

    Of several logs of one flight only the first counts; telemetry, whose IMU is slower, comes last.
    """

    def __init__(
        self, paths: Sequence[Path], options: ComparisonOptions, check: Callable[[Case], object] | None = None
    ) -> None:
        """``check``: raises AttlogError for a log on which nothing can be studied."""
        from attlog.batch.sources import find

        self._settings: Config = for_comparison(options)
        if self._settings.imu == "all":
            raise UsageError("imu = all: settings are compared on one unit; name it or leave it to the log")
        self._check = check
        self._logs, self.errors = find(paths)
        self._logs.sort(key=lambda path: path.suffix.lower() == TELEMETRY)
        self._summaries: list[dict[str, Any]] = []

    def __iter__(self) -> Iterator[Case]:
        """Yield the cases; if there is none, the first error is raised after the last log."""
        from attlog.compare.same_flight import FlightTrack, flight_track, repeat_warning, same_flight
        from attlog.pipeline import prepare

        late = list(self.errors)
        tracks: list[FlightTrack] = []
        for log in self._logs:
            try:
                case = prepare(log, self._settings)
                if self._check is not None:
                    self._check(case)
            except AttlogError as error:
                self.errors.append(error)
                late.append(error)
                continue
            _report_unreadable(late, set())
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
        _report_unreadable(late if self._summaries else late[1:], set())
        if not self._summaries:
            raise self.errors[0]

    def about(self) -> dict[str, Any]:
        """Return version, command, configuration and logs for a JSON file."""
        from attlog.core.machine import versions

        settings = self._settings.resolved()
        return {"attlog": versions(), "command": command_line(), "config": settings, "logs": self._summaries}


def _about_log(case: Case) -> dict[str, Any]:
    from attlog.core.files import sha256
    from attlog.pipeline.evaluation import summarize

    log = case.log
    return {
        "name": log.path.name,
        "sha256": sha256(log.path),
        "vehicle": log.vehicle,
        "firmware": log.firmware.version,
        "reference": case.reference.kind,
        "reference_text": summarize(case.reference).text,
    }
