"""Overturns and tumbles: control lost without a blow, or before one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from attlog.base import rotation
from attlog.segments import spans
from attlog.segments.airborne.grid import STEP_S, G, runs
from attlog.segments.crash.blows import AFTER_S, BEFORE_S, BLOW_G, FELL_S, LATER_S, LIES_DRIVEN_DEG, blows
from attlog.segments.crash.scene import (
    AGREES_DEG,
    LYING_M_S2,
    SETTLED_S,
    SETTLES_S,
    Ending,
    Scene,
    fastest_dps,
    lies,
    stands,
)

OVER_DEG, OVER_S, INVERTED_DEG, INVERTED_S = 90.0, 0.2, 120.0, 0.05
UPRIGHT_DEG, UPRIGHT_S = 60.0, 5.0
TURNED_DPS, TURNED_S = 100.0, 3.0
TUMBLE_DPS, TUMBLE_S = 400.0, 0.3
TIPPED_DEG, STOOD_DEG, LIES_S = 30.0, 15.0, 3.0
REPORTED_S = 10.0


def overturns(scene: Scene) -> list[Ending]:
    """Tilts beyond 90 deg that came from being upright, that the IMU confirms, and that are no aerobatics."""
    t, deg = scene.tilt.t, scene.tilt.deg
    if not len(t):
        return []
    allowed = spans.merge([*scene.armed, *scene.air.spans])
    limit = OVER_DEG
    found: list[Ending] = []
    for a, b in runs((deg > limit) & spans.inside(t, allowed)):
        until = float(min(t[min(b, len(t) - 1)], t[b - 1] + 0.5))
        largest = float(np.max(deg[a:b]))
        inverted = [(i, j) for i, j in runs(deg[a:b] > INVERTED_DEG)]
        long = until - t[a] >= OVER_S
        long |= any(t[min(a + j, len(t) - 1)] - t[a + i] >= INVERTED_S for i, j in inverted)
        upright = deg[spans.between(t, t[a] - UPRIGHT_S, float(t[a]))]
        if not long or not len(upright) or np.min(upright) > UPRIGHT_DEG or not _felt(scene, float(t[a]), until):
            continue
        if found and t[a] - found[-1].t_end < UPRIGHT_S:
            most = max(found[-1].size, largest)
            found[-1] = replace(found[-1], t_end=until, size=most, why=_over(most))
            continue
        lying = lies(scene, until)
        beyond = lying is not None and lying > LIES_DRIVEN_DEG
        if scene.flies_at(float(t[a]) + LATER_S) and not beyond and not _hit(scene, float(t[a]), until):
            continue
        if not _ends_badly(scene, float(t[a]), until, lying):
            continue
        source = (_attitude(scene),)
        found.append(Ending("overturn", float(t[a]), until, largest, "deg", _over(largest), lying, sources=source))
    return found


def _over(deg: float) -> str:
    return f"it turned over to {deg:.0f} deg"


def _spun(dps: float) -> str:
    return f"it tumbled at up to {dps:.0f} deg/s that nobody asked for"


def _attitude(scene: Scene) -> str:
    attitude = scene.log.onboard_attitude or scene.log.truth
    return attitude.source if attitude is not None else ""


def _ends_badly(scene: Scene, t: float, until: float, lying: float | None) -> bool:
    """Whether what turned over was in flight or at lift-off: driven or in the air as it turned."""
    grid = scene.air.grid
    part = spans.between(grid.t, t - 3.0, t + 0.5)
    driven = bool(scene.air.driven[part].any()) if part.stop > part.start else False
    return driven or any(a - BEFORE_S <= t <= b + AFTER_S for a, b in scene.air.spans)


def _hit(scene: Scene, t0: float, t1: float) -> bool:
    """Whether there is a blow from 3 s before to 3 s after."""
    within = [(t0 - FELL_S, t1 + FELL_S)]
    return any(blows(imu, within, BLOW_G) for imu in scene.log.imus)


def _felt(scene: Scene, t0: float, t1: float) -> bool:
    """Whether the IMU itself shows a turn: a fast rate before, or gravity from the side or above afterwards.

    Without an IMU in the log the autopilot's own report of a crash stands in.
    """
    if not scene.log.imus:
        reports = [p.t for p in scene.log.problems if p.code == "crash" and p.t is not None]
        return any(t0 - TURNED_S <= t <= t1 + REPORTED_S for t in reports)
    if fastest_dps(scene, t0 - TURNED_S, t0 + 0.5) > TURNED_DPS:
        return True
    lying = lies(scene, t0)
    return lying is not None and lying > UPRIGHT_DEG


def tumbles(scene: Scene) -> list[Ending]:
    """Rates above 400 deg/s in the air that nobody asked for."""
    imu = scene.log.replay_imu or next(iter(scene.log.imus), None)
    wanted = scene.log.rate_setpoints
    if imu is None or wanted is None or len(wanted.t) < 2 or scene.log.kind.winged:
        return []
    t, rate = imu.gyro.t_best, np.degrees(rotation.length(imu.gyro.x))
    asked = np.degrees(rotation.length(np.nan_to_num(wanted.x, posinf=0.0, neginf=0.0)))
    found: list[Ending] = []
    for a, b in runs((rate > TUMBLE_DPS) & spans.inside(t, spans.merge((x, y + BEFORE_S) for x, y in scene.air.spans))):
        least = TUMBLE_S if scene.end - t[b - 1] > 0.5 else 0.1
        if t[b - 1] - t[a] < least or scene.flies_at(float(t[a]) + LATER_S):
            continue
        around = asked[spans.between(wanted.t, t[a] - 0.1, t[b - 1] + 0.1)]
        fastest = float(rate[a:b].max())
        if len(around) and float(np.max(around)) > 0.5 * float(np.median(rate[a:b])):
            continue
        if found and t[a] - found[-1].t_end < UPRIGHT_S:
            most = max(found[-1].size, fastest)
            found[-1] = replace(found[-1], t_end=float(t[b - 1]), size=most, why=_spun(most))
            continue
        source = (imu.gyro.source,)
        found.append(Ending("tumble", float(t[a]), float(t[b - 1]), fastest, "deg/s", _spun(fastest), sources=source))
    return found


def tipped(scene: Scene, crashes: list[Ending]) -> list[Ending]:
    """Flights that end without a blow, and after which the vehicle lies beyond 30 deg."""
    found = []
    for _, b in scene.air.spans:
        if any(abs(e.t - b) < UPRIGHT_S for e in crashes):
            continue
        lying = lies(scene, b)
        if lying is not None and lying > TIPPED_DEG and not scene.driven_at(b + SETTLES_S, b + SETTLED_S):
            why = f"it ended tipped over, at {lying:.0f} deg"
            found.append(Ending("overturn", b, b, lying, "deg", why, lying, sources=("accelerometer",)))
    return found


def falls(scene: Scene) -> list[Ending]:
    """Falls from standing with motors driven: tilt and accelerometer pass 30 deg together and stay there for 3 s.

    In flight the force of rotors does not lean with the tilt; wings are another matter.
    """
    grid = scene.air.grid
    if grid.slow or scene.log.kind.winged or not np.isfinite(grid.down[:, 0]).any():
        return []
    down, force = stands(scene), rotation.length(grid.force)
    tilt = np.degrees(np.arccos(np.clip(np.nan_to_num(grid.down @ down, nan=1.0), -1.0, 1.0)))
    leans = np.degrees(np.arccos(np.clip(-grid.force @ down / np.maximum(force, 1e-9), -1.0, 1.0)))
    lying = (tilt > TIPPED_DEG) & (leans > TIPPED_DEG) & (np.abs(tilt - leans) < AGREES_DEG) & grid.known
    lying &= np.abs(force - G) < LYING_M_S2
    before, found = round(UPRIGHT_S / STEP_S), []
    for a, b in runs(lying):
        stood = np.maximum(tilt, leans)[max(a - before, 0) : a]
        if (b - a) * STEP_S < LIES_S or not len(stood) or stood.min() > STOOD_DEG or not scene.air.driven[a]:
            continue
        lean = float(np.median(tilt[a:b]))
        t, t_end = float(grid.t[a]), float(grid.t[b - 1])
        passed = scene.tilt.t[spans.between(scene.tilt.t, t - 1.0, t + 0.5)]
        above = scene.tilt.deg[spans.between(scene.tilt.t, t - 1.0, t + 0.5)] > TIPPED_DEG
        t = float(passed[np.argmax(above)]) if above.any() else t
        why = f"it fell over and lay at {lean:.0f} deg"
        found.append(Ending("overturn", t, t_end, lean, "deg", why, lean, sources=(_attitude(scene), "accelerometer")))
    return found
