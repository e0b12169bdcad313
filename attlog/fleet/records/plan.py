"""What will be done with which log of a batch, under which name: the same for the life of its folder."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from attlog import __version__
from attlog.analysis.config import Config
from attlog.base.errors import OutputError, UsageError
from attlog.base.files.output import write_atomic
from attlog.fleet.pages.index import INDEX
from attlog.fleet.processes.files import report_names
from attlog.fleet.records.record import INSIDE, read_record, record_path, records, written
from attlog.fleet.records.results_file import CSV, PARQUET
from attlog.fleet.records.work import Work, settings_key
from attlog.fleet.sources.remote import is_url
from attlog.fleet.sources.source import Source

SCHEMA = "attlog-batch/1"


@dataclass(frozen=True, slots=True)
class Job:
    """A batch: which logs, into which folder, and how each is treated (see :class:`attlog.fleet.records.work.Work`).

    ``commands``: for each log the command that makes its report alone. ``resume``: what is done in the folder stays;
    ``fresh``: what an earlier batch left there is removed first. Neither: a folder with a batch is refused.
    """

    sources: Sequence[Source]
    folder: Path
    config: Config
    commands: Sequence[str] = ()
    deterministic: bool = False
    timeout: float | None = None
    memory: float | None = None
    resume: bool = False
    fresh: bool = False


def planned(job: Job) -> list[Work]:
    """The work for each log, under names that stay the same for the life of the folder."""
    earlier = _earlier(job)
    settings = settings_key(job.config, job.deterministic)
    logs = [source.name for source in job.sources]
    earlier |= _moved(job, earlier)
    new = [source for source in job.sources if source.name not in earlier]
    names = earlier | dict(
        zip((source.name for source in new), report_names((s.file_name for s in new), earlier.values()), strict=True)
    )
    plan = {"schema": SCHEMA, "version": __version__, "settings": settings, "names": names}
    write_atomic(_plan(job.folder), json.dumps(plan, indent=1) + "\n")
    commands = job.commands or [""] * len(logs)
    return [
        Work(
            source,
            names[log],
            job.folder,
            job.config,
            settings,
            command,
            job.deterministic,
            job.timeout,
            job.memory,
            job.resume,
        )
        for source, log, command in zip(job.sources, logs, commands, strict=True)
    ]


def _plan(folder: Path) -> Path:
    return folder / INSIDE / "batch.json"


def _earlier(job: Job) -> dict[str, str]:
    """Names of reports that logs have in the folder already, by log."""
    try:
        plan = json.loads(_plan(job.folder).read_bytes())
        names: dict[str, str] = dict(plan["names"])
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, KeyError, TypeError):
        names = {record.log: record.name for record in records(job.folder)}
    if job.fresh:
        _forget(job.folder, names.values())
        return {}
    if not job.resume:
        done = sum(record_path(job.folder, name).exists() for name in names.values())
        raise UsageError(
            f"{job.folder} holds a batch ({done} of {len(names)} logs were reached): --resume goes on with it "
            "(what is done and unchanged is not done again), --fresh removes its reports and begins again, "
            "-o chooses another folder"
        )
    return names


def _moved(job: Job, earlier: dict[str, str]) -> dict[str, str]:
    """Logs that the folder knows by another path: same file name, same bytes. Their reports are taken over."""
    named = {source.name for source in job.sources}
    gone: dict[str, list[str]] = {}
    for log in earlier:
        if log not in named:
            gone.setdefault(re.split(r"[/\\]", log)[-1], []).append(log)
    found: dict[str, str] = {}
    for source in job.sources:
        if source.name in earlier or source.member or is_url(source.place) or source.file_name not in gone:
            continue
        now = written(Path(source.place))
        for log in gone[source.file_name]:
            record = read_record(job.folder, earlier[log])
            if now is not None and record is not None and record.key.startswith(f"{now[1]}:"):
                found[source.name] = earlier.pop(log)
                gone[source.file_name].remove(log)
                break
    return found


def _forget(folder: Path, names: Iterable[str]) -> None:
    """Remove what an earlier batch wrote: nothing but files that it is known to have made."""
    try:
        for name in names:
            record = read_record(folder, name)
            for file in record.files if record else ():
                (folder / file).unlink(missing_ok=True)
            record_path(folder, name).unlink(missing_ok=True)
        for page in (_plan(folder), folder / INDEX, folder / PARQUET, folder / CSV):
            page.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another place with -o") from error
