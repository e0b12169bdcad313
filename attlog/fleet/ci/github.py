"""Failures as GitHub's workflow commands: marks beside the files of a pull request.

GitHub shows ten of each kind and step and drops the rest without a word: the worst are told, a notice counts the rest.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from attlog.fleet.ci.gating import GatedLog, failing
from attlog.present.numbers import counted
from attlog.present.text import CONTROL

SHOWN = 10


def on_github(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether this runs in a step of a GitHub workflow."""
    return environment.get("GITHUB_ACTIONS") == "true"


def commands(logs: Sequence[GatedLog], root: Path | None = None) -> Iterator[str]:
    """One line for each failure, the worst of every log before the second worst of any; ``root``: of the repository."""
    found = failing(logs)
    errors = [_command("error", j.log, "not analysed", j.message, root) for j in found if j.broken]
    rank = sorted((k, -o.excess, n) for n, j in enumerate(found) for k, o in enumerate(j.worst))
    errors += [
        _command(
            "error",
            found[n].log,
            f"{found[n].worst[k].row}: {found[n].worst[k].check}",
            found[n].worst[k].sentence,
            root,
        )
        for k, _, n in rank
    ]
    yield from errors[:SHOWN]
    total = sum(j.failed + j.broken for j in found)
    if total > SHOWN:
        rest = f"{counted(total, 'failure')} in {counted(len(found), 'log')}"
        yield f"::notice title=attlog::{rest}, of which the worst {SHOWN} are marked; the reports show all of them"


def refused(why: str) -> Iterator[str]:
    """A line for each thing that is wrong with what was asked, so that nothing was run."""
    for line in why.splitlines()[:SHOWN]:
        yield f"::error title={_property('attlog, nothing was analysed')}::{_message(line)}"


def _command(kind: str, log: str, title: str, message: str, root: Path | None) -> str:
    place = _inside(log, root)
    file = f"file={_property(place)}," if place else ""
    said = f"{log}: {message.removeprefix(f'{log}: ')}"  # a log that cannot be read names itself
    return f"::{kind} {file}title={_property(f'attlog, {title}')}::{_message(said)}"


def _inside(log: str, root: Path | None) -> str:
    """The log's path in the repository; empty for what is not in it."""
    try:
        return Path(log).resolve().relative_to((root or Path.cwd()).resolve()).as_posix() if Path(log).exists() else ""
    except (OSError, ValueError):
        return ""


def _message(text: str) -> str:
    escaped = "\r".join(CONTROL.sub("", part) for part in text.split("\r")).replace("%", "%25")
    return escaped.replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _message(text).replace(":", "%3A").replace(",", "%2C")
