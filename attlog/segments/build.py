"""Build all segments of a log from sensors and flags."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans, timestamps
from attlog.core.spans import Span
from attlog.flight.model import Attitude, FlightLog, Imu, guarded_part
from attlog.segments import airborne as in_air
from attlog.segments import crash, flight_signs, increments, model, rest
from attlog.segments.crash import FlightOutcome, Wreck
from attlog.segments.model import Segment, Segments

Array = NDArray[np.float64]
# The phases that may stay unknown.
UNKNOWN = ("armed", "airborne")
# GNSS speed and vertical speed above which a vehicle is not at rest, even with a quiet IMU.
MOVING_M_S, CLIMB_M_S = 3.0, 1.0


def build(log: FlightLog) -> Segments:
    """Return all segments of a log, each with its reason.

    Stillness uses the replayed IMU, else the first one, however slow. A log without an IMU has the continuous segments
    of the onboard attitude and the flags. After a bug only continuous segments remain, and the log gets a problem.
    """
    return guarded_part(log, "Rest, arming and flight", lambda: _found(log), lambda: _continuous_alone(log))


def _continuous_alone(log: FlightLog) -> Segments:
    """Return continuous segments and gaps only; all phases are unknown."""
    clock = _clock(log)
    if not len(clock):
        return Segments([], {}, UNKNOWN)
    whole = Segment("continuous", float(np.min(clock)), float(np.max(clock)), "rest, arming and flight are not known")
    return Segments(
        guarded_part(log, "Gaps", lambda: model.find_continuous(clock, bool(log.imus)), lambda: [whole]), {}, UNKNOWN
    )


def _clock(log: FlightLog) -> Array:
    """Return finite times (n,) of the replayed IMU, else the first, else of onboard attitude or height."""
    imu, onboard = log.replay_imu or next(iter(log.imus), None), log.onboard_attitude or log.estimator.height
    clock = imu.gyro.t_best if imu is not None else onboard.t if onboard is not None else np.zeros(0)
    return clock[np.isfinite(clock)]


def _found(log: FlightLog) -> Segments:
    """Build all segments of a log from its sensors and flags."""
    notes: dict[str, str] = {}
    imu = log.replay_imu or next(iter(log.imus), None)
    onboard = log.onboard_attitude
    clock = _clock(log)
    found: list[Segment] = model.find_continuous(clock, imu is not None)
    if imu is None:
        notes["continuous"] = (
            "no IMU to replay: continuous segments are those of the onboard attitude, and nothing shows rest"
        )
    if not found:
        return Segments([], notes, UNKNOWN)
    t0, t1 = float(np.min(clock)), float(np.max(clock))

    whole = _between_pauses(found, t0, t1)
    armed = rest.armed_spans(log, t0, t1)
    parts = _windows(imu) if imu is not None else None
    motors = rest.motor_spans(log, armed, t0, t1)
    still = rest.still_windows(parts, motors) if parts is not None else None
    signs = flight_signs.build_grid(log, t0, t1) if log.kind.flies else None
    may = armed.spans if armed.known else None
    air = None if signs is None else in_air.find_flights(log, signs, may, whole)
    flown = FlightOutcome([], [], []) if air is None or not air.known else crash.find_crashes(log, air, may, t1)
    lying = rest.join_windows(parts, still) if parts is not None and still is not None else []
    airborne = rest.airborne_spans(log, armed, air, flown.flights, lying, t0, t1)
    brief = _between_pauses(found, t0, t1, in_air.MAX_BRIDGED_S)
    for phase in (armed, motors):
        phase.spans = spans.intersect(phase.spans, whole)
    if signs is None or not signs.slow:  # in telemetry only the link pauses
        airborne.spans = spans.intersect(airborne.spans, brief)
    found += [Segment("armed", a, b, armed.why) for a, b in armed.spans]
    found += [Segment("airborne", a, b, airborne.why) for a, b in airborne.spans]
    notes["armed"], notes["airborne"], notes["idle"] = armed.why, airborne.why, motors.why

    if parts is not None and still is not None:
        moving = np.nan_to_num(flight_signs.speed_at(log, parts.middle)) > MOVING_M_S
        if air is not None and not armed.known:
            moving |= np.interp(parts.middle, air.grid.t, np.abs(np.nan_to_num(air.climb))) > CLIMB_M_S
        rests = rest.find_rests(parts, still, airborne, motors, rest.busy_spans(armed, motors), moving)
        notes["rest"] = _rest_note(rests, rest.largest_rate_limit(parts, motors), armed, airborne)
        resting = [(s.t0, s.t1) for s in rests]
        found += rests + rest.find_idles(parts, still, airborne, motors, resting)
        found += guarded_part(log, "Hovers", lambda: rest.find_hovers(log, parts, airborne), list[Segment])
    found = [part for whole in found for part in _without_wrecks(whole, flown.wrecks)]
    found += [s for wreck in flown.wrecks for s in _lost(wreck, t1)]
    found += _cruise(found)
    if onboard is not None:
        found += guarded_part(log, "Resets", lambda: _resets(onboard, imu), list[Segment])
    unknown = tuple(name for name, phase in (("armed", armed), ("airborne", airborne)) if not phase.known)
    return Segments(sorted(found, key=lambda s: (s.t0, s.t1)), notes, unknown, air, flown.crash_events)


def _resets(onboard: Attitude, imu: Imu | None) -> list[Segment]:
    return [
        Segment("reset", float(onboard.t[i - 1]), float(onboard.t[i]), why)
        for i, why in zip(*increments.find_resets(onboard, imu), strict=True)
    ]


def _between_pauses(
    found: list[Segment], t0: float, t1: float, longest_s: float = timestamps.MAX_BRIDGED_GAP_S
) -> list[Span]:
    """Return the spans of [t0, t1] between longer gaps, by default those that restart a filter."""
    return spans.complement([(s.t0, s.t1) for s in found if s.kind == "gap" and s.seconds > longest_s], t0, t1)


def _without_wrecks(whole: Segment, wrecks: list[Wreck]) -> list[Segment]:
    """Return the parts of a segment outside wrecks; a rest in one becomes ``wreck``."""
    if whole.kind not in ("rest.long", "rest.short", "idle", "airborne", "hover"):
        return [whole]
    lost = [(w.impact_s, w.t1) for w in wrecks]
    if not spans.intersect([(whole.t0, whole.t1)], lost):
        return [whole]
    if whole.kind.startswith("rest"):
        at = max(w.impact_s for w in wrecks if w.impact_s < whole.t1)
        return [Segment("wreck", whole.t0, whole.t1, f"lies still after a crash at {at:.1f} s")]
    kept = spans.intersect([(whole.t0, whole.t1)], spans.complement(lost, -np.inf, np.inf))
    return [Segment(whole.kind, a, b, whole.why) for a, b in kept]


def _lost(wreck: Wreck, t1: float) -> list[Segment]:
    """Return a wreck as loss of control, with an impact where it lasts to the log's end."""
    if wreck.t1 < t1:
        return [Segment("loss_of_control", wreck.t0, wreck.t1, wreck.why)]
    lost = [Segment("loss_of_control", wreck.t0, wreck.impact_s, wreck.why)] if wreck.impact_s > wreck.t0 else []
    return [*lost, Segment("impact", wreck.impact_s, t1, wreck.why)]


def _cruise(found: list[Segment]) -> list[Segment]:
    """Return flight without hover."""
    hovering = [(s.t0, s.t1) for s in found if s.kind == "hover"]
    flying = [(s.t0, s.t1) for s in found if s.kind == "airborne"]
    moving = spans.intersect(flying, spans.complement(hovering, -np.inf, np.inf))
    return [Segment("cruise", a, b, "in the air, and not hovering") for a, b in moving]


def _windows(imu: Imu) -> rest.ImuWindows | None:
    """Return windows over the good samples of an IMU, None for too few."""
    t, gyro, acc = imu.gyro.t_best, imu.gyro.x, imu.acc.x
    n = min(len(t), len(gyro), len(acc))
    t, gyro, acc = t[:n], gyro[:n], acc[:n]
    good = np.isfinite(t) & rotation.finite_rows(gyro) & rotation.finite_rows(acc)
    if not good.all():
        t, gyro, acc = t[good], gyro[good], acc[good]
    return rest.build_windows(t, gyro, acc) if len(t) >= 10 else None


def _rest_note(rests: list[Segment], limit: float, armed: rest.FlagSpans, airborne: rest.FlagSpans) -> str:
    """Return how rest was found, or why there is none."""
    unknown = [word for word, phase in (("arming", armed), ("flight", airborne)) if not phase.known]
    doubt = f"; {' and '.join(unknown)} unknown, so by the sensors alone" if unknown else ""
    if not rests:
        return (
            f"no window as still as a surface (gyro noise under {limit:.2f} deg/s), disarmed and on the ground{doubt}"
        )
    total = sum(s.seconds for s in rests)
    return f"{len(rests)} rests, {total:.0f} s, gyro noise under {limit:.2f} deg/s{doubt}"
