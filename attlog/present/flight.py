"""What flew, when, how long, with which sensors: the line below the title."""

from __future__ import annotations

from attlog.present.numbers import counted, duration, listed, number
from attlog.result import Result

COMPARED_WITH = {"truth": "the logged truth", "smoother": "the smoother", "onboard": "the onboard attitude"}


def subtitle(result: Result) -> list[str]:
    """The parts of the line below the title."""
    log, reference = result.log, result.reference
    parts = [str(log.get("vehicle") or ""), firmware(result), "simulated" if log.get("simulated") else ""]
    parts.append(str(log["date_utc"])[:16].replace("T", " ") + " UTC" if log.get("date_utc") else "date unknown")
    parts += [length(result), rates(result)]
    compared = COMPARED_WITH.get(reference.choice) if reference else None
    filters = counted(sum(r.kind == "replay" for r in result.estimators), "filter") + " re-run"
    parts.append(f"{filters}, compared with {compared}" if compared else f"{filters}, nothing to compare with")
    return [p for p in parts if p]


def length(result: Result) -> str:
    """How long the log is, and how much of it was flown and rested."""
    seconds = result.log.get("seconds") or {}
    phases = (("airborne", "in the air"), ("rest", "at rest"))
    used = [f"{duration(seconds[k])} {words}" for k, words in phases if seconds.get(k)]
    whole = duration(result.log.get("duration_s"))
    return f"{whole}, of which {listed(used)}" if used else whole


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
