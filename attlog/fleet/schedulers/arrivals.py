"""Which files have arrived in folders: new or changed, and left alone by whoever writes them.

Folders are looked at again and again: the network drives that teams share tell no program of a
change (inotify sees local writes alone), and a look at 10,000 files takes some hundredths of a second.
"""

from __future__ import annotations

import glob
import os
import re
import stat
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from attlog.base.errors import LogUnreadable, UsageError
from attlog.fleet.sources.find import PATTERN
from attlog.fleet.sources.urls import is_url, shown

EMPTY_FOR_S = 60.0
"""An empty file is a place kept for a download, until it has been empty for so long."""
PARTS = (".part", ".partial", ".crdownload", ".opdownload", ".download", ".tmp", ".temp", ".filepart", ".!ut", ".aria2")
"""What browsers, copying programs and synchronisers call a file on its way. The
name without may stand beside it, as a place that is kept."""
_RSYNC = re.compile(r"\..+\.[A-Za-z0-9]{6}")
State = tuple[int, int, int]
"""Size, time of the last change (ns) and number of the file."""


@dataclass(slots=True)
class _Seen:
    state: State
    since: float
    """When it was first seen in this state."""
    given: bool = False


class Arrivals:
    """Files below folders and patterns, each given once for each state that it stayed in for ``settle`` seconds."""

    def __init__(self, places: Sequence[str], settle: float, without: Path | None = None) -> None:
        """``without``: a folder that is never looked into. UsageError for what cannot be watched."""
        for place in places:
            if place == "-" or is_url(place):
                raise UsageError(f"{shown(place)}: --watch looks at folders and patterns of this machine only")
            if not os.path.exists(place) and not PATTERN & set(place):
                raise LogUnreadable(f"{place}: no such folder; --watch needs one that exists")
        self._places, self._settle = list(places), settle
        self._without = None if without is None else str(without.resolve())
        self._seen: dict[str, _Seen] = {}

    def settled(self, now: float) -> list[tuple[Path, State]]:
        """Files whose state has lasted, in the order of their names; ``now`` (s) is of any clock that only goes on."""
        there = dict(self._files())
        for path in [path for path, known in self._seen.items() if path not in there and not known.given]:
            del self._seen[path]  # a download that was given up, or renamed when it was whole
        found = []
        for path, state in sorted(there.items()):
            known = self._seen.get(path)
            if known is None or known.state != state:
                known = self._seen[path] = _Seen(state, now)
            wait = self._settle if state[0] else max(self._settle, EMPTY_FOR_S)
            if not known.given and now - known.since >= wait and not on_its_way(path, there):
                known.given = True
                found.append((Path(path), state))
        return found

    def again(self, path: Path) -> None:
        """Give this file once more when it has settled: it changed while it was read."""
        self._seen.pop(str(path), None)

    @property
    def pending(self) -> int:
        """Files that have not settled yet."""
        return sum(not known.given for known in self._seen.values())

    def _files(self) -> Iterator[tuple[str, State]]:
        for place in self._places:
            matches = [place]
            if PATTERN & set(place) and not os.path.exists(place):
                matches = glob.glob(place, recursive=True)
            for match in matches:
                if os.path.isdir(match):
                    yield from self._below(match)
                elif (state := state_of(match)) is not None:
                    yield match, state

    def _below(self, folder: str) -> Iterator[tuple[str, State]]:
        """The files in a folder at any depth but hidden ones; what cannot be read is not there at the moment."""
        if self._without is not None and os.path.realpath(folder) == self._without:
            return
        folders = []
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    if entry.name.startswith("."):
                        continue
                    if entry.is_dir(follow_symlinks=False):  # a link to a folder may lead in a circle
                        folders.append(entry.path)
                    elif (state := state_of(entry)) is not None:
                        yield entry.path, state
        except OSError:
            return  # a drive that is away for a while
        for path in folders:
            if not on_its_way(path):
                yield from self._below(path)


def state_of(path: str | os.PathLike[str]) -> State | None:
    """The state of a file; None where there is none at the moment."""
    try:
        told = os.stat(path)
    except OSError:
        return None
    return (told.st_size, told.st_mtime_ns, told.st_ino) if stat.S_ISREG(told.st_mode) else None


def on_its_way(path: str, there: Container[str] = ()) -> bool:
    """Whether a name says that the file is still being written; ``there``: the names of other files."""
    name = os.path.basename(path)
    if name.lower().endswith(PARTS) or name.endswith("~") or _RSYNC.fullmatch(name):
        return True
    return any(path + part in there for part in PARTS)
