"""Is a sensor so wrong that no verdict on this log means anything? Then each card says that first."""

from __future__ import annotations

from attlog.present.text import typeset
from attlog.result import Check, Result, Verdict

SPOILING = {
    "gyro bias": "the gyro is wrong",
    "gravity": "the accelerometer is wrong",
    "accelerometer axes": "the accelerometer is wrong",
}
"""Checks of the sensors that every filter lives on, and what a bad one means."""


def spoiling(result: Result) -> Check | None:
    """The first bad check of a sensor that every filter lives on, None where both can be used: a gyro that is off
    can where that was subtracted and rows were judged all the same."""
    judged = all(row.status != "not_judged" for row in result.estimators)
    mended = judged and any(bias.dps is not None for bias in result.gyro_bias)
    bad = [check for check in result.audit if check.verdict == "fault" and check.name in SPOILING]
    return next((check for check in bad if not (mended and check.name == "gyro bias")), None)


def spoiled(result: Result, verdict: Verdict) -> Verdict:
    """The verdict, led by what is wrong with the sensors if anything is."""
    check = spoiling(result)
    if check is not None:
        found = typeset(check.text.rstrip("."))
        found = found[0].lower() + found[1:] if found[:2].istitle() else found
        verdict.sentence = f"Unreliable, {SPOILING[check.name]}: {found}. {verdict.sentence}"
    return verdict
