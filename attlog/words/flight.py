"""Display texts of a flight: title line, tone, gyro bias and messages."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from attlog.result import Reproduction, Result
from attlog.words.names import flown_name, truth_name
from attlog.words.numbers import duration, moment
from attlog.words.text import typeset

if TYPE_CHECKING:
    from attlog.result import CommonBias


COMPARED_WITH = {"truth": "the logged truth", "smoother": "the smoother", "onboard": "the onboard attitude"}


def subtitle(result: Result) -> list[str]:
    """Return the parts of the line below the title."""
    log, reference = result.log, result.reference
    vehicle = str(log.get("vehicle") or "vehicle unknown")
    what = [firmware(result), "(simulated)" if log.get("simulated") else ""]
    date = str(log["date_utc"])[:16].replace("T", " ") + " UTC" if log.get("date_utc") else "date unknown"
    compared = COMPARED_WITH.get(reference.choice) if reference else None
    if reference is not None and reference.fit is not None:
        compared = f"{truth_name(result)} ({reference.source})"
    parts = [vehicle[:1].upper() + vehicle[1:], " ".join(filter(None, what)), date, flight_length(result)]
    return [p for p in parts if p] + [f"compared with {compared}" if compared else "nothing to compare with"]


def what_happened(result: Result) -> str:
    """Return the headline without the vehicle, which the subtitle contains."""
    who, colon, what = result.headline.partition(": ")
    return what[:1].upper() + what[1:] if colon else who


def flight_tone(result: Result) -> str:
    """Return ``bad``, ``warn`` or ``good``, or an empty text without a flight."""
    if any(event.is_crash for event in result.events):
        return "bad"
    found = {finding.severity for finding in result.findings}
    if "serious" in found or "warning" in found:
        return "bad" if "serious" in found else "warn"
    return "good" if (result.log.get("seconds") or {}).get("airborne") else ""


def flight_length(result: Result) -> str:
    """Return the duration of the log and of its flights."""
    flown = (result.log.get("seconds") or {}).get("airborne")
    whole = duration(result.log.get("duration_s"))
    return f"{whole}, {duration(flown)} in flight" if flown else whole


def firmware(result: Result) -> str:
    """Return name, version and board of the autopilot."""
    said = result.log.get("firmware") or {}
    name = " ".join(str(said[k]) for k in ("name", "version") if said.get(k))
    return f"{name} on {said['board']}" if name and said.get("board") else name


# Gyro bias subtracted for every filter, as a sentence.


def gyro_bias_text(result: Result) -> list[str]:
    """Return one sentence per replayed IMU on the bias subtracted from its gyro."""
    several = len(result.gyro_bias) > 1
    return [
        (f"{bias.imu}: " if several else "") + sentence
        for bias in result.gyro_bias
        for sentence in (bias_sentence(bias), *([] if bias.steps_dps is None else [steps_sentence(bias.steps_dps)]))
    ]


def steps_sentence(dps: list[float]) -> str:
    """Return the sentence on a gyro whose readings are cut towards zero."""
    return f"The gyro's readings are cut towards zero in steps of {max(dps):.2g} deg/s; half a step was added."


def bias_sentence(bias: CommonBias) -> str:
    """Return the sentence for one IMU."""
    if bias.dps is None:
        why = f": {bias.why}" if bias.why else " (--gyro-bias none)"
        return f"No gyro bias was subtracted before the filters ran{why}."
    if bias.taken == "onboard":
        mean = rates_text(bias.dps)
        return f"Subtracted from the gyro for every filter: the onboard estimator's bias, in the mean {mean}."
    seconds = duration(bias.seconds)
    text = f"Subtracted from the gyro for every filter: {rates_text(bias.dps)}, its mean over {seconds} of rest"
    text += " before take-off" if bias.flew else ""
    if bias.half95_dps is not None:
        text += f" (±{max(bias.half95_dps):.2g} deg/s)"
    if bias.landed_dps is not None:
        moved = max(abs(after - before) for after, before in zip(bias.landed_dps, bias.dps, strict=True))
        text += f". After landing its mean differs by up to {moved:.2g} deg/s"
    return text + "."


def rates_text(dps: list[float]) -> str:
    """Format three rates about the body axes."""
    x, y, z = (f"{0.0 if abs(v) < 0.0005 else v:+.3f}" for v in dps)
    return f"{x}, {y}, {z} deg/s about x, y, z"


# Deviation of a re-run onboard filter from the flown attitude, as a sentence.


def rerun_sentences(result: Result) -> list[str]:
    """Describe how closely each re-run follows the flown attitude.

    Without a re-run return the reason.
    """
    rows = result.estimators
    found = [reproduction_text(row.estimator, row.reproduction) for row in rows if row.reproduction is not None]
    return found or [typeset(result.not_rerun)] * bool(result.not_rerun)


def rerun_summaries(result: Result) -> list[str]:
    """Return in a few words how closely each re-run follows the flown attitude, empty without a re-run."""
    rows = result.estimators
    return [reproduction_summary(row.estimator, row.reproduction) for row in rows if row.reproduction is not None]


def reproduction_summary(estimator: str, found: Reproduction) -> str:
    """Return in a few words how closely an estimator such as ``px4_ekf2`` follows the flown attitude."""
    until = "" if found.until_s is None else f" until {moment(found.until_s)}"
    if found.follows:
        return f"{flown_name(estimator)} re-run follows within {_distance(found)}{until}."
    return f"{flown_name(estimator)} re-run does not follow: {_distance(found)} apart{until}."


def mode_phrase(mode: str) -> str:
    """Return in one phrase where a re-run takes its resets and aiding from."""
    return "resets and GNSS use " + {"own": "by the filter's own rules", "flown": "as logged"}[mode]


def reproduction_text(estimator: str, found: Reproduction) -> str:
    """Describe how closely an estimator such as ``px4_ekf2`` follows the flown attitude."""
    where = "in the air" if found.airborne else "over the log"
    size = _distance(found)
    if found.until_s is not None:
        where += f" to the lane switch at {moment(found.until_s)}"
    if found.follows:
        return f"{flown_name(estimator)} run again: within {size} of the onboard attitude (median {where})."
    leaves = "" if found.leaves_s is None else f", from {moment(found.leaves_s, 0)}"
    text = f"{flown_name(estimator)} run again does not follow the onboard attitude"
    return f"{text}: {size} apart (median {where}{leaves})."


def _distance(found: Reproduction) -> str:
    """Return the distance of a re-run from what flew."""
    return f"{_upper_bound(found.tilt_median_deg)} tilt and {_upper_bound(found.heading_median_deg)} heading"


def _upper_bound(deg: float) -> str:
    """Return an angle rounded up, with two decimals below 1 deg."""
    scale = 100 if deg < 1.0 else 10
    return f"{max(math.ceil(deg * scale), 1) / scale:g}°"


# Autopilot messages, and alarms among them.

# Texts that are alarms at any level.
ALARM = re.compile(r"fail[- ]?safe|crash|emergency|lost|terminat|\bland(ing)? now\b|parachute", re.IGNORECASE)

LEVELS = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
CRITICAL, WARNING = 2, 4


def messages(result: Result) -> list[tuple[float, int, str]]:
    """Return the autopilot's messages in time order: (t, level, text)."""
    found = (result.log.get("timeline") or {}).get("texts") or []
    return sorted(((float(t), int(level), str(text)) for t, level, text in found), key=lambda m: m[0])


def alarming(level: int, text: str) -> bool:
    """Return whether a message is an alarm: a failsafe, crash or critical level."""
    return level <= CRITICAL or bool(ALARM.search(text))


def level_name(level: int) -> str:
    """Return the name of a syslog level."""
    return LEVELS[level] if 0 <= level < len(LEVELS) else str(level)
