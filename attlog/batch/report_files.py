"""Report and JSON file of one log, written here or in a child process."""

from __future__ import annotations

import json
import logging
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from attlog import __version__
from attlog.batch.job import Job, key, size_and_hash, stamp
from attlog.batch.log_file import require_unchanged
from attlog.core import files as file_names
from attlog.core.errors import (
    EXIT_BUG,
    LogUnreadable,
    OutputError,
    PluginError,
    PluginTimeout,
    UsageError,
    error_message,
    exit_code,
)
from attlog.core.files import is_disk_full, staging_folder
from attlog.core.own_files import REPORT, FileKind, grown_from, log_of, require_replaceable

if TYPE_CHECKING:
    from attlog.pipeline.config import Config
    from attlog.result import Result

# Pages of a batch, whose names no report may have.
RESERVED = ("index",)
# File in the scratch folder with everything that a log's process prints, also if it crashes.
PRINTED = "printed.txt"
# Loggers that report progress, and the key of their messages.
STAGES = {"attlog.stages": "stage", "attlog.compiling": "compiling"}


class ReportFiles(NamedTuple):
    """Result of a log and the files written for it."""

    result: Result
    report: Path
    json: Path


def analyze_to_files(
    log: Path,
    config: Config,
    folder: Path,
    name: str = "",
    *,
    command: str = "",
    deterministic: bool = False,
    figures: Path | None = None,
    earlier: Path | None = None,
) -> ReportFiles:
    """Analyse a log and write ``NAME.html`` and ``NAME.json`` to a folder.

    ``name``: the file's own by default. Both files are replaced together or not at all. Errors as in
    :func:`attlog.analyze`; LogUnreadable if the log changes meanwhile; OutputError if a file cannot be written.
    ``deterministic``: leave measured times out. ``figures``: path prefix of figures, written after the report, all or
    none. ``earlier``: folder of the report of an earlier run, ``folder`` by default; PluginError where no filter ran
    and it holds an answer, which is kept. The logger ``attlog.stages`` reports the stage.
    """
    from attlog.pipeline import analyze

    name = name or log.name
    report, document_path = folder / f"{name}.html", folder / f"{name}.json"
    if document_path.is_file() and (now := size_and_hash(log)) is not None:  # before filters run for minutes
        require_replaceable(document_path, kind_of_report(log, now[1], document_path))
    with require_unchanged(log):
        result = analyze(log, config, command=command)
    files = ReportFiles(result, report, document_path)
    _keep_earlier_answer(result, (earlier or folder) / files.json.name)
    logging.getLogger("attlog.stages").info("writing the report")
    kind = kind_of_report(log, result.log["sha256"], files.json)
    with staging_folder(folder, kind) as stage:
        document = result.to_json(stage / files.json.name, deterministic)
        result.to_html(stage / files.report.name, deterministic=deterministic, document=document)
    if figures is not None:
        from attlog.report.figures.files import write_figures

        logging.getLogger("attlog.stages").info("drawing the figures")
        write_figures(result, figures, kind.logs)
    return files


def kind_of_report(log: Path, sha256: str, earlier: Path) -> FileKind:
    """Return what a report of a log may replace: one of the same log, also of its beginning.

    ``earlier``: the JSON that may be there.
    """
    before = log_of(earlier) if earlier.is_file() else ""
    if before in ("", sha256):
        return REPORT.of(sha256)
    with suppress(OSError, ValueError, AttributeError):
        return REPORT.of(sha256, grown_from(log, json.loads(earlier.read_bytes()).get("log")))
    return REPORT.of(sha256)


def _keep_earlier_answer(result: Result, earlier: Path) -> None:
    """Raise PluginError if no filter ran where an earlier report has one that did."""
    from attlog.result import TIMED_OUT, Result, nothing_ran

    if not (failed := nothing_ran(result.estimators)):
        return
    with suppress(LogUnreadable, UsageError):
        if not nothing_ran(Result.load(earlier).estimators):
            timed_out = any(finding.kind == TIMED_OUT for finding in result.findings)
            raise (PluginTimeout if timed_out else PluginError)(
                f"no filter ran: {failed}; the report of an earlier run, {earlier.with_suffix('.html')}, is kept"
            )


def report_names(logs: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """Return a report name for each log: its file name, numbered if ``taken``.

    Names that differ in case only count as equal, as on some file systems; see :mod:`attlog.core.files`.
    """
    return file_names.file_names(map(str, logs), (*RESERVED, *taken))


def figure_starts(folder: Path, logs: Iterable[str]) -> list[Path]:
    """Return the path prefix of each log's figures, numbered if taken."""
    stems = [Path(name.removesuffix(".gz")).stem or name for name in map(str, logs)]
    return [folder / name for name in file_names.file_names(stems)]


class MessageHandler(logging.Handler):
    """Pass progress of loggers to a function."""

    def __init__(self, on_message: Callable[[dict[str, Any]], None]) -> None:
        super().__init__(logging.INFO)
        self._on_message = on_message

    def emit(self, record: logging.LogRecord) -> None:
        self._on_message({STAGES[record.name]: record.getMessage()})


@contextmanager
def messages_to(on_message: Callable[[dict[str, Any]], None]) -> Iterator[None]:
    """Pass stages and compilation messages to ``on_message``, and nowhere else."""
    loggers = [logging.getLogger(name) for name in STAGES]
    before = [(logger.handlers, logger.propagate, logger.level) for logger in loggers]
    for logger in loggers:
        logger.handlers, logger.propagate = [MessageHandler(on_message)], False
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, (handlers, propagate, level) in zip(loggers, before, strict=True):
            logger.handlers, logger.propagate = handlers, propagate
            logger.setLevel(level)


def load_shared(specs: list[str], *, on_message: Callable[[dict[str, Any]], None]) -> None:
    """Load filters and the page's script into this process, from which log processes are forked.

    Errors are ignored here, because the log's process meets and reports them too.
    """
    from attlog.pipeline.replay import preload
    from attlog.report.bundle import bundle

    with messages_to(on_message), suppress(Exception):
        preload(specs)
    with suppress(Exception):
        bundle()


def process_log(job: Job, scratch: Path, *, on_message: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Analyse a log to files in ``scratch / "out"`` and return its record fields.

    Errors are returned in these fields too. Output of the process goes to :data:`PRINTED`.
    """
    from attlog.batch.index_row import index_row
    from attlog.core.workers import write_output_to

    write_output_to(scratch / PRINTED)
    content, sign, out = "", "", scratch / "out"
    try:
        with suppress(LogUnreadable):  # a server that fails now may answer the download
            sign = stamp(job.source)  # before the content is read, so that a later change is noticed
        with messages_to(on_message), require_unchanged(Path(job.source.place)), job.source.local(scratch) as log:
            content = log.sha256
            files = analyze_to_files(
                log.path,
                job.config,
                out,
                job.name,
                command=job.command,
                deterministic=job.deterministic,
                figures=job.figures,
                earlier=job.folder,
            )
        return {
            "key": key(content, job.settings),
            "stamp": sign,
            "row": index_row(files.result),
            "files": {path.name: size_and_hash(path) for path in (files.report, files.json)},
        }
    except Exception as error:
        code = exit_code(error)
        return {
            "key": key(content, job.settings) if content and not isinstance(error, LogUnreadable) else "",
            "code": code,
            "message": error_message(error, __version__, job.source.name).replace(str(out), str(job.folder)),
            "trace": "".join(traceback.format_exception(error)) if code == EXIT_BUG else "",
            "folder_full": isinstance(error, OutputError) and is_disk_full(error.__cause__),
        }
