"""Find overturns and tumbles, how flights ended, and when a vehicle was a wreck.

Thresholds are from docs/story.md, measured on real crashes, hard landings and aerobatics. An autopilot's crash report
is no crash by itself: it is also sent for vehicles on a bench or in a hand.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans
from attlog.core.sorting import median
from attlog.core.spans import Span
from attlog.flight.model import FlightLog
from attlog.segments.airborne import InAir
from attlog.segments.flight_signs import STEP_S, G, Grid, true_runs
from attlog.segments.impacts import (
    AFTER_S,
    BEFORE_S,
    FALL_S,
    FLIES_ON_S,
    HARDER_RATIO,
    MAX_REST_FORCE_ERROR_M_S2,
    MAX_TILT_DIFFERENCE_DEG,
    MAX_UPRIGHT_DEG,
    MIN_IMPACT_G,
    MIN_LYING_DRIVEN_DEG,
    REST_BEGINS_S,
    REST_ENDS_S,
    CrashContext,
    CrashEvent,
    find_impacts,
    impact_peaks,
    last_still_tilt,
    max_rate_dps,
    onboard_tilt,
    rest_tilt,
    static_down,
)

# Overturn: minimum tilt and duration, or a larger tilt for a shorter duration.
MIN_OVERTURN_DEG, MIN_OVERTURN_S, MIN_INVERTED_DEG, MIN_INVERTED_S = 90.0, 0.2, 120.0, 0.05
# Ratio of down's parts along the body's axes above which it turned about one of them: 5 deg from the diagonal.
ONE_AXIS_RATIO = 1.2
# Time before an overturn in which it was upright; events closer than that are one.
UPRIGHT_BEFORE_S = 5.0
# Gyro rate that confirms an overturn, and how long before it.
MIN_TURN_DPS, TURN_BEFORE_S = 100.0, 3.0
# Tumble: minimum rate and duration.
MIN_TUMBLE_DPS, MIN_TUMBLE_S = 400.0, 0.3
# Fall on the ground: minimum tilt afterwards, maximum tilt before, minimum time lying.
MIN_TIPPED_DEG, MAX_STANDING_DEG, MIN_LYING_S = 30.0, 15.0, 3.0
# Time before and after a flight's end in which it tips over.
TIPPED_BEFORE_S, TIPPED_AFTER_S = 1.0, 6.0
# Maximum delay of the autopilot's crash report.
REPORT_AFTER_S = 10.0


def find_overturns(context: CrashContext) -> list[CrashEvent]:
    """Return tilts beyond 90 deg that the IMU confirms, without aerobatics."""
    t, deg = context.tilt.t, context.tilt.deg
    if not len(t):
        return []
    allowed = spans.merge([*context.armed, *context.air.spans])
    limit = MIN_OVERTURN_DEG
    found: list[CrashEvent] = []
    for a, b in true_runs((deg > limit) & spans.inside(t, allowed)):
        until = float(min(t[min(b, len(t) - 1)], t[b - 1] + 0.5))
        largest = float(np.max(deg[a:b]))
        inverted = [(i, j) for i, j in true_runs(deg[a:b] > MIN_INVERTED_DEG)]
        long = until - t[a] >= MIN_OVERTURN_S
        long |= any(t[min(a + j, len(t) - 1)] - t[a + i] >= MIN_INVERTED_S for i, j in inverted)
        upright = deg[spans.between(t, t[a] - UPRIGHT_BEFORE_S, float(t[a]))]
        if (
            not long
            or not len(upright)
            or np.min(upright) > MAX_UPRIGHT_DEG
            or not _imu_confirms(context, float(t[a]), until)
        ):
            continue
        if found and t[a] - found[-1].t_end < UPRIGHT_BEFORE_S:
            most = max(found[-1].size, largest)
            found[-1] = replace(found[-1], t_end=until, size=most, why=_overturn_text(most))
            continue
        lying = rest_tilt(context, until)
        beyond = lying is not None and lying > MIN_LYING_DRIVEN_DEG
        if context.flies_at(float(t[a]) + FLIES_ON_S) and not beyond and not _has_impact(context, float(t[a]), until):
            continue
        if not _was_driven(context, float(t[a]), until, lying):
            continue
        source, axis = (_attitude_source(context),), _tilt_axis(context.log, a)
        text = _overturn_text(largest)
        found.append(CrashEvent("overturn", float(t[a]), until, largest, "deg", text, lying, sources=source, axis=axis))
    return found


def _tilt_axis(log: FlightLog, k: int) -> Literal["", "roll", "pitch"]:
    """Return about which axis sample ``k`` of the attitude is tilted; empty for both."""
    attitude = log.onboard_attitude or log.truth
    if attitude is None:
        return ""
    x, y, _ = np.abs(rotation.rotate_inverse(attitude.q[k], np.array([0.0, 0.0, 1.0])))
    return "roll" if y > ONE_AXIS_RATIO * x else "pitch" if x > ONE_AXIS_RATIO * y else ""


def _overturn_text(deg: float) -> str:
    return f"it turned over to {deg:.0f} deg"


def _tumble_text(dps: float) -> str:
    return f"it tumbled without a command at up to {dps:.0f} deg/s"


def _attitude_source(context: CrashContext) -> str:
    attitude = context.log.onboard_attitude or context.log.truth
    return attitude.source if attitude is not None else ""


def _was_driven(context: CrashContext, t: float, until: float, lying: float | None) -> bool:
    """Return whether the vehicle was driven or in the air as it turned over."""
    grid = context.air.grid
    part = spans.between(grid.t, t - 3.0, t + 0.5)
    driven = bool(context.air.driven[part].any()) if part.stop > part.start else False
    return driven or any(a - BEFORE_S <= t <= b + AFTER_S for a, b in context.air.spans)


def _has_impact(context: CrashContext, t0: float, t1: float) -> bool:
    """Return whether there is an impact peak from 3 s before to 3 s after."""
    within = [(t0 - FALL_S, t1 + FALL_S)]
    return bool(impact_peaks(context.log.imus, within, MIN_IMPACT_G))


def _imu_confirms(context: CrashContext, t0: float, t1: float) -> bool:
    """Return whether a fast rate before, or gravity afterwards, confirms an overturn.

    Without an IMU the autopilot's report of a crash counts.
    """
    if not context.log.imus:
        reports = [p.t for p in context.log.problems if p.code == "crash" and p.t is not None]
        return any(t0 - TURN_BEFORE_S <= t <= t1 + REPORT_AFTER_S for t in reports)
    if max_rate_dps(context, t0 - TURN_BEFORE_S, t0 + 0.5) > MIN_TURN_DPS:
        return True
    lying = rest_tilt(context, t0)
    return lying is not None and lying > MAX_UPRIGHT_DEG


def find_tumbles(context: CrashContext) -> list[CrashEvent]:
    """Return uncommanded rates above 400 deg/s in the air."""
    imu = context.log.replay_imu or next(iter(context.log.imus), None)
    wanted = context.log.setpoints.rates
    if imu is None or wanted is None or len(wanted.t) < 2 or context.log.kind.winged:
        return []
    t, rate = imu.gyro.t_best, np.degrees(rotation.length(imu.gyro.x))
    asked = np.degrees(rotation.length(np.nan_to_num(wanted.x, posinf=0.0, neginf=0.0)))
    found: list[CrashEvent] = []
    for a, b in true_runs(
        (rate > MIN_TUMBLE_DPS) & spans.inside(t, spans.merge((x, y + BEFORE_S) for x, y in context.air.spans))
    ):
        least = MIN_TUMBLE_S if context.end - t[b - 1] > 0.5 else 0.1
        if t[b - 1] - t[a] < least or context.flies_at(float(t[a]) + FLIES_ON_S):
            continue
        around = asked[spans.between(wanted.t, t[a] - 0.1, t[b - 1] + 0.1)]
        fastest = float(rate[a:b].max())
        if len(around) and float(np.max(around)) > 0.5 * float(median(rate[a:b])):
            continue
        if found and t[a] - found[-1].t_end < UPRIGHT_BEFORE_S:
            most = max(found[-1].size, fastest)
            found[-1] = replace(found[-1], t_end=float(t[b - 1]), size=most, why=_tumble_text(most))
            continue
        source = (imu.gyro.source,)
        found.append(
            CrashEvent("tumble", float(t[a]), float(t[b - 1]), fastest, "deg/s", _tumble_text(fastest), sources=source)
        )
    return found


def find_tipped(context: CrashContext, crashes: list[CrashEvent]) -> list[CrashEvent]:
    """Return flights without an impact peak that end with the vehicle tilted beyond 30 deg.

    It tips at the last crossing of that tilt around the flight's end, and the accelerometer shows how it then lies.
    """
    found = []
    for _, b in context.air.spans:
        if any(abs(e.t - b) < UPRIGHT_BEFORE_S for e in crashes):
            continue
        lying = last_still_tilt(context, b, b + TIPPED_AFTER_S)
        if lying is None or lying < MIN_TIPPED_DEG or context.driven_at(b + REST_BEGINS_S, b + REST_ENDS_S):
            continue
        part = spans.between(context.tilt.t, b - TIPPED_BEFORE_S, b + TIPPED_AFTER_S)
        above = context.tilt.deg[part] > MIN_TIPPED_DEG
        crossed = np.flatnonzero(above[1:] & ~above[:-1])
        t = float(context.tilt.t[part][crossed[-1] + 1]) if len(crossed) else b
        why = f"it ended tipped over, at {lying:.0f} deg"
        found.append(CrashEvent("overturn", t, t, lying, "deg", why, lying, sources=("accelerometer",)))
    return found


def find_falls(context: CrashContext) -> list[CrashEvent]:
    """Return falls with motors driven: attitude and force beyond 30 deg for 3 s.

    In flight the specific force of a multirotor does not tilt with the attitude. Winged vehicles are excluded.
    """
    grid = context.air.grid
    if grid.slow or context.log.kind.winged or not np.isfinite(grid.down[:, 0]).any():
        return []
    down, force = static_down(context), rotation.length(grid.force)
    tilt = np.degrees(np.arccos(np.clip(np.nan_to_num(grid.down @ down, nan=1.0), -1.0, 1.0)))
    leans = np.degrees(np.arccos(np.clip(-grid.force @ down / np.maximum(force, 1e-9), -1.0, 1.0)))
    lying = (tilt > MIN_TIPPED_DEG) & (leans > MIN_TIPPED_DEG) & grid.known
    lying &= np.abs(tilt - leans) < MAX_TILT_DIFFERENCE_DEG
    lying &= np.abs(force - G) < MAX_REST_FORCE_ERROR_M_S2
    before, found = round(UPRIGHT_BEFORE_S / STEP_S), []
    for a, b in true_runs(lying):
        stood = np.maximum(tilt, leans)[max(a - before, 0) : a]
        if (
            (b - a) * STEP_S < MIN_LYING_S
            or not len(stood)
            or stood.min() > MAX_STANDING_DEG
            or not context.air.driven[a]
        ):
            continue
        lean = float(median(tilt[a:b]))
        t, t_end = float(grid.t[a]), float(grid.t[b - 1])
        passed = context.tilt.t[spans.between(context.tilt.t, t - 1.0, t + 0.5)]
        above = context.tilt.deg[spans.between(context.tilt.t, t - 1.0, t + 0.5)] > MIN_TIPPED_DEG
        t = float(passed[np.argmax(above)]) if above.any() else t
        why = f"it fell over and lay at {lean:.0f} deg"
        found.append(
            CrashEvent(
                "overturn", t, t_end, lean, "deg", why, lean, sources=(_attitude_source(context), "accelerometer")
            )
        )
    return found


# --- wrecks ------------------------------------------------------------------------------------------------------

Mask = NDArray[np.bool_]

# Upright again: minimum time, maximum angle of the force to z, maximum standard deviation of the force.
MIN_UPRIGHT_S, MAX_UPRIGHT_FORCE_DEG, MAX_STEADY_M_S2 = 2.0, 25.0, 0.3
# After a gap of this length, in which the vehicle was carried away, a shorter time is enough.
MIN_CARRIED_GAP_S, MIN_UPRIGHT_AFTER_GAP_S = 5.0, 1.0


class Wreck(NamedTuple):
    """Wreck from a crash at ``t0`` s until upright again, or the log's end, at ``t1`` s.

    ``impact_s``: first impact of the crash, else ``t0``. ``why``: a sentence with numbers.
    """

    t0: float
    impact_s: float
    t1: float
    why: str


class FlightOutcome(NamedTuple):
    """Flights of a log, their crashes and hard landings, and its wrecks."""

    flights: list[Span]
    crash_events: list[CrashEvent]
    wrecks: list[Wreck]


def find_crashes(log: FlightLog, air: InAir, armed: list[Span] | None, end: float) -> FlightOutcome:
    """Return the flights of a log and how they ended, in time order.

    ``armed``: None where unknown. ``end``: end of the log in s. A flight ends with its first crash. A later crash
    counts only after the vehicle was upright, still and undriven. Movement of a wreck is no flight.
    """
    if not log.kind.flies or not len(air.grid.t):
        return FlightOutcome([], [], [])
    context = CrashContext(
        log, air, armed if armed is not None else [(float(air.grid.t[0]), end)], end, onboard_tilt(log)
    )
    overturns = find_overturns(context)
    # What flips over at take-off never flew, and strikes the ground as it does.
    impacts = [] if overturns and not air.spans else find_impacts(context)
    found = [*impacts, *overturns, *find_tumbles(context)]
    found += find_tipped(context, [e for e in found if e.is_crash])
    crashes = [e for e in found if e.is_crash]
    found += [e for e in find_falls(context) if not any(abs(c.t - e.t) < UPRIGHT_BEFORE_S for c in crashes)]
    return _flights_before_wrecks(context, sorted(found, key=lambda e: e.t))


def _flights_before_wrecks(context: CrashContext, found: list[CrashEvent]) -> FlightOutcome:
    """Return flights cut at their first crash, crash events without repeats, and wrecks."""
    kept: list[CrashEvent] = []
    wrecks: list[Wreck] = []
    crash: list[CrashEvent] = []

    def close(t1: float) -> None:
        hit = next((e.t for e in crash if e.kind == "impact"), crash[0].t)
        wrecks.append(Wreck(crash[0].t, hit, t1, "; ".join(e.why for e in crash)))
        crash.clear()

    air = context.air
    driven = air.driven & (air.power_source != "arming")  # armed is not driven: there only stillness shows a stand
    times: list[tuple[float, CrashEvent | None]] = [(a, None) for a, _ in context.air.spans]
    times += [(e.t, e) for e in found]
    for t, ending in sorted(times, key=lambda x: (x[0], x[1] is not None)):
        if crash:
            stood = _stood_since(air.grid, driven, crash[0].t, t)
            if stood is not None:
                close(stood)
        if ending is None:
            continue
        same = crash and ending.is_crash and t - crash[-1].t_end < UPRIGHT_BEFORE_S and _same_crash(crash, ending)
        if not crash or same:
            kept.append(ending)
            crash += [ending] if ending.is_crash else []
    if crash:
        close(context.end)
    lost = spans.complement([(w.impact_s, w.t1) for w in wrecks], -np.inf, np.inf)
    flown = spans.intersect(context.air.spans, lost)
    begun = {a for a, _ in context.air.spans}
    impacts = [e.t for e in kept if e.kind == "impact"]
    stretched = [(a, next((e for e in impacts if b < e <= b + AFTER_S), b)) for a, b in flown if a in begun]
    return FlightOutcome(stretched, kept, wrecks)


def _same_crash(crash: list[CrashEvent], ending: CrashEvent) -> bool:
    """Return whether an event extends a crash.

    Another kind, a harder impact, one with the ground after one in the air, or an overturn after a fall. What spins
    after it struck the ground is the wreck.
    """
    last, impacts = crash[-1], [e.size for e in crash if e.kind == "impact" and not e.in_air]
    if ending.kind == "tumble" and impacts:
        return False
    if ending.kind == "impact" and impacts:
        return ending.size > HARDER_RATIO * max(impacts)
    if ending.kind == last.kind == "impact":
        return True  # after an impact in the air
    return ending.kind != last.kind or (last.unit == "deg" and last.size < MIN_OVERTURN_DEG < ending.size)


def _stood_since(grid: Grid, driven: Mask, crash: float, t: float) -> float | None:
    """Return when the vehicle was upright, still and undriven between ``crash`` and ``t``.

    For at least 2 s, after a long gap 1 s; None where never.
    """
    part = spans.between(grid.t, crash + REST_BEGINS_S, t)
    if part.stop <= part.start:
        return None
    upright = -grid.force[:, 2] > np.cos(np.radians(MAX_UPRIGHT_FORCE_DEG)) * rotation.length(grid.force)
    gap_ends = [b for a, b in true_runs(~grid.known[part]) if (b - a) * STEP_S >= MIN_CARRIED_GAP_S]
    for a, b in true_runs((upright & ~driven & grid.known)[part]):
        count = round((MIN_UPRIGHT_S if a not in gap_ends else MIN_UPRIGHT_AFTER_GAP_S) / STEP_S)
        for k in range(part.start + a, part.start + b - count + 1, max(count // 2, 1)):
            if float(np.sqrt(np.sum(np.var(grid.force[k : k + count], axis=0)))) < MAX_STEADY_M_S2:
                return float(grid.t[k])
    return None
