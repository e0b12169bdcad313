"""One action on this vehicle for each finding, with its parameters where the log holds them; none twice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from attlog.flight.model import FlightLog, Mag
from attlog.health.findings import compass
from attlog.health.findings.assessed import Advice
from attlog.health.findings.finding import Finding
from attlog.reference import declination

CLOSE, STEADY = 0.1, 0.1
"""A compass that reads the earth's field to this share, and varies by so little, is sound."""
OFF = 0.2
"""One that is off by more, while another is sound, is not to be used."""


def with_actions(
    findings: Sequence[Finding], log: FlightLog, advice: Mapping[str, Advice] = {}, *, chosen: bool = False
) -> list[Finding]:
    """The findings, worst first, with the actions that this vehicle can take; what stands above is not said again.

    ``advice``: by the kind of finding, what the assessments of its sensors say is to be done, and why; it wins.
    ``chosen``: whether they tell which compass to use; only where they do not, the size of the fields does.
    """
    taken: set[str] = set()
    found = []
    for finding in findings:
        action, cause = finding.action, finding.cause
        if finding.is_trouble and finding.kind in advice:
            action, cause = advice[finding.kind].action, advice[finding.kind].cause or cause
        elif finding.kind == compass.KIND and finding.is_trouble and not chosen:
            action = other_compass(log) or action
        found.append(replace(finding, cause=cause, action="" if action in taken else action))
        taken.add(action)
    return found


def other_compass(log: FlightLog) -> str:
    """The advice to use another compass that reads the earth's field while the one in use does not; empty without."""
    model = declination.model(log)
    if model is None or log.mag is None:
        return ""
    earth = model.strength_t
    sizes = {k: _size(mag.field.x) for k, mag in enumerate(log.mags)}
    own, _ = sizes[log.mag]
    sound = [k for k, (size, spread) in sizes.items() if abs(size / earth - 1) <= CLOSE and spread <= STEADY]
    if abs(own / earth - 1) <= OFF or not sound or log.mag in sound:
        return ""
    other, used = log.mags[sound[0]], log.mags[log.mag]
    reads = f"{other.field.source} instead, which reads {1e6 * sizes[sound[0]][0]:.1f} uT"
    if not calibrated(other):
        return f"Calibrate and use {reads}."
    changes = [f"{name} {now:g}" for name, now in switching(log, other, used).items()]
    return f"Use {reads}: set {' and '.join(changes)}." if changes else f"Use {reads}."


def calibrated(mag: Mag) -> bool:
    """Whether a compass ever was: a firmware that applies offsets of zero refuses to arm with it."""
    return mag.calibrated and (mag.offsets is None or len(mag.offsets.x) == 0 or bool(mag.offsets.x.any()))


def switching(log: FlightLog, other: Mag, used: Mag) -> dict[str, float]:
    """What uses one compass instead of another, of what changes; empty where the log does not hold both switches.

    An estimator that starts with the first one (``FlightLog.compass_first``) has none if that is only switched off.
    """
    names = [log.compass_switches.get(mag.index, "") for mag in (other, used)]
    if not all(names):
        return {}
    wanted = dict(zip(names, (1.0, 0.0), strict=True))
    if log.compass_first:
        wanted[log.compass_first] = float(other.index)
    return {name: value for name, value in wanted.items() if log.param(name) != value}


def _size(field: np.ndarray) -> tuple[float, float]:
    """Median size (T) of a field (n, 3), and its standard deviation as a share of it."""
    norm = np.sqrt(np.nansum(field**2, axis=1))
    norm = norm[norm > 0]
    if not len(norm):
        return 0.0, np.inf
    return float(np.median(norm)), float(np.std(norm) / np.median(norm))
