"""Find flights by physics: drive, movement and height.

Flags and throttle alone are no evidence: motors run at 60 % of hover throttle on the ground and at 100 % on a bench,
and land detectors are seconds late or never change. A flight needs motor drive, and either movement that is impossible
on the ground or a height beyond barometer drift. Heights (rangefinder, barometer, GNSS, never the estimator's) are
relative to the ground height interpolated between rests before and after.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from attlog.core import spans
from attlog.core.spans import Span
from attlog.flight.model import FlightLog, Stream
from attlog.flight.vehicle import VehicleKind
from attlog.segments.flight_signs import MAX_AGE_S, MAX_HAND_M_S, STEP_S, Grid, hold_last, seconds_to_nearest, true_runs

# --- heights -----------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LIKELY_HEIGHT_M = {"range": 0.3, "barometer": 0.7, "GNSS": 3.0}
CERTAIN_HEIGHT_M = {"range": 0.5, "barometer": 2.0, "GNSS": 12.0}
# Maximum ground speed and climb rate of a vehicle at rest or carried by hand.
MAX_GROUND_SPEED_M_S, MAX_GROUND_CLIMB_M_S = 2.0, 0.5
# Averaging time of a height, and minimum time at rest that gives the ground height.
HEIGHT_MEAN_S, MIN_STAND_S = 1.0, 1.0
# Minimum change of a rangefinder's height; below it the sensor sits too low or sees no ground.
MIN_RANGE_CHANGE_M = 0.5
# Minimum share of a flight in range for a rangefinder to be preferred for the height.
MIN_RANGED_SHARE = 0.95
# Minimum height that is reported for a flight.
MIN_REPORTED_HEIGHT_M = 0.3
# A flight left the rangefinder's range where the barometer's top exceeds this ratio of the range's plus this height:
# wind and propellers shift a barometer by up to 4 m.
OUT_OF_RANGE_RATIO, OUT_OF_RANGE_M = 1.5, 5.0
# A height sample further than SPIKE_M from the median over SPIKE_S is a spike: 10 m/s^2 of climb gives 5 m only.
SPIKE_M, SPIKE_S = 15.0, 4.0
# Longest pause of the drive, and smallest height change in it, of a fall or climb in the air: on the ground propellers
# shift a barometer by up to 4 m.
MAX_FALL_S, MIN_FALL_M = 10.0, 5.0


@dataclass(frozen=True, slots=True)
class HeightLevel:
    """Height (n,) m above the ground, NaN where unknown, by a ``sensor`` of LIKELY_HEIGHT_M."""

    sensor: str
    source: str
    above: Array

    @property
    def hint(self) -> Mask:
        """Mask (n,) of heights above which flight is likely."""
        return np.nan_to_num(self.above, nan=-1.0) > LIKELY_HEIGHT_M[self.sensor]

    @property
    def sure(self) -> Mask:
        """Mask (n,) of heights above which flight is certain."""
        return np.nan_to_num(self.above, nan=-1.0) > CERTAIN_HEIGHT_M[self.sensor]


def height_levels(log: FlightLog, grid: Grid, driven: Mask) -> list[HeightLevel]:
    """Return heights above ground: rangefinder first, then barometer or GNSS."""
    stands = ~driven & grid.known & ~(grid.speed > MAX_GROUND_SPEED_M_S)
    found = []
    if log.rangefinder is not None and len(log.rangefinder.t) > 3:
        raw = hold_last(grid.t, log.rangefinder, np.nan) * np.clip(np.nan_to_num(grid.down[:, 2], nan=1.0), 0.0, 1.0)
        ranged = (
            raw - np.nanmedian(raw[stands]) if np.isfinite(raw[stands]).any() else raw - np.nanmin(raw, initial=1e9)
        )
        if np.nanmax(ranged, initial=0.0) > MIN_RANGE_CHANGE_M:
            found.append(HeightLevel("range", log.rangefinder.source, ranged))
    for sensor, stream in _height_streams(log):
        level = _averaged_height(grid.t, stream)
        climb = np.gradient(level, STEP_S)
        level_ground = stands & (np.abs(np.nan_to_num(climb, nan=9.0)) < MAX_GROUND_CLIMB_M_S)
        ground = _long_runs(level_ground, round(MIN_STAND_S / STEP_S)) & np.isfinite(level)
        if ground.any():
            found.append(HeightLevel(sensor, stream.source, level - np.interp(grid.t, grid.t[ground], level[ground])))
            break
    return found


def highest_level(levels: list[HeightLevel], flying: Mask) -> tuple[HeightLevel, float] | None:
    """Return the preferred height source and its maximum in m while flying.

    ``flying`` (n,): mask. None without a reportable height. A rangefinder in range for 95 % of the time is preferred,
    unless the barometer shows that the vehicle left its range. Barometer height changes with wind; GNSS height lags.
    """
    tops = [(level, float(np.nanmax(level.above[flying], initial=-np.inf))) for level in levels]
    others = max((top for level, top in tops if level.sensor != "range"), default=-np.inf)

    def rank(candidate: tuple[HeightLevel, float]) -> int:
        level, top = candidate
        if level.sensor != "range":
            return 1
        seen = np.isfinite(level.above[flying]).mean() > MIN_RANGED_SHARE
        return 0 if seen and others <= OUT_OF_RANGE_RATIO * top + OUT_OF_RANGE_M else 2

    return next(((level, top) for level, top in sorted(tops, key=rank) if top > MIN_REPORTED_HEIGHT_M), None)


def join_across_falls(log: FlightLog, grid: Grid, found: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Join flights between which the height changes by more than 5 m.

    Zero throttle or specific force ends the signs of flight, but a falling vehicle is still in the air.
    """
    stream = height_stream(log)
    if stream is None or len(found) < 2:
        return found
    level = _averaged_height(grid.t, stream)
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


def height_stream(log: FlightLog) -> Stream | None:
    """Return height (n, 1) in m over time: the barometer, else GNSS altitude with a 3D fix, else None."""
    return next((stream for _, stream in _height_streams(log)), None)


def _height_streams(log: FlightLog) -> list[tuple[str, Stream]]:
    """Return streams of height in m (m, 1) without bad values: the barometer, then GNSS with a fix."""
    found = []
    for stream in log.baro:
        x = stream.x.reshape(len(stream.t), -1)[:, 0] if len(stream.t) else np.zeros(0)
        good = np.isfinite(x)
        if stream.unit == "m" and np.count_nonzero(good) > 10:
            found.append(("barometer", Stream(stream.t[good], x[good, None], "m", "", stream.source)))
            break
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & np.isfinite(gnss.alt) & np.isfinite(gnss.t)
        if np.count_nonzero(good) > 10:
            found.append(("GNSS", Stream(gnss.t[good], gnss.alt[good, None], "m", "", gnss.source)))
            break
    return found


def _averaged_height(t: Array, stream: Stream) -> Array:
    """Return height (n,) averaged over 1 s, without spikes; NaN where no sample is near."""
    raw = np.interp(t, stream.t, stream.x[:, 0])
    around = round(0.5 * SPIKE_S / STEP_S)
    middle = np.median(sliding_window_view(np.pad(raw, around, mode="edge"), 2 * around + 1), axis=1)
    raw = np.where(np.abs(raw - middle) > SPIKE_M, middle, raw)
    half = round(0.5 * HEIGHT_MEAN_S / STEP_S)
    mean = np.convolve(np.pad(raw, half, mode="edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")
    near: Array = np.where(seconds_to_nearest(t, stream.t) <= MAX_AGE_S, mean, np.nan)
    return near


def _long_runs(mask: Mask, count: int) -> Mask:
    """Return the samples of a mask in runs of at least ``count`` samples."""
    kept = np.zeros(len(mask), bool)
    for a, b in true_runs(mask):
        kept[a:b] = b - a >= count
    return kept


# --- flights -----------------------------------------------------------------------------------------------------

# Dynamics (:attr:`Grid.dynamics`) of a vehicle in the air, at rest, and landed.
AIRBORNE_DYNAMICS, REST_DYNAMICS, LANDED_DYNAMICS = 0.4, -0.6, -2.5
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
# Rotor thrust has no sideways part, so this sideways force (15 deg of tilt) without speed or height is a hand's.
MIN_HAND_FORCE_M_S2 = 2.5
# Ground speed that only flight reaches.
MIN_AIR_SPEED_M_S = 5.0
# Signs of flight are late after long ground contact: a flight is extended while the height, above this share of a
# likely one, rises or sinks, up to noise and for so long.
GROUND_HEIGHT_SHARE, HEIGHT_NOISE_M, MAX_EXTENSION_S = 0.3, 0.03, 3.0
# Change of the force at lift-off: minimum, and in standard deviations; ratio of the landing peak to the median.
MIN_LIFTOFF_STEP_M_S2, LIFTOFF_SIGMAS, LANDING_PEAK_RATIO = 0.25, 5.0, 4.0
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
    power, source = _drive_power(log, t)
    may = grid.known & spans.inside(t, known_spans)
    may &= spans.inside(t, armed) if armed is not None else True
    if power is None:
        driven = may.copy() if armed is not None else np.zeros(len(t), bool)  # arming alone is no lift
        power, source, usual, lifting = driven.astype(np.float64), "arming", 1.0, np.zeros(len(t), bool)
    else:
        moving = (np.nan_to_num(grid.dynamics, nan=-9.0) > AIRBORNE_DYNAMICS) & ~grid.contact
        usual = _usual_power(power, may & moving & (power > MIN_DRIVE))
        driven, lifting = may & (power > max(MIN_DRIVE, DRIVEN_SHARE * usual)), power > MAX_IDLE_POWER
    levels = height_levels(log, grid, driven)
    flying = _flying_mask(log.kind, grid, levels, driven, power / max(usual, MIN_DRIVE), lifting)
    found = join_across_falls(log, grid, _flight_ranges(log.kind, flying, grid, levels, driven, power))
    rolls = log.kind.fixed_wing  # a take-off run hides the force step of lift-off
    edges = [(float(t[a]) if rolls else _liftoff_time(grid, a, driven), _landing_time(grid, b)) for a, b in found]
    heights = ", ".join(f"height by {level.source}" for level in levels[:2])
    why = f"driven ({source}) and moving as only the air lets it" + (f", {heights}" if heights else "")
    drive_known = source != "arming" or armed is not None  # unknown in a ROS bag that holds sensors only
    known = drive_known and (bool(levels) or (source != "arming" and not grid.slow))
    return InAir(grid, spans.merge(s for s in edges if s[1] > s[0]), driven, power, levels, source, why, known)


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
    return float(np.median(power[carried]) if carried.any() else np.quantile(power, 0.95))


def _flying_mask(
    kind: VehicleKind, grid: Grid, levels: list[HeightLevel], driven: Mask, power: Array, lifting: Mask
) -> Mask:
    """Mark times in the air; ``power`` is relative to the usual power of flight."""
    none = np.zeros(len(grid.t), bool)
    hint, sure, clear = none, none, none
    for level in levels:
        hint, sure = hint | level.hint, sure | level.sure
        clear = clear | (np.nan_to_num(level.above) > MIN_CLEAR_M)
    fast = np.nan_to_num(grid.speed) > MIN_AIR_SPEED_M_S
    if kind.winged and not levels:
        hint = sure = clear = fast
    if grid.slow:
        return driven & (hint | sure)
    dynamics = np.nan_to_num(grid.dynamics, nan=-9.0)
    by_air = none
    if kind.winged:
        by_air = driven & sure & (fast | (dynamics > AIRBORNE_DYNAMICS)) | fast & hint & (dynamics > AIRBORNE_DYNAMICS)
        if kind is not VehicleKind.VTOL:
            return by_air
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
        if grid.slow or kind.fixed_wing:
            found.append((a, b))
            continue
        own = float(np.median(power[a:b]))
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
    if grid.slow:
        return _bridge_gaps(found, grid.known)
    reached = []
    for a, b in found:
        pushed = driven & (power > FLIGHT_SHARE * float(np.median(power[a:b])))
        reached.append(_extend_to_ground(a, b, levels, pushed))
    return _bridge_gaps(reached, grid.known)


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


def _is_flight(a: int, b: int, grid: Grid, levels: list[HeightLevel]) -> bool:
    """Return whether height, or movement with likely height or for long, confirms flight."""

    def seconds(masks: list[Mask]) -> float:
        return max((np.count_nonzero(mask[a:b]) for mask in masks), default=0) * STEP_S

    if seconds([level.sure for level in levels]) >= MIN_HEIGHT_S:
        return True
    hints = seconds([level.hint for level in levels])
    if grid.slow:
        return hints >= MIN_SLOW_HEIGHT_S
    hinted = hints >= MIN_HEIGHT_S
    dynamics = float(np.quantile(np.nan_to_num(grid.dynamics[a:b], nan=-9.0), 0.8))
    by_tilt = bool(np.isfinite(grid.down[a:b, 0]).any())  # without attitude, ground contact cannot be excluded
    moves = dynamics > MIN_DYNAMICS_ALONE and (b - a) * STEP_S >= MIN_DYNAMICS_S and by_tilt
    return (hinted and dynamics > MIN_DYNAMICS_WITH_HEIGHT) or (moves and not (levels and _is_handheld(a, b, grid)))


def _is_handheld(a: int, b: int, grid: Grid) -> bool:
    """Return whether a slow span has a large sideways force, as in a hand."""
    sideways = np.hypot(grid.force[a:b, 0], grid.force[a:b, 1])
    slow = not np.any(grid.speed[a:b] > MAX_HAND_M_S)
    return slow and float(np.quantile(sideways, 0.6)) > MIN_HAND_FORCE_M_S2


def _liftoff_time(grid: Grid, first: int, driven: Mask) -> float:
    """Return the time at which the force leaves its level on the ground."""
    a, b = max(first - round(0.5 / STEP_S), 0), min(first + round(2.5 / STEP_S), len(grid.t))
    a += int(np.argmax(driven[a : first + 1]))
    before = grid.size[max(a - round(2.0 / STEP_S), 0) : a]
    if grid.slow or len(before) < 5:
        return float(grid.t[first])
    level = float(np.median(before))
    spread = 1.4826 * float(np.median(np.abs(before - level)))
    off, limit = np.abs(grid.size[a:b] - level), max(MIN_LIFTOFF_STEP_M_S2, LIFTOFF_SIGMAS * spread)
    left = np.flatnonzero(off > limit)
    if not len(left):
        return float(grid.t[first])
    k = int(left[0])
    share = float((limit - off[k - 1]) / (off[k] - off[k - 1])) if k else 1.0
    # A mean over an even number of grid steps is centred between two steps.
    return float(grid.t[a + k]) - (1.5 - share) * STEP_S


def _landing_time(grid: Grid, end: int) -> float:
    """Return the start of the largest force peak around the end of flight."""
    a, b = max(end - round(2.0 / STEP_S), 0), min(end + round(1.0 / STEP_S) + 1, len(grid.t))
    if grid.slow or end >= len(grid.t):
        return float(grid.t[min(end, len(grid.t) - 1)])
    bump = np.abs(grid.size[a:b] - np.median(grid.size[a:b]))
    stands_out = bump.max() > max(2.0 * MIN_LIFTOFF_STEP_M_S2, LANDING_PEAK_RATIO * float(np.median(bump)))
    if not stands_out:
        return float(grid.t[end])
    k = int(np.argmax(bump))
    while k and bump[k - 1] > 0.5 * bump.max():  # averaging widens the peak, and landing gear touches repeatedly
        k -= 1
    return float(grid.t[a + k])
