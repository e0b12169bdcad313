"""All segments of a log, from the sensors and the flags together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import gap, rotation
from attlog.flight.model import Attitude, FlightLog, Imu, part_of
from attlog.segments import flags, flying, gaps, hover, impact, motion, resets, rest, spans, windows
from attlog.segments.model import Segment, Segments
from attlog.segments.spans import Span

Array = NDArray[np.float64]
UNKNOWN = ("armed", "airborne")
"""The phases that may stay unknown."""
MOVING_M_S = 3.0
"""GNSS speed from which a vehicle is not at rest, whatever its IMU feels."""


def build(log: FlightLog) -> Segments:
    """Runs, gaps, rests, idling, arming, flight, hover, impact and resets of a log, each with its reason.

    Without an IMU to replay the first one still tells stillness, however slow; without any there are the
    continuous segments of the onboard attitude and what the flags tell, and the notes say so. Where finding
    them ends in a bug there are the continuous segments alone, nothing is known of rest and flight, and a problem of
    the log says so.
    """
    return part_of(log, "Rest, arming and flight", lambda: _found(log), lambda: _continuous_alone(log))


def _continuous_alone(log: FlightLog) -> Segments:
    """What can be said where the rest cannot: where samples follow each other, which every filter and metric needs."""
    clock = _clock(log)
    if not len(clock):
        return Segments([], {}, UNKNOWN)
    whole = Segment("continuous", float(np.min(clock)), float(np.max(clock)), "rest, arming and flight are not known")
    return Segments(part_of(log, "Gaps", lambda: gaps.find(clock), lambda: [whole]), {}, UNKNOWN)


def _clock(log: FlightLog) -> Array:
    """The times (n,) of the unit to replay, else of the first, else of the onboard attitude."""
    imu, onboard = log.replay_imu or next(iter(log.imus), None), log.onboard_attitude
    clock = imu.gyro.t_best if imu is not None else onboard.t if onboard is not None else np.zeros(0)
    return clock[np.isfinite(clock)]


def _found(log: FlightLog) -> Segments:
    """The segments, none of them missing."""
    notes: dict[str, str] = {}
    imu = log.replay_imu or next(iter(log.imus), None)
    onboard = log.onboard_attitude
    clock = _clock(log)
    found: list[Segment] = gaps.find(clock)
    if imu is None:
        notes["continuous"] = (
            "no IMU to replay: continuous segments are those of the onboard attitude, and nothing tells rest"
        )
    if not found:
        return Segments([], notes, UNKNOWN)
    t0, t1 = float(np.min(clock)), float(np.max(clock))

    whole = _between_pauses(found, t0, t1)
    armed = flags.armed(log, t0, t1)
    parts = _windows(imu) if imu is not None else None
    motors = flags.motors(log, armed, t0, t1)
    still = rest.still(parts, motors) if parts is not None else None
    lying = windows.join(parts, still) if parts is not None and still is not None else []
    seen = flying.evidence(log, armed.spans if armed.known else None, t0, t1)
    airborne = flags.airborne(log, armed, seen, parts, lying, t0, t1)
    for phase in (armed, airborne, motors):
        phase.spans = spans.intersect(phase.spans, whole)
    found += [Segment("armed", a, b, armed.why) for a, b in armed.spans]
    found += [Segment("airborne", a, b, airborne.why) for a, b in airborne.spans]
    notes["armed"], notes["airborne"], notes["idle"] = armed.why, airborne.why, motors.why

    if parts is not None and still is not None:
        moving = np.nan_to_num(motion.speed_m_s(log, parts.middle)) > MOVING_M_S
        if seen is not None and not armed.known:
            moving |= np.interp(parts.middle, seen.t, np.abs(seen.climb)) > flying.CLIMB_M_S
        rests = rest.rests(parts, still, airborne, motors, flags.busy(armed, motors), moving)
        notes["rest"] = _rest_note(rests, rest.largest_limit(parts, motors), armed, airborne)
        resting = [(s.t0, s.t1) for s in rests]
        found += rests + rest.idles(parts, still, airborne, motors, resting)
        found += part_of(log, "Hovers", lambda: hover.find(log, parts, airborne), list[Segment])
    if parts is not None and imu is not None:
        lies = impact.lying(log, parts, lying)
        lost = impact.losses(log, imu, airborne, lies, [b for _, b in whole])
        found += [Segment("loss_of_control", loss.t0, loss.t1, loss.why) for loss in lost]
        found += impact.find(log, imu, airborne, lies, lost, t1)
    blow = min((s.t0 for s in found if s.kind == "impact"), default=np.inf)
    found = [s for whole in found for s in _cut_at_impact(whole, blow)]
    found += _cruise(found)
    if onboard is not None:
        found += part_of(log, "Resets", lambda: _resets(onboard, imu), list[Segment])
    unknown = tuple(name for name, phase in (("armed", armed), ("airborne", airborne)) if not phase.known)
    return Segments(sorted(found, key=lambda s: (s.t0, s.t1)), notes, unknown)


def _resets(onboard: Attitude, imu: Imu | None) -> list[Segment]:
    return [
        Segment("reset", float(onboard.t[i - 1]), float(onboard.t[i]), why)
        for i, why in zip(*resets.find(onboard, imu), strict=True)
    ]


def _between_pauses(found: list[Segment], t0: float, t1: float) -> list[Span]:
    """The time of [t0, t1] without the gaps after which filters restart: nothing is known there, so no span crosses."""
    return spans.complement([(s.t0, s.t1) for s in found if s.kind == "gap" and s.seconds > gap.RESTART_S], t0, t1)


def _cut_at_impact(whole: Segment, blow: float) -> list[Segment]:
    """A rest is none after an impact at ``blow`` s but a wreck, and flight, hover and idling end with it."""
    if whole.t1 <= blow or whole.kind not in ("rest.long", "rest.short", "idle", "airborne", "hover"):
        return [whole]
    if whole.kind.startswith("rest"):
        return [Segment("wreck", whole.t0, whole.t1, f"lies still after an impact at {blow:.1f} s")]
    return [] if whole.t0 >= blow else [Segment(whole.kind, whole.t0, blow, whole.why)]


def _cruise(found: list[Segment]) -> list[Segment]:
    """Flight without hover."""
    hovering = [(s.t0, s.t1) for s in found if s.kind == "hover"]
    flying = [(s.t0, s.t1) for s in found if s.kind == "airborne"]
    moving = spans.intersect(flying, spans.complement(hovering, -np.inf, np.inf))
    return [Segment("cruise", a, b, "in the air, and not hovering") for a, b in moving]


def _windows(imu: Imu) -> windows.Windows | None:
    """Windows over the good samples of an IMU, None where it has too few."""
    t, gyro, acc = imu.gyro.t_best, imu.gyro.x, imu.acc.x
    n = min(len(t), len(gyro), len(acc))
    t, gyro, acc = t[:n], gyro[:n], acc[:n]
    good = np.isfinite(t) & rotation.finite(gyro) & rotation.finite(acc)
    if not good.all():
        t, gyro, acc = t[good], gyro[good], acc[good]
    return windows.build(t, gyro, acc) if len(t) >= 10 else None


def _rest_note(rests: list[Segment], limit: float, armed: flags.FlagSpans, airborne: flags.FlagSpans) -> str:
    """The sentence on how rest was found, or why there is none."""
    unknown = [word for word, phase in (("arming", armed), ("flight", airborne)) if not phase.known]
    doubt = f"; {' and '.join(unknown)} unknown, so by the sensors alone" if unknown else ""
    if not rests:
        return (
            f"no window as still as a surface (gyro noise under {limit:.2f} deg/s), disarmed and on the ground{doubt}"
        )
    total = sum(s.seconds for s in rests)
    return f"{len(rests)} rests, {total:.0f} s, gyro noise under {limit:.2f} deg/s{doubt}"
