"""What the tools of an assistant answer: documents of plain values with units, intervals and reasons.

Each function runs in a process of its own and returns the document with the texts of the log, which are marked in it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from attlog.core.errors import UsageError, suggestion
from attlog.result import CHECKS, Check, Event, Finding, Result, agreed_settings
from attlog.words.log_text import marked, without_marks

if TYPE_CHECKING:
    from attlog.flight.model import FlightLog

Answer = tuple[dict[str, Any], list[str]]
# Points of one signal, and signals of one answer.
MAX_POINTS, MAX_SIGNALS = 200, 6
# Letters of the list of a message's fields.
MAX_FIELDS = 400
# Settings of one comparison, and logs.
MAX_SETTINGS, MAX_LOGS = 4, 5
# Names that need no marks in a sentence: short ones of firmware.
USUAL_NAME = re.compile(r"[A-Z][A-Z0-9_]{1,15}")
VERDICT_ORDER = ("fault", "warning", "ok", "unknown")


def info(path: Path, name: str) -> Answer:
    """Return what is in a log and which questions it can answer."""
    from attlog.pipeline.inspection import inspect

    report = inspect(path)
    messages = [
        {
            "message": marked(m["name"] + (f"[{m['instance']}]" if m["instance"] else "")),
            "records": m["records"],
            "rate_hz": m["rate_hz"],
            "fields": m["fields"],
        }
        for m in report["messages"]
    ]
    answerable = [
        {"question": a["question"], "can": a["can"], "reason": a["reason"], "needs": a["setting"]}
        for a in report["answerable"]
    ]
    document = _head(report["log"], name) | {
        "headline": report["headline"],
        "compared_with": report["compared_with"],
        "sensors": _sensors(report["log"]),
        "answerable": answerable,
        "findings": [_finding(Finding(**f)) for f in report["findings"]],
        "messages": messages,
        "status_texts": _texts(report["log"]),
    }
    return document, _own_words(report["log"], [m["name"] for m in report["messages"]])


def health(path: Path, name: str) -> Answer:
    """Return whether sensors can be trusted, with evidence, and what to set."""
    from attlog.flight import read
    from attlog.pipeline.evaluation import health as assess

    log = read(path)
    own = _names(log)
    result = assess(log)
    checks = sorted(result.checks, key=lambda check: VERDICT_ORDER.index(check.verdict))
    document = _head(result.log, name) | {
        "headline": result.headline,
        "settings": _settings(result.checks),
        "findings": [_finding(f) for f in result.findings if f.is_trouble],
        "checks": [_check(check) for check in checks],
        "notes": [_finding(f) for f in result.findings if not f.is_trouble],
    }
    return document, _own_words(result.log, own)


def analyze(path: Path, name: str, estimators: Sequence[str] = (), window: str = "") -> Answer:
    """Return headline, events, findings with evidence, and the answers with intervals."""
    config = ({"estimators": list(estimators)} if estimators else {}) | ({"window": window} if window else {})
    result, texts = _analyzed(path, config)
    reference = result.reference
    document = _head(result.log, name) | {
        "headline": result.headline,
        "compared_with": None if reference is None else reference.text,
        "caveat": None if reference is None else reference.caveat,
        "findings": [_finding(f) for f in result.findings if f.is_trouble],
        "settings": _settings(result.checks),
        "events": [_event(event) for event in result.events],
        "answers": [{"question": v.question, "answered": v.answered, "answer": v.sentence} for v in result.verdicts],
        "numbers": _numbers(result, window),
        "parameters_set_in_flight": _changes(result.log),
        "notes": [_finding(f) for f in result.findings if not f.is_trouble],
        "status_texts": _texts(result.log),
    }
    return document, texts


def _analyzed(path: Path, config: dict[str, Any]) -> tuple[Result, list[str]]:
    """Return the result of a log and the log's words."""
    from attlog.flight import read
    from attlog.pipeline.evaluation import analyze as run

    log = read(path)
    own = _names(log)
    result = run(log, {"signals": "none", **config})
    return result, _own_words(result.log, own)


def signals(
    path: Path, name: str, names: Sequence[str], start_s: float | None, end_s: float | None, points: int
) -> Answer:
    """Return fields of messages by name over time: the smallest and largest value of each part, within ``points``.

    Without names those that the log has.
    """
    import numpy as np

    from attlog.flight import read
    from attlog.flight.signals import Signals
    from attlog.metrics.trace import envelope

    log = read(path)
    known = Signals(log)
    if not names:
        fields: dict[str, dict[str, list[str]]] = {}
        for one in known.all:
            arrays = fields.setdefault(one.name.removesuffix(f".{one.field}"), {})
            unit = f" [{one.unit}]" if one.unit else ""
            arrays.setdefault(one.field.partition("[")[0] + unit, []).append(f"{one.field}{unit}")
        listed = [
            {"message": marked(message), "fields": marked(", ".join(map(_span, arrays.values())), MAX_FIELDS)}
            for message, arrays in fields.items()
        ]
        return {"log": marked(name), "duration_s": log.seconds, "messages": listed}, []
    if len(names) > MAX_SIGNALS:
        raise UsageError(f"{len(names)} signals; ask for at most {MAX_SIGNALS} at a time")
    series = []
    for asked in map(without_marks, names):
        t, y = known.read(asked)
        kept = (t >= (-np.inf if start_s is None else start_s)) & (t <= (np.inf if end_s is None else end_s))
        t, y = t[kept], y[kept]
        finite = np.isfinite(y)
        found: dict[str, Any] = {"signal": marked(asked), "unit": _logged_unit(known.unit(asked)), "records": len(t)}
        if not finite.any():
            found["values"] = None
            found["reason"] = "unknown: no finite value" if len(t) else "unknown: no record in this time"
        else:
            thin_t, thin_y = envelope(t, y[:, None], max(min(points, MAX_POINTS) // len(names), 4))
            found |= {"min": float(y[finite].min()), "max": float(y[finite].max()), "mean": float(y[finite].mean())}
            found |= {"not_finite": int((~finite).sum())} if not finite.all() else {}
            found |= {"thinned": len(thin_t) < len(t), "t_s": _column(thin_t, 4), "values": _column(thin_y[:, 0], 5)}
        series.append(found)
    document = {"log": marked(name), "duration_s": log.seconds, "clock": "s from the first IMU sample"}
    return document | {"series": series}, []


def compared_settings(settings: Sequence[str], logs: Sequence[Path]) -> tuple[str, ...]:
    """Return the settings to compare, what flew before a single one of its filter. UsageError for wrong ones."""
    from attlog.compare.setting import flown_filter, parse_configuration

    if len(settings) == 1 and (flown := flown_filter(settings[0])):
        settings = [flown, *settings]
    if len(settings) < 2:
        raise UsageError(
            "give two settings or more; only one of the filter that flew can be alone (EKF2_GPS_DELAY=250)"
        )
    if len(settings) > MAX_SETTINGS or len(logs) > MAX_LOGS:
        raise UsageError(f"compare at most {MAX_SETTINGS} settings on {MAX_LOGS} logs at a time")
    for text in settings:
        parse_configuration(text)
    return tuple(settings)


def compare(paths: Sequence[Path], names: Sequence[str], settings: Sequence[str]) -> Answer:
    """Return how settings of filters differ from the first one on logs, with intervals."""
    from attlog.compare.run import compare as run
    from attlog.compare.setting import parse_configuration

    found = run(list(paths), [parse_configuration(text) for text in settings])
    shown = {line.name: marked(name) for line, name in zip(found.logs, names, strict=True)}
    rows = [
        {
            "metric": question.id,
            "title": question.title,
            "setting": contrast.configuration,
            "logs": pooled.logs,
            "unit": _unit(question.unit),
            "change": None if pooled.value is None else {question.scale: pooled.value, "ci95": pooled.ci95},
            "better_or_worse": pooled.direction,
            "reason": pooled.reason,
        }
        for question in found.questions
        if question.main
        for contrast in question.contrasts
        if (pooled := contrast.over) is not None and pooled.value is not None
    ]
    document = {
        "compared": [c.text for c in found.configurations],
        "first": found.first.text,
        "verdicts": [{"setting": v.configuration, "verdict": v.lead} for v in found.verdicts],
        "logs": [
            {"log": shown[line.name], "compared_with": marked(line.reference), "not_used": marked(line.reason)}
            | ({"same_flight_as": shown.get(line.same_as, line.same_as)} if line.same_as else {})
            for line in found.logs
        ],
        "differences": rows,
        "unanswered": [{"metric": metric, "reason": why} for metric, why in found.unanswered.items()],
    }
    return document, []


def explain(name: str, path: Path | None = None, log_name: str = "") -> Answer:
    """Return what a metric, a check or a parameter means; with a log its value or verdict there.

    UsageError for a name that attlog does not know.
    """
    from attlog.metrics import definitions

    name = without_marks(name).strip()
    metrics = definitions()
    if name in metrics:
        metric = metrics[name]
        found: dict[str, Any] = {"metric": name, "title": metric.title, "unit": _unit(metric.unit)}
        found |= {"best": metric.better, "definition": metric.definition, "page": "docs/metrics.md"}
        if path is None:
            return found, []
        result, texts = _analyzed(path, {})
        windows = [
            where for where in result.windows if any(name in r.metrics.get(where, {}) for r in result.estimators)
        ]
        here = [{"window": where, "rows": _rows(result, where, name)} for where in windows or ["all"]]
        return found | {"log": marked(log_name), "in_this_log": here}, texts
    if name in CHECKS:
        return _explained_check(name, path, log_name)
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{1,40}", name) and (name.isupper() or path is not None):
        return _explained_parameter(name, path, log_name)
    raise UsageError(f"{name[:60]!r} is no metric, check or parameter{suggestion(name, [*metrics, *CHECKS])}")


def _explained_check(question: str, path: Path | None, log_name: str) -> Answer:
    from attlog.health.registry import CAUSES

    row = CHECKS[question]
    found: dict[str, Any] = {"check": question, "title": row.title, "page": "docs/sensors.md"}
    found |= {"verdicts": "ok, warning, fault, or unknown with the reason", "usual_cause": CAUSES.get(question, "")}
    if path is None:
        return found, []
    document, texts = health(path, log_name)
    here = [check for check in document["checks"] if check["question"] == question]
    why = "unknown: this log has nothing to check it with" if not here else ""
    return found | {"log": marked(log_name), "in_this_log": here, "reason": why}, texts


def _explained_parameter(name: str, path: Path | None, log_name: str) -> Answer:
    from attlog.assistants.parameters import REFERENCES, meaning
    from attlog.flight.limits import documented_range

    if path is None:
        known = meaning(name)
        if known is None:
            raise UsageError(f"{name!r} is no metric or check, and attlog describes no parameter of this name")
        return {"parameter": name, **known, "range": documented_range(name)}, []
    from attlog.flight import read
    from attlog.flight.advice import LOG_BITS, bit_mask
    from attlog.flight.parameters import parameter_histories

    log = read(path)
    known = meaning(name, log.firmware.name or "")
    found: dict[str, Any] = {"parameter": marked(name), "log": marked(log_name)}
    found |= {"firmware": marked(" ".join(filter(None, (log.firmware.name, log.firmware.version))) or "unknown")}
    found |= known or {"meaning": "unknown: attlog does not use this parameter and has no description of it"}
    found |= {} if known else {"reference": REFERENCES.get(log.firmware.name or "", "")}
    found["range"] = documented_range(name)
    history = next((h for h in parameter_histories(log) if h.name == name), None)
    if history is None:
        if known is None and (near := suggestion(name, log.parameters.lines)).startswith("; did"):
            found["near"] = marked(near.removeprefix("; did you mean ").rstrip("?"))
        return found | {"value": None, "reason": "unknown: the log does not hold this parameter"}, []
    default = "unknown: not logged" if history.default is None else history.default
    found |= {"value": history.value, "default": default, "origin": history.origin}
    mask = bit_mask(history.value) if found.get("unit") == "bits" else None
    found |= {} if mask is None else {"bits_set": [bit for bit in range(53) if mask >> bit & 1]}
    if name == "LOG_BITMASK" and (bits := LOG_BITS.get(log.settings.family)) is not None:
        found["bits_of_this_vehicle"] = {kind: bit for kind, bit in bits._asdict().items() if bit is not None}
    return found | {"set_during_the_log": [{"t_s": t, "value": value} for t, value in history.changes]}, []


# Parts of documents.


def _head(log: dict[str, Any], name: str) -> dict[str, Any]:
    """Return what flew, without place and device numbers."""
    firmware = " ".join(str(log["firmware"][key]) for key in ("name", "version") if log["firmware"].get(key))
    return {
        "log": marked(name),
        "vehicle": marked(log["vehicle"] or "unknown"),
        "firmware": marked(firmware or "unknown"),
        "simulated": bool(log["simulated"]),
        "date_utc": log["date_utc"] or "unknown: the log has no GNSS time",
        "duration_s": log["duration_s"],
        "airborne_s": (log["seconds"] or {}).get("airborne"),
    }


def _sensors(log: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {"sensor": what, "source": marked(log[what]["source"]), "rate_hz": log[what]["rate_hz"]}
        if log[what] is not None
        else {"sensor": what, "source": None, "reason": log["choices"].get(what) or "the log has none"}
        for what in ("imu", "mag", "attitude", "truth")
    ]


def _finding(finding: Finding) -> dict[str, Any]:
    found: dict[str, Any] = {"severity": finding.severity, "kind": finding.kind, "text": finding.text}
    found |= {"t_s": finding.t, "t_end_s": finding.t_end, "count": finding.count if finding.count > 1 else None}
    found |= {"value": finding.value, "unit": _unit(finding.unit) if finding.value is not None else None}
    found |= {"evidence": finding.evidence[:4], "cause": finding.cause, "action": finding.action}
    return _given(found)


def _event(event: Event) -> dict[str, Any]:
    found: dict[str, Any] = {"t_s": event.t, "t_end_s": event.t_end, "kind": event.kind, "severity": event.severity}
    found |= {"text": event.text, "value": event.value, "unit": _unit(event.unit) if event.value is not None else None}
    return _given(found | {"evidence": event.evidence[:3], "cause": None if event.cause is None else event.cause.text})


def _check(check: Check) -> dict[str, Any]:
    found: dict[str, Any] = {"question": check.question, "sensor": check.sensor, "verdict": check.verdict}
    found |= {"in_use": None if check.in_use else False, "text": check.text, "value": check.value, "ci95": check.ci95}
    found |= {"unit": _unit(check.unit) if check.value is not None else None, "limit": check.threshold}
    found |= {"evidence": check.evidence[:3], "cause": check.cause}
    found["action"] = check.action or ("" if check.settings else check.why_no_setting)
    return _given(found)


def _settings(checks: Iterable[Check]) -> list[dict[str, Any]]:
    return [
        {"parameter": s.name, "old": s.old if s.old is not None else "unknown", "new": s.new, "unit": s.unit}
        for s in agreed_settings(checks)
    ]


def _numbers(result: Result, window: str) -> list[dict[str, Any]]:
    """Return the metric behind each answer with the value of every row, or why it is missing."""
    from attlog.metrics import definitions

    found = []
    for verdict in result.verdicts:
        where, metric = verdict.window or window or "all", verdict.metric
        rows = _rows(result, where, metric)
        known = definitions().get(metric)
        found.append(
            {
                "question": verdict.question,
                "metric": metric,
                "window": where,
                "unit": _unit(known.unit if known else ""),
                "best": known.better if known else None,
                "none_significantly_better_than": result.best.get(where, {}).get(metric, []),
                "rows": rows,
            }
        )
    return found


def _rows(result: Result, where: str, metric: str) -> list[dict[str, Any]]:
    """Return a metric's value of every row in a window, or why it is missing."""
    rows: list[dict[str, Any]] = []
    for row in result.estimators:
        one = row.metrics.get(where, {}).get(metric)
        if one is None:
            rows.append({"row": row.name, "value": None, "reason": row.reason or "not computed in this window"})
        elif one.value is None:
            rows.append({"row": row.name, "value": None, "reason": one.reason or one.code or "unknown"})
        else:
            ranked = {} if one.ranked else {"not_ranked": one.reason or "not comparable"}
            rows.append({"row": row.name, "value": one.value, "ci95": one.ci95, "n": one.n} | ranked)
    if not any(row["value"] is not None for row in rows):
        reasons = dict.fromkeys(str(row["reason"]) for row in rows)
        rows = [{"row": "all", "value": None, "reason": "; ".join(reasons) or "no filter ran"}]
    return rows


def _changes(log: dict[str, Any]) -> list[dict[str, Any]]:
    changed = log.get("params_in_flight") or {}
    return [
        {"parameter": marked(name), "t_s": t, "value": value} for name, all_ in changed.items() for t, value in all_
    ]


def _names(log: FlightLog) -> list[str]:
    """Return the names of messages and parameters of a log."""
    return [*(name for name, _ in (log.messages.tables if log.messages is not None else ())), *log.parameters.lines]


def _texts(log: dict[str, Any]) -> list[dict[str, Any]]:
    return [{"t_s": t, "level": level, "text": marked(text)} for t, level, text in log["timeline"]["texts"]]


def _own_words(log: dict[str, Any], messages: Iterable[str] = ()) -> list[str]:
    """Return the texts and unusual names that the writer of a log chose."""
    from attlog.assistants.parameters import REFERENCES

    names = [*(log.get("params_in_flight") or {}), *(n for n in log.get("params") or {} if not USUAL_NAME.fullmatch(n))]
    names += [*(n for n in messages if not USUAL_NAME.fullmatch(n)), *log["attitudes"], *log["poses"]]
    names += [log[what]["source"] for what in ("imu", "mag", "attitude", "truth") if log[what] is not None]
    names += [str(value) for value in log["firmware"].values() if value and str(value) not in REFERENCES]
    unusual = [
        name for name in names if not re.fullmatch(r"[A-Za-z0-9_]{1,8}(:\d+)?|[a-z]+(_[a-z0-9]+){1,4}(:\d+)?", name)
    ]
    return [*(str(text) for _, _, text in log["timeline"]["texts"]), *unusual]


def _unit(unit: str) -> str:
    return "none" if unit in ("", "1") else unit


def _span(elements: list[str]) -> str:
    """Return the elements of an array as first and last."""
    return elements[0] if len(elements) == 1 else f"{elements[0]} to {elements[-1]}"


def _logged_unit(unit: str) -> str:
    """Return a unit, which a log may define itself: marked where it is none of the usual form."""
    if not unit:
        return "unknown: the log has none"
    return unit if re.fullmatch(r"[\w/^*%()²°µ.\-]{0,14}", unit) else marked(unit)


def _given(document: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in document.items() if value is not None}


def _column(values: Any, digits: int) -> list[float | None]:
    return [float(f"{x:.{digits + 1}g}") if abs(x) < 1e300 else None for x in values.tolist()]
