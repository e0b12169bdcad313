"""Does a sensor say the same in every record while the vehicle moves? Then it, its driver or its bus has stopped."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from attlog.base import rotation
from attlog.flight import magnetic
from attlog.flight.model import Array, FlightLog, Gnss, Stream
from attlog.health.model import Check
from attlog.segments import gaps
from attlog.segments.model import Segments
from attlog.segments.spans import Span, intersect, seconds

GYRO, OTHERS = "frozen gyro", "frozen sensors"
IMU_S, MAG_S, BARO_S = 1.0, 5.0, 5.0
"""So long a value may stay by chance: an IMU's noise changes its last digit at each sample, that of a barometer at most
of them; a compass of whole milligauss may rest."""
DOWN = np.array([0.0, 0.0, 1.0])
RECORDS = 20
"""Fewer equal records in a row are a slow message."""
MOVING_DPS, TURNED_DEG, CLIMBED_M = 3.0, 5.0, 10.0
"""A vehicle that moves: the gyro shows so much (standard deviation), attitude or field turn, GNSS rises so far.
An accelerometer that shakes is no sign of it: engines run on the ground."""
UNUSABLE_PCT = 5.0
"""A gyro that stood still for more than this part of the record makes every replay wrong from there on."""
LIMIT = (
    f"ok: no value stays for {IMU_S:.0f} s (compass {MAG_S:.0f} s, barometer {BARO_S:.0f} s) while the vehicle moves"
)


class _Where(TypedDict, total=False):
    t: float
    count: int


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """The gyro by itself, the others together; nothing without a gyro to replay."""
    imu = log.replay_imu
    if imu is None:
        return []
    stopped = [s for s in held(imu.gyro, IMU_S) if _turned(log, s) >= TURNED_DEG]
    lost = 100.0 * seconds(stopped) / max(log.seconds, 1e-9)
    text = f"{imu.gyro.source}: {_sentence('gyro', stopped)}." if stopped else "The gyro never stands still in motion."
    found = [Check(GYRO, "fault" if stopped else "ok", text, round(lost, 1), "%", LIMIT, **_first(stopped))]
    others = {
        f"{imu.acc.source}: {_sentence('accelerometer', spans)}": spans
        for spans in [[s for s in held(imu.acc, IMU_S) if np.degrees(_spread(imu.gyro, s)) >= MOVING_DPS]]
        if spans
    }
    serious = bool(others)
    others |= _compass(log) | _barometer(log, segments)
    every = sorted((s for spans in others.values() for s in spans), key=lambda s: s[0] - s[1])
    text = f"{'; '.join(others)}." if others else "No other sensor stands still while the vehicle moves."
    verdict = "fault" if serious else "warning" if others else "ok"
    longest = round(every[0][1] - every[0][0], 1) if every else 0.0
    return [*found, Check(OTHERS, verdict, text, longest, "s", LIMIT, **_first(every))]


def unusable(check: Check) -> str:
    """Why no filter can be judged where the gyro stood still for too long, empty where it did not."""
    if check.name != GYRO or not isinstance(check.value, float) or check.value <= UNUSABLE_PCT:
        return ""
    return f"the gyro stands still for {check.value:.0f} % of the record while the vehicle moves"


def held(stream: Stream, least_s: float) -> list[Span]:
    """Spans (t0, t1) s in which every record holds the same finite values (all of them), for ``least_s`` and more."""
    x = stream.x.reshape(len(stream.t), -1)
    if len(x) < RECORDS:
        return []
    t, x = gaps.only(rotation.finite(x), stream.t, x)
    changed = np.zeros(max(len(t) - 1, 0), bool)
    for column in x.T:  # one at a time: of gigabytes copies add up
        changed |= column[1:] != column[:-1]
    edges = np.concatenate([[0], np.flatnonzero(changed) + 1, [len(t)]])
    long = np.flatnonzero(np.diff(edges) >= RECORDS)
    spans = [(float(t[edges[k]]), float(t[edges[k + 1] - 1])) for k in long]
    return [(a, b) for a, b in spans if b - a >= least_s]


def compass(log: FlightLog) -> list[Span]:
    """Where the compass in use stands still while the gyro turns; one that never changes is told as dead elsewhere."""
    imu = log.replay_imu
    if log.mag is None or imu is None:
        return []
    return [s for s in held(log.mags[log.mag].field, MAG_S) if magnetic.turn(imu, *s) > magnetic.TURN_DEG]


def _compass(log: FlightLog) -> dict[str, list[Span]]:
    """What is said of the compass in use that stopped, and where."""
    spans = compass(log)
    return {f"{log.mags[log.mag or 0].field.source}: {_sentence('compass', spans)}": spans} if spans else {}


def _barometer(log: FlightLog, segments: Segments) -> dict[str, list[Span]]:
    """The first barometer, in the air; simulated ones without noise may stay in hover."""
    if not log.baro:
        return {}
    flown = intersect(held(log.baro[0], BARO_S), segments.spans("airborne"))
    flown = [s for s in flown if max((_climbed(gnss, s) for gnss in log.gnss), default=0.0) >= CLIMBED_M]
    return {f"{log.baro[0].source}: {_sentence('barometer', flown)}": flown} if flown else {}


def _climbed(gnss: Gnss, span: Span) -> float:
    """The range (m) of a receiver's height in a span, 0 where it has none."""
    height = gnss.alt[slice(*np.searchsorted(gnss.t, span))]
    height = height[np.isfinite(height)]
    return float(np.ptp(height)) if len(height) else 0.0


def _turned(log: FlightLog, span: Span) -> float:
    """How far (deg) down by the onboard attitude, or without one the magnetic field, is away from its middle for a
    fifth of a span: an alignment at the start is one jump."""
    attitude = log.onboard_attitude
    if attitude is not None:
        x = rotation.rotate_inverse(attitude.q[slice(*np.searchsorted(attitude.t, span))], DOWN)
    elif log.mag is not None:
        field = log.mags[log.mag].field
        x = field.x[slice(*np.searchsorted(field.t, span))]
        x = x[rotation.finite(x)]
    else:
        return 0.0
    middle = np.median(x, axis=0) if len(x) else np.zeros(3)
    size = np.sqrt(np.sum(x**2, axis=1) * np.sum(middle**2))
    if len(x) < RECORDS or not size.all():
        return 0.0
    return float(np.degrees(np.quantile(np.arccos(np.clip(x @ middle / size, -1.0, 1.0)), 0.8)))


def _spread(stream: Stream, span: Span) -> float:
    """The largest standard deviation of an axis in a span."""
    first, last = np.searchsorted(stream.t, span)
    inside: Array = stream.x[first:last]
    return float(np.nanmax(np.std(inside, axis=0), initial=0.0)) if len(inside) > 1 else 0.0


def _sentence(what: str, spans: list[Span]) -> str:
    if len(spans) == 1:
        return f"the {what} says the same from {spans[0][0]:.1f} s to {spans[0][1]:.1f} s while the vehicle moves"
    return f"the {what} says the same {len(spans)} times, {seconds(spans):.1f} s in all, while the vehicle moves"


def _first(spans: list[Span]) -> _Where:
    return {"t": min(s[0] for s in spans), "count": len(spans)} if spans else {}
