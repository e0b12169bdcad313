"""One log to files: the report, the JSON, and what both are called."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from attlog.base import file_names
from attlog.base.output import staged
from attlog.fleet.sources.unchanged import unchanged

if TYPE_CHECKING:
    from attlog.analysis.config import Config
    from attlog.result import Result


@dataclass(frozen=True, slots=True)
class Written:
    """What was found out about a log, and the files it stands in."""

    result: Result
    report: Path
    json: Path


def analyze_to_files(
    log: Path, config: Config, folder: Path, name: str = "", *, command: str = "", deterministic: bool = False
) -> Written:
    """Analyse a log and write ``NAME.html`` and ``NAME.json`` to a folder; ``name`` is the file's own by default.

    Both files appear whole or the old ones stay, and nothing is written of a log that fails.
    Errors as in :func:`attlog.analyze`; LogUnreadable where the log changed meanwhile; OutputError if a file cannot
    be written.
    ``deterministic`` leaves measured times out of both files. The logger ``attlog.stages`` tells the stage.
    """
    from attlog.analysis import analyze

    name = name or log.name
    with unchanged(log):
        result = analyze(log, config, command=command)
    written = Written(result, folder / f"{name}.html", folder / f"{name}.json")
    logging.getLogger("attlog.stages").info("writing the report")
    document = result.to_dict(deterministic)  # large: made once for both
    with staged(folder) as stage:
        result.to_html(stage / written.report.name, deterministic=deterministic, document=document)
        result.to_json(stage / written.json.name, whole=document)
    return written


RESERVED = ("index",)
"""Names that the pages of a batch have."""


def report_names(logs: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """The name of each log's report: its file name with suffix; a second of the same name gets a number.

    Names that differ in case alone count as the same: some file systems do not tell them apart; what a file system
    or a terminal may stumble over is replaced (:mod:`attlog.base.file_names`). ``taken`` are names of other reports in
    the folder.
    """
    return file_names.file_names(map(str, logs), (*RESERVED, *taken))
