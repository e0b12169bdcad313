"""Find flights by physics: drive, movement and height.

Flags and throttle alone are no evidence: motors run at 60 % of hover throttle on the ground and at 100 % on a bench,
and land detectors are seconds late or never change. A flight needs motor drive, and either movement that is impossible
on the ground or a height beyond barometer drift. Where the drive is not logged, arming takes its place, and a vehicle
without a height is in the air only while its sideways force ignores its tilt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import spans
from attlog.core.brief import brief
from attlog.core.sorting import median, quantile
from attlog.core.spans import Span
from attlog.flight.model import FlightLog
from attlog.flight.vehicle import VehicleKind
from attlog.segments.flight_signs import (
    AIRBORNE_DYNAMICS,
    MAX_HAND_M_S,
    REST_DYNAMICS,
    STEP_S,
    Grid,
    hold_last,
    true_runs,
)
from attlog.segments.heights import (
    LIKELY_HEIGHT_M,
    HeightLevel,
    averaged_height,
    has_jumps,
    height_levels,
    height_stream,
    long_runs,
)
from attlog.segments.sparse_flights import (
    armed_by_drive,
    count_from_arming,
    flights_by_motion,
    ground_without_drive,
    grow_flights,
    heard_drive,
    join_ranges,
    liftoff_by_tilt,
    rotor_sign,
    stood_times,
    tilts_as_in_air,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Dynamics (:attr:`Grid.dynamics`) of a vehicle that landed.
LANDED_DYNAMICS = -2.5
# Minimum dynamics (80 % quantile) that confirm a flight with a likely height, and without any height.
MIN_DYNAMICS_WITH_HEIGHT, MIN_DYNAMICS_ALONE = 0.2, 0.55
# Minimum dynamics in the air where the height is likely.
MIN_LIKELY_DYNAMICS = -0.3
# Minimum drive at all.
MIN_DRIVE = 0.02
# Shares of the usual power of flight: driven, in a likely flight or while a flight lasts, lifting, hovering.
DRIVEN_SHARE, FLIGHT_SHARE, LIFT_SHARE, HOVER_SHARE = 0.25, 0.6, 0.5, 0.8
# Maximum power of idle motors.
MAX_IDLE_POWER = 0.1
# Minimum time with a height, that of a slow IMU, and with dynamics alone; longest pause within a flight.
MIN_HEIGHT_S, MIN_SLOW_HEIGHT_S, MIN_DYNAMICS_S, MAX_BRIDGED_S = 0.5, 3.0, 1.5, 2.0
# Minimum time with the sign of rotors where a height is logged and stays low.
MIN_ROTOR_S = 1.0
# Time high above the ground after which a drive at zero is not the drive.
MIN_UNDRIVEN_S = 3.0
# Rotor thrust has no sideways part, so this sideways force (15 deg of tilt) without speed or height is a hand's.
MIN_HAND_FORCE_M_S2 = 2.5
# Ground speed that only flight reaches.
MIN_AIR_SPEED_M_S = 5.0
# Signs of flight are late after long ground contact: a flight is extended while the height, above this share of a
# likely one, rises or sinks, up to noise and for so long.
GROUND_HEIGHT_SHARE, HEIGHT_NOISE_M, MAX_EXTENSION_S = 0.3, 0.03, 3.0
# Longest pause of the drive, and smallest height change in it, of a fall or climb in the air: on the ground propellers
# shift a barometer by up to 4 m.
MAX_FALL_S, MIN_FALL_M = 10.0, 5.0
# Change of the force at lift-off: minimum, and in standard deviations; ratio of the landing peak to the median.
MIN_LIFTOFF_STEP_M_S2, LIFTOFF_SIGMAS, LANDING_PEAK_RATIO = 0.25, 5.0, 4.0
# Windows of the dynamics: it moves until this long before they show rest.
CAME_TO_REST_S = 3.0
# Above this height ground contact is impossible: near the ground propellers shift a barometer by up to 4 m.
MIN_CLEAR_M = 5.0


@dataclass(slots=True)
class InAir:
    """Flights (t0, t1) s of a log, with the drive and heights that show them.

    ``driven`` (mask) and ``power`` (n,), 0 to 1, at the grid's times, from ``power_source``. ``why``: evidence as text.
    ``known``: False where the log cannot show flight.
    """

    grid: Grid
    spans: list[Span]
    driven: Mask
    power: Array
    levels: list[HeightLevel]
    power_source: str
    why: str
    known: bool = True
    __repr__ = brief

    @property
    def climb(self) -> Array:
        """Vertical speed (n,) in m/s by the barometer or GNSS, NaN where unknown."""
        above = next((level.above for level in self.levels if level.sensor != "range"), None)
        return np.full(len(self.grid.t), np.nan) if above is None else np.gradient(above, STEP_S)


def find_flights(log: FlightLog, grid: Grid, armed: list[Span] | None, known_spans: list[Span]) -> InAir:
    """Return the flights in a grid.

    ``armed``: None where unknown. ``known_spans``: time logged without pauses.
    """
    t = grid.t
    allowed = spans.inside(t, armed) if armed is not None else np.ones(len(t), bool)
    power, source = _drive_power(log, t)
    if grid.slow:
        return _slow_flights(log, grid, armed, allowed)
    may = grid.known & spans.inside(t, known_spans) & allowed
    if power is None or _is_no_drive(log, grid, power, may):
        return _flights_without_drive(log, grid, armed, may)
    moving = (np.nan_to_num(grid.dynamics, nan=-9.0) > AIRBORNE_DYNAMICS) & ~grid.contact
    usual = _usual_power(power, may & moving & (power > MIN_DRIVE))
    driven, lifting = may & (power > max(MIN_DRIVE, DRIVEN_SHARE * usual)), power > MAX_IDLE_POWER
    levels = height_levels(log, grid, ~driven)
    flying = _flying_mask(log.kind, grid, levels, may, driven, power / max(usual, MIN_DRIVE), lifting)
    found = join_across_falls(log, grid, _flight_ranges(log.kind, flying, grid, levels, driven, power))
    if armed is None:  # carried in a car, wings are never driven
        found = [(a, b) for a, b in found if driven[a:b].any()]
    rolls = log.kind.fixed_wing  # a take-off run hides the force step of lift-off
    edges = [(float(t[a]) if rolls else _liftoff_time(grid, a, driven), _landing_time(grid, b)) for a, b in found]
    return _in_air(grid, edges, driven, power, levels, source, True)


def _in_air(
    grid: Grid, edges: list[Span], driven: Mask, power: Array, levels: list[HeightLevel], source: str, known: bool
) -> InAir:
    """Return flights with their evidence; ``known``: the log can show flight even where it shows none."""
    heights = ", ".join(f"height by {level.source}" for level in levels[:2])
    why = f"driven ({source}) and moving as only the air lets it" + (f", {heights}" if heights else "")
    flown = spans.merge(s for s in edges if s[1] > s[0])
    return InAir(grid, flown, driven, power, levels, source, why, known or bool(flown))


def _is_no_drive(log: FlightLog, grid: Grid, power: Array, armed: Mask) -> bool:
    """Return whether the logged drive stays at zero while armed although the vehicle is high."""
    if not armed.any() or power[armed].max() > MIN_DRIVE:
        return False
    levels = height_levels(log, grid, ~armed)
    count = round(MIN_UNDRIVEN_S / STEP_S)
    return any(long_runs(armed & (np.nan_to_num(level.above) > MIN_CLEAR_M), count).any() for level in levels)


def _flights_without_drive(log: FlightLog, grid: Grid, armed: list[Span] | None, may: Mask) -> InAir:
    """Return the flights of a log without a drive, by arming, movement and height."""
    driven = may if armed is not None else np.zeros(len(may), bool)  # arming alone is no lift
    rotor = rotor_sign(grid, driven)
    levels = height_levels(log, grid, ground_without_drive(grid, driven, rotor))
    hint, _, clear = _height_signs(log.kind, grid, levels)
    dynamics = np.nan_to_num(grid.dynamics, nan=-9.0)
    free, moving = ~(grid.contact & ~clear), dynamics > AIRBORNE_DYNAMICS
    flying = _winged_flight(log.kind, grid, levels, driven, may)
    if not log.kind.fixed_wing:
        flying |= driven & free & moving & (grid.force[:, 2] < 0.0) & (hint | rotor)
    lasting = driven & (free & moving | hint & (dynamics > REST_DYNAMICS))
    found = []
    for a, b in _bridge_gaps(list(true_runs(flying)), grid.known & driven):
        if not _is_flight(a, b, grid, levels):
            continue
        while not log.kind.fixed_wing and b < len(flying) and lasting[b]:
            b += 1
        found.append((a, b) if log.kind.fixed_wing else _extend_to_ground(a, b, levels, driven))
    stream = height_stream(log)
    if stream is not None:
        height = averaged_height(grid.t, stream)
        found += flights_by_motion(grid, height, may, log.kind.winged)
    found = join_across_falls(log, grid, join_ranges(found, MAX_BRIDGED_S))
    begins = [float(grid.t[a]) if log.kind.winged else liftoff_by_tilt(grid, a) for a, _ in found]
    edges = [(a, _landing_time(grid, b)) for a, (_, b) in zip(begins, found, strict=True)]
    known = armed is not None and bool(levels)  # unknown in a ROS bag that holds sensors only
    return _in_air(grid, edges, driven, driven.astype(np.float64), levels, "arming", known)


def _slow_flights(log: FlightLog, grid: Grid, armed: list[Span] | None, allowed: Mask) -> InAir:
    """Return the flights of slow telemetry, by heights and the drive that was heard."""
    t, streams = grid.t, (log.power.throttle, log.power.motors, log.power.rpm)
    stream = next((one for one in streams if one is not None and len(one.t) > 1), None)
    if stream is not None:
        power, heard = heard_drive(t, stream)
        power = power / max(float(power.max()), 1e-9) if stream is not log.power.throttle else power
        up = power > max(MIN_DRIVE, DRIVEN_SHARE * _usual_power(power, np.zeros(len(t), bool)))
        if armed is not None:
            armed = armed_by_drive(t, armed, up & heard)
            allowed = spans.inside(t, armed)
        driven, off, source = allowed & heard & up, heard & ~up, stream.source
    else:
        driven = allowed if armed is not None else np.zeros(len(t), bool)
        power, off, source = driven.astype(np.float64), np.zeros(len(t), bool), "arming"
    levels = height_levels(log, grid, off | ~allowed)
    own = log.estimator.height
    if own is not None and len(own.t) > 1 and all(level.sensor != "estimator" for level in levels):
        levels = [HeightLevel("estimator", own.source, averaged_height(t, own), has_jumps(own)), *levels]
    levels = [count_from_arming(t, level, armed or []) for level in levels]
    sensed = [level for level in levels if level.sensor != "estimator"] or levels
    hint, sure, _ = _height_signs(log.kind, grid, sensed)
    found = [(a, b) for a, b in true_runs(driven & (hint | sure)) if _is_flight(a, b, grid, sensed)]
    height = height_stream(log)
    if height is not None and (stream is None or not sensed):
        found += flights_by_motion(grid, averaged_height(t, height), allowed, log.kind.winged)
    above = levels[0].above if levels else np.full(len(t), np.nan)
    stood = stood_times(grid, ~allowed, off, above, log.kind.winged)
    found = grow_flights(join_ranges(found, 0.0), stood, off, above)
    edges = [(float(t[a]), float(t[min(b, len(t) - 1)])) for a, b in found]
    return _in_air(
        grid, edges, driven, power, levels, source, bool(levels) and (source != "arming" or armed is not None)
    )


def _drive_power(log: FlightLog, t: Array) -> tuple[Array | None, str]:
    """Return motor drive (n,), 0 to 1: throttle, else motor outputs, else rotor speed."""
    if log.power.throttle is not None and len(log.power.throttle.t) > 1:
        return np.abs(hold_last(t, log.power.throttle)), log.power.throttle.source
    for stream in (log.power.motors, log.power.rpm):
        if stream is not None and len(stream.t) > 1:
            mean = np.mean(np.nan_to_num(stream.x.reshape(len(stream.t), -1)), axis=1)[:, None]
            mean = mean / max(float(mean.max()), 1e-9)
            return hold_last(t, replace(stream, x=mean)), stream.source
    return None, ""


def _usual_power(power: Array, carried: Mask) -> float:
    """Return the usual power of flight: median while airborne, else the 95th percentile."""
    return float(median(power[carried]) if carried.any() else quantile(power, 0.95))


def _height_signs(kind: VehicleKind, grid: Grid, levels: list[HeightLevel]) -> tuple[Mask, Mask, Mask]:
    """Return where a height makes flight likely, where certain, and where contact impossible, each (n,).

    Ground speed takes the place of a height for wings.
    """
    none = np.zeros(len(grid.t), bool)
    if kind.winged and not levels:
        fast = np.nan_to_num(grid.speed) > MIN_AIR_SPEED_M_S
        return fast, fast, fast
    hint, sure, clear = none, none, none
    for level in levels:
        hint, sure = hint | level.hint, sure | level.sure
        clear = clear | (np.nan_to_num(level.above) > MIN_CLEAR_M)
    return hint, sure, clear


def _winged_flight(kind: VehicleKind, grid: Grid, levels: list[HeightLevel], driven: Mask, may: Mask) -> Mask:
    """Mark times in which wings carry; none for others, nor in a ride without any arming (``may``), as on a car."""
    if not kind.winged:
        return np.zeros(len(grid.t), bool)
    hint, sure, _ = _height_signs(kind, grid, levels)
    fast = np.nan_to_num(grid.speed) > MIN_AIR_SPEED_M_S
    moves = np.nan_to_num(grid.dynamics, nan=-9.0) > AIRBORNE_DYNAMICS
    carried: Mask = grid.known & (driven & sure & (fast | moves) | fast & hint & moves)
    for a, b in true_runs(carried):
        carried[a:b] = may[a:b].any()
    return carried


def _flying_mask(
    kind: VehicleKind, grid: Grid, levels: list[HeightLevel], may: Mask, driven: Mask, power: Array, lifting: Mask
) -> Mask:
    """Mark times in the air; ``power`` is relative to the usual power of flight."""
    by_air = _winged_flight(kind, grid, levels, driven, may)
    if kind.fixed_wing:
        return by_air
    hint, sure, clear = _height_signs(kind, grid, levels)
    dynamics = np.nan_to_num(grid.dynamics, nan=-9.0)
    contact = grid.contact & ~clear
    free = ~contact & (grid.force[:, 2] < 0.0)
    carried = (dynamics > AIRBORNE_DYNAMICS) & free & (hint | lifting & (power > LIFT_SHARE))
    likely = hint & (dynamics > MIN_LIKELY_DYNAMICS) & free & (power > FLIGHT_SHARE)
    flying: Mask = by_air | driven & (carried | likely | sure & (~contact | (power > HOVER_SHARE)))
    return flying


def _flight_ranges(
    kind: VehicleKind, flying: Mask, grid: Grid, levels: list[HeightLevel], driven: Mask, power: Array
) -> list[tuple[int, int]]:
    """Return index ranges of confirmed flights, extended to lift-off and landing."""
    found = []
    for a, b in _bridge_gaps(list(true_runs(flying)), grid.known & driven):
        if not _is_flight(a, b, grid, levels):
            continue
        if kind.fixed_wing:
            found.append((a, b))
            continue
        own = float(median(power[a:b]))
        dynamics = np.nan_to_num(grid.dynamics, nan=-9.0)
        lasting = driven & (power > FLIGHT_SHARE * own) & ~grid.contact & (dynamics > LANDED_DYNAMICS)
        while b < len(flying) and lasting[b]:
            b += 1
        before = driven & (power > HOVER_SHARE * own) & ~grid.contact & (dynamics > REST_DYNAMICS)
        if before[:a].all():  # a log that begins in the air
            a = 0
        while not levels and 0 < a < b - 1 and power[a] < FLIGHT_SHARE * own:
            a += 1  # without a height: motors spin up on the ground
        found.append((a, b))
    reached = []
    for a, b in found:
        pushed = driven & (power > FLIGHT_SHARE * float(median(power[a:b])))
        reached.append(_extend_to_ground(a, b, levels, pushed))
    return join_ranges(reached, MAX_BRIDGED_S)


def _extend_to_ground(a: int, b: int, levels: list[HeightLevel], driven: Mask) -> tuple[int, int]:
    """Extend a flight while the height still rises from, or sinks to, the ground."""
    for level in levels:
        above, least = np.nan_to_num(level.above), GROUND_HEIGHT_SHARE * LIKELY_HEIGHT_M[level.sensor]
        furthest = round(MAX_EXTENSION_S / STEP_S)
        while furthest and a > 0 and driven[a - 1] and least < above[a - 1] <= above[a] + HEIGHT_NOISE_M:
            a, furthest = a - 1, furthest - 1
        furthest = round(MAX_EXTENSION_S / STEP_S)
        while furthest and b < len(above) and driven[b] and least < above[b] <= above[b - 1] + HEIGHT_NOISE_M:
            b, furthest = b + 1, furthest - 1
    return a, b


def _bridge_gaps(found: list[tuple[int, int]], whole: Mask) -> list[tuple[int, int]]:
    """Join ranges across gaps of up to 2 s that lie wholly in the mask ``whole``."""
    joined: list[tuple[int, int]] = []
    for a, b in found:
        if joined and (a - joined[-1][1]) * STEP_S <= MAX_BRIDGED_S and bool(whole[joined[-1][1] : a].all()):
            joined[-1] = joined[-1][0], max(b, joined[-1][1])
        else:
            joined.append((a, b))
    return joined


def join_across_falls(log: FlightLog, grid: Grid, found: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Join flights between which the height changes by more than 5 m.

    Zero throttle or specific force ends the signs of flight, but a falling vehicle is still in the air.
    """
    stream = height_stream(log)
    if stream is None or len(found) < 2:
        return found
    level = averaged_height(grid.t, stream)
    joined = found[:1]
    for a, b in found[1:]:
        end = joined[-1][1]
        pause = level[end : a + 1]
        moved = float(np.nanmax(pause) - np.nanmin(pause)) if np.isfinite(pause).any() else 0.0
        if (a - end) * STEP_S <= MAX_FALL_S and moved > MIN_FALL_M and bool(grid.known[end:a].all()):
            joined[-1] = joined[-1][0], b
        else:
            joined.append((a, b))
    return joined


def _is_flight(a: int, b: int, grid: Grid, levels: list[HeightLevel]) -> bool:
    """Return whether height, or movement with likely height or for long, confirms flight."""

    def seconds(masks: list[Mask]) -> float:
        return max((np.count_nonzero(mask[a:b]) for mask in masks), default=0) * STEP_S

    if seconds([level.sure for level in levels]) >= MIN_HEIGHT_S:
        return True
    hints = seconds([level.hint for level in levels])
    if grid.slow:  # propellers raise a barometer on the ground
        own = np.zeros(len(grid.t), bool)
        own[a:b] = True
        return hints >= MIN_SLOW_HEIGHT_S and tilts_as_in_air(grid, own) is not False
    hinted = hints >= MIN_HEIGHT_S
    dynamics = float(quantile(np.nan_to_num(grid.dynamics[a:b], nan=-9.0), 0.8))
    by_tilt = bool(np.isfinite(grid.down[a:b, 0]).any())  # without attitude, ground contact cannot be excluded
    moves = dynamics > MIN_DYNAMICS_ALONE and (b - a) * STEP_S >= MIN_DYNAMICS_S and by_tilt
    if levels and not hinted:  # a run on the ground
        moves = moves and seconds([rotor_sign(grid, grid.known)]) >= MIN_ROTOR_S
    return (hinted and dynamics > MIN_DYNAMICS_WITH_HEIGHT) or (moves and not (levels and _is_handheld(a, b, grid)))


def _is_handheld(a: int, b: int, grid: Grid) -> bool:
    """Return whether a slow span has a large sideways force, as in a hand."""
    sideways = np.hypot(grid.force[a:b, 0], grid.force[a:b, 1])
    slow = not np.any(grid.speed[a:b] > MAX_HAND_M_S)
    return slow and float(quantile(sideways, 0.6)) > MIN_HAND_FORCE_M_S2


def _liftoff_time(grid: Grid, first: int, driven: Mask) -> float:
    """Return the time at which the force leaves its level on the ground."""
    a, b = max(first - round(0.5 / STEP_S), 0), min(first + round(2.5 / STEP_S), len(grid.t))
    a += int(np.argmax(driven[a : first + 1]))
    before = grid.size[max(a - round(2.0 / STEP_S), 0) : a]
    if grid.slow or len(before) < 5:
        return float(grid.t[first])
    level = float(median(before))
    spread = 1.4826 * float(median(np.abs(before - level)))
    off, limit = np.abs(grid.size[a:b] - level), max(MIN_LIFTOFF_STEP_M_S2, LIFTOFF_SIGMAS * spread)
    left = np.flatnonzero(off > limit)
    if not len(left):
        return float(grid.t[first])
    k = int(left[0])
    share = float((limit - off[k - 1]) / (off[k] - off[k - 1])) if k and np.isfinite(off[k - 1]) else 1.0
    # A mean over an even number of grid steps is centred between two steps.
    return float(grid.t[a + k]) - (1.5 - share) * STEP_S


def _landing_time(grid: Grid, end: int) -> float:
    """Return the start of the largest force peak around the end of flight.

    Where the vehicle already rests there with motors driven, the peak is sought from when it came to rest.
    """
    a, b = max(end - round(2.0 / STEP_S), 0), min(end + round(1.0 / STEP_S) + 1, len(grid.t))
    if grid.slow or end >= len(grid.t):
        return float(grid.t[min(end, len(grid.t) - 1)])
    moving = np.flatnonzero(~(grid.dynamics[:end] < REST_DYNAMICS))
    if len(moving) and moving[-1] < end - 1:
        a = min(a, max(int(moving[-1]) - round(CAME_TO_REST_S / STEP_S), 0))
    bump = np.abs(grid.size[a:b] - median(grid.size[a:b]))
    stands_out = bump.max() > max(2.0 * MIN_LIFTOFF_STEP_M_S2, LANDING_PEAK_RATIO * float(median(bump)))
    if not stands_out:
        return float(grid.t[end])
    k = int(np.argmax(bump))
    while k and bump[k - 1] > 0.5 * bump.max():  # averaging widens the peak, and landing gear touches repeatedly
        k -= 1
    return float(grid.t[a + k])
