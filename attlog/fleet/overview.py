"""What a batch folder shows of all its logs: the index and the file with every number."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from attlog.fleet.entry import Entry
from attlog.fleet.index_page import write_index
from attlog.fleet.results_file import write_results
from attlog.fleet.row import light


def write_overview(folder: Path, entries: Iterable[Entry], *, title: str = "") -> tuple[Path, Path]:
    """Write ``results.parquet`` (or ``.csv``) and ``index.html``; their paths. Each appears whole or not at all.

    Entries are taken one after the other, once; what stays in memory of each is what the index shows, some 10 kB.
    OutputError if a file cannot be written.
    """
    kept: list[Entry] = []

    def seen() -> Iterator[Entry]:
        for entry in entries:
            kept.append(replace(entry, row=light(entry.row)) if entry.row else entry)
            yield entry

    results = write_results(folder, seen())
    return write_index(folder, kept, title=title, results=results.name), results
