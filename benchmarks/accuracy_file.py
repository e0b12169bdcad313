"""The file that ``attlog estimators`` reads and the table of docs/estimators.md, of what ``accuracy.py`` measured."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog import __version__
from attlog.estimators import names
from attlog.estimators.accuracy import ANGLES, FILE, SETS, FilterAccuracy, read_accuracy
from attlog.metrics.statistics import student

Array = NDArray[np.float64]
PAGE = Path(__file__).resolve().parent.parent / "docs" / "estimators.md"
SET_OF = {"broad": "broad", "euroc": "euroc", "sitl/ardupilot": "simulated", "sitl/px4": "simulated"}
SET_OF |= {"unbiased/ardupilot": "simulated_unbiased", "unbiased/px4": "simulated_unbiased"}
"""Groups of trials -> sets of the file; other groups are not kept."""
PEERS = {
    "peer vqf": "package vqf",
    "peer vqf_restored": "package vqf, gyro restored",
    "peer vqf_offline": "package vqf, its own smoother",
    "peer vqf_offline_restored": "package vqf, its own smoother, gyro restored",
    "peer imufusion": "package imufusion",
    "peer ahrs": "package ahrs, Madgwick",
    "peer qmt_madgwick": "package qmt, Madgwick",
    "peer qmt_mahony": "package qmt, Mahony",
    "peer riann": "package riann",
    "peer attipy": "package attipy",
}
COLUMNS = ["filter", "set", "trials", *(f"{a}{end}" for a in ANGLES for end in ("", "_low", "_high"))]
COLUMNS += ["ns", "version", "date"]
HEAD = "| filter | BROAD, {broad} | EuRoC, {euroc} (tilt) | SITL, {simulated} |"
BEGIN, END = "| filter | BROAD", "\n\n"


def interval(values: Array) -> tuple[float, float, float]:
    """Mean of ``values`` (n,) with its 95 % interval on the log scale; NaN for the interval of one value."""
    mean = float(np.mean(values))
    if len(values) < 2 or mean <= 0.0:
        return mean, math.nan, math.nan
    factor = math.exp(student(0.975, len(values) - 1) * float(np.std(values, ddof=1)) / mean / math.sqrt(len(values)))
    return mean, mean / factor, mean * factor


def lines(table: Mapping[tuple[str, str], Sequence[Array]]) -> Iterator[dict[str, str]]:
    """A line of the file for each filter and set of (row, group) -> trials of (total, heading, tilt, ns)."""
    together: dict[tuple[str, str], list[Array]] = {}
    for (row, group), values in table.items():
        if group in SET_OF:
            together.setdefault((PEERS.get(row, row), SET_OF[group]), []).extend(values)
    for (row, name), values in together.items():
        found = np.array(values)
        line = {"filter": row, "set": name, "trials": str(len(found)), "ns": f"{np.median(found[:, 3]):.0f}"}
        for k, angle in enumerate(ANGLES):
            for end, x in zip(("", "_low", "_high"), interval(found[:, k]), strict=True):
                line[f"{angle}{end}"] = f"{x:.4g}" if math.isfinite(x) else ""
        yield line | {"version": __version__, "date": date.today().isoformat()}


def write(table: Mapping[tuple[str, str], Sequence[Array]], path: Path = FILE) -> None:
    """Put what was measured into the file; lines of what was not measured now stay, with their version and date."""
    known: dict[tuple[str, str], dict[str, str]] = {}
    if path.exists():
        with path.open(encoding="utf-8", newline="") as file:
            known = {(line["filter"], line["set"]): line for line in csv.DictReader(file)}
    known |= {(line["filter"], line["set"]): line for line in lines(table)}
    order = [name for n in names() for name in (n, *sorted(f for f, _ in known if f.startswith(f"{n}@")))]
    order = list(dict.fromkeys([*order, *PEERS.values()]))
    kept = sorted((key for key in known if key[0] in order), key=lambda k: (order.index(k[0]), list(SETS).index(k[1])))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(known[key] for key in kept)
    read_accuracy.cache_clear()


def table(found: Mapping[str, Mapping[str, FilterAccuracy]]) -> str:
    """The table of the docs: mean RMSE, in brackets the total with the gyro's bias subtracted."""
    trials = {s: max((sets[s].trials for sets in found.values() if s in sets), default=0) for s in SETS}
    text = [HEAD.format(**trials), "| --- | --- | --- | --- |"]
    for name, sets in found.items():
        cells = [cell(sets[s], s) if s in sets else "" for s in ("broad", "euroc", "simulated")]
        if "simulated_unbiased" in sets:
            rmse = sets["simulated_unbiased"].rmse_deg
            cells[2] += f" ({rmse['total' if 'total' in rmse else 'tilt'].value:.1f})"
        text.append(f"| {name if name in PEERS.values() else f'`{name}`'} | {' | '.join(cells)} |")
    return "\n".join(text)


def cell(one: FilterAccuracy, name: str) -> str:
    """Total/heading/tilt; dashes for what a filter without heading cannot tell on a set that others can."""
    return one.short() if name == "euroc" or "total" in one.rmse_deg else f"-/-/{one.short()}"


def write_page(page: Path = PAGE) -> None:
    """Put the table of the file into the page, in place of the one that is there."""
    text = page.read_text(encoding="utf-8")
    begin = text.index(BEGIN)
    end = text.index(END, begin)
    page.write_text(text[:begin] + table(read_accuracy()) + text[end:], encoding="utf-8")
