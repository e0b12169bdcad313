"""Every number of a result in little space, filters' and sensors': for tables over many logs."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Container, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.compare.gates import BASELINE_ESTIMATORS
from attlog.core.plain import to_plain
from attlog.result import MEASURED_TIMES, Answer, Check, EstimatorRow, Finding, Result, Verdict, agreed_settings
from attlog.words.findings import parameter_change
from attlog.words.flight import firmware
from attlog.words.names import row_names
from attlog.words.numbers import listed
from attlog.words.table import main_table

SENSOR_WINDOW = "sensors"
"""The window of what assessments say of sensors: each question knows its own seconds. The row is the sensor."""


@dataclass(frozen=True, slots=True)
class Number:
    """One metric of one row in one window: a value with interval, or the code and reason why there is none."""

    row: str
    window: str
    metric: str
    unit: str
    value: float | None
    low: float | None
    high: float | None
    n: int | None
    seconds: float | None
    code: str | None
    reason: str | None


def packed(result: Result) -> dict[str, Any]:
    """All answers as plain values, without measured times; assessments stand as metrics of their sensor.

    ``values``: row -> window -> metric -> [value, low, high, n, seconds], or the place in ``missing`` of
    [code, reason]; ``units``: metric -> unit. A sentence that many answers share stands there once.
    """
    missing: dict[tuple[str, str], int] = {}
    units: dict[str, str] = {}
    values: dict[str, dict[str, dict[str, Any]]] = {}
    for row in result.estimators:
        for window, answers in row.metrics.items():
            kept = {m: a for m, a in answers.items() if m not in MEASURED_TIMES}
            units |= {m: a.unit for m, a in kept.items()}
            if kept:
                place = values.setdefault(row.name, {}).setdefault(window, {})
                place |= {m: _packed(a, missing) for m, a in kept.items()}
    for found in result.checks:
        units[found.question] = found.unit or units.get(found.question, "")
        place = values.setdefault(found.sensor or SENSOR_WINDOW, {}).setdefault(SENSOR_WINDOW, {})
        place[found.question] = _of_sensor(found, missing)
    return {"values": values, "missing": [list(k) for k in missing], "units": units}


def _packed(answer: Answer, missing: dict[tuple[str, str], int]) -> Any:
    if answer.value is None:
        return missing.setdefault((answer.code or "", answer.reason or ""), len(missing))
    low, high = answer.ci95 or (None, None)
    return [answer.value, low, high, answer.n, answer.seconds]


def _of_sensor(found: Check, missing: dict[tuple[str, str], int]) -> Any:
    """An assessment as an answer; one without a value tells its verdict in place of a code."""
    if found.value is None:
        return missing.setdefault((found.verdict, found.text), len(missing))
    low, high = found.ci95 or (None, None)
    return [found.value, low, high, found.n, found.seconds]


def numbers(answers: dict[str, Any], wanted: Container[str] | None = None) -> Iterator[Number]:
    """What :func:`packed` made, one by one; of the ``wanted`` metrics alone where they are given."""
    units, missing = answers["units"], answers["missing"]
    for row, windows in answers["values"].items():
        for window, metrics in windows.items():
            for metric, found in metrics.items():
                if wanted is not None and metric not in wanted:
                    continue
                if isinstance(found, int):
                    code, reason = missing[found]
                    yield Number(row, window, metric, units[metric], None, None, None, None, None, code, reason)
                else:
                    value, low, high, n, seconds = found
                    yield Number(row, window, metric, units[metric], value, low, high, n, seconds, None, None)


# A flight at a glance: its height over the log, or how far it leaned, with the serious events, in a few points.

Array = NDArray[np.float64]

THUMBNAIL_POINTS = 48
"""Points of a thumbnail over the whole log."""
MOST_SPANS = 20
BRIDGED = 4
"""Points without a sample between two with one that are drawn straight, as in a short log with a slow barometer."""
FULL_DEG, LEAST_M = 90.0, 5.0
"""The full height of the picture: of tilt, on a square root's scale; of height at least."""
FULL_BYTE, NO_BYTE = 254, 255
MARKED = {"reset": "The attitude jumped", "impact": "Impact", "loss_of_control": "Loss of control"}
"""What a mark means that tells a kind instead of a sentence, as records of earlier versions have it."""


def thumbnail(result: Result) -> dict[str, Any] | None:
    """The largest height or tilt in each of POINTS equal parts of the log; None without traces of either.

    ``height`` (m) above the ground it stood on, of a log that never flew or tells no height the ``tilt`` (degrees) of
    the attitude that everything is compared with, of the one that flew, or of a filter; None where nothing is known.
    ``t0`` and ``t1``: the log's ends (s);
    ``air``: seconds in the air; ``marks``: [seconds, sentences] of serious events, those of one place together.
    """
    air = (result.log.get("timeline") or {}).get("airborne") or []
    found = (_height(result) if air else None) or _tilt(result)
    if found is None:
        return None
    name, t, y = found
    start = min(0.0, float(np.nanmin(t)))
    ends = [x for x in (float(np.nanmax(t)), result.log.get("duration_s")) if x is not None and math.isfinite(x)]
    edges = np.linspace(start, max(*ends, start + 1e-3), THUMBNAIL_POINTS + 1)
    return {
        "t0": round(start, 2),
        "t1": round(float(edges[-1]), 2),
        name: [round(float(v), 1) if math.isfinite(v) else None for v in _bridged(_largest(t, y, edges))],
        "air": [[round(float(a), 1), round(float(b), 1)] for a, b in air[:MOST_SPANS]],
        "marks": _marks(result, edges),
    }


def encoded(seen: dict[str, Any] | None, out: bytearray) -> list[Any] | None:
    """What stands beside the curve of a thumbnail, with what it shows in words; the curve goes to ``out``, a byte for
    each point, from 0 at the foot of the picture to FULL_BYTE at its top."""
    if seen is None:
        return None
    at = len(out)
    curve = seen["height" if "height" in seen else "tilt"]
    held = [v for v in curve if v is not None]
    top = max(held, default=0.0)
    if "height" in seen:
        low = min(0.0, *held, 0.0)
        span = max(LEAST_M, top - low)
        shares = [None if v is None else (v - low) / span for v in curve]
        words = "Height over time"
    else:
        shares = [None if v is None else math.sqrt(min(v, FULL_DEG) / FULL_DEG) for v in curve]
        words = "Tilt over time"
    out += bytes(NO_BYTE if v is None else round(FULL_BYTE * v) for v in shares)
    return [at, seen["t0"], seen["t1"], words, seen["air"], [[t, MARKED.get(text, text)] for t, text in seen["marks"]]]


def _height(result: Result) -> tuple[str, Array, Array] | None:
    """The name of the curve, times (n,) s and heights (n,) m; None where no sensor tells them."""
    found = next((t for t in result.traces if t.figure == "height"), None)
    if found is None or not np.isfinite(found.columns["height"]).any():
        return None
    return "height", found.t, found.columns["height"]


def _tilt(result: Result) -> tuple[str, Array, Array] | None:
    """The name of the curve, times (n,) s and angles (n,) degrees; None without any attitude."""
    attitudes = {t.row: t for t in result.traces if t.figure == "attitude" and np.isfinite(t.t).any()}
    if not attitudes:
        return None
    choice = result.reference.choice if result.reference else ""
    filters = [r.name for r in result.estimators if r.kind == "replay" and r.estimator not in BASELINE_ESTIMATORS]
    shown = next(attitudes[k] for k in (choice, "onboard", *filters, *attitudes) if k in attitudes)
    roll, pitch = (np.radians(shown.columns[c]) for c in ("roll", "pitch"))
    return "tilt", shown.t, np.degrees(np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0)))


def _largest(t: Array, y: Array, edges: Array) -> Array:
    """The largest y (n,) between each pair of edges; NaN where there is no finite value."""
    y = np.asarray(y, np.float64)
    good = np.isfinite(y) & np.isfinite(t)
    out = np.full(len(edges) - 1, -np.inf)
    np.maximum.at(out, np.clip(np.searchsorted(edges, t[good], "right") - 1, 0, len(out) - 1), y[good])
    return np.where(np.isfinite(out), out, np.nan)


def _bridged(values: Array) -> Array:
    """The same with straight lines across short gaps."""
    known = np.flatnonzero(np.isfinite(values))
    for a, b in itertools.pairwise(known):
        if b - a <= BRIDGED:
            values[a : b + 1] = np.linspace(values[a], values[b], b - a + 1)
    return values


def _marks(result: Result, edges: Array) -> list[list[Any]]:
    """Serious events in the order of time; what lies closer than a point of the picture is one mark."""
    found: list[list[Any]] = []
    for event in sorted((e for e in result.events if e.severity == "serious"), key=lambda e: e.t):
        if found and event.t - found[-1][0] < edges[1] - edges[0]:
            found[-1][1] += f" {event.text}"
        elif len(found) < MOST_SPANS:
            found.append([round(event.t, 1), event.text])
    return found


# What was wrong with a flight's attitude, and how urgently somebody should look: reasons in words, worst first.
#
# Logs are opened in the order of :data:`RANKS`. Points order the reasons of one log, and logs of the same rank.

ATTITUDE_KINDS = frozenset({"attitude", "mounting", "estimator"})
"""Kinds of findings that say the onboard attitude was wrong, or that its estimator failed."""
RESET_KINDS = frozenset({"reset", "realigned"})
SENSOR_KINDS = frozenset(
    {
        "accelerometer",
        "accelerometer_axes",
        "accelerometer_delay",
        "compass",
        "frozen_gyro",
        "frozen_sensors",
        "gnss",
        "gyro",
        "gyro_bias",
        "gyro_range",
        "gyro_spikes",
        "imu_all_zero",
        "imu_mostly_refused",
        "mag_dead",
        "vibration",
    }
)
"""Kinds of findings about a sensor; others tell what the log lacks."""

REASON_WEIGHTS = {
    ("gate", "serious"): 100.0,
    ("attitude", "serious"): 100.0,
    ("crash", "serious"): 80.0,
    ("sensor", "serious"): 40.0,
    ("attitude", "warning"): 30.0,
    ("log", "serious"): 20.0,
    ("reset", "warning"): 20.0,
    ("reset", "serious"): 40.0,
    ("sensor", "fault"): 20.0,
    ("sensor", "warning"): 10.0,
    ("log", "warning"): 3.0,
}
"""How much a reason weighs, by kind and severity; notes weigh nothing and are left out.

A sensor's warning counts as a fault where one of its checks says so.
"""
FILTER_POINTS, MOST_FILTERS = 10.0, 5
REFUSED_POINTS = 40.0
SERIOUS, LOOK = 40.0, 10.0
"""One reason of this weight makes a log serious, or one to look at."""
RANKS = ("crash", "attitude", "serious", "other")
"""What somebody should open first: a crash or loss of control, a wrong attitude in flight, another serious finding in
flight (or a failed gate), all else."""
LANDED_S = 2.0
"""What begins so soon after landing belongs to the flight; what began before take-off went along."""
ANY_JUMP, PER_DEGREE, MOST_DEGREES = 5.0, 0.5, 60.0
"""A jump of known size: a heading set anew by a few degrees at take-off is no news, one by 60 deg nearly serious."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why somebody should look: ``kind`` gate, attitude, crash, reset, filter, sensor or log.

    ``points`` is its weight, ``text`` a sentence, ``t`` s on the log's clock or None. ``in_flight``: it was there while
    the vehicle flew; of a crash, that sensors show it.
    """

    kind: str
    code: str
    points: float
    text: str
    t: float | None = None
    in_flight: bool = False

    @property
    def rank(self) -> int:
        """The place in RANKS of a log that has this reason."""
        if self.points < SERIOUS or not self.in_flight:
            return RANKS.index("other")
        return RANKS.index(self.kind) if self.kind in RANKS else RANKS.index("serious")


def trouble(reasons: Iterable[Reason]) -> dict[str, Any]:
    """Reasons as plain values, the heaviest first.

    ``level``: serious, look or none; ``rank``: the first place in RANKS; ``score``: the sum of points.
    """
    found = sorted(reasons, key=lambda r: -r.points)
    most = found[0].points if found else 0.0
    return {
        "level": "serious" if most >= SERIOUS else "look" if most >= LOOK else "none",
        "rank": min((r.rank for r in found), default=RANKS.index("other")),
        "score": round(sum(r.points for r in found), 1),
        "reasons": [asdict(r) for r in found],
    }


def with_gates(said: dict[str, Any], failed: Iterable[str]) -> dict[str, Any]:
    """What :func:`trouble` told, with one more reason for each sentence of a gate that failed."""
    gates = [Reason("gate", "gate", REASON_WEIGHTS["gate", "serious"], text, in_flight=True) for text in failed]
    return trouble([*gates, *(Reason(**reason) for reason in said["reasons"])]) if gates else said


def reasons(result: Result) -> list[Reason]:
    """Everything in a result that speaks of trouble with the attitude or with what it is computed from."""
    faults = {check.text for check in result.checks if check.verdict == "fault"}
    found = [reason for finding in result.findings if (reason := _of_finding(finding, faults)) is not None]
    codes = {r.code for r in found}
    crashes = [event for event in result.events if event.is_crash]
    if crashes and "crash" not in codes:
        found.append(
            Reason("crash", crashes[0].kind, REASON_WEIGHTS["crash", "serious"], crashes[0].text, crashes[0].t)
        )
    refused = result.reference.refused if result.reference else {}
    for kind, why in refused.items():
        if kind == "truth" or (kind == "onboard" and not codes & ATTITUDE_KINDS):
            said = "truth" if kind == "truth" else "onboard attitude"
            found.append(Reason("attitude", "refused", REFUSED_POINTS, f"The {said} is refused as reference: {why}."))
    shown = bool(crashes) or not result.events  # what the autopilot alone reports as a crash is often a bench
    landed = _last_landing(result)
    return [
        replace(r, in_flight=shown if r.kind == "crash" else landed is not None and (r.t is None or r.t <= landed))
        for r in [*found, *_of_rows(result)]
    ]


def _last_landing(result: Result) -> float | None:
    """When the last flight was over, s; None of a log that never flew, infinite where nobody knows when."""
    spans = (result.log.get("timeline") or {}).get("airborne") or []
    if spans:
        return float(spans[-1][1]) + LANDED_S
    return math.inf if (result.log.get("seconds") or {}).get("airborne") else None


def _of_finding(finding: Finding, faults: Collection[str]) -> Reason | None:
    kind = kind_of(finding.kind)
    told = {finding.text, *finding.evidence}
    is_fault = finding.severity == "warning" and not told.isdisjoint(faults) and (kind, "fault") in REASON_WEIGHTS
    points = REASON_WEIGHTS.get((kind, "fault" if is_fault else finding.severity))
    if points is None:
        return None
    if kind == "reset" and finding.value is not None and finding.unit == "deg":
        points = ANY_JUMP + PER_DEGREE * min(abs(finding.value), MOST_DEGREES)
    times = f" ({finding.count} times)" if finding.count > 1 and str(finding.count) not in finding.text else ""
    return Reason(kind, finding.kind, points, finding.text + times, finding.t)


def kind_of(finding: str) -> str:
    """Which kind of trouble a kind of finding stands for."""
    if finding in ATTITUDE_KINDS:
        return "attitude"
    if finding in RESET_KINDS:
        return "reset"
    if finding == "crash":
        return "crash"
    return "sensor" if finding in SENSOR_KINDS else "log"


def _of_rows(result: Result) -> list[Reason]:
    """Rows that diverged or failed: the onboard attitude on its own, the filters together."""
    names = row_names(result)
    found = [
        Reason(
            "attitude", r.status, REASON_WEIGHTS["attitude", "serious"], f"The onboard attitude {r.status}: {r.reason}."
        )
        for r in result.estimators
        if r.name == "onboard" and r.status in ("diverged", "failed")
    ]
    for status in ("diverged", "failed"):
        lost = [r for r in result.estimators if r.status == status and _judged(r)]
        if lost:
            why = f": {lost[0].reason}" if len(lost) == 1 and lost[0].reason else ""
            text = f"{listed([names[r.name] for r in lost])} {status}{why}."
            found.append(Reason("filter", status, FILTER_POINTS * min(len(lost), MOST_FILTERS), text))
    return found


def _judged(row: EstimatorRow) -> bool:
    return row.kind == "replay" and row.estimator not in BASELINE_ESTIMATORS


# What a batch knows of one log: enough for its index and its tables, so that no result is read again.

FORM = 2
"""Grows when what stands in a row changes its meaning."""
HEAVY = "answers"
"""The one part that only tables need: most of a row's size."""


@dataclass(frozen=True, slots=True)
class Entry:
    """``log`` as it was given, ``name`` of its report without suffix, what became of it.

    ``code`` and ``message``: the exit code, and the sentence of a log that failed; ``row``: what
    :func:`index_row` made, None of a log that failed; ``gates``: a sentence for each gate that
    failed. ``known``: it failed like this in an earlier run.
    """

    log: str
    name: str
    code: int = 0
    message: str = ""
    row: dict[str, Any] | None = None
    gates: tuple[str, ...] = ()
    known: bool = False


def index_row(result: Result) -> dict[str, Any]:
    """Everything that the index and the tables of a batch tell of one log, as plain JSON values.

    The same log, version and configuration give the same row: measured times stay out. ``headline``: what happened;
    ``flight``: what flew, when, how long (s); ``rows``: every row of the comparison by id; ``verdicts``: the four
    sentences with their numbers; ``trouble``: see :func:`attlog.batch.index_row.trouble`; ``columns``: the
    columns of the comparison with their values by row; ``thumbnail``: the flight at a glance, None where the result
    holds no traces; ``sensors``: how many assessments are faults and warnings, and what to set; ``answers``: every
    metric, see :func:`attlog.batch.index_row.packed`.
    """
    row: dict[str, Any] = to_plain(
        {
            "form": FORM,
            "headline": result.headline,
            "flight": _flight(result),
            "rows": _rows(result),
            "verdicts": [_verdict(v) for v in result.verdicts],
            "trouble": trouble(reasons(result)),
            "columns": _columns(result),
            "thumbnail": thumbnail(result),
            "sensors": _sensors(result),
            HEAVY: packed(result),
        }
    )
    return row


def light(row: dict[str, Any]) -> dict[str, Any]:
    """A row without the part that only tables need: a tenth of its size, for those who hold many in memory."""
    return {key: value for key, value in row.items() if key != HEAVY}


def sensors_of(row: dict[str, Any]) -> dict[str, Any]:
    """What a row tells of sensors: ``faults``, ``warnings``, ``to_set``; nothing is off in one of an older version."""
    found: dict[str, Any] = {"faults": 0, "warnings": 0, "to_set": []} | (row.get("sensors") or {})
    return found


def _flight(result: Result) -> dict[str, Any]:
    log = result.log
    seconds = log.get("seconds") or {}
    said = log.get("firmware") or {}
    return {
        "name": log.get("name"),
        "sha256": log.get("sha256"),
        "date_utc": log.get("date_utc"),
        "firmware": firmware(result).partition(" on ")[0],
        "autopilot": said.get("name"),
        "version": said.get("version"),
        "board": said.get("board"),
        "vehicle": log.get("vehicle"),
        "simulated": bool(log.get("simulated")),
        "format": log.get("format"),
        "duration_s": log.get("duration_s"),
        "airborne_s": seconds.get("airborne"),
        "rest_s": seconds.get("rest"),
        "reference": result.reference.choice if result.reference else None,
        "attlog": result.attlog.get("version"),
        "schema": result.schema,
    }


def _sensors(result: Result) -> dict[str, Any]:
    verdicts = Counter(assessment.verdict for assessment in result.checks)
    settings = [str(parameter_change(setting)) for setting in agreed_settings(result.checks)]
    return {"faults": verdicts["fault"], "warnings": verdicts["warning"], "to_set": settings}


def _rows(result: Result) -> dict[str, dict[str, Any]]:
    names = row_names(result)
    return {
        r.name: {
            "name": names[r.name],
            "kind": r.kind,
            "estimator": r.estimator,
            "status": r.status,
            "reason": r.reason,
            "is_reference": r.is_reference,
        }
        for r in result.estimators
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    """Return an answer without its notes."""
    return {
        "question": verdict.question,
        "sentence": verdict.sentence,
        "metric": verdict.metric,
        "window": verdict.window,
        "answered": verdict.answered,
    }


def _columns(result: Result) -> list[dict[str, Any]]:
    """The comparison's columns: title, metric, window, unit, and row -> value, or the code why there is none."""
    found = []
    for heading in main_table(result).columns:
        if heading.metric in MEASURED_TIMES:
            continue
        cells = {r.name: r.metrics.get(heading.window, {}).get(heading.metric) for r in result.estimators}
        values = {name: _short(answer) for name, answer in cells.items() if answer is not None}
        unit = next(a.unit for a in cells.values() if a is not None and a.value is not None)
        found.append(
            {"title": heading.title, "metric": heading.metric, "window": heading.window, "unit": unit, "values": values}
        )
    return found


def _short(answer: Answer) -> float | str | None:
    return answer.code if answer.value is None else float(f"{answer.value:.6g}")
