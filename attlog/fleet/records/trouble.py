"""What was wrong with a flight's attitude, and how urgently somebody should look: reasons in words, worst first.

Logs are opened in the order of :data:`RANKS`. Points order the reasons of one log, and logs of the same rank.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any

from attlog.compare.gates.rows import BASELINES
from attlog.present.names import row_names
from attlog.present.numbers import listed
from attlog.result import EstimatorRow, Finding, Result

ATTITUDE = frozenset({"attitude", "mounting", "estimator"})
"""Kinds of findings that say the onboard attitude was wrong, or that its estimator failed."""
RESETS = frozenset({"reset", "realigned"})
SENSORS = frozenset(
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
"""Kinds of findings about a sensor; others tell what the log lacks."""

POINTS = {
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
"""How much a reason weighs, by kind and severity; notes weigh nothing and are left out.

A sensor's warning counts as a fault where one of its checks says so.
"""
FILTER_POINTS, MOST_FILTERS = 10.0, 5
REFUSED_POINTS = 40.0
SERIOUS, LOOK = 40.0, 10.0
"""One reason of this weight makes a log serious, or one to look at."""
RANKS = ("crash", "attitude", "serious", "other")
"""What somebody should open first: a crash or loss of control, a wrong attitude in flight, another serious finding in
flight (or a failed gate), all else."""
LANDED_S = 2.0
"""What begins so soon after landing belongs to the flight; what began before take-off went along."""
ANY_JUMP, PER_DEGREE, MOST_DEGREES = 5.0, 0.5, 60.0
"""A jump of known size: a heading set anew by a few degrees at take-off is no news, one by 60 deg nearly serious."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why somebody should look: ``kind`` gate, attitude, crash, reset, filter, sensor or log.

    ``points`` is its weight, ``text`` a sentence, ``t`` s on the log's clock or None. ``in_flight``: it was there while
    the vehicle flew; of a crash, that sensors show it.
    """

    kind: str
    code: str
    points: float
    text: str
    t: float | None = None
    in_flight: bool = False

    @property
    def rank(self) -> int:
        """The place in RANKS of a log that has this reason."""
        if self.points < SERIOUS or not self.in_flight:
            return RANKS.index("other")
        return RANKS.index(self.kind) if self.kind in RANKS else RANKS.index("serious")


def trouble(reasons: Iterable[Reason]) -> dict[str, Any]:
    """Reasons as plain values, the heaviest first.

    ``level``: serious, look or none; ``rank``: the first place in RANKS; ``score``: the sum of points.
    """
    found = sorted(reasons, key=lambda r: -r.points)
    most = found[0].points if found else 0.0
    return {
        "level": "serious" if most >= SERIOUS else "look" if most >= LOOK else "none",
        "rank": min((r.rank for r in found), default=RANKS.index("other")),
        "score": round(sum(r.points for r in found), 1),
        "reasons": [asdict(r) for r in found],
    }


def with_gates(said: dict[str, Any], failed: Iterable[str]) -> dict[str, Any]:
    """What :func:`trouble` told, with one more reason for each sentence of a gate that failed."""
    gates = [Reason("gate", "gate", POINTS["gate", "serious"], text, in_flight=True) for text in failed]
    return trouble([*gates, *(Reason(**reason) for reason in said["reasons"])]) if gates else said


def reasons(result: Result) -> list[Reason]:
    """Everything in a result that speaks of trouble with the attitude or with what it is computed from."""
    faults = {check.text for check in result.audit if check.verdict == "fault"}
    found = [reason for finding in result.findings if (reason := _of_finding(finding, faults)) is not None]
    codes = {r.code for r in found}
    crashes = [event for event in result.events if event.is_crash]
    if crashes and "crash" not in codes:
        found.append(Reason("crash", crashes[0].kind, POINTS["crash", "serious"], crashes[0].text, crashes[0].t))
    refused = result.reference.refused if result.reference else {}
    for kind, why in refused.items():
        if kind == "truth" or (kind == "onboard" and not codes & ATTITUDE):
            said = "truth" if kind == "truth" else "onboard attitude"
            found.append(Reason("attitude", "refused", REFUSED_POINTS, f"The {said} is refused as reference: {why}."))
    shown = bool(crashes) or not result.events  # what the autopilot alone reports as a crash is often a bench
    landed = _last_landing(result)
    return [
        replace(r, in_flight=shown if r.kind == "crash" else landed is not None and (r.t is None or r.t <= landed))
        for r in [*found, *_of_rows(result)]
    ]


def _last_landing(result: Result) -> float | None:
    """When the last flight was over, s; None of a log that never flew, infinite where nobody knows when."""
    spans = (result.log.get("timeline") or {}).get("airborne") or []
    if spans:
        return float(spans[-1][1]) + LANDED_S
    return math.inf if (result.log.get("seconds") or {}).get("airborne") else None


def _of_finding(finding: Finding, faults: Collection[str]) -> Reason | None:
    kind = kind_of(finding.kind)
    told = {finding.text, *finding.evidence}
    is_fault = finding.severity == "warning" and not told.isdisjoint(faults) and (kind, "fault") in POINTS
    points = POINTS.get((kind, "fault" if is_fault else finding.severity))
    if points is None:
        return None
    if kind == "reset" and finding.value is not None and finding.unit == "deg":
        points = ANY_JUMP + PER_DEGREE * min(abs(finding.value), MOST_DEGREES)
    times = f" ({finding.count} times)" if finding.count > 1 and str(finding.count) not in finding.text else ""
    return Reason(kind, finding.kind, points, finding.text + times, finding.t)


def kind_of(finding: str) -> str:
    """Which kind of trouble a kind of finding stands for."""
    if finding in ATTITUDE:
        return "attitude"
    if finding in RESETS:
        return "reset"
    if finding == "crash":
        return "crash"
    return "sensor" if finding in SENSORS else "log"


def _of_rows(result: Result) -> list[Reason]:
    """Rows that diverged or failed: the onboard attitude on its own, the filters together."""
    names = row_names(result)
    found = [
        Reason("attitude", r.status, POINTS["attitude", "serious"], f"The onboard attitude {r.status}: {r.reason}.")
        for r in result.estimators
        if r.name == "onboard" and r.status in ("diverged", "failed")
    ]
    for status in ("diverged", "failed"):
        lost = [r for r in result.estimators if r.status == status and _judged(r)]
        if lost:
            why = f": {lost[0].reason}" if len(lost) == 1 and lost[0].reason else ""
            text = f"{listed([names[r.name] for r in lost])} {status}{why}."
            found.append(Reason("filter", status, FILTER_POINTS * min(len(lost), MOST_FILTERS), text))
    return found


def _judged(row: EstimatorRow) -> bool:
    return row.kind == "replay" and row.estimator not in BASELINES
