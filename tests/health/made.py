"""Checks made by hand: every verdict, with and without values to set."""

from __future__ import annotations

import pytest

from attlog.health import registry
from attlog.health.check import Check, HealthCase, Setting, unknown

OFFSET = Check(
    "compass_offset",
    "warning",
    "MAG.0 reads 24 uT too much forward.",
    sensor="MAG.0",
    value=24.0,
    unit="uT",
    ci95=(21.0, 27.0),
    vector=[24.0, -3.0, 0.5],
    vector_ci95=[3.0, 3.0, 4.0],
    n=40,
    seconds=200.0,
    threshold="1.5 uT and 4 standard errors",
    source="measured on 39 simulated flights",
    settings=[Setting("COMPASS_OFS_X", -12.0, 145.0, "mG"), Setting("COMPASS_OFS_Y", 4.5, -20.25, "mG")],
    evidence=["The compass heading was off by 15 deg, after it by 1.5 deg."],
)
REFUSED = Check(
    "compass_motors",
    "fault",
    "MAG.1 reads 30 uT more at full current.",
    sensor="MAG.1",
    value=30.0,
    unit="uT",
    ci95=(20.0, 60.0),
    why_no_setting="No samples on the ground: set LOG_DISARMED 1.",
)
SOUND = Check(
    "vibration_level", "ok", "Vibration is 4 m/s^2.", sensor="IMU.0", value=4.0, unit="m/s^2", ci95=(3.5, 4.5)
)
SILENT = unknown("gnss_delay", "The flight has too few turns.", sensor="GPS.0")
MADE = [SOUND, OFFSET, REFUSED, SILENT]


def asked(monkeypatch: pytest.MonkeyPatch, *found: Check, seen: list[HealthCase] | None = None) -> None:
    """Let these be the checks of every log; ``seen`` keeps the cases that were asked."""

    def make(case: HealthCase) -> list[Check]:
        if seen is not None:
            seen.append(case)
        return list(found)

    rows = {question: row._replace(make=make) for question, row in registry.CHECKS.items()}
    monkeypatch.setattr(registry, "CHECKS", rows)
    # What is made here is not tried on the filter that flew.
    monkeypatch.setattr("attlog.pipeline.evaluation.prove_settings", lambda case, checks: checks)
