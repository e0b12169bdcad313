"""Signs of flight in logs without a drive, and in telemetry too slow for any but heights.

A missing sign is unknown, not false: a throttle that is not logged is no throttle at rest, and one that was not heard
for some seconds is not off. Thresholds are from docs/story.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans
from attlog.core.sorting import median
from attlog.core.spans import Span
from attlog.flight.model import Stream
from attlog.segments.flight_signs import AIRBORNE_DYNAMICS, MAX_AGE_S, REST_DYNAMICS, STEP_S, Grid, Mask, true_runs
from attlog.segments.heights import HeightLevel, long_runs

Array = NDArray[np.float64]

# --- no drive -----------------------------------------------------------------------------------------------------

# Slope of the sideways force on gravity's below which rotors carry the vehicle.
MAX_ROTOR_SLOPE = 0.4
# Ground is sought until this time before the first sign of rotors.
BEFORE_ROTORS_S = 1.0
# Window before the first sign in which down is known, search after it, and change of down at lift-off.
DOWN_FROM_S, DOWN_TO_S, SOUGHT_BEFORE_S, SOUGHT_AFTER_S, LIFTOFF_TILT_DEG = 4.0, 1.0, 1.0, 4.0, 1.5


def rotor_sign(grid: Grid, may: Mask) -> Mask:
    """Mark times (n,) at which rotors carry: it moves, and the sideways force does not follow the tilt."""
    carried = np.nan_to_num(grid.slope, nan=9.0) < MAX_ROTOR_SLOPE
    moving = np.nan_to_num(grid.dynamics, nan=-9.0) > AIRBORNE_DYNAMICS
    return may & carried & moving & ~grid.contact & (grid.force[:, 2] < 0.0)


def ground_without_drive(grid: Grid, may: Mask, rotor: Mask) -> Mask:
    """Mark times (n,) that may be on the ground; ``may``: armed, ``rotor``: of :func:`rotor_sign`."""
    dynamics = np.nan_to_num(grid.dynamics, nan=9.0)
    quiet = dynamics < AIRBORNE_DYNAMICS
    before = np.arange(len(quiet)) < (np.argmax(rotor) - round(BEFORE_ROTORS_S / STEP_S) if rotor.any() else len(quiet))
    return before & quiet | (dynamics < REST_DYNAMICS) | grid.contact & quiet | ~may


def liftoff_by_tilt(grid: Grid, first: int) -> float:
    """Return the time at which down leaves its direction on the ground, else that of the first sign of flight."""
    a, b = first - round(DOWN_FROM_S / STEP_S), first - round(DOWN_TO_S / STEP_S)
    before = grid.down[max(a, 0) : max(b, 0)]
    before = before[rotation.finite_rows(before)]
    if not len(before):
        return float(grid.t[first])
    stood = median(before, axis=0)
    low, high = max(first - round(SOUGHT_BEFORE_S / STEP_S), 0), first + round(SOUGHT_AFTER_S / STEP_S)
    turned = rotation.length(grid.down[low:high] - stood) > np.radians(LIFTOFF_TILT_DEG)
    return float(grid.t[low + np.argmax(turned)]) if turned.any() else float(grid.t[first])


# --- motion -------------------------------------------------------------------------------------------------------

# Ground speed and height above slow times that only flight reaches, for this long.
MIN_FLIGHT_M_S, MIN_FLIGHT_M, MIN_FLIGHT_S = 8.0, 10.0, 5.0
# Ground speed of slow times. Flight lasts while it is faster or higher than this, over such breaks.
SLOW_M_S, LASTING_M, MAX_BREAK_S = 5.0, 3.0, 2.0
# Flights of wings this close are one where the ground speed stays above the minimum.
MAX_WINGED_BREAK_S, MIN_WINGED_M_S = 10.0, 2.0


def flights_by_motion(grid: Grid, height: Array, may: Mask, winged: bool) -> list[tuple[int, int]]:
    """Return index ranges of flights by ground speed and ``height`` (n,) m of any origin."""
    speed, slow = np.nan_to_num(grid.speed), np.isfinite(height) & (grid.speed < SLOW_M_S)
    if not np.isfinite(height).any():
        return []
    above = np.nan_to_num(height - (median(height[slow]) if slow.any() else np.nanmin(height)), nan=0.0)
    certain = may & (speed > MIN_FLIGHT_M_S) & (above > MIN_FLIGHT_M)
    lasting = may & ((speed > SLOW_M_S) | (above > LASTING_M))
    found = []
    for a, b in join_ranges(list(true_runs(lasting)), MAX_BREAK_S):
        if max((d - c for c, d in true_runs(certain[a:b])), default=0) * STEP_S >= MIN_FLIGHT_S:
            found.append((a, b))
    return list(_joined_wings(found, speed)) if winged else found


def _joined_wings(found: list[tuple[int, int]], speed: Array) -> Iterator[tuple[int, int]]:
    """Join flights between which a fixed wing never stops."""
    last: tuple[int, int] | None = None
    for a, b in found:
        near = last is not None and (a - last[1]) * STEP_S <= MAX_WINGED_BREAK_S
        if last is not None and near and bool(np.all(speed[last[1] : a] > MIN_WINGED_M_S)):
            last = last[0], b
            continue
        if last is not None:
            yield last
        last = a, b
    if last is not None:
        yield last


def join_ranges(found: list[tuple[int, int]], seconds: float) -> list[tuple[int, int]]:
    """Join index ranges across breaks of up to ``seconds``."""
    joined: list[tuple[int, int]] = []
    for a, b in sorted(found):
        if joined and (a - joined[-1][1]) * STEP_S <= seconds:
            joined[-1] = joined[-1][0], max(b, joined[-1][1])
        else:
            joined.append((a, b))
    return joined


# --- slow telemetry -----------------------------------------------------------------------------------------------

# A drive is heard while its last value is younger than this, or this many usual intervals.
HEARD_S, HEARD_INTERVALS = 1.5, 1.5
# Window around arming from which heights count, and height there of a vehicle first heard in the air.
COUNT_BEFORE_S, COUNT_AFTER_S, FIRST_HEARD_M = 2.0, 1.0, 3.0
# Median change of the tilt in 1 s above which a driven vehicle may be in the air. Measured: 0.03 to 0.21 deg on the
# ground (12 of 16 logs), 0.29 deg and more in all 45 real flights; a simulated hover in calm air has less.
MIN_TILT_STEP_DEG, TILT_STEP_S = 0.25, 1.0
# A vehicle stood after this time disarmed or with the drive heard off; limits of one with wings.
STOOD_S, MAX_STOOD_M_S, MAX_STOOD_M = 2.0, 3.0, 2.0
# Height of the ground, and below which a drive heard off is a landing.
GROUND_M, OFF_M = 0.5, 2.0


def heard_drive(t: Array, stream: Stream) -> tuple[Array, Mask]:
    """Return the last value (n,) of a drive at times ``t``, and whether it is heard there."""
    x = np.nan_to_num(stream.x.reshape(len(stream.t), -1)).mean(axis=1)
    usual = float(median(np.diff(stream.t))) if len(stream.t) > 1 else MAX_AGE_S
    i = np.searchsorted(stream.t, t, side="right") - 1
    age = np.where(i >= 0, t - stream.t[np.maximum(i, 0)], np.inf)
    return np.where(i >= 0, np.abs(x[np.maximum(i, 0)]), 0.0), age <= max(HEARD_S, HEARD_INTERVALS * usual)


def armed_by_drive(t: Array, armed: list[Span], pushed: Mask) -> list[Span]:
    """Begin armed spans where the unbroken drive before them began: heartbeats get lost."""
    found = []
    for a, b in armed:
        k = int(np.searchsorted(t, a))
        k = min(k, len(t) - 1)
        while k > 0 and pushed[k] and pushed[k - 1]:
            k -= 1
        found.append((min(a, float(t[k])), b))
    return spans.merge(found)


def count_from_arming(t: Array, level: HeightLevel, armed: list[Span]) -> HeightLevel:
    """Return a height that is zero at each arming, unless the vehicle was first heard in the air."""
    above = level.above.copy()
    for (a, _), end in zip(armed, [*(a for a, _ in armed[1:]), np.inf], strict=False):
        around = level.above[(t >= a - COUNT_BEFORE_S) & (t <= a + COUNT_AFTER_S)]
        around = around[np.isfinite(around)]
        if len(around) and median(around) < FIRST_HEARD_M:
            above[(t >= a - COUNT_BEFORE_S) & (t < end)] -= median(around)
    return replace(level, above=above)


def tilts_as_in_air(grid: Grid, within: Mask) -> bool | None:
    """Return whether down moves within a mask (n,) as it does in the air, None without an attitude."""
    count = round(TILT_STEP_S / STEP_S)
    steps = np.degrees(rotation.length(grid.down[count:] - grid.down[:-count]))
    known = steps[within[count:] & within[:-count] & np.isfinite(steps)]
    return bool(median(known) > MIN_TILT_STEP_DEG) if len(known) else None


def stood_times(grid: Grid, disarmed: Mask, off: Mask, above: Array, winged: bool) -> Mask:
    """Mark times (n,) of at least 2 s disarmed or with the drive heard off."""
    still = disarmed | off
    if winged:
        still &= ~(grid.speed > MAX_STOOD_M_S) & ~(above > MAX_STOOD_M)
    return long_runs(still, round(STOOD_S / STEP_S))


def grow_flights(found: list[tuple[int, int]], stood: Mask, off: Mask, above: Array) -> list[tuple[int, int]]:
    """Grow flights to the ground on both sides, and join those without a stand between them."""
    ground = stood | (above < GROUND_M) | off & (above < OFF_M)
    grown: list[tuple[int, int]] = []
    for a, b in found:
        first, last = a, b
        while first > 0 and not ground[first - 1]:
            first -= 1
        while last < len(ground) and not ground[last]:
            last += 1
        if grown and not stood[grown[-1][1] : first].any():
            grown[-1] = grown[-1][0], max(last, grown[-1][1])
        else:
            grown.append((first, last))
    return grown
