"""Who wrote an ArduPilot log and what flew: firmware, family, kind of vehicle."""

from __future__ import annotations

import re

from attlog.flight.model import Firmware
from attlog.formats.base import Messages

BANNER = re.compile(
    r"(?:APM:|Ardu|APM|Antenna|\b)(Copter|Plane|Rover|rover2?|Sub|Tracker|Blimp)\s+"
    r"[Vv]?(\d[\w.\-]*)(?:\s*\(([0-9a-fA-F]+)\))?"
)
BOARD = re.compile(r"^(\S+) [0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8}$")
FRAMES = {
    1: "quadrotor",
    2: "hexarotor",
    3: "octorotor",
    4: "octorotor",
    5: "hexarotor",
    6: "helicopter",
    7: "tricopter",
    8: "single rotor",
    9: "coaxial helicopter",
    11: "helicopter",
    12: "dodecarotor",
    13: "helicopter",
}
"""FRAME_CLASS of Copter."""
SOFTWARE = {0: "plane", 10: "copter", 20: "rover", 40: "sub"}
"""SYSID_SW_TYPE."""
FAMILY_RECORDS = (("copter", ("MOTB", "PSCD", "PSC")), ("plane", ("AETR", "TECS", "LAND")), ("rover", ("STER", "THR")))


def banner(messages: Messages) -> tuple[str, str, str]:
    """(family, version, git hash) from the firmware's message, empty strings where there is none."""
    texts = [t.text for t in messages.texts]
    texts += [str(v) for v in messages.info.values() if isinstance(v, str)]
    own = messages.info.get("VER")
    if isinstance(own, dict):
        texts.insert(0, str(own.get("FWS", "")))
    for line in messages.info.get("banner", ()) or ():
        texts.append(str(line))
    matches = [m for m in map(BANNER.search, texts) if m]
    if not matches:
        return "", "", ""
    best = next((m for m in matches if m[3]), matches[0])  # the one with a hash is the firmware's own
    family = best[1].lower()
    return ("rover" if family.startswith("rover") else family), best[2], best[3] or ""


def firmware(messages: Messages) -> Firmware:
    """Who wrote the log, as far as it tells; the version starts with the vehicle (``Copter 4.6.2``)."""
    family, version, git = banner(messages)
    board = next((m[1] for t in messages.texts if (m := BOARD.match(t.text.strip()))), "")
    return Firmware("ArduPilot", f"{family.capitalize()} {version}".strip(), git, board)


def family_of(messages: Messages, values: dict[str, float]) -> str:
    """The firmware family (copter, plane, rover, sub), empty if unknown: by message, parameters or records."""
    family = banner(messages)[0]
    if family:
        return family
    if values.get("SYSID_SW_TYPE") in SOFTWARE:
        return SOFTWARE[int(values["SYSID_SW_TYPE"])]
    names = set(messages.names())
    for known, records in FAMILY_RECORDS:
        if names & set(records):
            return known
    control = messages.first("CTUN")
    if control is not None and any(c in control for c in ("AngBst", "ABst", "ThrIn")):
        return "copter"
    return ""


def vehicle(messages: Messages, values: dict[str, float], family: str) -> str:
    """The kind of vehicle in words."""
    if family == "plane":
        return "VTOL" if values.get("Q_ENABLE", 0) > 0 else "fixed wing"
    if family == "rover":
        return "boat" if values.get("FRAME_CLASS") == 2 else "rover"
    if family == "sub":
        return "submarine"
    if family == "copter":
        if int(values.get("FRAME_CLASS", 0)) in FRAMES:
            return FRAMES[int(values["FRAME_CLASS"])]
        for text in messages.texts:
            match = re.search(r"[Ff]rame: (\w+)", text.text)
            for word, name in (
                ("QUAD", "quadrotor"),
                ("HEXA", "hexarotor"),
                ("OCTA", "octorotor"),
                ("Y6", "hexarotor"),
                ("TRI", "tricopter"),
                ("HELI", "helicopter"),
            ):
                if match and match[1].upper().startswith(word):
                    return name
        return "helicopter" if any(n.startswith("H_SV") for n in values) else "multirotor"
    return family or "unknown"
