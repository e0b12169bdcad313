"""One log to files: the report, the JSON, what both are called, and the same as the work of a process of its own."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from attlog import __version__
from attlog.batch.job import Work, key, stamp, written
from attlog.batch.log_file import unchanged
from attlog.core import files as file_names
from attlog.core.errors import EXIT_BUG, LogUnreadable, OutputError, error_message, exit_code
from attlog.core.files import is_disk_full, staging_folder

if TYPE_CHECKING:
    from attlog.pipeline.config import Config
    from attlog.result import Result

RESERVED = ("index",)
"""Names that the pages of a batch have."""
PRINTED = "printed.txt"
"""In the scratch folder of a log's process: all that it prints, also when it crashes."""
STAGES = {"attlog.stages": "stage", "attlog.compiling": "compiling"}
"""Loggers that say what is being done, and what they say it as."""


@dataclass(frozen=True, slots=True)
class ReportFiles:
    """What was found out about a log, and the files it stands in."""

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
) -> ReportFiles:
    """Analyse a log and write ``NAME.html`` and ``NAME.json`` to a folder; ``name`` is the file's own by default.

    Both files appear whole or the old ones stay, and nothing is written of a log that fails.
    Errors as in :func:`attlog.analyze`; LogUnreadable where the log changed meanwhile; OutputError if a file cannot
    be written.
    ``deterministic`` leaves measured times out of both files. ``figures``: how the paths of figures begin that are
    written after the report, all of them or none; a report stays where they fail. The logger ``attlog.stages`` tells
    the stage.
    """
    from attlog.pipeline import analyze

    name = name or log.name
    with unchanged(log):
        result = analyze(log, config, command=command)
    files = ReportFiles(result, folder / f"{name}.html", folder / f"{name}.json")
    logging.getLogger("attlog.stages").info("writing the report")
    document = result.to_dict(deterministic)  # large: made once for both
    with staging_folder(folder) as stage:
        result.to_html(stage / files.report.name, deterministic=deterministic, document=document)
        result.to_json(stage / files.json.name, whole=document)
    if figures is not None:
        from attlog.report.figures.files import write_figures

        logging.getLogger("attlog.stages").info("drawing the figures")
        write_figures(result, figures)
    return files


def report_names(logs: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """The name of each log's report: its file name with suffix; a second of the same name gets a number.

    Names that differ in case alone count as the same: some file systems do not tell them apart; what a file system
    or a terminal may stumble over is replaced (:mod:`attlog.core.files`). ``taken`` are names of other
    reports in the folder.
    """
    return file_names.file_names(map(str, logs), (*RESERVED, *taken))


def figure_starts(folder: Path, logs: Iterable[str]) -> list[Path]:
    """How the paths of each log's figures begin: the log's name without its suffixes, a second one with a number."""
    stems = [Path(name.removesuffix(".gz")).stem or name for name in map(str, logs)]
    return [folder / name for name in file_names.file_names(stems)]


class MessageHandler(logging.Handler):
    """Hands on what loggers say is being done."""

    def __init__(self, tell: Callable[[dict[str, Any]], None]) -> None:
        super().__init__(logging.INFO)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell({STAGES[record.name]: record.getMessage()})


@contextmanager
def messages_to(tell: Callable[[dict[str, Any]], None]) -> Iterator[None]:
    """A block in which stages and what is compiled are handed on, and reach nobody else."""
    loggers = [logging.getLogger(name) for name in STAGES]
    before = [(logger.handlers, logger.propagate, logger.level) for logger in loggers]
    for logger in loggers:
        logger.handlers, logger.propagate = [MessageHandler(tell)], False
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, (handlers, propagate, level) in zip(loggers, before, strict=True):
            logger.handlers, logger.propagate = handlers, propagate
            logger.setLevel(level)


def load_filters(specs: list[str], *, tell: Callable[[dict[str, Any]], None]) -> None:
    """Load filters into this process, which forks others that then have them; those that are compiled are told.

    What fails here fails in the process of a log, and is told there.
    """
    from attlog.pipeline.replay import preload

    with messages_to(tell), suppress(Exception):
        preload(specs)


def process_log(work: Work, scratch: Path, *, tell: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """The work of a log's process: :func:`fields_of_record`; what is printed goes to a file of the folder."""
    from attlog.core.workers import write_output_to

    write_output_to(scratch / PRINTED)
    return fields_of_record(work, scratch, tell)


def fields_of_record(work: Work, scratch: Path, tell: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Analyse a log to files in ``scratch / "out"``; the fields of its record. An error is told by them, not raised."""
    from attlog.batch.index_row import index_row

    content, out = "", scratch / "out"
    try:
        sign = _stamp(work)
        with messages_to(tell), unchanged(Path(work.source.place)), work.source.local(scratch) as log:
            content = log.sha256
            files = analyze_to_files(
                log.path,
                work.config,
                out,
                work.name,
                command=work.command,
                deterministic=work.deterministic,
                figures=work.figures,
            )
        return {
            "key": key(content, work.settings),
            "stamp": sign,
            "row": index_row(files.result),
            "files": {path.name: written(path) for path in (files.report, files.json)},
        }
    except Exception as error:
        code = exit_code(error)
        return {
            "key": key(content, work.settings) if content and not isinstance(error, LogUnreadable) else "",
            "code": code,
            "message": error_message(error, __version__, work.source.name).replace(str(out), str(work.folder)),
            "trace": "".join(traceback.format_exception(error)) if code == EXIT_BUG else "",
            "folder_full": isinstance(error, OutputError) and is_disk_full(error.__cause__),
        }


def _stamp(work: Work) -> str:
    """Taken before the bytes, so that a later change is noticed. A server that fails now may answer the download."""
    try:
        return stamp(work.source)
    except LogUnreadable:
        return ""
