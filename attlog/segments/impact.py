"""Loss of control, and impact: the moment from which a log tells about a wreck and not about a flight."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import FlightLog, Imu
from attlog.segments import motion, spans
from attlog.segments.flags import FlagSpans
from attlog.segments.model import Segment
from attlog.segments.spans import Span
from attlog.segments.windows import Windows, join

Array = NDArray[np.float64]

G = 9.80665
BLOW_G = 4.0
TUMBLE_DPS, NEAR_S = 200.0, 0.5
TILT_DEG, TURNED_S = 90.0, 0.3
END_S, LOST_S = 10.0, 3.0
AGAIN_S = 5.0
"""Flight of this length after an impact: it was none."""
LYING_DEG, LYING_DPS, LYING_S = 60.0, 10.0, 3.0
"""Proposed, not measured: the logs in hand hold few crashes (docs/metrics.md)."""
LOG_STOPPED = "the log stopped"
CRASH = re.compile(r"\bcrash(ed)?\b(?!.{0,2}(check|dump|log|catcher))", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class LossOfControl:
    """A loss of control at ``t0`` s: ``t1`` is the blow that ends it (``blow``), else where it begins to lie."""

    t0: float
    t1: float
    blow: bool
    why: str

    @property
    def end(self) -> float:
        """What an impact counts from: the blow, without one the loss itself."""
        return self.t1 if self.blow else self.t0


def losses(
    log: FlightLog, imu: Imu, airborne: FlagSpans, lying: list[Span], pauses: list[float]
) -> list[LossOfControl]:
    """Losses of control: beyond 90 deg of tilt in the air, and within 10 s disarmed, lying still or unseen.

    ``pauses`` are the times at which the log stops, for a while or for good. A loss lasts to the first blow above
    4 g within 10 s, whatever flags say of landing and arming: autopilots disarm and "land" in free fall.
    """
    ends = _ends(log, lying, pauses)
    found: list[LossOfControl] = []
    for t, tilt in _overturned(log, airborne):
        after = [(e, what) for e, what in ends if -0.5 <= e - t <= END_S]
        if not after or (found and t <= found[-1].t1):
            continue
        end, what = min(after)
        blows = _blows(imu, [(t, t + END_S)])
        why = f"tilt of {tilt:.0f} deg, "
        why += f"{_later(blows[0][0] - t)} a blow of {blows[0][1]:.1f} g; " if blows else "and "
        why += f"{_later(end - t, ' after the loss' if blows else ' later')} {what}"
        found.append(LossOfControl(t, max(blows[0][0] if blows else end, t), bool(blows), why))
    return found


def find(
    log: FlightLog, imu: Imu, airborne: FlagSpans, lying: list[Span], lost: list[LossOfControl], t1: float
) -> list[Segment]:
    """The impact as a list of one segment that lasts to the log's end ``t1``, or an empty list.

    The blow that ends a loss of control (without one, the loss itself); or a blow above 4 g with a tumble
    (200 deg/s within half a second: a firm touch-down has none) in the air, followed within 10 s by disarming or
    lying still, or by the log's end within 3 s, for power is often lost with the rotors; or the autopilot's own
    message. A vehicle that flies again for 5 s had none.
    """
    stretched = [(a - 1.0, b + 1.0) for a, b in airborne.spans]  # land detector and ground do not wait for each other
    found = [
        (t, f"the autopilot says: {text.strip()[:80]}")
        for t, _, text in log.texts
        if CRASH.search(text) and spans.inside(np.array([t]), stretched).any()
    ]
    found += [(loss.end, loss.why) for loss in lost]
    ends = _ends(log, lying, [])
    for t, g in _blows(imu, stretched, tumbling=True):
        after = [(e, what) for e, what in ends if -0.5 <= e - t <= END_S]
        after += [(t1, LOG_STOPPED)] if t1 - t <= LOST_S else []
        if after:
            found.append((t, f"{g:.1f} g with a tumble, and {_later(min(after)[0] - t)} {min(after)[1]}"))
    final = [(t, why) for t, why in sorted(found) if not _flies_again(airborne, t)]
    return [Segment("impact", t, t1, why) for t, why in final[:1]]


def _flies_again(airborne: FlagSpans, t: float) -> bool:
    """Whether a flight that begins after ``t`` lasts 5 s."""
    return any(a > t and b - a >= AGAIN_S for a, b in airborne.spans)


def _ends(log: FlightLog, lying: Iterable[Span], pauses: Iterable[float]) -> list[tuple[float, str]]:
    """When a vehicle lay still, was disarmed, or its log stopped."""
    told = [(a, "it lay still") for a, _ in lying] + [(t, "it was disarmed") for t in _disarmed(log)]
    return told + [(t, LOG_STOPPED) for t in pauses]


def _later(seconds: float, words: str = " later") -> str:
    return f"{seconds:.1f} s{words}" if seconds >= 0.1 else "at once"


def lying(log: FlightLog, windows: Windows, still: list[Span]) -> list[Span]:
    """Spans as still as a surface, and those of at least 3 s in which a rotorcraft lies beyond 60 deg of tilt."""
    if log.kind.winged:
        return still
    overturned = (windows.rate_rms < LYING_DPS) & (motion.tilt_deg(log, windows.middle) > LYING_DEG)
    return still + [(a, b) for a, b in join(windows, overturned) if b - a >= LYING_S]


def _disarmed(log: FlightLog) -> list[float]:
    """Times of disarming."""
    if log.armed is None:
        return []
    values = [bool(v) for v in log.armed.value]
    pairs = zip(values[:-1], values[1:], log.armed.t[1:], strict=True)
    return [float(t) for before, after, t in pairs if before and not after]


def _blows(imu: Imu, within: list[Span], tumbling: bool = False) -> list[tuple[float, float]]:
    """Times and sizes (g) of forces above 4 g within spans; ``tumbling``: with 200 deg/s within 0.5 s of it."""
    force = rotation.length(imu.acc.x) / G
    t = imu.acc.t_best
    hit = np.flatnonzero((force > BLOW_G) & spans.inside(t, within))
    if tumbling:
        speed = np.degrees(rotation.length(imu.gyro.x))
        fast = imu.gyro.t_best[speed > TUMBLE_DPS]
        hit = hit[np.searchsorted(fast, t[hit] + NEAR_S) > np.searchsorted(fast, t[hit] - NEAR_S)]
    return [(float(t[i]), float(force[i])) for i in hit]


def _overturned(log: FlightLog, airborne: FlagSpans) -> list[tuple[float, float]]:
    """Starts of the spans in the air beyond 90 deg of tilt by the onboard attitude, of 0.3 s, with the largest tilt."""
    attitude = log.onboard_attitude
    if attitude is None or len(attitude.t) == 0:
        return []
    over = np.degrees(rotation.inclination_angle(attitude.q))
    beyond = (over > TILT_DEG) & spans.inside(attitude.t, airborne.spans)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], beyond.astype(np.int8), [0]])))
    return [
        (float(attitude.t[a]), float(np.max(over[a:b])))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if attitude.t[min(b, len(beyond) - 1)] - attitude.t[a] >= TURNED_S
    ]
