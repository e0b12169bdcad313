"""Index row of one result, for index and tables of a batch."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Container, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.compare.gates import BASELINE_ESTIMATORS
from attlog.core.plain import to_plain
from attlog.result import MEASURED_TIMES, Answer, Check, EstimatorRow, Finding, Result, Verdict, agreed_settings
from attlog.words.findings import parameter_change
from attlog.words.flight import firmware
from attlog.words.names import row_names
from attlog.words.numbers import listed
from attlog.words.table import AGREEMENT_TITLES, main_table

# Version of the row format. Rows of other versions are rebuilt from their result.
FORM = 3
# Key of all metrics: most of a row's size, needed by tables only.
ANSWERS = "answers"
# Window of checks: each has its own seconds. Their row is the sensor.
SENSOR_WINDOW = "sensors"


def index_row(result: Result) -> dict[str, Any]:
    """Return everything that index and tables show of one log, as JSON values.

    Equal log, version and configuration give an equal row: measured times are left out. ``flight``: vehicle, date,
    duration (s). ``rows``: rows of the comparison by id. ``verdicts``: the four answers. ``reasons``: to look at the
    log. ``columns``: the comparison with values by row. ``thumbnail``: see :func:`thumbnail`. ``sensors``: number of
    faults and warnings, and parameters to set. ``answers``: see :func:`pack_answers`.
    """
    row: dict[str, Any] = to_plain(
        {
            "form": FORM,
            "headline": result.headline,
            "flight": _flight(result),
            "rows": _rows(result),
            "verdicts": [_verdict(v) for v in result.verdicts],
            "reasons": [asdict(reason) for reason in reasons(result)],
            "columns": _columns(result),
            "thumbnail": thumbnail(result),
            "sensors": _sensors(result),
            ANSWERS: pack_answers(result),
        }
    )
    return row


def without_metrics(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row without its metrics, which only tables need."""
    return {key: value for key, value in row.items() if key != ANSWERS}


def sensors_of(row: dict[str, Any]) -> dict[str, Any]:
    """Return ``faults``, ``warnings`` and ``to_set`` of a row, empty where it has none."""
    found: dict[str, Any] = {"faults": 0, "warnings": 0, "to_set": []} | (row.get("sensors") or {})
    return found


class Number(NamedTuple):
    """One metric of one row and window: value and interval, or reason."""

    row: str
    window: str
    metric: str
    value: float | None
    low: float | None
    high: float | None
    n: int | None
    seconds: float | None
    unit: str
    code: str | None
    reason: str | None


def pack_answers(result: Result) -> dict[str, Any]:
    """Pack all metrics and checks as plain values, without measured times.

    ``values``: row -> window -> metric -> [value, low, high, n, seconds], or the index into ``missing`` of
    [code, reason]; ``units``: metric -> unit. Reasons shared by many metrics are stored once.
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
                place |= {m: _packed(a, (a.code or "", a.reason or ""), missing) for m, a in kept.items()}
    for check in result.checks:
        units[check.question] = check.unit or units.get(check.question, "")
        place = values.setdefault(check.sensor or SENSOR_WINDOW, {}).setdefault(SENSOR_WINDOW, {})
        place[check.question] = _packed(check, (check.verdict, check.text), missing)
    return {"values": values, "missing": [list(k) for k in missing], "units": units}


def _packed(answer: Answer | Check, reason: tuple[str, str], missing: dict[tuple[str, str], int]) -> Any:
    if answer.value is None:
        return missing.setdefault(reason, len(missing))
    low, high = answer.ci95 or (None, None)
    return [answer.value, low, high, answer.n, answer.seconds]


def numbers(answers: dict[str, Any], wanted: Container[str] | None = None) -> Iterator[Number]:
    """Yield the numbers stored by :func:`pack_answers`; only ``wanted`` metrics if given."""
    units, missing = answers["units"], answers["missing"]
    for row, windows in answers["values"].items():
        for window, metrics in windows.items():
            for metric, found in metrics.items():
                if wanted is not None and metric not in wanted:
                    continue
                is_missing = isinstance(found, int)
                value, low, high, n, seconds = [None] * 5 if is_missing else found
                code, reason = missing[found] if is_missing else (None, None)
                yield Number(row, window, metric, value, low, high, n, seconds, units[metric], code, reason)


# Thumbnail: height or tilt over the log in a few points, with serious events.

Array = NDArray[np.float64]

THUMBNAIL_POINTS = 48
# Most flights and marks of a thumbnail.
MAX_SPANS = 20
# Longest gap (points) bridged by a straight line, as between samples of a slow barometer.
MAX_BRIDGE = 4
# Full height of the picture: tilt (deg, on a square-root scale); height (m) at least.
FULL_TILT_DEG, MIN_HEIGHT_M = 90.0, 5.0
# Byte of the top of the picture, and of a point without value.
FULL_BYTE, NO_BYTE = 254, 255


def thumbnail(result: Result) -> dict[str, Any] | None:
    """Return the thumbnail: largest height or tilt in THUMBNAIL_POINTS parts of the log.

    None without either. ``height`` (m) above the start; for a log without flight or height ``tilt`` (deg) of the
    reference, the onboard attitude or a filter. ``t0``, ``t1``: ends of the log (s). ``air``: airborne spans (s).
    ``marks``: [t, sentences] of serious events, near ones joined.
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
        "air": [[round(float(a), 1), round(float(b), 1)] for a, b in air[:MAX_SPANS]],
        "marks": _marks(result, edges),
    }


def encode_thumbnail(seen: dict[str, Any] | None, out: bytearray) -> list[Any] | None:
    """Append the curve to ``out``, one byte per point; return the other fields."""
    if seen is None:
        return None
    at = len(out)
    curve = seen["height" if "height" in seen else "tilt"]
    held = [v for v in curve if v is not None]
    top = max(held, default=0.0)
    if "height" in seen:
        low = min(0.0, *held, 0.0)
        span = max(MIN_HEIGHT_M, top - low)
        shares = [None if v is None else (v - low) / span for v in curve]
        words = "Height over time"
    else:
        shares = [None if v is None else math.sqrt(min(v, FULL_TILT_DEG) / FULL_TILT_DEG) for v in curve]
        words = "Tilt over time"
    out += bytes(NO_BYTE if v is None else round(FULL_BYTE * v) for v in shares)
    return [at, seen["t0"], seen["t1"], words, seen["air"], seen["marks"]]


def _height(result: Result) -> tuple[str, Array, Array] | None:
    """Return "height", times (n,) s and heights (n,) m; None without a height."""
    found = next((t for t in result.traces if t.figure == "height"), None)
    if found is None or not np.isfinite(found.columns["height"]).any():
        return None
    return "height", found.t, found.columns["height"]


def _tilt(result: Result) -> tuple[str, Array, Array] | None:
    """Return "tilt", times (n,) s and angles (n,) deg; None without an attitude."""
    attitudes = {t.row: t for t in result.traces if t.figure == "attitude" and np.isfinite(t.t).any()}
    if not attitudes:
        return None
    choice = result.reference.choice if result.reference else ""
    filters = [r.name for r in result.estimators if r.kind == "replay" and r.estimator not in BASELINE_ESTIMATORS]
    shown = next(attitudes[k] for k in (choice, "onboard", *filters, *attitudes) if k in attitudes)
    roll, pitch = (np.radians(shown.columns[c]) for c in ("roll", "pitch"))
    return "tilt", shown.t, np.degrees(np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0)))


def _largest(t: Array, y: Array, edges: Array) -> Array:
    """Return the largest finite y (n,) between each pair of edges, else NaN."""
    y = np.asarray(y, np.float64)
    good = np.isfinite(y) & np.isfinite(t)
    out = np.full(len(edges) - 1, -np.inf)
    np.maximum.at(out, np.clip(np.searchsorted(edges, t[good], "right") - 1, 0, len(out) - 1), y[good])
    return np.where(np.isfinite(out), out, np.nan)


def _bridged(values: Array) -> Array:
    """Fill short gaps with straight lines."""
    known = np.flatnonzero(np.isfinite(values))
    for a, b in itertools.pairwise(known):
        if b - a <= MAX_BRIDGE:
            values[a : b + 1] = np.linspace(values[a], values[b], b - a + 1)
    return values


def _marks(result: Result, edges: Array) -> list[list[Any]]:
    """Return [t, sentence] of serious events; events closer than one point are joined."""
    found: list[list[Any]] = []
    for event in sorted((e for e in result.events if e.severity == "serious"), key=lambda e: e.t):
        if found and event.t - found[-1][0] < edges[1] - edges[0]:
            found[-1][1] += f" {event.text}"
        elif len(found) < MAX_SPANS:
            found.append([round(event.t, 1), event.text])
    return found


# Reasons to look at a log, with points, which order the reasons of one log, and logs of equal level.

# Kinds of findings about a wrong onboard attitude or a failed estimator.
ATTITUDE_KINDS = frozenset({"attitude", "mounting", "estimator"})
RESET_KINDS = frozenset({"reset", "realigned"})
# Kinds of findings about a sensor; others are about what the log lacks.
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
# Points of a reason by kind and severity; notes have none. A sensor's warning has the severity ``fault`` if a check
# reports a fault.
REASON_POINTS = {
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
FILTER_POINTS, MAX_FILTERS = 10.0, 5
REFUSED_POINTS = 40.0
# Points of a jump in degrees: a heading set anew by a few degrees is harmless, one by 60 deg nearly serious.
JUMP_POINTS, POINTS_PER_DEG, MAX_JUMP_DEG = 5.0, 0.5, 60.0
# Events up to this long after landing (s) belong to the flight.
LANDED_S = 2.0


@dataclass(frozen=True, slots=True)
class Reason:
    """Reason to look at a log.

    ``kind``: gate, attitude, crash, reset, filter, sensor or log. ``t``: s on the log's clock or None. ``in_flight``:
    present in flight; for a crash: confirmed by sensors.
    """

    kind: str
    code: str
    points: float
    text: str
    t: float | None = None
    in_flight: bool = False


def reasons(result: Result) -> list[Reason]:
    """Return the reasons to look at a result."""
    faults = {check.text for check in result.checks if check.verdict == "fault"}
    found = [reason for finding in result.findings if (reason := _of_finding(finding, faults)) is not None]
    codes = {r.code for r in found}
    crashes = [event for event in result.events if event.is_crash]
    if crashes and "crash" not in codes:
        found.append(Reason("crash", crashes[0].kind, REASON_POINTS["crash", "serious"], crashes[0].text, crashes[0].t))
    refused = result.reference.refused if result.reference else {}
    for kind, why in refused.items():
        if kind == "truth" or (kind == "onboard" and not codes & ATTITUDE_KINDS):
            name = "truth" if kind == "truth" else "onboard attitude"
            found.append(Reason("attitude", "refused", REFUSED_POINTS, f"The {name} is refused as reference: {why}."))
    shown = bool(crashes) or not result.events  # crashes reported by the autopilot alone are often bench tests
    landed = _last_landing(result)
    return [
        replace(r, in_flight=shown if r.kind == "crash" else landed is not None and (r.t is None or r.t <= landed))
        for r in [*found, *_of_rows(result)]
    ]


def _last_landing(result: Result) -> float | None:
    """Return the end of the last flight (s); None without flight, infinite if unknown."""
    spans = (result.log.get("timeline") or {}).get("airborne") or []
    if spans:
        return float(spans[-1][1]) + LANDED_S
    return math.inf if (result.log.get("seconds") or {}).get("airborne") else None


def _of_finding(finding: Finding, faults: Collection[str]) -> Reason | None:
    kind = kind_of(finding.kind)
    texts = {finding.text, *finding.evidence}
    is_fault = finding.severity == "warning" and not texts.isdisjoint(faults) and (kind, "fault") in REASON_POINTS
    points = REASON_POINTS.get((kind, "fault" if is_fault else finding.severity))
    if points is None:
        return None
    if kind == "reset" and finding.value is not None and finding.unit == "deg":
        points = JUMP_POINTS + POINTS_PER_DEG * min(abs(finding.value), MAX_JUMP_DEG)
    times = f" ({finding.count} times)" if finding.count > 1 and str(finding.count) not in finding.text else ""
    return Reason(kind, finding.kind, points, finding.text + times, finding.t)


def kind_of(finding: str) -> str:
    """Map the kind of a finding to the kind of a reason."""
    if finding in ATTITUDE_KINDS:
        return "attitude"
    if finding in RESET_KINDS:
        return "reset"
    if finding == "crash":
        return "crash"
    return "sensor" if finding in SENSOR_KINDS else "log"


def _of_rows(result: Result) -> list[Reason]:
    """Return reasons of rows that diverged or failed.

    The onboard attitude has its own reason, all filters share one.
    """
    names = row_names(result)
    found = [
        Reason(
            "attitude", r.status, REASON_POINTS["attitude", "serious"], f"The onboard attitude {r.status}: {r.reason}."
        )
        for r in result.estimators
        if r.name == "onboard" and r.status in ("diverged", "failed")
    ]
    for status in ("diverged", "failed"):
        lost = [r for r in result.estimators if r.status == status and _judged(r)]
        if lost:
            why = f": {lost[0].reason}" if len(lost) == 1 and lost[0].reason else ""
            text = f"{listed([names[r.name] for r in lost])} {status}{why}."
            found.append(Reason("filter", status, FILTER_POINTS * min(len(lost), MAX_FILTERS), text))
    return found


def _judged(row: EstimatorRow) -> bool:
    return row.kind == "replay" and row.estimator not in BASELINE_ESTIMATORS


def _flight(result: Result) -> dict[str, Any]:
    log = result.log
    seconds = log.get("seconds") or {}
    software = log.get("firmware") or {}
    return {
        "name": log.get("name"),
        "sha256": log.get("sha256"),
        "date_utc": log.get("date_utc"),
        "firmware": firmware(result).partition(" on ")[0],
        "autopilot": software.get("name"),
        "version": software.get("version"),
        "board": software.get("board"),
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
    """Return the comparison's columns.

    Each has title, metric, whether it is agreement with the onboard attitude, window, unit and row -> value, or the
    code of a missing value.
    """
    found = []
    for heading in main_table(result).columns:
        if heading.metric in MEASURED_TIMES:
            continue
        cells = {r.name: r.metrics.get(heading.window, {}).get(heading.metric) for r in result.estimators}
        values = {name: _short(answer) for name, answer in cells.items() if answer is not None}
        unit = next(a.unit for a in cells.values() if a is not None and a.value is not None)
        found.append(
            {
                "title": heading.title,
                "metric": heading.metric,
                "agreement": heading.title in AGREEMENT_TITLES.values(),
                "window": heading.window,
                "unit": unit,
                "values": values,
            }
        )
    return found


def _short(answer: Answer) -> float | str | None:
    return answer.code if answer.value is None else float(f"{answer.value:.6g}")
