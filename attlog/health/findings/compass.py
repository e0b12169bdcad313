"""One entry per compass: size, direction, declination, motors, rejections, realignments and texts are its evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from attlog.health.findings.finding import Explanation, Finding
from attlog.health.onboard import gnss_heading

KIND = "compass"
CHECKS = {
    gnss_heading.NAME: Explanation(
        KIND,
        as_fault="serious",
        cause="The compass is turned, badly calibrated or disturbed, or the declination is wrong.",
        fault="compass",
    ),
    "compass axes": Explanation(
        KIND,
        as_fault="serious",
        cause="The compass is mounted otherwise than set, or its axes are mixed up.",
        fault="compass_mounting",
    ),
    "compass turn": Explanation(
        KIND,
        as_fault="serious",
        cause="The compass is mounted turned against what is set, or the attitude's heading is off.",
        fault="compass_mounting",
    ),
    "compass offset": Explanation(
        KIND, cause="Iron or a current near the compass that its calibration does not know.", fault="compass"
    ),
    "field": Explanation(KIND, cause="The compass is not calibrated, or iron is near.", fault="compass"),
    "field against motors": Explanation(
        KIND, cause="Currents of motors and battery bend the field at the compass.", fault="interference"
    ),
    "field against attitude": Explanation(
        KIND, cause="A disturbed or badly calibrated compass, or an attitude that turns away.", fault="compass"
    ),
    "rejected compass": Explanation(
        KIND, cause="A disturbed or badly calibrated compass, or a wrong heading.", fault="compass"
    ),
    "declination": Explanation(
        KIND,
        as_warning="note",
        cause="The compass does not point forward, or the heading is not of true north.",
        fault="compass",
    ),
    "declination set": Explanation(
        "declination", cause="A value set by hand, or kept from another place.", fault="declination"
    ),
}
"""By the name of the check, the one that leads among equals first."""
REPORTS = {"mag_spikes": KIND, "mag_uncalibrated": KIND, "err_3_1": KIND, "err_3_4": KIND, "compass_switch": KIND}
"""What readers and autopilot say of it, by code."""
ONLY_OFFSETS = "mag_only_offsets"
MISSING = ("mag_dead", "no_mag", "mag_not_in_log", ONLY_OFFSETS)
"""What a reader says of a compass that is not there says it all."""
DEAD = Explanation("mag_dead", cause="Its wiring, its bus or the compass itself.", fault="compass_wiring")
"""Of a compass that measures no field."""
ATTITUDE, SHARED = "attitude", ("realigned", "reset", "attitude")
"""Kinds that are of the compass where they speak of heading and the compass is in doubt."""
LOST = "The onboard estimator was not aligned, or drifted without a compass."
BY_FIELD = ("compass axes", "field", "field against motors")
BENT_PCT = 30.0
LEADS = (
    gnss_heading.NAME,
    "compass axes",
    "compass turn",
    "compass_motors",
    "compass offset",
    *BY_FIELD[1:],
    "field against attitude",
    "compass_offset",
    "innovations",
    "declination",
)
"""Checks of the compass alone, and what tells most of it first."""
BY_ATTITUDE = ("field against attitude", "declination", "compass turn", "compass offset")
"""Checks that turn the field by the onboard attitude."""


def settled(signs: Sequence[Finding]) -> list[Finding]:
    """The signs with those of heading under the compass where it is in doubt itself.

    A heading that jumps or differs while the field is wrong has the same cause, and nobody who believed that field
    can tell whose heading is wrong.
    """
    signs = _by_gnss(_once_dead(signs))
    if any(sign.kind in MISSING and sign.is_trouble for sign in signs):
        signs = [sign for sign in signs if sign.kind != KIND]
    if any(sign.kind == KIND and sign.about in BY_FIELD and sign.is_trouble for sign in signs):
        signs = [replace(s, severity="warning") if _accuses_heading(s) else s for s in signs]
    if any(sign.kind == ATTITUDE and sign.severity == "serious" for sign in signs):
        signs = [sign for sign in signs if not (sign.kind == KIND and sign.about in BY_ATTITUDE)]
    if not any(sign.kind == KIND and sign.is_trouble for sign in signs):
        return list(signs)
    own = [replace(sign, kind=KIND) if _of_heading(sign) else sign for sign in signs]
    return sorted(own, key=_place)


def _once_dead(signs: Sequence[Finding]) -> list[Finding]:
    """The signs without "all its values are zero" of a compass whose values are its offsets, and were left out."""
    dead = {_source(sign): sign for sign in signs if sign.kind == DEAD.kind}
    left = {_source(sign) for sign in signs if sign.kind == ONLY_OFFSETS}
    return [
        replace(sign, cause=dead[_source(sign)].cause, action=dead[_source(sign)].action)
        if sign.kind == ONLY_OFFSETS and _source(sign) in dead
        else sign
        for sign in signs
        if not (sign.kind == DEAD.kind and _source(sign) in left)
    ]


def _source(sign: Finding) -> str:
    """The sensor that a sentence begins with."""
    return sign.text.partition(":")[0]


def _by_gnss(signs: Sequence[Finding]) -> list[Finding]:
    """The signs with what says that the heading is wrong under the compass too, where GNSS shows that it is.

    GNSS believed no field: nobody has to doubt it. What the field shows tells the cause better. Without a compass it
    is the attitude's.
    """
    gnss = [sign for sign in signs if sign.about == gnss_heading.NAME and sign.is_trouble]
    if not gnss:
        return list(signs)
    if any(sign.kind in MISSING and sign.is_trouble for sign in signs):
        return [
            replace(sign, kind=ATTITUDE, about="heading", cause=LOST, action="") if sign in gnss else sign
            for sign in signs
        ]
    others = [sign for sign in signs if sign.kind == KIND and sign.is_trouble and sign not in gnss and sign.action]
    if others:
        signs = [replace(sign, cause="", action="") if sign in gnss else sign for sign in signs]
    return [_under_compass(sign) if sign.kind in SHARED and sign.about == "heading" else sign for sign in signs]


def _under_compass(sign: Finding) -> Finding:
    return replace(sign, kind=KIND, cause="", action="")


def _place(sign: Finding) -> int:
    """What tells most of a compass first: motors that bend it by a third, else its size."""
    if sign.about == "field against motors" and sign.value is not None and sign.value > BENT_PCT:
        return 0
    return LEADS.index(sign.about) if sign.about in LEADS else len(LEADS)


def _of_heading(sign: Finding) -> bool:
    return sign.kind in SHARED and sign.about == "heading" and sign.severity != "serious"


def _accuses_heading(sign: Finding) -> bool:
    return sign.kind == ATTITUDE and sign.about == "heading" and sign.severity == "serious"
