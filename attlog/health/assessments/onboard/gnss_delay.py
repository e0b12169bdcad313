"""How late is GNSS, and does the onboard estimator know it?

Estimates with little in common: the fit of velocities by :mod:`attlog.health.fits.delays`, and the likelihood of the
smoother, without and with the compass. Their mean is told; half their range is part of its error.
"""

from __future__ import annotations

import math

from attlog.flight.aiding import delays as aiding
from attlog.flight.aiding.delays import DelayParameter
from attlog.flight.model import Gnss
from attlog.health.assessments.model import Assessment, HealthCase, Setting, unknown
from attlog.health.assessments.onboard import in_flight
from attlog.health.fits import delays
from attlog.health.fits.delays import DelayFit

QUESTION = "gnss_delay"
OFF_MS, SIGMAS, FLOOR_MS = 20.0, 3.0, 8.0
"""Offered beyond both. On 24 simulated flights both estimates lie within 18 ms of the truth; floor: their scatter."""
LEAST_M_S2, LEAST_S = 0.4, 15.0
"""Change of the horizontal force that shows a delay (RMS), and how much flight."""
APART_MS = 40.0
"""Estimates further apart than this tell nothing."""
TURNED_DEG = 10.0
"""The equations are linear in a turn of the heading: up to so much."""
SURE_MS = 30.0
"""A delay known less well than this (one sigma) is not told."""
ROUND_MS = 5.0
LIMIT = f"ok within {OFF_MS:.0f} ms or {SIGMAS:.0f} sigma of what is set"
SOURCE = "planted delays on 24 simulated flights"


def assessments(case: HealthCase) -> list[Assessment]:
    """The delay of each receiver that had fixes in flight against the parameter that flew."""
    flown = in_flight.flown(case)
    receivers = [g for g in case.log.gnss if (g.fix >= delays.FIX_3D).sum() > delays.FEWEST]
    if not flown or not receivers:
        return []
    path = None if case.log.replay_imu is None else in_flight.attitude_path(case)
    return [_assessed(case, one, path, flown) for one in receivers]


def _assessed(
    case: HealthCase, receiver: Gnss, path: delays.AttitudePath | None, flown: list[tuple[float, float]]
) -> Assessment:
    imu = case.log.replay_imu
    if imu is None or path is None:
        return unknown(receiver.source, QUESTION, in_flight.no_path(case), LIMIT, SOURCE)
    smoothed = _of_smoothers(case, receiver)
    found = delays.gnss(imu, receiver, path, flown, 1e-3 * smoothed[0] if smoothed else 0.1)
    why = _doubt(found, smoothed)
    if found is None or why:
        return unknown(receiver.source, QUESTION, why, LIMIT, SOURCE)
    own = 1e3 * found.delay
    every = [own, *smoothed]
    late, apart = sum(every) / len(every), 0.5 * (max(every) - min(every))
    sigma = math.sqrt((1.5e3 * found.sigma) ** 2 + FLOOR_MS**2 + apart**2)
    parameter = aiding.of_receiver(case.log, receiver, flown[0][0])
    told = _told(receiver, late, sigma, parameter, aiding.buffer(case.log, flown[0][0]))
    told.n, told.seconds = found.n, round(found.seconds, 1)
    told.evidence.insert(0, f"By {path.name} the velocities are {own:.0f} ms late in {found.seconds:.0f} s of flight.")
    if smoothed:
        shown = " and ".join(f"{x:.0f} ms" for x in smoothed)
        told.evidence.insert(1, f"The likelihood of the smoother finds {shown}.")
    return told


def _told(
    receiver: Gnss, late: float, sigma: float, parameter: DelayParameter | str, buffer: DelayParameter | None
) -> Assessment:
    """The delay beside the parameter; a value where it is off by more than both limits."""
    interval = f"{late - 1.96 * sigma:.0f} to {late + 1.96 * sigma:.0f}"
    text = f"{receiver.source} is {late:.0f} ms late ({interval}, 95 %)"
    found = Assessment(receiver.source, QUESTION, "ok", f"{text}.", threshold=LIMIT, source=SOURCE)
    found.value, found.unit = round(late, 1), "ms"
    found.ci95 = (round(late - 1.96 * sigma, 1), round(late + 1.96 * sigma, 1))
    if isinstance(parameter, str):
        found.verdict, found.why_no_setting = "unknown", parameter
        return found
    found.text = f"{text}; {parameter.words}."
    off = max(parameter.low - late, late - parameter.high, 0.0)
    if off <= max(OFF_MS, SIGMAS * sigma):
        if off > OFF_MS:
            found.evidence.append(
                f"A difference of {off:.0f} ms is within {SIGMAS:.0f} sigma: accelerate and brake more."
            )
        if parameter.low < parameter.high:
            found.verdict = "unknown"
            found.why_no_setting = "The log does not name the receiver's hardware: log from boot on."
        return found
    found.verdict = "warning"
    new = ROUND_MS * round(late / ROUND_MS)
    if not 0.0 < new <= parameter.most:
        found.why_no_setting = f"{parameter.name} ends at {parameter.most:.0f} ms: look for what delays the receiver."
        return found
    found.settings = [Setting(parameter.name, parameter.old, new, "ms")]
    if buffer is not None and new > buffer.old:
        found.settings.append(Setting(buffer.name, buffer.old, new, "ms"))
    found.action = f"Set {parameter.name} to {new:.0f} ms, reboot, and compare test ratios of the next flight."
    return found


def _of_smoothers(case: HealthCase, receiver: Gnss) -> list[float]:
    """What smoothers without and with the compass find in ms since a record's receipt, of the receiver they use."""
    used = next((g for g in case.log.gnss if (g.fix >= delays.FIX_3D).sum() > 1), None)
    qualities = [] if case.motion is None else [case.motion.quality]
    if case.reference is not None and case.reference.kind == "smoother":
        qualities.append(case.reference.quality)
    found = [quality.get("gnss_delay_ms") for quality in qualities]
    between = 1e3 * _written_after(receiver)
    return [late - between for late in found if isinstance(late, float)] if used is receiver else []


def _written_after(receiver: Gnss) -> float:
    """How long after its receipt a record was written, s: the median."""
    if receiver.received is None or len(receiver.t) == 0:
        return 0.0
    between = sorted((receiver.t - receiver.received).tolist())
    return float(between[len(between) // 2])


def _doubt(found: DelayFit | None, smoothed: list[float]) -> str:
    """Why a fit is not believed; empty where it is."""
    if found is None:
        return "Too few GNSS velocities in flight to find their delay."
    if found.seconds < LEAST_S:
        return f"{found.seconds:.0f} s of flight with GNSS velocities; {LEAST_S:.0f} s are needed for their delay."
    if found.moving < LEAST_M_S2:
        return f"The force changes by {found.moving:.2f} m/s^2 only; accelerate and brake to show the delay of GNSS."
    if 1.5e3 * found.sigma > SURE_MS:
        return f"The delay of GNSS is known to {1.5e3 * found.sigma:.0f} ms only; accelerate and brake more."
    if abs(found.turn_deg) > TURNED_DEG:
        return (
            f"The attitude's heading is {abs(found.turn_deg):.0f} deg off GNSS velocities: no delay can be determined."
        )
    if any(abs(1e3 * found.delay - late) > APART_MS for late in smoothed):
        shown = " and ".join(f"{x:.0f}" for x in (1e3 * found.delay, *smoothed))
        return f"Estimates of the GNSS delay differ: {shown} ms."
    one, two = found.halves
    if not abs(one - two) <= max(3.0 * math.sqrt(8.0) * found.sigma, 1e-3 * APART_MS):
        return f"The halves of the flight show different GNSS delays: {1e3 * one:.0f} and {1e3 * two:.0f} ms."
    return ""
