"""What flew, when, how long, with which sensors: the line below the title."""

from __future__ import annotations

from attlog.present.names import truth_name
from attlog.present.numbers import duration, number
from attlog.result import Result

COMPARED_WITH = {"truth": "the logged truth", "smoother": "the smoother", "onboard": "the onboard attitude"}


def subtitle(result: Result) -> list[str]:
    """The parts of the line below the title."""
    log, reference = result.log, result.reference
    vehicle = str(log.get("vehicle") or "vehicle unknown")
    what = [firmware(result), "(simulated)" if log.get("simulated") else ""]
    date = str(log["date_utc"])[:16].replace("T", " ") + " UTC" if log.get("date_utc") else "date unknown"
    compared = COMPARED_WITH.get(reference.choice) if reference else None
    if reference is not None and reference.fit is not None:
        compared = f"{truth_name(result)} ({reference.source})"
    parts = [vehicle[:1].upper() + vehicle[1:], " ".join(filter(None, what)), date, length(result)]
    return [p for p in parts if p] + [f"compared with {compared}" if compared else "nothing to compare with"]


def what_happened(result: Result) -> str:
    """The headline without who flew, which stands in the line below the title."""
    who, colon, what = result.headline.partition(": ")
    return what[:1].upper() + what[1:] if colon else who


def tone(result: Result) -> str:
    """How bad a flight was: ``bad``, ``warn``, ``good``, or empty where nothing flew or nothing can be told."""
    if any(event.is_crash for event in result.events):
        return "bad"
    found = {finding.severity for finding in result.findings}
    if "serious" in found or "warning" in found:
        return "bad" if "serious" in found else "warn"
    return "good" if (result.log.get("seconds") or {}).get("airborne") else ""


def length(result: Result) -> str:
    """How long the log is, and how much of it was flown."""
    flown = (result.log.get("seconds") or {}).get("airborne")
    whole = duration(result.log.get("duration_s"))
    return f"{whole}, {duration(flown)} in flight" if flown else whole


def rates(result: Result) -> str:
    """How often each sensor was logged."""
    log = result.log
    return ", ".join(
        f"{word} {number(log[key]['rate_hz'], 'Hz')} Hz"
        for key, word in (("imu", "IMU"), ("mag", "magnetometer"), ("attitude", "attitude"))
        if log.get(key)
    )


def firmware(result: Result) -> str:
    """Name, version and board of the autopilot."""
    said = result.log.get("firmware") or {}
    name = " ".join(str(said[k]) for k in ("name", "version") if said.get(k))
    return f"{name} on {said['board']}" if name and said.get("board") else name
