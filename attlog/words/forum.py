"""One log as Markdown of one screen, for a forum or an issue, without what identifies pilot, place, time or vehicle."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator

from attlog.result import Finding, Result, Setting, agreed_settings, setting_number
from attlog.words.findings import SEVERITY
from attlog.words.flight import flight_length, what_happened
from attlog.words.log_text import LogText, public
from attlog.words.numbers import counted
from attlog.words.parameters import ParameterLine, parameter_lines
from attlog.words.text import UNITS_IN_TEXT, escape_markdown

# Most lines and characters of the text: a screen.
MAX_LINES, MAX_CHARACTERS = 40, 4000
# Most findings, lines of evidence of each, and parameters of a list.
MAX_FINDINGS, MAX_EVIDENCE, MAX_PARAMETERS = 6, 2, 14
# Letters of a sentence, longer ones end with an ellipsis.
MAX_SENTENCE = 400
# ArduPilot and PX4 allow 16 letters.
PARAMETER_NAME = re.compile(r"[A-Z][A-Z0-9_]{1,15}")
# Parameters that identify a vehicle, its place, its network or its history, and calibration, which does so as well.
IDENTIFYING = re.compile(
    r"(STAT_|SIM_|SIH_|TC_|SR\d|MAV\d_|SYSID|MAV_SYS_ID|MAV_COMP_ID|CAL_|COMPASS_(OFS|DIA|ODI|MOT|SCALE|PRIO)|RALLY_|FENCE_"
    r"|AHRS_TRIM|RC\d+_(MIN|MAX|TRIM)|INS\d?_.*(OFF|SCAL|CAL)|SENS_BOARD_|TERRAIN_|SCR_USER|COM_FLIGHT).*"
    r"|.*(_ID\d?|DEVID\d?|IP\d?|MAC\d?|GW|(LAT|LNG|LON|ALT|H)0|LAT|LNG|LON|DEC|DECL|PRESS|QNH|FLTTIME|RUNTIME|BOOTCNT|TOTAL|CALTEMP|RECTEMP)"
    r"|.*(SERIAL_?NUM|UUID|NETMASK|PASS|FLIGHT_T_|HOVER).*"
)
# A fraction, or a number of 1e-7 deg, that differs less from the latitude or longitude of the flight may be it.
NEAR_PLACE_DEG = 0.05
# Parameters of wiring, radio, logging and displays.
WIRING = re.compile(
    r"RC\d*_|PWM_|SERVO\d|OSD|SERIAL|MAV_|NTF_|LOG_|SDLOG_|BRD_|CAN_|UAVCAN|TEL_|GCS_|VTX|RELAY|MNT\d?_|CAM\d?_|TRIG_|FRSKY"
    r"|MSP_|SCR_|(COM_)?FLTMODE|CBRK_|SYS_|COM_OF|COM_OBL|HTTP|NET_"
)


def forum_text(result: Result) -> str:
    """Return what happened, findings with evidence, versions and changed parameters as Markdown.

    Left out are positions, dates, times of day, serial numbers, names, paths and every word of the log that firmware
    does not write. Times are s from the start of the log.
    """
    texts = LogText(str(text) for _, _, text in (result.log.get("timeline") or {}).get("texts") or [])

    def shown(sentence: str) -> str:
        for found, written in UNITS_IN_TEXT:
            sentence = found.sub(written, sentence)
        sentence = public(sentence, texts)
        return escape_markdown(sentence if len(sentence) <= MAX_SENTENCE else f"{sentence[: MAX_SENTENCE - 1]}…")

    trouble = [f for f in result.findings if f.is_trouble]
    for evidence in range(MAX_EVIDENCE, -1, -1):
        for most in range(MAX_FINDINGS if evidence == 0 else 0, MAX_FINDINGS + 1)[::-1]:
            lines = list(_lines(result, trouble[:most], len(trouble), evidence, shown))
            text = "\n".join(lines) + "\n"
            if len(lines) <= MAX_LINES and len(text) <= MAX_CHARACTERS:
                return text
            if evidence:
                break
    return text


def _lines(
    result: Result, findings: list[Finding], total: int, evidence: int, shown: Callable[[str], str]
) -> Iterator[str]:
    """Yield the lines with ``evidence`` lines for each of some findings."""
    yield f"**{shown(_title(result))}**"
    yield ""
    yield shown(what_happened(result) or "What happened is unknown: the log has no sign of a flight.")
    yield ""
    yield "**Findings**" if findings else "**Findings:** no problem was found in what this log can answer."
    if findings:
        yield ""
    for finding in findings:
        at = "" if finding.t is None or re.search(r"\d s\b", finding.text) else f" (at {finding.t:.1f} s)"
        text = f"{finding.text.rstrip('.')}{at}."
        action = "" if finding.action in finding.text else finding.action
        yield f"- **{SEVERITY[finding.severity][0]}:** {shown(f'{text} {action}'.strip())}"
        others = [line for line in finding.evidence if line.rstrip(".") not in text]
        yield from (f"  - {shown(line)}" for line in others[:evidence])
    if total > len(findings):
        yield f"- {counted(total - len(findings), 'more finding')} in the report."
    if settings := agreed_settings(result.checks):
        yield ""
        yield f"**To set, with the log's value before it:** {_settings(settings)}"
    yield ""
    yield from _parameters(_unplaced(result), " ".join(f"{f.text} {f.action} {f.evidence}" for f in findings))
    yield ""
    version = result.attlog.get("version") or "of unknown version"
    yield f"*By attlog {version}. Times are s from the start of the log. Place, date, names, serial numbers: left out.*"


def _title(result: Result) -> str:
    """Name vehicle, firmware with its commit, board and length."""
    said = result.log.get("firmware") or {}
    name = " ".join(str(said[key]) for key in ("name", "version") if said.get(key)) or "unknown firmware"
    git = re.fullmatch(r"[0-9a-f]{7,40}", str(said.get("git") or ""))
    name += f" (commit {git[0][:7]})" if git and git[0][:7] not in name else ""
    board = re.match(r"[A-Za-z][\w+-]*", str(said.get("board") or ""))
    name += f" on {board[0]}" if board else ""
    vehicle = str(result.log.get("vehicle") or "vehicle unknown")
    parts = [
        vehicle[:1].upper() + vehicle[1:],
        name,
        "simulated" if result.log.get("simulated") else "",
        flight_length(result),
    ]
    return ", ".join(part for part in parts if part)


def _settings(settings: Iterable[Setting]) -> str:
    old = ((s, "" if s.old is None else f"{setting_number(s.old)} -> ") for s in settings)
    return _shortened([f"`{s.name} {before}{setting_number(s.new)}`" for s, before in old])


def _unplaced(result: Result) -> list[ParameterLine]:
    """Return the parameters without those whose value is the place of the flight, whatever their name."""
    place = result.log.get("place") or {}
    places = [place[key] for key in ("lat", "lon") if place.get(key)]
    values = result.log.get("params") or {}
    near = {
        name
        for name, value in values.items()
        if any(abs(x - at) < NEAR_PLACE_DEG for at in places for x in (value if value % 1 else math.nan, 1e-7 * value))
    }
    return [line for line in parameter_lines(result) if line.name not in near]


def _parameters(lines: list[ParameterLine], said: str) -> Iterator[str]:
    """Yield parameters set during the log, and those that differ from their default.

    Those that findings have ``said`` come first, wiring and logging last.
    """
    if not lines:
        yield "**Changed parameters:** unknown, the log holds no parameter."
        return
    known = [line for line in lines if PARAMETER_NAME.fullmatch(line.name) and not IDENTIFYING.fullmatch(line.name)]
    during = [
        f"`{line.name} {line.value} -> {line.changes[-1].value}` at {line.changes[-1].t:.0f} s"
        for line in known
        if line.changes and line.changes[-1].value != line.value
    ]
    if during:
        yield f"**Set during the log:** {_shortened(during)}"
        yield ""
    if not any(line.kind in ("set", "airframe", "default") for line in lines):
        yield f"**Changed parameters:** unknown, the log holds {counted(len(lines), 'parameter')} but no defaults."
        return
    known.sort(key=lambda line: (line.name not in said, WIRING.match(line.name) is not None))
    changed = [f"`{line.name} {line.value}` ({line.default})" for line in known if line.kind == "set"]
    yield f"**Not at the default (in brackets), without calibration:** {_shortened(changed) or 'none'}"


def _shortened(items: list[str]) -> str:
    rest = len(items) - MAX_PARAMETERS
    return ", ".join(items[:MAX_PARAMETERS]) + (f" and {rest:,} more" if rest > 0 else "")
